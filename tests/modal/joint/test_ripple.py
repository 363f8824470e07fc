"""The motor's ripple: its orders are found and fitted with the mode, and none where there is no ripple."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import sosfilt
from tests.modal.joint.conftest import SmallRun, inertia_of, small_run, two_stops

from ballscrew.axis.sheet import DataSheet
from ballscrew.fcft.plan import Motion
from ballscrew.modal.joint import ripple
from ballscrew.modal.joint.blocks import ROTOR_HELD, make_block
from ballscrew.modal.joint.fit import JointFit, fit_blocks
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.parameters import Modes
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.ripple import RippleModel, select_orders, turn_harmonics
from ballscrew.modal.joint.settings import JointSettings, Response
from ballscrew.modal.joint.windows import Windows, average_windows
from ballscrew.testbed.example import AXIS, LOAD
from ballscrew.testbed.trip import Disturbances, Rig

LEAD = AXIS.screw.lead


@pytest.fixture(scope="module")
def cogging(rig: Rig) -> SmallRun:
    """An axis whose motor has a strong twelfth order and no other."""
    strong = Disturbances(ripple_orders=(12.0,), ripple=0.012, ball_pass=0.0)
    return small_run(replace(rig, disturbances=strong))


@pytest.fixture(scope="module")
def cogging_result(cogging: SmallRun, sheet: DataSheet) -> JointResult:
    return identify_jointly(cogging.trips, cogging.transients, sheet, LOAD)


@pytest.fixture(scope="module")
def cogging_fit(cogging: SmallRun) -> tuple[JointFit, float]:
    return first_fit(cogging)


@pytest.fixture(scope="module")
def smooth(rig: Rig) -> SmallRun:
    return small_run(replace(rig, disturbances=Disturbances(ripple=0.0, ball_pass=0.0)))


@pytest.fixture(scope="module")
def smooth_result(smooth: SmallRun, sheet: DataSheet) -> JointResult:
    return identify_jointly(smooth.trips, smooth.transients, sheet, LOAD)


@pytest.fixture(scope="module")
def run_with_order(rig: Rig) -> Callable[[float], SmallRun]:
    """Run of an axis whose ripple has one order, simulated once for each order."""

    @cache
    def simulated(order: float) -> SmallRun:
        pushed = Disturbances(ripple=0.006, ripple_orders=(order,), ball_pass=0.0)
        return small_run(replace(rig, disturbances=pushed))

    return simulated


def first_fit(run: SmallRun) -> tuple[JointFit, float]:
    mass = inertia_of(run.trips)
    middle = np.mean([run.free[x] for x in (0.1, 0.2)])
    w = average_windows(run.trips, run.transients, mass, 0.5 * middle, 2.6 * middle)
    assert w is not None
    shape = AxialMode(
        1 / (2 * np.pi * middle) ** 2, slope_of(run.free), 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03
    )
    blocks = [make_block("torque-nut", w)]
    return fit_blocks(blocks, [shape], ("compliance", "damping", "slope"), most_steps=8), mass


def errors(result: JointResult, run: SmallRun) -> list[float]:
    """Errors of the cells with a frequency, Hz."""
    return [abs(c.frequency_Hz - run.free[c.position_m]) for c in result.cells if c.frequency_Hz is not None]


def slope_of(truth: dict[float, float]) -> float:
    """Slope of the compliance along the axis, over that in the middle."""
    rise, level = np.polyfit(np.array(list(truth)) - 0.15, np.array(list(truth.values())) ** -2.0, 1)
    return float(rise / level)


def found(run: SmallRun, now: JointFit) -> tuple[int, ...]:
    w = now.blocks[0].windows
    return select_orders("torque-nut", w, now.modes[0], turn_harmonics(run.trips, w, LEAD), LEAD)


def test_the_order_is_found_and_explains_most_of_the_residual(
    cogging: SmallRun, cogging_fit: tuple[JointFit, float]
) -> None:
    now, _ = cogging_fit
    assert found(cogging, now) == (12,)
    w = now.blocks[0].windows
    twelfth = ripple.select_harmonics(turn_harmonics(cogging.trips, w, LEAD), (12,))
    b = make_block("torque-nut", w, ripple=twelfth)
    then = fit_blocks([b], now.modes, ("compliance", "damping", "slope"), most_steps=4)
    assert then.projections[0].unexplained < 0.5 * now.projections[0].unexplained


def test_where_there_is_no_ripple_it_changes_nothing(
    smooth: SmallRun, smooth_result: JointResult, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ripple, "_MOST_ORDERS", 0)
    monkeypatch.setattr(ripple, "find_balls", lambda *_, **__: None)
    without = identify_jointly(smooth.trips, smooth.transients, sheet, LOAD)
    for cell, other in zip(smooth_result.cells, without.cells, strict=True):
        assert cell.frequency_Hz == pytest.approx(other.frequency_Hz, abs=0.05)


def test_an_order_below_the_band_at_full_speed_is_not_fitted(rig: Rig) -> None:
    """Its columns vary as slowly as friction at the start of a motion, and would be fitted to that."""
    strong = Disturbances(ripple_orders=(12.0, 24.0), ripple=0.02, ball_pass=0.0)
    slow = Motion(speed=0.045, acceleration=0.6, jerk=600.0, dwell=0.25)
    run = small_run(replace(rig, disturbances=strong), motion=slow)
    now, _ = first_fit(run)
    orders = found(run, now)
    assert 24 in orders
    assert min(orders) * slow.speed / LEAD >= 0.95 * now.blocks[0].windows.band.low


def test_the_size_of_a_force_is_found(cogging: SmallRun, cogging_fit: tuple[JointFit, float]) -> None:
    """The fitted twelfth order is the motor's ripple over the whole mass."""
    now, mass = cogging_fit
    w = now.blocks[0].windows
    twelfth = ripple.select_harmonics(turn_harmonics(cogging.trips, w, LEAD), (12,))
    b = make_block("torque-nut", w, ripple=twelfth)
    then = fit_blocks([b], now.modes, ("compliance", "damping", "slope"), most_steps=8)
    weights = then.projections[0].weights.mean(
        axis=1
    )  # over both sides of the table, which pitch against each other
    assert np.hypot(*weights[-2:]) / weights[0] == pytest.approx(0.012 / mass, rel=0.1)


@pytest.mark.parametrize("lead", [0.0, LEAD])
def test_without_an_order_there_is_no_force(smooth: SmallRun, lead: float) -> None:
    now, _ = first_fit(smooth)
    w = now.blocks[0].windows
    turns = turn_harmonics(smooth.trips, w, lead)
    assert turns.shape == (len(w.centred_position), 36 if lead else 0, 2)
    assert select_orders("torque-nut", w, now.modes[0], turns, lead) == ()
    assert ripple.select_harmonics(turns, ()).shape == (len(w.centred_position), 0)


def test_orders_are_chosen_anew_until_they_stay(
    cogging: SmallRun, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the mode was far off, the first choice may be a wrong one."""
    choices = iter([(5,), (6, 12), (6, 12)])
    monkeypatch.setattr(ripple, "select_orders", lambda *_, **__: next(choices))
    monkeypatch.setattr(ripple, "find_balls", lambda *_, **__: None)
    tried: list[tuple[int, ...]] = []
    of = ripple.select_harmonics
    monkeypatch.setattr(ripple, "select_harmonics", lambda turns, some: tried.append(some) or of(turns, some))
    identify_jointly(cogging.trips, two_stops(cogging).transients, sheet, LOAD)
    assert tried[:2] == [(5,), (6, 12)]
    assert set(tried[2:]) == {(6, 12)}  # for the balls, and for each trip
    assert next(choices, None) is None


def test_the_response_to_the_motors_motion_includes_the_ripple(
    cogging: SmallRun, cogging_fit: tuple[JointFit, float]
) -> None:
    now, _ = cogging_fit
    w = now.blocks[0].windows
    pushes = ripple.select_harmonics(turn_harmonics(cogging.trips, w, LEAD), (12,))
    assert make_block("motor-nut", w, ripple=pushes).ripple.shape[1] == 0
    assert make_block("torque-nut", w, ripple=pushes).ripple.shape[1] == 2
    # The force is a part of the answer beside what it makes of the mode: at the motor, or at the nut.
    for name in ("torque-motor", "torque-nut"):
        without, pushed = (make_block(name, w, ripple=forces) for forces in (None, pushes))
        assert pushed.fixed_columns.shape[1] == without.fixed_columns.shape[1] + 2
        start, stop = w.spans[2]
        in_band = sosfilt(w.band.sections, pushes[start:stop], axis=0)
        assert pushed.fixed_columns[start:stop, -2:] == pytest.approx(in_band, abs=1e-12)


def test_orders_are_averaged_as_the_trips_are(cogging: SmallRun, cogging_fit: tuple[JointFit, float]) -> None:
    w = cogging_fit[0].blocks[0].windows
    turns = turn_harmonics(cogging.trips, w, LEAD)
    start, stop = w.spans[3]
    pushed = [
        np.cos(2 * np.pi * 12 / LEAD * cogging.trips[trip].position[first : first + stop - start])
        for trip, first in w.pieces[3]
    ]
    expected = np.mean(pushed, axis=0)
    assert turns[start:stop, 11, 0] == pytest.approx(expected - expected[0], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("phases", [1, 2, 3])
def test_ripple_that_stays_where_it_is_costs_little(rig: Rig, sheet: DataSheet, phases: int) -> None:
    """Three times the ripple of the example: where it is not fitted, all cells are refused."""
    strong = Disturbances(ripple=0.024, ripple_seed=phases, ball_pass=0.0)
    run = small_run(replace(rig, disturbances=strong))
    result = identify_jointly(run.trips, run.transients, sheet, LOAD)
    off = np.array(errors(result, run))
    uncertainty = np.array([cell.standard_uncertainty_Hz for cell in result.cells], float)
    damping = np.array([cell.uncertainty_terms_Hz["damping"] for cell in result.cells])
    by_noise = np.sqrt(uncertainty**2 - damping**2)
    assert len(off) == 12
    assert (off < 2 * by_noise).all()
    assert by_noise.max() < 0.15  # 0.10 to 0.13: the noise of three trips


@pytest.mark.slow
def test_ripple_costs_little_of_the_accuracy(cogging: SmallRun, cogging_result: JointResult) -> None:
    off = errors(cogging_result, cogging)
    assert len(off) == 12
    assert max(off) < 0.2


def test_the_amplitude_of_the_ripple_is_estimated(
    cogging: SmallRun, cogging_result: JointResult, sheet: DataSheet
) -> None:
    mass = inertia_of(cogging.trips)
    (push,) = cogging_result.ripple
    assert push.order == 12
    assert push.amplitude is not None
    assert push.uncertainty is not None
    assert push.amplitude * mass == pytest.approx(0.012, rel=0.02)
    assert abs(push.amplitude * mass - 0.012) < 1.96 * push.uncertainty * mass
    (alone,) = identify_jointly(cogging.trips, cogging.transients, sheet, LOAD, response="motor").ripple
    assert alone.amplitude is not None
    assert alone.uncertainty is not None
    assert abs(alone.amplitude * mass - 0.012) < 1.96 * alone.uncertainty * mass
    assert alone.uncertainty > push.uncertainty


@pytest.mark.slow
@pytest.mark.parametrize("order", [7.0, 7.3])
def test_what_stays_below_the_mode_or_lies_between_orders_has_no_size(
    rig: Rig, sheet: DataSheet, order: float
) -> None:
    strong = Disturbances(ripple_orders=(order,), ripple=0.05, ball_pass=0.0)
    run = small_run(replace(rig, disturbances=strong))
    found = {p.order: p.amplitude for p in identify_jointly(run.trips, run.transients, sheet, LOAD).ripple}
    near = {k: size for k, size in found.items() if abs(k - order) < 1.5}
    assert near
    assert all(size is None for size in near.values())


@pytest.mark.slow
@pytest.mark.parametrize("order", [2.0, 4.0])
def test_an_order_below_the_band_is_within_the_uncertainty(rig: Rig, sheet: DataSheet, order: float) -> None:
    strong = Disturbances(ripple_orders=(order,), ripple=0.05, ball_pass=0.0)
    run = small_run(replace(rig, disturbances=strong))
    result = identify_jointly(run.trips, run.transients, sheet, LOAD)
    assert all(found.order > 5 for found in result.ripple)
    for cell in result.cells:
        assert abs(cell.frequency_Hz - run.free[cell.position_m]) < 2 * cell.standard_uncertainty_Hz


@pytest.mark.slow
def test_an_order_between_whole_ones_shows_as_several_without_a_size(rig: Rig, sheet: DataSheet) -> None:
    """All of them come near the mode; only that they are neighbours shows it."""
    strong = Disturbances(ripple_orders=(17.5,), ripple=0.02, ball_pass=0.0)
    run = small_run(replace(rig, disturbances=strong))
    result = identify_jointly(run.trips, run.transients, sheet, LOAD)
    for cell in result.cells:
        assert abs(cell.frequency_Hz - run.free[cell.position_m]) < 2 * cell.standard_uncertainty_Hz
        assert cell.verdict == "suspect"
    assert len({16, 17, 18, 19} & {p.order for p in result.ripple}) >= 2
    assert all(p.amplitude is None for p in result.ripple)


def test_a_refused_run_reports_the_ripple(cogging: SmallRun, sheet: DataSheet) -> None:
    strict = JointSettings(most_uncertainty=1e-6)
    result = identify_jointly(cogging.trips, two_stops(cogging).transients, sheet, LOAD, strict)
    assert all(c.verdict == "refused" for c in result.cells)
    assert [(p.order, p.amplitude) for p in result.ripple] == [(12, None)]


def test_ripple_that_moves_the_axis_more_than_the_torque_is_suspect(rig: Rig, sheet: DataSheet) -> None:
    strong = Disturbances(ripple_orders=(24.0,), ripple=0.2, ball_pass=0.0)
    run = two_stops(small_run(replace(rig, disturbances=strong)))
    cells = identify_jointly(run.trips, run.transients, sheet, LOAD).cells
    assert all("move the axis more" in " ".join(c.reasons) for c in cells)


@pytest.mark.slow
def test_an_order_between_whole_ones_that_looks_like_the_mode_is_not_good(rig: Rig, sheet: DataSheet) -> None:
    strong = Disturbances(ripple_orders=(11.5,), ripple=0.03)
    run = small_run(replace(rig, disturbances=strong))
    cells = identify_jointly(run.trips, run.transients, sheet, LOAD).cells
    assert any("was not measured" in reason for reason in cells[0].reasons)
    for cell in cells:
        assert cell.verdict != "good"
        if cell.frequency_Hz is not None:
            assert abs(cell.frequency_Hz - run.free[cell.position_m]) < 2 * cell.standard_uncertainty_Hz


def test_a_motor_without_ripple_is_reported_as_such(smooth_result: JointResult) -> None:
    assert smooth_result.ripple == ()


@pytest.fixture(scope="module")
def loud(rig: Rig) -> SmallRun:
    """At constant speed the twelfth order is a tone at 180 Hz, and rings louder than all else."""
    return small_run(
        replace(rig, disturbances=Disturbances(ripple_orders=(12.0,), ripple=0.03, ball_pass=0.0))
    )


@pytest.fixture(scope="module")
def loud_result(loud: SmallRun, sheet: DataSheet) -> tuple[JointResult, list[tuple[Modes, Modes]]]:
    """The result, and the modes before and after each second search."""
    searches: list[tuple[Modes, Modes]] = []
    search = RippleModel._search_mode

    def record(model: RippleModel, w: Windows, modes: Modes) -> Modes:
        found = search(model, w, modes)
        searches.append((modes, found))
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RippleModel, "_search_mode", record)
        return identify_jointly(loud.trips, loud.transients, sheet, LOAD), searches


def test_a_tone_is_not_taken_for_the_mode(
    loud: SmallRun, loud_result: tuple[JointResult, list[tuple[Modes, Modes]]]
) -> None:
    off = errors(loud_result[0], loud)
    assert len(off) == 12
    assert max(off) < 0.1


def test_the_second_search_takes_the_form_of_the_rotor_free(
    loud_result: tuple[JointResult, list[tuple[Modes, Modes]]],
) -> None:
    """Slope and damping come from the mode with the rotor held, whose form along the axis is another."""
    _, searches = loud_result
    assert searches
    for before, after in searches:
        assert before[0].form_curve != before[ROTOR_HELD].form_curve
        assert after[0].form_curve == before[0].form_curve


@pytest.mark.slow
def test_the_second_search_is_dropped_where_it_explains_no_more(
    loud: SmallRun, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ripple, "CLEAR_REDUCTION", -1e9)
    result = identify_jointly(loud.trips, loud.transients, sheet, LOAD)
    off = errors(result, loud)
    assert not off or max(off) > 5  # the tone


@pytest.mark.parametrize("response", ["both", "motor"])
def test_a_tone_is_refused_without_a_lead(loud: SmallRun, response: Response) -> None:
    result = identify_jointly(loud.trips, loud.transients, None, 0.0, response=response)
    assert all(c.frequency_Hz is None for c in result.cells)
    expected = "was not measured" if response == "both" else "a periodic force"
    assert any(expected in reason.text for reason in result.reasons)


def test_a_nut_that_follows_the_motor_and_not_the_torque_is_suspect(rig: Rig) -> None:
    strong = Disturbances(ripple_orders=(6.0,), ripple=0.1, ball_pass=0.0)
    run = two_stops(small_run(replace(rig, disturbances=strong)))
    result = identify_jointly(run.trips, run.transients, None, 0.0)
    assert {c.verdict for c in result.cells} <= {"suspect", "refused"}
    expected = "a force at the motor was not measured, or the torque signal contains a disturbance"
    assert all(any(expected in reason for reason in c.reasons) for c in result.cells)


def test_strong_ripple_that_is_not_fitted_is_refused(
    cogging: SmallRun, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ripple, "_MOST_ORDERS", 0)
    monkeypatch.setattr(ripple, "find_balls", lambda *_, **__: None)
    result = identify_jointly(cogging.trips, two_stops(cogging).transients, sheet, LOAD)
    assert all(c.frequency_Hz is None and c.reasons for c in result.cells)


def test_the_zero_from_torque_to_motor_accounts_for_the_ripple(cogging: SmallRun, sheet: DataSheet) -> None:
    """From the nut alone, the rotor-held frequency is checked by the zero, which unfitted ripple spoils."""
    result = identify_jointly(cogging.trips, cogging.transients, sheet, LOAD, response="nut")
    for cell in result.cells:
        assert cell.rotor_held_frequency_Hz is not None
        assert cell.rotor_held_standard_uncertainty_Hz is not None
        assert abs(cell.rotor_held_frequency_Hz - cogging.held[cell.position_m]) < 0.6
        assert cell.rotor_held_standard_uncertainty_Hz < 1.0


@pytest.mark.parametrize(
    ("order", "response"),
    [
        pytest.param(13.3, "both", marks=pytest.mark.slow),
        (13.3, "motor"),
        pytest.param(12.0, "both", marks=pytest.mark.slow),
    ],
)
def test_an_order_between_whole_ones_is_fitted_with_the_mode(
    run_with_order: Callable[[float], SmallRun], sheet: DataSheet, order: float, response: Response
) -> None:
    """As behind a belt: by whole orders alone, cells were 1.3 Hz off."""
    run = run_with_order(order)
    result = identify_jointly(run.trips, run.transients, sheet, LOAD, response=response)
    assert len(result.cells) == 12
    for cell in result.cells:
        assert cell.frequency_Hz is not None
        assert cell.standard_uncertainty_Hz is not None
        assert abs(cell.frequency_Hz - run.free[cell.position_m]) < 1.96 * cell.standard_uncertainty_Hz
