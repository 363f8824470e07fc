from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from ballscrew.axis.sheet import Bearing, Drive, Guide, Limits, Table
from ballscrew.base.errors import InputError
from ballscrew.fcft.concerns import EXCITED, QUIET, RINGING, SHORTEST, notes, warnings
from ballscrew.fcft.expected import expected_cells
from ballscrew.fcft.levels import two_levels
from ballscrew.fcft.plan import Motion, Plan, read_plan, validate_plan
from ballscrew.fcft.planfile import plan_toml

BENCH = Motion(0.15, 2.5, 1500.0, 0.35)
STOPS = tuple(0.045 * index for index in range(11))
PLAN = Plan(STOPS, 3, (100.0,), (BENCH,))
WORDS = {"null": "has a null", "load": "nut load", "dwell": "the dwell of", "short": "an acceleration takes"}


def moved(plan=PLAN, **changes):
    return replace(plan, motions=(replace(plan.motions[0], **changes),))


def concerns_of(plan, sheet):
    return warnings(plan, sheet, expected_cells(plan, sheet))


def kinds(plan, sheet):
    return {kind for text in concerns_of(plan, sheet) for kind, words in WORDS.items() if words in text}


def about(kind, plan, sheet):
    (text,) = [text for text in concerns_of(plan, sheet) if WORDS[kind] in text]
    return text


def number(pattern, text):
    return float(re.search(pattern, text)[1])


def cured(kind, text, plan):
    """The plan with the cure that a sentence names."""
    if kind == "null":
        return moved(plan, jerk=number(r"a jerk of (\S+) m/s\^3 or more", text))
    if kind == "dwell":
        return moved(plan, dwell=number(r"need (\S+) ms or more", text) / 1e3)
    changes = {}
    if kind == "load":
        changes["acceleration"] = number(r"an acceleration of (\S+) m/s\^2 or less", text)
        speed = re.search(r"at (\S+) mm/s or less", text)
    else:
        changes["acceleration"] = number(r"accelerate at (\S+) m/s\^2", text)
        speed = re.search(r"to (\S+) mm/s, since", text)
    if speed:
        changes["speed"] = float(speed[1]) / 1e3
    return moved(plan, **changes)


def test_nothing_speaks_against_the_bench(sheet):
    assert concerns_of(PLAN, sheet) == ()


def test_two_modes_of_nearly_equal_share_are_both_named(sheet):
    """A light table on a soft belt and a lead of 20 mm."""
    belted = replace(
        sheet,
        screw=replace(sheet.screw, lead=0.02, nominal_diameter=0.02),
        table=Table(10.0),
        drive=Drive(4.2e-4, belt_stiffness=300.0),
    )
    plan = replace(PLAN, masses=(0.0,))
    cells = expected_cells(plan, belted)
    both = [cell for cell in cells if cell.second_frequency is not None]
    assert 0 < len(both) < len(cells)
    (sentence,) = [text for text in warnings(plan, belted, cells) if "two axial modes" in text]
    assert sentence.startswith(f"{len(both)} of {len(cells)} cells have two axial modes")
    assert f"{both[0].frequency:.1f} and {both[0].second_frequency:.1f} Hz" in sentence
    for cell in both:
        assert cell.standard_uncertainty > 0.15 * abs(cell.second_frequency - cell.frequency)


# --- a null on the natural frequency


@pytest.mark.parametrize("null", [115.0, 122.0, 150.0, 168.0, 184.0])
def test_a_null_on_an_expected_frequency(sheet, null):
    plan = moved(jerk=2.5 * null)
    text = about("null", plan, sheet)
    assert f"a null at {null:.1f} Hz (jerk time {1000 / null:.3g} ms)" in text
    assert kinds(cured("null", text, plan), sheet) == set()


@pytest.mark.parametrize("null", [280.0, 600.0, 1e4])
def test_a_null_far_above_is_none(sheet, null):
    assert concerns_of(moved(jerk=2.5 * null), sheet) == ()


def test_every_cell_with_too_little_is_counted(sheet):
    plan = moved(jerk=2.5 * 122.0)
    weak = [cell for cell in expected_cells(plan, sheet) if cell.least_excitation < EXCITED]
    assert 0 < len(weak) <= 40
    assert f"of {len(weak)} of 40 cells" in about("null", plan, sheet)


def test_the_second_null_is_named_where_it_is_the_second(sheet):
    plan = Plan((0.0, 0.45), 3, (100.0,), (Motion(0.3, 2.5, 2.5 * 72.5, 0.35),))
    assert "a null at 145.0 Hz" in about("null", plan, sheet)


def test_a_jerk_for_a_motion_that_does_not_reach_its_acceleration(sheet):
    plan = moved(speed=0.02, acceleration=50.0, jerk=0.02 * 150.0**2)  # T_j = sqrt(v/j) = 1/150 s
    text = about("null", plan, sheet)
    assert "null" not in kinds(cured("null", text, plan), sheet)


def narrow(sheet, *, u=0.0):
    """An axis whose frequency is known."""
    return replace(sheet, tolerances={"rigidity": u, "stiffness": u, "preload_ratio": u})


def test_a_spread_that_fills_the_null_is_named_and_does(sheet):
    sheet = narrow(sheet)
    plan = replace(moved(jerk=2.5 * 166.0), positions=(0.0, 0.01 * 8), repetitions=8)
    text = about("null", plan, sheet)
    spread = number(r"so does jerk_spread = ([\d.]+), which", text)
    assert 0 < spread <= 1
    assert "null" not in kinds(moved(plan, jerk_spread=spread), sheet)
    assert "null" in kinds(moved(plan, jerk_spread=spread / 2), sheet), "a good deal less does not do"


def test_a_spread_is_not_named_where_it_cannot_help(sheet):
    sheet = narrow(sheet)
    plan = replace(moved(jerk=2.5 * 166.0), positions=(0.0, 0.08), repetitions=1)
    assert "jerk_spread" not in about("null", plan, sheet), "one repetition has the nominal jerk"
    soft = replace(moved(jerk=2.5 * 30.0), repetitions=8)
    assert "jerk_spread" not in about("null", soft, sheet), "beyond the first lobe all is weak"


def test_a_spread_that_needs_more_room_than_there_is_is_not_named(sheet):
    sheet = narrow(sheet)
    motion = replace(BENCH, jerk=2.5 * 166.0)
    room = 2 * motion.acceleration_distance * (1 + 1e-6)
    plan = Plan((0.0, room), 8, (100.0,), (motion,))
    validate_plan(plan, sheet)
    assert "jerk_spread" not in about("null", plan, sheet)
    assert "jerk_spread" in about("null", replace(plan, positions=(0.0, 3 * room)), sheet)


# --- the nut load


def accelerated(sheet, ratio, **changes):
    """The bench's motion with a nut load of so many preloads, and a speed that holds it a while."""
    acceleration = (ratio * sheet.nominal_preload - sheet.guide.friction) / (sheet.table.mass + 100.0)
    motion = Motion(0.04 * acceleration, acceleration, acceleration / 0.0015, 0.35)
    return replace(PLAN, positions=(0.0, 0.45), motions=(replace(motion, **changes),))


@pytest.mark.parametrize(("ratio", "words"), [
    (1.49, None), (1.5, None), (1.51, "too low"), (2.5, "too low"), (2.82, "too low"),
    (2.84, "does not depend on the preload"), (6.0, "does not depend on the preload"),
])  # fmt: skip
def test_a_nut_load_beside_its_limits(sheet, ratio, words):
    plan = accelerated(sheet, ratio)
    if words is None:
        assert concerns_of(plan, sheet) == ()
        return
    text = about("load", plan, sheet)
    assert words in text
    assert f"is {ratio:.2f} times the nominal preload of 600 N" in text
    assert "load" not in kinds(cured("load", text, plan), sheet)


def test_the_softening_that_is_told_is_that_of_the_cell(sheet):
    plan = accelerated(sheet, 2.0)
    (cell, *_) = expected_cells(plan, sheet)
    assert f"the frequency is {-cell.nut_load_shift:.2f} Hz too low" in about("load", plan, sheet)


def notes_on(sheet):
    return notes(PLAN, sheet, expected_cells(PLAN, sheet))


def test_friction_that_is_assumed_is_a_note(sheet):
    unstated = replace(sheet, guide=Guide())
    (note,) = [note for note in notes_on(unstated) if "friction" in note]
    assert "up to 26 N are assumed, 2% of the weight, and rolling guides have 9 to 78 N" in note
    assert not any("guide.friction" in note for note in notes_on(sheet))


def test_a_guide_whose_friction_is_too_much_has_no_cure(sheet):
    stiff = replace(sheet, guide=Guide(950.0))
    assert "no acceleration helps" in about("load", PLAN, stiff)


def test_a_weight_that_is_too_much_has_no_cure_and_is_named(sheet):
    vertical = replace(sheet, orientation="vertical", inclination=math.pi / 2)
    sentence = about("load", PLAN, vertical)
    assert "the weight (1294 N) and the guides' friction (25 N) alone are more than 1.5 P" in sentence


def test_where_the_stops_are_close_the_speed_is_named_too(sheet):
    plan = accelerated(sheet, 2.0)
    plan = replace(plan, positions=(0.0, 2 * plan.motions[0].acceleration_distance * 1.01))
    text = about("load", plan, sheet)
    assert "mm/s or less (the stops are" in text
    validate_plan(cured("load", text, plan), sheet)
    assert "load" not in kinds(cured("load", text, plan), sheet)


def test_the_heaviest_load_decides_and_is_named(sheet):
    plan = replace(accelerated(sheet, 1.6), masses=(0.0, 100.0, 50.0))
    assert "at 100 kg (PA)" in about("load", plan, sheet)


def test_the_offered_levels_are_not_warned_of(sheet, tmp_path):
    levels = replace(PLAN, motions=two_levels(PLAN, sheet).motions)
    assert len(levels.motions) == 2
    (tmp_path / "levels.toml").write_text(plan_toml(levels), encoding="utf-8")
    for plan in (levels, read_plan(tmp_path / "levels.toml")):
        assert concerns_of(plan, sheet) == (), "1.5 P is what may be, also after nine digits"


# --- ringing and phases


def test_ringing_that_the_dwell_cuts_off(sheet):
    lowest = min(cell.frequency for cell in expected_cells(PLAN, sheet))
    needed = (RINGING + QUIET) / lowest
    assert concerns_of(moved(dwell=needed), sheet) == ()
    plan = moved(dwell=0.99 * needed)
    text = about("dwell", plan, sheet)
    assert "18.8 periods of the lowest expected frequency (122.1 Hz)" in text
    assert concerns_of(cured("dwell", text, plan), sheet) == ()


def test_a_start_that_varies_only_adds_to_the_dwell(sheet):
    assert kinds(moved(dwell=0.1, start_spread=1.0), sheet) == {"dwell"}
    assert kinds(moved(start_spread=1.0), sheet) == set()


def test_a_phase_that_is_too_short(sheet):
    lowest = min(cell.frequency for cell in expected_cells(PLAN, sheet))
    enough = SHORTEST / lowest - BENCH.jerk_time
    assert concerns_of(moved(speed=1.001 * enough * 2.5), sheet) == ()
    plan = moved(speed=0.99 * enough * 2.5)
    text = about("short", plan, sheet)
    assert "4.0 periods" in text
    assert concerns_of(cured("short", text, plan), sheet) == ()


def test_a_phase_that_is_too_short_between_close_stops(sheet):
    motion = Motion(0.05, 2.5, 1500.0, 0.35)
    plan = Plan((0.0, 2 * motion.acceleration_distance * 1.01), 3, (100.0,), (motion,))
    text = about("short", plan, sheet)
    assert "allow no more" in text
    better = cured("short", text, plan)
    validate_plan(better, sheet)
    assert "short" not in kinds(better, sheet)


# --- all together


def test_each_of_several_motions_is_named(sheet):
    plan = replace(PLAN, motions=(BENCH, replace(BENCH, dwell=0.05), replace(BENCH, jerk=375.0)))
    first, second = concerns_of(plan, sheet)
    assert first.startswith("motion 1: the dwell")
    assert second.startswith("motion 2: the torque has a null")
    assert about("dwell", moved(dwell=0.05), sheet).startswith("the motion: ")


@settings(
    max_examples=40,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
)
@given(
    acceleration=st.floats(0.2, 60), rise=st.floats(3e-4, 0.03), hold=st.floats(1e-3, 0.2),
    dwell=st.floats(0, 1), room=st.floats(1.0, 20.0), load=st.floats(0, 300),
    repetitions=st.integers(1, 9), spread=st.floats(0, 0.5),
)  # fmt: skip
def test_every_cure_removes_what_it_is_told_against(
    sheet, acceleration, rise, hold, dwell, room, load, repetitions, spread
):
    motion = Motion(acceleration * hold, acceleration, acceleration / rise, dwell, spread)
    gap = 2 * motion.acceleration_distance * room
    assume(1e-3 < gap < 0.28)
    plan = Plan((0.0, gap, 2 * gap), repetitions, (load,), (motion,))
    validate_plan(plan, sheet)
    by_kind = {
        kind: text for text in concerns_of(plan, sheet) for kind, words in WORDS.items() if words in text
    }
    for kind, text in by_kind.items():
        better = cured(kind, text, plan)
        validate_plan(better, sheet)
        assert kind not in kinds(better, sheet), text
    if "so does jerk_spread" in by_kind.get("null", ""):
        filled = number(r"jerk_spread = ([\d.]+), which", by_kind["null"])
        assert "null" not in kinds(moved(plan, jerk_spread=filled), sheet)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(acceleration=st.floats(0.5, 20), rise=st.floats(5e-4, 0.012), dwell=st.floats(0.05, 0.4))
def test_a_warning_appears_exactly_when_it_should(sheet, acceleration, rise, dwell):
    motion = Motion(0.045 * acceleration, acceleration, acceleration / rise, dwell)
    plan = Plan((0.0, 0.2, 0.45), 3, (0.0, 100.0), (motion,))
    try:
        validate_plan(plan, sheet)
    except InputError:
        assume(False)
    cells = expected_cells(plan, sheet)
    lowest = min(cell.frequency for cell in cells)
    force = 132 * motion.peak_acceleration + 25
    wanted = {
        "load": force > 1.5 * 600 * (1 + 1e-6),
        "dwell": dwell < 19 / lowest * (1 - 1e-6),
        "short": motion.acceleration_time < 4 / lowest,
        "null": min(cell.least_excitation for cell in cells) < 0.2,
    }
    assert kinds(plan, sheet) == {kind for kind, there in wanted.items() if there}


# --- notes


def test_the_preloads_at_which_the_load_is_too_much(sheet):
    text = notes(PLAN, sheet, expected_cells(PLAN, sheet))[0]
    assert "nut load of 355 N reaches 1.5 P at 237 N of preload (1.58% of Ca)" in text
    assert "(2.83 P) at 126 N of preload (0.84% of Ca)" in text
    assert (355 / 1.5, 355 / 2 / math.sqrt(2)) == pytest.approx((236.7, 125.5), abs=0.1)


def test_what_is_so_already_is_not_told_as_what_will_come(sheet):
    def falling(ratio):
        plan = accelerated(sheet, ratio)
        return [t for t in notes(plan, sheet, expected_cells(plan, sheet)) if "as the preload falls" in t]

    assert "reaches 1.5 P at 600 N" in falling(1.5)[0]
    (text,) = falling(2.0)
    assert "reaches" not in text
    assert "unloads the nut (2.83 P) at 424 N" in text
    assert falling(3.0) == []


def test_warm_up_and_temperature_are_asked_for(sheet):
    def text_of_notes(**changes):
        plan = replace(PLAN, **changes)
        return " ".join(notes(plan, sheet, expected_cells(plan, sheet)))

    assert "no warm-up (warm_up) and no temperature (temperature)" in text_of_notes()
    assert "has no temperature" in text_of_notes(warm_up=2)
    assert "has no warm-up (warm_up):" in text_of_notes(temperature=True)
    assert "asks for" not in text_of_notes(warm_up=1, temperature=True)


def test_weight_and_pretension_are_noted_where_the_sheet_states_them(sheet):
    vertical = replace(sheet, orientation="vertical", inclination=math.pi / 2)
    upright = " ".join(notes(PLAN, vertical, expected_cells(PLAN, vertical)))
    assert "1294 N, 2.16 times the nominal preload" in upright
    stretched = replace(sheet, support="fixed-fixed", bearing=Bearing(160e6, pretension=300.0))
    sentence = " ".join(notes(PLAN, stretched, expected_cells(PLAN, stretched)))
    assert "pretension of 300 N is used up by a nut load of" in sentence
    assert concerns_of(PLAN, stretched) == concerns_of(PLAN, sheet)


def test_a_plan_that_uses_up_the_pretension_is_warned_of_with_the_acceleration_that_does_not(sheet):
    slack = replace(sheet, support="fixed-fixed", bearing=Bearing(160e6, pretension=200.0))
    (text,) = [text for text in concerns_of(PLAN, slack) if "unloads an end" in text]
    acceleration = number(r"an acceleration of (\S+) m/s\^2 or less", text)
    slower = moved(acceleration=acceleration)
    assert not any("unloads an end" in text for text in concerns_of(slower, slack))
    faster = moved(acceleration=1.1 * acceleration)
    assert any("unloads an end" in text for text in concerns_of(faster, slack))
    weak = replace(slack, bearing=Bearing(160e6, pretension=10.0))
    assert any("no acceleration helps: stretch the screw" in text for text in concerns_of(PLAN, weak))


def test_a_window_that_is_not_filled_is_noted_and_one_too_short_is_warned_of(sheet):
    def noted(plan):
        return any(
            "between the two blows" in text for text in notes(plan, sheet, expected_cells(plan, sheet))
        )

    assert noted(PLAN), "7.5 periods"
    assert not noted(Plan((0.0, 0.45), 3, (100.0,), (replace(BENCH, speed=0.3),))), "14.8"
    assert not noted(moved(speed=0.05)), "2.6 are warned of"
    assert kinds(moved(speed=0.05), sheet) == {"short"}


def test_limits_of_the_machine_are_no_concern_here(sheet):
    assert concerns_of(PLAN, replace(sheet, limits=Limits(0.1, 0.2, 0.01, 0.1))) == ()


def test_the_warnings_do_not_depend_on_the_order_of_the_loads(sheet):
    plan = replace(moved(jerk=375.0), masses=(0.0, 100.0))
    other = replace(plan, masses=(100.0, 0.0))
    assert len(concerns_of(plan, sheet)) == len(concerns_of(other, sheet)) == 1


def test_a_stop_that_leaves_the_nut_no_room_is_told(sheet):
    near = Plan((-0.079, 0.2, 0.57), 1, (0.0,), (BENCH,))
    text_of_notes = " ".join(notes(near, sheet, expected_cells(near, sheet)))
    assert "the stop at -79 mm is 1 mm from the thrust bearing" in text_of_notes
    assert "the stop at 570 mm is 0 mm from the screw's far end" in text_of_notes
    far = Plan((0.0, 0.2, 0.45), 1, (0.0,), (BENCH,))
    assert "nut's own length" not in " ".join(notes(far, sheet, expected_cells(far, sheet)))


def test_an_acceleration_that_is_never_reached_is_told(sheet):
    slow = Plan((0.0, 0.2), 1, (0.0,), (Motion(0.05, 10.0, 500.0, 0.35),))
    text_of_notes = " ".join(notes(slow, sheet, expected_cells(slow, sheet)))
    assert "motion 0 asks for 10 m/s^2, and reaches 5 m/s^2" in text_of_notes


def test_a_rigidity_of_unknown_convention_and_a_spring_are_noted(sheet):
    def noted(**screw):
        changed = replace(sheet, screw=replace(sheet.screw, **screw))
        return " ".join(notes(PLAN, changed, expected_cells(PLAN, changed)))

    assert "rigidity_convention" not in noted()
    assert "rigidity_convention" in noted(rigidity_convention="unknown", rigidity_preload_ratio=None)
    assert "preloaded by a spring" in noted(preload_by="spring")


def test_a_nut_with_a_spring_loses_contact_at_a_load_of_its_preload(sheet):
    spring = replace(sheet, screw=replace(sheet.screw, preload_by="spring"))
    faster = moved(acceleration=4.5)
    assert "is 1.03 times the nominal preload of 600 N and unloads the nut (1.00 P)" in about(
        "load", faster, spring
    )
    slower = moved(
        acceleration=number(r"an acceleration of (\S+) m/s\^2 or less", about("load", PLAN, spring))
    )
    assert "load" not in kinds(slower, spring)
    assert "unloads the nut (1.00 P) at" in " ".join(notes(slower, spring, expected_cells(slower, spring)))
    assert "loses contact at a load of P" in two_levels(PLAN, spring).reason


def test_a_weight_is_compared_with_the_lowest_preload_of_the_plan(sheet):
    vertical = replace(sheet, orientation="vertical", inclination=math.pi / 2)
    plan = replace(PLAN, preloads=(600.0, 431.0))
    upright = " ".join(notes(plan, vertical, expected_cells(plan, vertical)))
    assert "1294 N, 3.00 times the lowest preload" in upright
