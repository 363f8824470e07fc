from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.recording.quality.conftest import codes, ran
from tests.recording.synthetic import LOAD, PLAN, SHEET, changed, recorded, synthetic_trip

from ballscrew.axis.model import rotor_mass, weight_on_nut
from ballscrew.recording.quality.completeness import _check_mass, check_run
from ballscrew.recording.rigid_body import RigidBody


def messages(findings, code):
    return [f.message for f in findings if f.code == code]


def test_a_good_run_passes(run):
    assert ran(run.recordings, run.plan, run.sheet, run.load) == ()


def test_without_a_plan_and_a_sheet_nothing_is_wrong(run):
    assert ran(run.recordings, None, None, run.load) == ()


def test_missing_trips_are_one_sentence(run):
    plan = replace(run.plan, repetitions=len(run.recordings) + 1)
    findings = ran(run.recordings, plan, run.sheet, run.load)
    assert codes(findings) == {"repetitions": "suspect"}
    cells = 4 * len(run.plan.positions) - 4
    (message,) = messages(findings, "repetitions")
    plural = "s" * (len(run.recordings) > 1)
    assert message.startswith(
        f"of the plan's {cells} cells {cells} have {len(run.recordings)} repetition{plural}, where"
    )


def test_a_missing_trip_of_motions_that_look_alike(run):
    motion = run.plan.motions[0]
    other = replace(motion, jerk=1.3 * motion.jerk)
    plan = replace(run.plan, repetitions=len(run.recordings), motions=(motion, other))
    (message,) = messages(ran(run.recordings, plan, run.sheet, run.load), "repetitions")
    assert message.endswith("motions 0 and 1 differ in their order only, so they cannot be assigned")


def test_a_cut_file_misses_repetitions(run):
    cut = changed(run.recordings[-1], lambda _, x: x[: len(x) // 2])
    findings = ran((*run.recordings[:-1], cut), run.plan, run.sheet, run.load)
    assert codes(findings)["repetitions"] == "suspect"


def test_a_stop_that_is_never_reached_is_named(run):
    run = run.short
    stops = (*run.plan.positions, run.plan.positions[-1] + 0.045)
    findings = ran(run.recordings, replace(run.plan, positions=stops), run.sheet, run.load)
    assert codes(findings)["stops"] == "suspect"
    assert f"1 of the plan's {len(stops)} stops" in messages(findings, "stops")[0]


def test_places_that_are_not_the_plans_are_reported(run):
    run = run.short
    stops = tuple(stop * (1.5 if 0 < index < 3 else 1.0) for index, stop in enumerate(run.plan.positions))
    findings = ran(run.recordings, replace(run.plan, positions=tuple(sorted(stops))), run.sheet, run.load)
    assert codes(findings)["places"] == "suspect"


@pytest.mark.parametrize("offset", [2e-3, -1e-3])
def test_a_zero_that_moved_is_reported(run, offset):
    run = run.short
    shifted = tuple(changed(trip, lambda _, x: x + offset, "position") for trip in run.recordings)
    findings = ran(shifted, run.plan, run.sheet, run.load)
    assert codes(findings) == {"offset": "suspect"}
    assert f"{1e3 * offset:+.3g} mm" in findings[0].message


@pytest.mark.parametrize("factor", [1e-3, 1.1, 2.0])
def test_a_position_in_another_unit_is_not_the_plan(run, factor):
    run = run.short
    scaled = tuple(changed(trip, lambda _, x: x * factor, "position") for trip in run.recordings)
    assert set(codes(ran(scaled, run.plan, run.sheet, run.load))) & {"places", "stops"}


@pytest.mark.parametrize("load", [60.0, 80.0, 90.0, 110.0, 120.0, 150.0])
def test_a_wrong_load_is_reported_with_the_load_that_explains_it(run, load):
    run = run.short
    findings = ran(run.recordings, run.plan, run.sheet, load)
    assert codes(findings) == {"load": "suspect"}
    declared, measured = messages(findings, "load")
    assert f"{load:g} kg is not in the plan (100 kg)" in declared
    reported = float(measured.split("a load of ")[2].split(" kg")[0])
    assert reported == pytest.approx(100.0, abs=2.0)


def test_a_load_that_is_not_declared_is_not_checked(run):
    assert ran(run.recordings, run.plan, run.sheet, None) == ()


def test_a_load_that_was_not_put_on_is_found_where_plan_and_run_agree():
    findings = ran((recorded(synthetic_trip(load=80.0)),), PLAN, SHEET, LOAD)
    assert codes(findings) == {"load": "suspect"}
    assert "a load of 80 kg would explain it" in findings[0].message


def test_an_inverted_torque_has_a_negative_mass(run):
    run = run.short
    inverted = tuple(changed(trip, lambda _, x: -x, "torque") for trip in run.recordings)
    assert codes(ran(inverted, run.plan, run.sheet, run.load)) == {"polarity": "suspect"}


@pytest.mark.parametrize("factor", [1e-3, 0.5, 1e3])
def test_a_torque_in_another_unit_is_bad(run, factor):
    run = run.short
    scaled = tuple(changed(trip, lambda _, x: factor * x, "torque") for trip in run.recordings)
    findings = ran(scaled, run.plan, run.sheet, run.load)
    assert codes(findings) == {"load": "bad"}
    assert "too much for a wrong load" in findings[0].message


def test_a_mass_that_the_fit_cannot_determine_is_not_checked():
    vague = RigidBody(400.0, 1.0, 1.0, 0.0, (100.0, 1.0, 1.0, 1.0), 1.0, 0.5)
    table = _empty(recorded(synthetic_trip()))
    assert check_run(table, None, SHEET, LOAD, vague) == ()
    sure = replace(vague, uncertainty=(1.0, 1.0, 1.0, 1.0))
    assert codes(check_run(table, None, SHEET, LOAD, sure)) == {"load": "suspect"}
    unknown = replace(vague, equivalent_mass=float("nan"))
    assert check_run(table, None, SHEET, LOAD, unknown) == ()


def masses_of(measured, offset=0.0):
    return RigidBody(measured, 1.0, 25.0, offset, (0.5, 1.0, 1.0, 1.0), 1.0, 0.99)


def test_a_transmission_that_the_sheet_does_not_state_is_asked_for():
    """Of a belt of 2, the motor's torque times 1/β is half of the force of four times the motor's inertia."""
    table = _empty(recorded(synthetic_trip()))
    turning = rotor_mass(SHEET)
    motor = 4.2e-4 / (0.01 / (2 * math.pi)) ** 2
    measured = (132 + turning + 3 * motor) / 2
    found = check_run(table, None, SHEET, LOAD, masses_of(measured))
    assert "a belt or gear of 0.46 or 2 motor turns per screw turn between" in found[0].message
    geared = replace(SHEET, drive=replace(SHEET.drive, ratio=2.0))
    assert check_run(table, None, geared, LOAD, masses_of(2 * measured)) == ()


@pytest.mark.parametrize("positive", ["up", "down"])
def test_a_constant_force_asks_whether_the_axis_is_vertical(positive):
    table = _empty(recorded(synthetic_trip()))
    vertical = replace(SHEET, orientation="vertical", inclination=math.pi / 2, positive=positive)
    weight = float(weight_on_nut(vertical, LOAD))
    body = masses_of(132 + rotor_mass(SHEET), weight)
    (found,) = check_run(table, None, SHEET, LOAD, body)
    assert (found.code, found.severity) == ("constant-force", "suspect")
    assert f"{weight:.0f} N" in found.message
    assert "is this axis vertical or inclined?" in found.message
    assert check_run(table, None, vertical, LOAD, body) == ()
    opposite = replace(vertical, positive="down" if positive == "up" else "up")
    (found,) = check_run(table, None, opposite, LOAD, body)
    assert "positive" in found.message


@pytest.mark.parametrize(("part", "expected"), [(0.95, {"pretension": "suspect"}), (1.05, {}), (None, {})])
def test_a_nut_load_that_unloads_an_end_of_the_screw_is_suspect(part, expected):
    """An end lets go at the load whose part by the softer side is the pretension."""
    friction = 0.0 if SHEET.guide.friction is None else SHEET.guide.friction
    force = 132 * PLAN.motions[0].peak_acceleration + friction
    screw = SHEET.screw
    section = math.pi * screw.root_diameter**2 / 4 * screw.youngs_modulus
    distances = screw.bearing_to_zero + np.array(PLAN.positions)
    near = 1 / SHEET.bearing.stiffness + distances / section
    far = 1 / SHEET.bearing.stiffness + (screw.length - distances) / section
    needed = force * float(np.max(np.maximum(near, far) / (near + far)))
    pretension = None if part is None else part * needed
    sheet = replace(SHEET, support="fixed-fixed", bearing=replace(SHEET.bearing, pretension=pretension))
    table = _empty(recorded(synthetic_trip()))
    found = check_run(table, PLAN, sheet, LOAD, masses_of(132 + rotor_mass(SHEET)))
    assert {code: severity for code, severity in codes(found).items() if code == "pretension"} == expected


def test_a_constant_force_of_no_consequence_is_not_reported():
    """A quarter of the preload, half of the friction and three standard uncertainties are allowed."""
    table = _empty(recorded(synthetic_trip()))
    mass = 132 + rotor_mass(SHEET)
    assert check_run(table, None, SHEET, LOAD, masses_of(mass, 149.0)) == ()
    assert codes(check_run(table, None, SHEET, LOAD, masses_of(mass, -151.0))) == {
        "constant-force": "suspect"
    }
    rough = replace(masses_of(mass, 300.0), coulomb=601.0)
    assert check_run(table, None, SHEET, LOAD, rough) == ()
    vague = replace(masses_of(mass, 300.0), uncertainty=(1.0, 1.0, 1.0, 101.0))
    assert check_run(table, None, SHEET, LOAD, vague) == ()


def test_a_run_without_any_phase_is_bad():
    table = _empty(recorded(synthetic_trip()))
    findings = check_run(table, PLAN, SHEET, LOAD, None)
    assert codes(findings) == {"repetitions": "bad"}
    assert "none of the 20 planned cells" in findings[0].message


def _empty(trip):
    from ballscrew.recording.aligned import align
    from ballscrew.recording.transients import label

    return label((), align(trip), LOAD, PLAN)


def test_phases_that_the_record_cuts_count_for_nothing(run):
    from ballscrew.recording.aligned import align
    from ballscrew.recording.kinematics import kinematics
    from ballscrew.recording.phases import find_phases
    from ballscrew.recording.transients import cut, label

    aligned = align(run.one)
    segments = cut(aligned, find_phases(kinematics(aligned.position, aligned.rate)), 0)
    table = label(segments, aligned, run.load, run.plan)
    table = table.assign_coords(complete=("transient", np.zeros(len(segments), bool)))
    assert codes(check_run(table, run.plan, None, run.load, None)) == {"repetitions": "bad"}


def test_more_repetitions_than_planned_are_reported(run):
    plan = replace(run.plan, repetitions=len(run.recordings))
    twice = (*run.recordings, changed(run.recordings[0], lambda source, x: x + 1e-9 * (source == "torque")))
    findings = ran(twice, plan, run.sheet, run.load)
    assert "repetitions" in codes(findings)
    (message,) = messages(findings, "repetitions")
    assert f"have up to {len(twice)} repetitions, where {plan.repetitions}" in message
    assert "two runs in one file" in message


def test_warm_up_trips_that_were_recorded_are_not_too_many(run):
    plan = replace(run.plan, repetitions=1, warm_up=len(run.recordings) - 1)
    assert ran(run.recordings, plan, run.sheet, run.load) == ()


def test_transients_that_are_there_twice_are_reported(run):
    item = run.one
    findings = ran((item, item), replace(run.plan, repetitions=2), run.sheet, run.load)
    assert codes(findings) == {"copies": "suspect"}
    cells = 4 * len(run.plan.positions) - 4
    assert f"{cells} of {2 * cells} transients occur twice" in findings[0].message
    assert "of recording 1 again at" in findings[0].message


def test_trips_that_differ_by_their_noise_alone_are_no_copies(run):
    random = np.random.default_rng(0)
    other = changed(run.one, lambda _, x: x + 1e-3 * random.standard_normal(len(x)), "torque")
    assert ran((run.one, other), replace(run.plan, repetitions=2), run.sheet, run.load) == ()


@pytest.mark.parametrize(
    ("part", "severity", "words"),
    [
        (1.0, None, ""),
        (0.9, "suspect", "no load explains it; a wrong scale of the torque, or a wrong lead"),
        (1.2, "suspect", "kg would explain it, as would a wrong scale of the torque"),
        (3.0, "bad", "too much for a wrong load"),
    ],
)
def test_a_mass_that_no_load_explains_is_one_of_the_scale(part, severity, words):
    own = SHEET.table.mass + rotor_mass(SHEET)
    rigid = RigidBody(part * own, 0.0, 0.0, 0.0, (0.1, 0.0, 0.0, 0.0), 1.0, 1.0)
    findings = _check_mass(SHEET, 0.0, rigid)
    assert [finding.severity for finding in findings] == ([severity] if severity else [])
    assert all(words in finding.message for finding in findings)


@pytest.mark.parametrize(("factor", "offset"), [(-1.0, 0.0), (1.0, 5.0)])
def test_a_nut_that_leaves_the_screw_is_bad(run, factor, offset):
    run = run.short
    moved = tuple(changed(trip, lambda _, x: factor * x + offset, "position") for trip in run.recordings)
    sheet = replace(run.sheet, screw=replace(run.sheet.screw, bearing_to_zero=0.05))
    found = messages(ran(moved, None, sheet, None), "places")
    assert len(found) == 1
    assert ", off the screw, which ends at -50 and " in found[0]
    assert not messages(ran(run.recordings, None, sheet, None), "places")
