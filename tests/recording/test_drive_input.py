from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.recording.synthetic import PLAN, SHEET, path_of

from ballscrew.base.errors import BallscrewError, InputError, MeasurementError
from ballscrew.recording.aligned import align
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.drive_input import DriveInput, electrical_turns, force_scale, q_current
from ballscrew.recording.load import read_recording

RATE = 2000.0
TURNS = 400.0  # per metre: four pole pairs and a lead of 10 mm
POSITION, SPEED, ACCELERATION = path_of(PLAN, RATE)
# Inertia, friction and a ringing behind each change of the acceleration.
TORQUE = 1.5 * ACCELERATION + 0.8 * np.tanh(SPEED / 1e-3) + 0.5 * ACCELERATION * np.sin(900 * POSITION)


def phases(*, zero=0.7, sign=1.0, late=0.0, i_d=0.0, gains=(1, 1, 1), offsets=(0, 0, 0), noise=0.01):
    """Currents of three phases that make TORQUE, as sensors with these errors record them."""
    random = np.random.default_rng(0)
    angle = sign * 2 * np.pi * TURNS * (POSITION - SPEED * late) + zero
    vector = (TORQUE + 1j * i_d * np.abs(SPEED)) * np.exp(1j * angle)
    currents = {}
    for index, phase in enumerate("uvw"):
        current = (vector * np.exp(-2j * np.pi / 3 * index)).real
        current = gains[index] * current + offsets[index]
        currents[phase] = current + noise * random.standard_normal(len(current))
    return currents


def error(got):
    """Rms error over the rms torque, beside a common gain."""
    gain = got @ TORQUE / (TORQUE @ TORQUE)
    assert gain == pytest.approx(1.0, abs=0.03)
    return np.std(got / gain - TORQUE) / np.std(TORQUE)


@pytest.mark.parametrize("turns", [TURNS, None])
@pytest.mark.parametrize("which", ["uvw", "uw"])
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"sign": -1.0, "zero": -2.5},
        {"late": 1e-3},
        {"i_d": 4.0},
        {"gains": (1.05, 0.96, 1.0), "offsets": (0.1, -0.05, 0.0)},
    ],
    ids=lambda change: ",".join(change) or "ideal",
)
def test_the_torque_comes_back_from_the_phases(turns, which, change):
    currents = phases(**change)
    got = q_current({phase: currents[phase] for phase in which}, POSITION, RATE, turns, "trip1.h5")
    assert error(got) < 0.01


def test_a_scale_error_of_the_position_is_no_other_number_of_pole_pairs():
    assert error(q_current(phases(), 1.009 * POSITION, RATE, TURNS, "trip1.h5")) < 0.01


def test_errors_of_the_sensors_would_show():
    currents = phases(gains=(1.05, 0.96, 1.0), offsets=(0.1, -0.05, 0.0))
    angle = 2 * np.pi * TURNS * POSITION + 0.7
    vector = sum(np.exp(2j * np.pi / 3 * k) * currents[p] for k, p in enumerate("uvw")) * 2 / 3
    assert error((vector * np.exp(-1j * angle)).real) > 0.025


@pytest.mark.parametrize(
    ("currents", "turns", "message"),
    [
        ({"u": phases()["u"]}, TURNS, "the current of one phase alone"),
        (phases(), 1.25 * TURNS, r"with 0\.8 times the drive\.pole_pairs"),
        (phases(gains=(-1, 1, 1)), TURNS, "one is inverted"),
        (dict.fromkeys("uv", 0 * TORQUE), None, "do not follow the position: they"),
        ({"u": TORQUE, "v": ACCELERATION}, None, "do not follow the position: they|differ in amplitude"),
        (dict.fromkeys("uvw", TORQUE), TURNS, "differ in amplitude|do not follow"),
        ({p: np.roll(x, 1500) for p, x in phases().items()}, None, "do not follow the position: they"),
    ],
)
def test_currents_of_another_kind_are_refused(currents, turns, message):
    with pytest.raises(BallscrewError, match=f"trip1.h5: .*({message})") as raised:
        q_current(currents, POSITION, RATE, turns, "trip1.h5")
    configured = "one phase" in message or "pole_pairs" in message
    assert isinstance(raised.value, InputError if configured else MeasurementError)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_samples_that_are_no_numbers_are_left_to_the_quality_gate(value):
    currents = phases()
    currents["v"][100] = value
    assert np.isnan(q_current(currents, POSITION, RATE, TURNS, "trip1.h5")).all()


@pytest.mark.parametrize(
    ("quantity", "sheet", "scale"),
    [
        ("force", None, 1.0),
        ("force", SHEET, 1.0),
        ("torque", None, None),
        ("torque", SHEET, 2 * np.pi / 0.01),
        ("current", None, None),
        ("current", SHEET, None),
        ("current", replace(SHEET, drive=replace(SHEET.drive, torque_constant=0.5)), np.pi / 0.01),
        ("relative torque", SHEET, None),
        ("relative torque", replace(SHEET, drive=replace(SHEET.drive, rated_torque=2.0)), 4 * np.pi / 0.01),
    ],
)
def test_what_takes_the_input_to_a_force(quantity, sheet, scale):
    assert force_scale(quantity, sheet) == pytest.approx(scale)


def test_electrical_turns_are_those_of_the_motor():
    assert electrical_turns(None) is None
    assert electrical_turns(SHEET) is None
    belt = replace(SHEET, drive=replace(SHEET.drive, pole_pairs=4, ratio=2.0))
    assert electrical_turns(belt) == pytest.approx(800.0)


def test_currents_of_the_bench_make_its_torque(bench):
    known = read_channels(bench / "channels.toml").to_settings()
    rows = [{"source": f"current_{phase}", "quantity": "current", "unit": "A"} for phase in "uvw"]
    channels = ChannelMap.from_settings(known | {"channel": known["channel"] + rows})
    recording = read_recording(bench / "preload-4-percent-trip1.h5", channels)
    assert align(recording).drive == DriveInput("torque", ("torque",))
    torque = recording.array("torque")
    without = {name: values for name, values in recording.channels.items() if name != "torque"}
    for which, pole_pairs, commutation in (("uvw", 4, "data sheet"), ("vw", None, "currents")):
        left = {name: values for name, values in without.items() if values.attrs["phase"] in which}
        sheet = replace(SHEET, drive=replace(SHEET.drive, pole_pairs=pole_pairs))
        got = align(replace(recording, channels=left), sheet)
        sources = tuple(f"current_{phase}" for phase in which)
        assert got.drive == DriveInput("current", sources, commutation)
        # The noise of torque and currents; 1.5 % of the torque.
        assert np.std(0.45 * got.input - torque) < 0.007


@pytest.mark.parametrize("turns", [TURNS, None])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_of_a_position_that_is_missing_somewhere_no_current_is_known(turns, value):
    """The quality gate reports it."""
    position = POSITION.copy()
    position[len(position) // 2] = value
    assert np.isnan(q_current(phases(), position, RATE, turns, "trip1.h5")).all()


def test_a_position_that_no_axis_has_determines_no_angle():
    position = POSITION.copy()
    position[100:102] = -1.7e308, 1.7e308  # whose difference is no number
    with np.errstate(all="ignore"), pytest.raises(MeasurementError, match="trip1"):
        q_current(phases(), position, RATE, None, "trip1.h5")
