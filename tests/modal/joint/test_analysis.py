"""Cells in a null of the torque; the clock of a run."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.trace import SAMPLES_PER_PERIOD
from ballscrew.modal.cell import CellResult, SharedError
from ballscrew.modal.joint.analysis import (
    _clock_uncertainty,
    _with_lost_end,
    analyse_jointly,
    signal_reducer,
    suspect_delayed,
    suspect_rotating,
    suspect_unexcited,
)
from ballscrew.modal.joint.identify import rate_refusal
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.reason import Reason
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.quality.clock import Clock
from ballscrew.recording.quality.finding import Quality
from ballscrew.testbed.example import AXIS

CELL = CellResult(0.0, "PA", 0, 3, 170.0, 0.3, 0.02, "joint", "good", ())


def plan(jerk_time: float, spread: float = 0.0) -> Plan:
    motion = Motion(0.15, 2.0, 2.0 / jerk_time, 0.3, jerk_spread=spread)
    return Plan((0.0, 0.1), 3, (50.0,), (motion,), source="plan.toml")


def test_no_frequency_on_a_screw_fixed_at_both_ends_asks_for_its_pretension() -> None:
    refused = replace(CELL, frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused")
    assert "lost its pretension" in _with_lost_end([refused])[0].reasons[-1]
    assert _with_lost_end([refused, CELL]) == [refused, CELL]
    slow = refused.with_reasons(Reason("low-rate", "record at 3000 Hz or more"))
    assert _with_lost_end([slow]) == [slow]


def test_without_a_data_sheet_the_rate_suffices_for_every_mode_that_may_be_found() -> None:
    """The recordings were reduced for the middle of the range: modes from 256 Hz on were refused."""
    settings, samples = JointSettings(), np.zeros(51_200)
    aligned = Aligned(51_200.0, samples, "torque", samples, np.zeros((1, len(samples))), ("acc1",))
    trip = signal_reducer(None, 0.0, settings)(aligned)
    assert rate_refusal(trip.rate, settings.highest, settings) is None
    assert trip.rate < 2 * SAMPLES_PER_PERIOD * settings.highest


def test_a_jerk_of_one_period_makes_a_cell_suspect() -> None:
    (cell,) = suspect_unexcited([CELL], plan(1 / 172.0))
    assert cell.verdict == "suspect"
    assert "null" in cell.reasons[-1]
    assert "5.8 ms" in cell.reasons[-1]
    assert cell.frequency_Hz == CELL.frequency_Hz  # doubted, not taken away


def test_a_soft_jerk_away_from_a_null_has_a_reason_of_its_own() -> None:
    (cell,) = suspect_unexcited([CELL], plan(2.5 / 170.0))
    assert cell.verdict == "suspect"
    assert "2.5 of the mode's periods: too soft" in cell.reasons[-1]
    assert "null" not in cell.reasons[-1]


def test_a_short_or_varied_jerk_is_not() -> None:
    assert suspect_unexcited([CELL], plan(0.4 / 170.0)) == (CELL,)
    assert suspect_unexcited([CELL], plan(1 / 172.0, spread=0.8)) == (CELL,)


def test_a_varied_jerk_has_no_common_null() -> None:
    (cell,) = suspect_unexcited([CELL], plan(4 / 170.0, spread=0.05))
    assert cell.verdict == "suspect"
    assert "too soft" in cell.reasons[-1]
    assert "null" not in cell.reasons[-1]


def test_reasons_are_added_and_refused_cells_unchanged() -> None:
    refused = replace(CELL, frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused")
    assert suspect_unexcited([refused], plan(1 / 172.0)) == (refused,)
    (cell,) = suspect_unexcited([replace(CELL, reasons=("wide",))], plan(1 / 172.0))
    assert cell.reasons[0] == "wide"
    assert len(cell.reasons) == 2


def test_without_a_plan_cells_are_unchanged() -> None:
    assert suspect_unexcited([CELL], None) == (CELL,)


def test_the_clocks_uncertainty_is_at_least_its_deviation_from_the_plan() -> None:
    settings = JointSettings()
    for error, expected in ((1e-3, 1e-3), (-1e-3, 1e-3), (1e-4, settings.clock)):
        measurement = SimpleNamespace(clock=Clock(error, 5e-5))
        assert _clock_uncertainty(measurement, settings) == expected
    assert _clock_uncertainty(SimpleNamespace(clock=None), settings) == settings.clock


def test_cells_whose_mode_is_a_rotation_of_the_table_are_suspect(monkeypatch: pytest.MonkeyPatch) -> None:
    rotations = [("pitch", 2.34), None, None]
    monkeypatch.setattr("ballscrew.modal.joint.analysis.rotating_modes", lambda *_: rotations)
    refused = replace(CELL, frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused")
    pitching, *others = suspect_rotating([replace(CELL, reasons=("wide",)), CELL, refused], ())
    assert pitching.verdict == "suspect"
    assert pitching.reasons[0] == "wide"
    assert "by pitch the ends of the table move 2.3 times as much across the screw" in pitching.reasons[1]
    assert pitching.frequency_Hz == CELL.frequency_Hz
    assert others == [CELL, refused]


def test_a_delayed_motion_of_the_motor_makes_all_good_cells_suspect_with_a_reason() -> None:
    refused = replace(CELL, frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused")
    cells = suspect_delayed([CELL, refused])
    assert [cell.verdict for cell in cells] == ["suspect", "refused"]
    for cell in cells:
        assert cell.reason_kinds == ("measurement",)
        assert "the motor's motion is delayed against the torque" in cell.reasons[0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"band_low": 1.0}, "the band reaches from 1 to 2.6 times the mode's frequency; it must contain"),
        ({"band_high": 0.9}, "it must contain the mode"),
        ({"band_high": float("inf")}, "it must contain the mode"),
        ({"lowest": 500.0, "highest": 400.0}, "the search range is 500 to 400 Hz"),
        ({"lowest": 0.0}, "the first must be above 0 and below the second"),
        ({"rate": 5.9}, "the rate is 5.9 times the mode's frequency; it must be 6 or more"),
        ({"rate": float("nan")}, "the rate is nan times"),
        ({"clock": 0.0}, "clock is 0; it must be more than 0"),
        ({"most_load": -1.0}, "most_load is -1; it must be more than 0"),
        ({"model_floor": float("nan")}, "model_floor is nan"),
    ],
)
def test_settings_that_cannot_be_are_refused(change: dict[str, float], sentence: str) -> None:
    with pytest.raises(InputError) as error:
        JointSettings(**change)
    assert sentence in str(error.value)
    assert JointSettings(rate=6.0).rate == 6.0


@pytest.mark.parametrize("support", ["fixed-free", "fixed-fixed"])
def test_results_are_in_the_order_of_the_listed_cells_without_a_table_of_responses_too(
    support: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "ballscrew.modal.joint.analysis"
    listed = [replace(CELL, condition=name, frequency_Hz=None, method="paper") for name in ("PA", "ND", "NA")]
    reason = Reason("no-mode", "no mode was found")
    refused = [CellResult.refused(cell.key, 3, "joint", [reason]) for cell in reversed(listed[:2])]
    error = SharedError("noise", repeats=False, effects_Hz=(0.2, 0.1))
    monkeypatch.setattr(f"{module}.complete_transients", lambda _: ())
    monkeypatch.setattr(
        f"{module}.identify_jointly", lambda *_: JointResult(tuple(refused), shared_errors=(error,))
    )
    measurement = SimpleNamespace(
        quality=Quality("good"), transients=object(), extracts={}, files=(), clock=None
    )
    sheet = replace(AXIS, support=support)
    found = analyse_jointly(measurement, listed, None, sheet, 50.0, JointSettings(), "both")
    assert [cell.condition for cell in found.cells] == ["PA", "ND", "NA"]
    assert [cell.reasons[:1] for cell in found.cells[:2]] == [(reason.text,)] * 2
    assert found.shared_errors[0].effects_Hz == (0.1, 0.2, 0.0)
    lost = ["lost its pretension" in cell.reasons[-1] for cell in found.cells[:2]]
    assert lost == [support == "fixed-fixed"] * 2
    assert all(cell.coherence is None for cell in found.cells)
