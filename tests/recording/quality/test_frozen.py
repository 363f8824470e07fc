from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.recording.quality.conftest import codes
from tests.recording.synthetic import changed, recorded, synthetic_trip

from ballscrew.recording.quality.signal_faults import frozen_position, frozen_signal
from ballscrew.recording.quality.signals import check_signals


def held(start, stop):
    def change(_, x):
        x[int(start * len(x)) : int(stop * len(x))] = x[int(start * len(x))]
        return x

    return change


@pytest.mark.parametrize(("start", "stop"), [(0.7, 1.0), (0.2, 0.9), (0.3, 0.6), (0.0, 0.5)])
@pytest.mark.parametrize("source", ["torque", "position", "acc1_x"])
def test_a_channel_that_stands_while_the_axis_moves_is_flat_from_and_to(run, start, stop, source):
    item = run.one
    findings = check_signals(changed(item, held(start, stop), source))
    # A position that goes on elsewhere jumps there.
    assert codes(findings) in ({"flat": "bad"}, {"flat": "bad", "wrapped": "bad"})
    (message,) = (finding.message for finding in findings if finding.code == "flat")
    length = len(item.array("torque")) / item.rate("torque")
    reported = message.split(" flat from ")[1].split(" s, ")[0].split(" to ")
    assert [float(x) for x in reported] == pytest.approx([start * length, stop * length], abs=0.2)


def test_a_position_is_checked_by_the_torque_where_there_is_no_accelerometer(run):
    item = changed(run.one, held(0.7, 1.0), "position")
    stored = {name: x for name, x in item.channels.items() if not name.startswith("acceleration")}
    assert codes(check_signals(replace(item, channels=stored))) == {"flat": "bad"}


@pytest.mark.parametrize("encoder", [1e-6, 1e-5, 1e-4])
def test_a_coarse_encoder_at_its_stops_passes(encoder):
    signals = synthetic_trip(encoder=encoder)
    assert frozen_position(signals["position"], signals["acc1_x"], 12800.0, drive=False) is None
    assert frozen_position(signals["position"], signals["torque"], 12800.0, drive=True) is None


@pytest.mark.parametrize("pause", [0.5, 5.0])
def test_a_long_pause_in_one_place_passes(pause):
    signals = {
        name: np.concatenate([x[:5000], np.full(int(pause * 12800), x[4999]), x[5000:]])
        for name, x in synthetic_trip(lead_in=0.5).items()
    }
    assert frozen_position(signals["position"], signals["acc1_x"], 12800.0, drive=False) is None


@pytest.mark.parametrize("levels", [15, 60])
def test_a_coarse_torque_at_an_even_speed_passes(levels):
    signals = synthetic_trip(noise=0.0)
    step = np.ptp(signals["torque"]) / levels
    assert (
        frozen_signal(np.round(signals["torque"] / step) * step, signals["position"], 12800.0, None) is None
    )


def test_a_clipped_torque_is_clipped_and_not_flat(run):
    limit = 0.4 * np.abs(run.one.array("torque")).max()
    findings = check_signals(changed(run.one, lambda _, x: np.clip(x, -limit, limit), "torque"))
    assert codes(findings) == {"clipped": "bad"}


@pytest.mark.parametrize("size", [64, 200, 700, 2000])
def test_short_records_raise_nothing(size):
    x = np.zeros(size)
    assert frozen_position(x, x, 12800.0, drive=False) is None
    assert frozen_signal(x, x, 12800.0, None) is None
    check_signals(recorded({name: values[:size] for name, values in synthetic_trip().items()}))


@pytest.mark.parametrize("back", [0.02, 0.05])
def test_a_position_that_stops_at_once_at_the_end_is_flat(back):
    """The last move is cut in its cruise: nothing but ringing is left to see of it in the accelerometer."""
    signals = synthetic_trip()
    fast = np.flatnonzero(np.abs(np.diff(signals["position"])) * 12800 > 0.149)[-1]
    at = fast - int(back * 12800)
    signals["position"][at:] = signals["position"][at]
    signals = {name: x[: at + 1600] for name, x in signals.items()}
    assert frozen_position(signals["position"], signals["acc1_x"], 12800.0, drive=False) is not None


def test_a_position_that_stops_at_once_for_few_samples_is_not_flat():
    signals = synthetic_trip()
    fast = np.flatnonzero(np.abs(np.diff(signals["position"])) * 12800 > 0.149)[-1]
    signals["position"][fast - 400 : fast] = signals["position"][fast - 400]
    found = frozen_position(signals["position"], signals["acc1_x"], 12800.0, drive=False)
    assert found is None
