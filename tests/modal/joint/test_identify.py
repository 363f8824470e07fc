from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from tests.modal.joint.conftest import MOTION, SmallRun, inertia_of, small_run, two_stops

from ballscrew.axis.hertz import RELEASE
from ballscrew.axis.model import guide_friction, moving_mass, screw_part
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint import identify, profile, search
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.initial import InitialValues
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.testbed.example import AXIS, LOAD
from ballscrew.testbed.trip import Rig


@pytest.fixture(scope="module")
def result(run: SmallRun, sheet: DataSheet) -> JointResult:
    return identify_jointly(run.trips, run.transients, sheet, LOAD)


def errors(result: JointResult, run: SmallRun) -> tuple[np.ndarray, np.ndarray]:
    free, held = [], []
    for cell in result.cells:
        if cell.frequency_Hz is not None:
            free.append(cell.frequency_Hz - run.free[cell.position_m])
        if cell.rotor_held_frequency_Hz is not None:
            held.append(cell.rotor_held_frequency_Hz - run.held[cell.position_m])
    return np.array(free), np.array(held)


def test_every_cell_has_the_true_frequency_within_its_uncertainty(result: JointResult, run: SmallRun) -> None:
    free, held = errors(result, run)
    assert len(free) == len(result.cells) == 12
    assert np.abs(free).max() < 0.9
    assert np.abs(held).max() < 1.2
    spread = np.array([c.standard_uncertainty_Hz for c in result.cells])
    assert (np.abs(free) < 3 * spread).all()
    assert spread.max() < 1.0


def test_steps_of_the_torque_add_an_error_of_all_cells_and_a_larger_one_at_the_ends(
    run: SmallRun, sheet: DataSheet, result: JointResult
) -> None:
    """Both as large as the amplitude of the rounding; the frequencies stay."""
    added = []
    for rounding in (2.5e-9, 1e-8):  # 3e-12 by the sensor
        trips = tuple(replace(trip, rounding=rounding) for trip in run.trips)
        coarse = identify_jointly(trips, run.transients, sheet, LOAD)
        shares = {}
        for cell, fine in zip(coarse.cells, result.cells, strict=True):
            assert cell.frequency_Hz is not None
            assert cell.frequency_Hz == fine.frequency_Hz
            larger = math.sqrt(cell.standard_uncertainty_Hz**2 - fine.standard_uncertainty_Hz**2)
            shares[cell.position_m] = larger / cell.frequency_Hz
        added.append(np.array([shares[x] for x in sorted(shares)]))
    small, large = added
    np.testing.assert_allclose(large, 2 * small, rtol=1e-6)
    np.testing.assert_allclose(small, small[::-1], rtol=0.05)  # about the middle of the stops
    assert small[0] > 1.5 * small[1] > 0


def test_the_sheet_starts_the_search_and_does_not_decide_it(
    run: SmallRun, sheet: DataSheet, result: JointResult
) -> None:
    soft = replace(
        sheet,
        screw=replace(sheet.screw, rigidity=0.75 * sheet.screw.rigidity),
        bearing=replace(sheet.bearing, stiffness=0.75 * sheet.bearing.stiffness),
    )
    other = identify_jointly(run.trips, run.transients, soft, LOAD)
    for one, two in zip(result.cells, other.cells, strict=True):
        assert one.frequency_Hz is not None
        assert two.frequency_Hz == pytest.approx(one.frequency_Hz, abs=0.25)


def test_a_dent_is_followed_and_reported(dented: SmallRun, run: SmallRun, sheet: DataSheet) -> None:
    assert run.free[0.1] - dented.free[0.1] > 3.0
    result = identify_jointly(dented.trips, dented.transients, sheet, LOAD)
    free, held = errors(result, dented)
    assert len(free) == 12
    assert np.abs(free).max() < 1.2
    assert np.abs(held).max() < 1.5
    spread = np.array([c.standard_uncertainty_Hz for c in result.cells])
    assert np.mean(np.abs(free) < 1.96 * spread) >= 0.75
    there = [c.deviation_Hz for c in result.cells if c.position_m == 0.1]
    elsewhere = [c.deviation_Hz for c in result.cells if c.position_m != 0.1 and c.deviation_Hz is not None]
    assert max(d for d in there if d is not None) < -1.0 < min(elsewhere)


def test_the_weight_of_a_vertical_axis_is_corrected(rig: Rig, sheet: DataSheet) -> None:
    """The weight of 1.3 times the preload softens the nut; the frequency is that of the unloaded nut."""
    vertical = replace(sheet, orientation="vertical", inclination=math.pi / 2)
    run = two_stops(small_run(replace(rig, machine=replace(rig.machine, sheet=vertical))))
    known, _ = errors(identify_jointly(run.trips, run.transients, vertical, LOAD), run)
    ignored, _ = errors(identify_jointly(run.trips, run.transients, sheet, LOAD), run)
    assert np.abs(known).max() < 0.9
    assert abs(known.mean()) < 0.3
    assert ignored.mean() < known.mean() - 0.4


def test_a_nut_that_the_test_unloads_is_not_good(unloaded: SmallRun, sheet: DataSheet) -> None:
    result = identify_jointly(unloaded.trips, two_stops(unloaded).transients, sheet, LOAD)
    assert len(result.cells) == 4
    assert not any(c.verdict == "good" for c in result.cells)
    assert all(c.reasons for c in result.cells)
    assert all(c.frequency_Hz is None for c in result.cells)
    assert all((c.nut_load_over_preload or 0.0) > RELEASE for c in result.cells)


def test_the_interval_contains_the_frequency_of_a_worn_nut_under_load(rig: Rig, sheet: DataSheet) -> None:
    # With the prior of a sound nut alone the mean error is 2.2 times its uncertainty.
    worn = small_run(replace(rig, machine=replace(rig.machine, preload=0.2 * rig.machine.preload)))
    result = identify_jointly(worn.trips, worn.transients, sheet, LOAD)
    free, _ = errors(result, worn)
    uncertainty = [c.standard_uncertainty_Hz for c in result.cells if c.standard_uncertainty_Hz is not None]
    assert len(uncertainty) == 12
    assert abs(np.mean(free)) < 1.96 * np.mean(uncertainty)


def test_viscous_friction_of_the_guide_loads_a_worn_nut(rig: Rig, sheet: DataSheet) -> None:
    """Without it in the model the largest error is 3.3 standard uncertainties, and the load a third."""
    machine = replace(rig.machine, preload=0.2 * rig.machine.preload, viscous=600.0)
    worn = small_run(replace(rig, machine=machine))
    result = identify_jointly(worn.trips, worn.transients, sheet, LOAD)
    free, _ = errors(result, worn)
    uncertainty = np.array([c.standard_uncertainty_Hz for c in result.cells])
    assert np.abs(free / uncertainty).max() < 1.96
    mass = float(moving_mass(sheet, LOAD))
    # The acceleration ends shortly before the speed is reached.
    friction = float(guide_friction(sheet, LOAD)) + 0.9 * machine.viscous * MOTION.speed
    load = (mass * MOTION.acceleration + friction) / machine.preload
    stated = [c.nut_load_over_preload for c in result.cells if c.condition.endswith("A")]
    # The fitted mass over preload is 20 % low.
    assert stated == pytest.approx([load] * len(stated), rel=0.25)


@pytest.mark.parametrize("viscous", [-1.0, 1e-170, 1e-9])
def test_an_axis_without_viscous_friction_has_the_frequencies_of_one_with_hardly_any(
    run: SmallRun, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch, viscous: float
) -> None:
    def estimates(estimate: float) -> Array:
        inertia = inertia_of(run.trips)
        monkeypatch.setattr(identify, "inertia_and_viscous_friction", lambda _: (inertia, estimate))
        cells = identify_jointly(run.trips, two_stops(run).transients, sheet, LOAD).cells
        return np.array([(c.frequency_Hz, c.standard_uncertainty_Hz) for c in cells], float)

    found, expected = estimates(viscous), estimates(1e-3)
    np.testing.assert_allclose(found[:, 0], expected[:, 0], atol=0.01)
    np.testing.assert_allclose(found[:, 1], expected[:, 1], rtol=0.02)


def test_viscous_friction_of_the_motor_does_not_load_the_nut(
    rig: Rig, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the true preload. With the torque that overcomes it as a load, the errors are 0.14 to 0.18 Hz."""
    machine = replace(rig.machine, preload=0.2 * rig.machine.preload, viscous=0.0, motor_viscous=1500.0)
    worn = small_run(replace(rig, machine=machine))
    mass = float(moving_mass(sheet, LOAD))
    true = (mass + screw_part(sheet)) / machine.preload
    monkeypatch.setattr(search, "expected_mass_over_preload", lambda *_: (true, 1e-3, 0.0))
    monkeypatch.setattr(profile, "GUIDE_PART_MEAN", 0.0)
    monkeypatch.setattr(profile, "GUIDE_PART_DEVIATION", 1e-3)
    result = identify_jointly(worn.trips, worn.transients, sheet, LOAD)
    free, _ = errors(result, worn)
    assert np.abs(free).max() < 0.12
    load = (mass * MOTION.acceleration + float(guide_friction(sheet, LOAD))) / machine.preload
    stated = [c.nut_load_over_preload for c in result.cells]
    # The highest acceleration exceeds that of the plan by up to 13 %.
    assert stated == pytest.approx([load] * len(stated), rel=0.15)


def test_at_a_single_stop_the_motor_alone_determines_both_frequencies(
    run: SmallRun, sheet: DataSheet
) -> None:
    """The gain of the mode cannot change along the axis there."""
    single = two_stops(run, places=(0.2,))
    deaf = [replace(t, response=np.empty((0, len(t.force)))) for t in single.trips]
    result = identify_jointly(deaf, single.transients, sheet, LOAD)
    free, held = errors(result, single)
    assert len(free) == len(held) == 4
    assert np.abs(free).max() < 1.0
    assert np.abs(held).max() < 3.0


def test_the_motor_alone_determines_both_frequencies(run: SmallRun, sheet: DataSheet) -> None:
    deaf = [replace(t, response=np.empty((0, len(t.force)))) for t in run.trips]
    result = identify_jointly(deaf, run.transients, sheet, LOAD)
    free, held = errors(result, run)
    assert len(free) == 12
    assert np.median(np.abs(free)) < 1.0
    assert np.median(np.abs(held)) < 1.5


def test_two_stops_are_enough(run: SmallRun, sheet: DataSheet) -> None:
    result = identify_jointly(run.trips, two_stops(run).transients, sheet, LOAD)
    free, _ = errors(result, run)
    spread = np.array(
        [c.standard_uncertainty_Hz for c in result.cells if c.standard_uncertainty_Hz is not None]
    )
    assert len(result.cells) == 4
    assert len(free)
    assert (np.abs(free) < 3 * spread).all()


def test_what_was_measured_once_is_not_good(run: SmallRun, sheet: DataSheet) -> None:
    two = two_stops(run, places=(0.1, 0.3)).transients
    transients = [m for m in two if m.file == 0 or m.position_m != 0.1]
    result = identify_jointly(run.trips, transients, sheet, LOAD)
    for cell in result.cells:
        assert any("measured once" in why for why in cell.reasons) == (cell.position_m == 0.1)
        assert cell.position_m != 0.1 or cell.verdict != "good"


def test_a_coarse_encoder_determines_no_rotor_held_frequency(run: SmallRun, sheet: DataSheet) -> None:
    coarse = [replace(t, position=np.round(t.position / 1e-5) * 1e-5) for t in run.trips]
    result = identify_jointly(coarse, two_stops(run).transients, sheet, LOAD)
    assert all(c.rotor_held_frequency_Hz is None for c in result.cells)


@pytest.mark.parametrize("faster", [0.4, pytest.param(2.2, marks=pytest.mark.slow)])
def test_without_a_sheet_a_mode_far_from_where_the_search_starts_is_found(
    run: SmallRun, faster: float
) -> None:
    trips = [replace(t, rate=faster * t.rate, response=faster**2 * t.response) for t in run.trips]
    transients = [replace(m, start_s=m.start_s / faster, stop_s=m.stop_s / faster) for m in run.transients]
    result = identify_jointly(trips, transients)
    told = [c for c in result.cells if c.frequency_Hz is not None]
    assert told
    for cell in told:
        assert cell.frequency_Hz == pytest.approx(faster * run.free[cell.position_m], rel=0.02)


def test_a_single_cell_is_too_few_to_average(run: SmallRun, sheet: DataSheet) -> None:
    first = run.transients[0]
    alike = [row for row in run.transients if (row.position_m, row.condition) == (first.position_m, "PA")]
    result = identify_jointly(run.trips, alike, sheet, LOAD)
    assert [cell.verdict for cell in result.cells] == ["refused"]
    assert result.reasons[0] == ("measurement", "too few transients of one kind to average")


def test_noise_is_refused_and_says_why(run: SmallRun, sheet: DataSheet) -> None:
    random = np.random.default_rng(1)
    noise = [replace(t, response=random.standard_normal(t.response.shape), force=t.force) for t in run.trips]
    result = identify_jointly(noise, two_stops(run).transients, sheet, LOAD)
    assert all(c.frequency_Hz is None and c.verdict == "refused" for c in result.cells)
    assert "explains only" in result.reasons[0].text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"force": np.full(10, np.nan)}, "no numbers"),
        ({"motor": np.append(np.zeros(9), np.nan)}, "no numbers"),
        ({"position": np.zeros(10)}, "does not move"),
    ],
)
def test_a_record_that_cannot_be_used_is_refused(change: dict[str, np.ndarray], said: str) -> None:
    flat = {"force": np.zeros(10), "position": np.arange(10.0), "response": np.zeros((1, 10))} | change
    trip = TripSignals(1000.0, **flat)
    result = identify_jointly([trip], [TransientRow(0, 0.0, 0.005, 0.0, "PA", 0, 1)])
    assert said in result.reasons[0].text
    assert result.cells[0].verdict == "refused"


@pytest.mark.parametrize(("frequency", "reason"), [(150.0, None), (450.0, "low-rate"), (600.0, "no-mode")])
def test_a_mode_beyond_the_range_asks_for_no_higher_rate(frequency: float, reason: str | None) -> None:
    """The recording may have that rate: without a data sheet it was reduced for the range."""
    settings = JointSettings()
    without_sheet = cast(InitialValues, SimpleNamespace(sheet=None, rotor_free=frequency))
    found = identify._frequency_refusal(4000.0, frequency, without_sheet, settings)
    assert reason == (found and found.kind)
    with_sheet = cast(InitialValues, SimpleNamespace(sheet=AXIS, rotor_free=frequency))
    found = identify._frequency_refusal(4000.0, frequency, with_sheet, settings)
    assert (found and found.kind) == (None if frequency < 400 else "low-rate")
    wrong_sheet = cast(InitialValues, SimpleNamespace(sheet=AXIS, rotor_free=100.0))
    found = identify._frequency_refusal(4000.0, frequency, wrong_sheet, settings)
    assert (found is None) == (frequency < 400)
    if found is not None:
        assert found.kind == "low-rate"
        assert found.text.endswith("far above the 100 Hz that the data sheet predicts: check the data sheet")


def test_what_does_not_fit_together_is_an_error() -> None:
    trip = TripSignals(1000.0, np.zeros(10), np.arange(10.0), np.empty((0, 10)))
    with pytest.raises(InputError, match="no accelerometer"):
        identify_jointly([trip], [], response="nut")
    with pytest.raises(InputError, match="different lengths"):
        identify_jointly([replace(trip, motor=np.zeros(9))], [])
    with pytest.raises(InputError, match="not among the 1"):
        identify_jointly([trip], [TransientRow(3, 0.0, 0.1, 0.0, "PA", 0, 1)])
    with pytest.raises(InputError, match="must be one of"):
        identify_jointly([trip], [], response="ear")  # type: ignore[arg-type]
    other = replace(trip, rate=2000.0)
    with pytest.raises(InputError, match="different rates or accelerometers"):
        identify_jointly([trip, other], [])
    with pytest.raises(InputError, match="no trip"):
        identify_jointly([], [])
    with pytest.raises(InputError, match="different lengths"):
        identify_jointly([replace(trip, force=np.zeros(9))], [])
    (reason,) = identify_jointly([trip], []).reasons
    assert reason == ("measurement", "no acceleration phase was found")


def test_the_real_drive_at_one_kilohertz_has_no_frequency(emps: Path) -> None:
    import scipy.io

    raw = scipy.io.loadmat(emps / "DATA_EMPS.mat")
    force, position = (np.ravel(raw[n]).astype(float) for n in ("vir", "qm"))
    from ballscrew.modal.joint.signals import complete_transients
    from ballscrew.recording.aligned import Aligned
    from ballscrew.recording.kinematics import kinematics
    from ballscrew.recording.phases import find_phases
    from ballscrew.recording.transients import cut, label

    aligned = Aligned(1000.0, force, "force", position, np.zeros((1, len(force))), ("motor",))
    segments = cut(aligned, find_phases(kinematics(position, 1000.0)), 0)
    trip = TripSignals(1000.0, force, position, np.empty((0, len(force))))
    result = identify_jointly([trip], complete_transients(label(segments, aligned, 0.0)))
    assert all(c.frequency_Hz is None for c in result.cells)
    assert all("1000 samples per second are too few" in c.reasons[0] for c in result.cells)


def test_a_run_with_loose_sensors_is_suspect(rig: Rig, sheet: DataSheet) -> None:
    """Both alike, at 1.14 times the axial mode: only the motor's motion shows it."""
    loose = replace(rig.instruments, pitch_frequency=200.0, pitch_damping=0.05, pitch=(1.0, 1.0))
    run = small_run(replace(rig, instruments=loose))
    result = identify_jointly(run.trips, run.transients, sheet, LOAD)
    assert {cell.verdict for cell in result.cells} == {"suspect"}
    assert {kind for cell in result.cells for kind in cell.reason_kinds} == {"responses-differ"}
