from __future__ import annotations

import itertools
import re
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from tests.fcft.controller import Block, blocks, move_time

from ballscrew.axis.sheet import Limits
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.gcode import gcode, write_gcode
from ballscrew.fcft.plan import Motion, Plan, read_plan
from ballscrew.fcft.profile import route
from ballscrew.fcft.schedule import duration, trips

DIALECTS = ("iso", "fanuc", "siemens")
SPREAD = ('dwell = "350 ms"', 'dwell = "350 ms"\njerk_spread = 0.3\nstart_spread = "50 ms"')


def text(lines):
    return "".join(f"{line}\n" for line in lines)


def feeds(program):
    return [block.feed for block in program if block.kind == "move"]


def remarks(lines):
    return " ".join(line.strip("();").strip() for line in lines if line[0] in "(;").replace(" ... ", " ")


def run(program, plan):
    """Time after the first stop is reached, with the settings that the plan wants for each trip."""
    moves = [block for block in program if block.kind == "move"]
    here, seconds, done = moves[0].to, 0.0, 0
    trip, per_trip = trips(plan), len(route(plan)) - 1
    for block in program[program.index(moves[0]) + 1 :]:
        if block.kind == "move":
            motion = trip[done // per_trip].executed
            seconds += move_time(round(abs(block.to - here), 9), block.feed, motion.acceleration, motion.jerk)
            here, done = block.to, done + 1
        seconds += block.seconds
    return seconds


def visits_every_stop_in_order(program, plan):
    moves = [block.to for block in program if block.kind == "move"]
    wanted = [plan.positions[0]] + [stop for _ in trips(plan) for stop in route(plan)[1:]]
    assert moves == pytest.approx(wanted, abs=0.51e-7)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_bench_through_a_parser_of_another_make(bench, tmp_path, dialect):
    plan, sheet = read_plan(bench / "plan.toml"), read_axis(bench / "axis.toml")
    path, _ = write_gcode(plan, sheet, tmp_path / "bench.ngc", dialect=dialect)
    program = blocks(path.read_text(encoding="ascii"), dialect)
    visits_every_stop_in_order(program, plan)
    assert run(program, plan) == pytest.approx(duration(plan), rel=0.001)  # 2 % are asked for
    assert feeds(program)[1:] == pytest.approx([0.15] * 60)
    assert {round(block.seconds, 9) for block in program if block.kind == "dwell"} == {0.35}


def test_each_trip_stands_at_the_first_stop_before_and_after(read, sheet):
    kinds = [block.kind for block in blocks(text(gcode(read(), sheet)))]
    trip = ["dwell", *(["move", "dwell"] * 20)]
    assert kinds == ["move", *(trip * 3)]


def test_it_goes_to_the_first_stop_slowly(read, sheet):
    first = blocks(text(gcode(read(), sheet)))[0]
    assert first == Block("move", 0.0, pytest.approx(0.015))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_dry_run(read, sheet, dialect):
    plan = read()
    lines = list(gcode(plan, sheet, dialect=dialect, dry_run=True))
    program = blocks(text(lines), dialect)
    moves = [block for block in program if block.kind == "move"]
    assert [block.to for block in moves] == pytest.approx([0.0, *route(plan)[1:]])
    assert feeds(program) == pytest.approx([0.015] * 21)
    assert "dry run" in remarks(lines).lower()


def test_the_dry_run_is_never_faster_than_20_mm_per_second(read, sheet):
    plan = read(('speed = "150 mm/s"', 'speed = "300 mm/s"'))
    program = blocks(text(gcode(plan, sheet, dry_run=True)))
    assert feeds(program) == pytest.approx([0.020] * 21)
    slow = replace(plan, motions=(*plan.motions, replace(plan.motions[0], speed=0.05)))
    program = blocks(text(gcode(slow, sheet, dry_run=True)))
    assert feeds(program) == pytest.approx([0.005] * 21)


def test_the_blocks_of_each_dialect(read, sheet):
    plan = read()
    iso, fanuc, siemens = (list(gcode(plan, sheet, dialect=dialect)) for dialect in DIALECTS)
    assert "G4 P0.350" in iso
    assert "G04 P350" in fanuc
    assert "G4 F0.350" in siemens
    assert iso[0] == fanuc[0] == iso[-1] == fanuc[-1] == "%"
    assert fanuc[1] == "O1000"
    assert (siemens[0][:2], siemens[-1]) == ("; ", "M30")
    assert "G710" in siemens
    assert "G21" not in siemens
    assert all("G1 X45.0000 F9000.000" in lines for lines in (iso, fanuc, siemens))
    assert not re.search(r"\([^)]*[a-z]", text(fanuc))


def test_positions_below_zero_and_no_minus_zero(read, sheet):
    start = 'positions = { start = "0 mm", stop = "450 mm", step = "45 mm" }'
    lines = list(gcode(read((start, 'positions = ["-45 mm", "-0.00001 mm", "45.12346 mm"]')), sheet))
    words = {line.split()[1] for line in lines if line.startswith("G1")}
    assert words == {"X-45.0000", "X0.0000", "X45.1235"}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_without_a_dwell_the_axis_stops_all_the_same(read, sheet, dialect):
    plan = read(('dwell = "350 ms"', "dwell = 0"))
    program = blocks(text(gcode(plan, sheet, dialect=dialect)), dialect)
    for here, after in itertools.pairwise(program):
        assert not here.kind == after.kind == "move"
    assert {block.seconds for block in program if block.kind == "dwell"} == {0.001}


def test_a_varied_test_tells_and_stops_for_the_operator(read, sheet):
    plan = read(SPREAD)
    lines = list(gcode(plan, sheet))
    program = blocks(text(lines))
    visits_every_stop_in_order(program, plan)
    assert run(program, plan) == pytest.approx(duration(plan), rel=0.001)
    assert [block.kind for block in program].count("stop") == 2  # the first has the nominal jerk
    jerks = [trip.executed.jerk for trip in trips(plan)]
    assert len(set(jerks)) == 3
    comments = re.findall(r"trip \d of 3, repetition (\d), motion 0: .*?jerk ([\d.]+) m/s3", remarks(lines))
    assert [(int(k), float(jerk)) for k, jerk in comments] == [
        (k, pytest.approx(jerk, rel=1e-4)) for k, jerk in enumerate(jerks, start=1)
    ]
    assert "Acceleration or jerk change 2 times" in remarks(lines)


def test_where_only_the_start_is_varied_nobody_is_stopped(read, sheet):
    lines = list(gcode(read(('dwell = "350 ms"', 'dwell = "350 ms"\nstart_spread = "50 ms"')), sheet))
    program = blocks(text(lines))
    assert "stop" not in {block.kind for block in program}
    assert len({block.seconds for block in program if block.kind == "dwell"}) == 3
    assert "The dwell is varied" in remarks(lines)


def test_the_header_says_what_it_does(read, sheet):
    plan = replace(read(), warm_up=2, temperature=True, masses=(0.0, 100.0))
    guarded = replace(sheet, limits=Limits(lowest_position=-0.01, torque=5.0))
    comments = remarks(list(gcode(plan, guarded)))
    for words in (
        "axis: bench, data sheet axis.toml",
        "plan: plan.toml",
        "stops: 11, from 0 to 450 mm, 45 mm apart",
        "motion 0: speed 150 mm/s, acceleration 2.5 m/s2, jerk 1500 m/s3, dwell 0.35 s",
        "ACCELERATION AND JERK cannot be set in ISO 6983: set them in the controller",
        "trips: 5 round trips, the first 2 to warm up",
        "load on the table: 0, 100 kg, one run for each",
        f"time of one run: {duration(plan):.1f} s",
        "nut load 355 N, motor torque 1.41 N m",
        "TEMPERATURE: the plan asks for it",
        "RUN THE DRY RUN FIRST",
        "checked: travel of the screw, without the length of the nut, lower soft limit, torque",
        "NOT CHECKED, for the data sheet does not state it: upper soft limit, speed",
        "trip 1 of 5, warm-up, motion 0",
        "trip 3 of 5, repetition 1, motion 0",
    ):
        assert words in comments, words


HOSTILE = (
    "a)\nG0 X9999\n(b", "%", "(((", ")", "x\rM30", "x\u2028G1 X1 F1", "; G1 X9999", "Größe µ ² \u202e",
    "MSG, x", "y" * 50 + " LOGOPEN,/tmp/x.txt " * 9, "\x00\x1a\x7f", "'\"`$PATH=/x", "{number}",
    " " * 200 + "x",
)  # fmt: skip


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("name", HOSTILE)
def test_no_name_breaks_out_of_its_comment(read, sheet, name, dialect):
    plan = replace(read(), source=name)
    hostile = replace(sheet, name=name, source=name)
    for dry_run in (False, True):
        got = text(gcode(plan, hostile, dialect=dialect, dry_run=dry_run))
        assert blocks(got, dialect) == blocks(
            text(gcode(read(), sheet, dialect=dialect, dry_run=dry_run)), dialect
        )
        # What LinuxCNC would obey must never begin a comment.
        assert not re.search(r"\(\s*(MSG|DEBUG|PRINT|LOG|PROBE|PY|ABORT)", got, re.IGNORECASE)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
@given(name=st.text(max_size=90))
@example("\x85G0 X5")
def test_any_name_at_all(sheet, name):
    plan = Plan((0.0, 0.1), 1, (0.0,), (Motion(0.1, 2.0, 500.0, 0.1),), source=name)
    for dialect in DIALECTS:
        got = blocks(text(gcode(plan, replace(sheet, name=name), dialect=dialect)), dialect)
        assert [block.kind for block in got] == ["move", "dwell", "move", "dwell", "move", "dwell"]


@st.composite
def plans(draw):
    """A plan that the axis of these tests can do."""
    motions = draw(
        st.lists(
            st.builds(
                Motion,
                st.floats(0.01, 0.5),
                st.floats(0.5, 20),
                st.floats(50, 5000),
                st.sampled_from([0.05, 0.35, 1.2345]),
                st.sampled_from([0.0, 0.3, 1.0]),
                st.sampled_from([0.0, 0.07]),
            ),
            min_size=1,
            max_size=2,
        )
    )
    # The lowest jerk of a spread needs the longest way.
    least = max(2 * replace(m, jerk=m.jerk / (1 + m.jerk_spread)).acceleration_distance for m in motions)
    gaps = draw(st.lists(st.floats(1.0, 3.0), min_size=1, max_size=5))
    stops = tuple(itertools.accumulate((gap * least for gap in gaps), initial=draw(st.floats(-0.07, 0))))
    if stops[-1] > 0.57:
        stops = (-0.07, 0.56)
        motions = [Motion(0.05, 1.0, 100.0, 0.1)]
    return Plan(stops, draw(st.integers(1, 3)), (50.0,), tuple(motions), warm_up=draw(st.integers(0, 2)))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(plan=plans(), dialect=st.sampled_from(DIALECTS), axis=st.sampled_from("XYZ"))
def test_any_plan_visits_its_stops_in_its_time(sheet, plan, dialect, axis):
    program = blocks(text(gcode(plan, sheet, dialect=dialect, axis_word=axis)), dialect, axis)
    visits_every_stop_in_order(program, plan)
    assert run(program, plan) == pytest.approx(duration(plan), rel=0.02)


UNSAFE = [
    ({}, ('stop = "450 mm"', 'stop = "585 mm"'), "positions has 0.585 m, .*screw"),
    ({"highest_position": 0.44}, None, "positions has 0.45 m; limits.highest_position .* allows 0.44 m"),
    ({"lowest_position": 0.01}, None, "positions has 0 m; limits.lowest_position of axis.toml allows 0.01"),
    ({"speed": 0.1}, None, "motion.speed is 0.15 m/s; limits.speed of axis.toml allows 0.1 m/s"),
    ({"torque": 1.0}, None, "motion needs a torque of 1.41 N m with a load of 100 kg; limits.torque"),
]  # fmt: skip


@pytest.mark.parametrize(("limits", "change", "message"), UNSAFE)
def test_an_unsafe_plan_is_not_exported(read, sheet, tmp_path, limits, change, message):
    plan = read(*([change] if change else []))
    folder = tmp_path / "out"
    folder.mkdir()
    with pytest.raises(InputError, match=rf"^plan\.toml: {message}") as error:
        write_gcode(plan, replace(sheet, limits=Limits(**limits)), folder / "a.ngc")
    assert error.value.exit_status == 2
    assert list(folder.iterdir()) == []
    with pytest.raises(InputError):  # at the call, not when the first line is asked for
        gcode(plan, replace(sheet, limits=Limits(**limits)))


def test_an_unsafe_plan_leaves_the_old_program_alone(read, sheet, tmp_path):
    (tmp_path / "a.ngc").write_text("old", encoding="ascii")
    with pytest.raises(InputError):
        write_gcode(read(), replace(sheet, limits=Limits(speed=0.01)), tmp_path / "a.ngc")
    assert (tmp_path / "a.ngc").read_text(encoding="ascii") == "old"


def test_the_dry_run_lies_beside_the_program(read, sheet, tmp_path):
    (tmp_path / "a.b.ngc").write_text("old", encoding="ascii")
    got = write_gcode(read(), sheet, str(tmp_path / "a.b.ngc"))
    assert got == (tmp_path / "a.b.ngc", tmp_path / "a.b-dry-run.ngc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.b-dry-run.ngc", "a.b.ngc", "plan.toml"]
    assert "DRY RUN of" in got[1].read_text(encoding="ascii")
    assert "DRY RUN of" not in got[0].read_text(encoding="ascii")
    assert b"\r" not in got[0].read_bytes()


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("none/a.ngc", "cannot be written"),
        (".", "is a folder"),
        ("", "is a folder"),
        ("/", "is a folder"),
        ("taken", "is a folder"),
        ("beside.ngc", "beside-dry-run.ngc: is a folder"),
        ("a\x00.ngc", "cannot be written"),
        ("y" * 300, "cannot be written"),
        ("plan.toml/a.ngc", "cannot be written"),
    ],
)
def test_a_place_that_cannot_be_written(read, sheet, tmp_path, monkeypatch, path, message):
    monkeypatch.chdir(tmp_path)
    plan = read()
    (tmp_path / "taken").mkdir()
    (tmp_path / "beside-dry-run.ngc").mkdir()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match=message):
        write_gcode(plan, sheet, path)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_full_disk_leaves_nothing_behind(read, sheet, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    plan = read()
    monkeypatch.setattr("ballscrew.fcft.gcode._trips", full)
    with pytest.raises(InputError, match=r"a\.ngc: cannot be written \(No space left on device\)\."):
        write_gcode(plan, sheet, tmp_path / "a.ngc")
    assert [path.name for path in tmp_path.iterdir()] == ["plan.toml"]


@pytest.mark.parametrize("word", ["", "XY", "x ", "G", "F", "I", "1", "X1", "X\n", "É", None, 3, "X(", "-X"])
def test_an_axis_word_that_is_none(read, sheet, word):
    with pytest.raises(
        InputError, match=r"the axis word is .*; in the dialect 'iso' it must be one of X, Y,"
    ):
        gcode(read(), sheet, axis_word=word)


@pytest.mark.parametrize(
    ("dialect", "word"), [("iso", "A"), ("siemens", "C1"), ("fanuc", "U"), ("fanuc", "W")]
)
def test_a_word_that_turns_or_counts_from_where_it_is(read, sheet, dialect, word):
    with pytest.raises(InputError, match=f"the axis word is '{word}'; in the dialect '{dialect}'"):
        gcode(read(), sheet, dialect=dialect, axis_word=word)


@pytest.mark.parametrize(
    ("dialect", "unit"),
    [("iso", "P in seconds"), ("fanuc", "P IN MILLISECONDS"), ("siemens", "F in seconds")],
)
def test_the_header_says_what_a_dwell_is_told_in(read, sheet, dialect, unit):
    for dry_run in (False, True):
        assert unit in remarks(list(gcode(read(), sheet, dialect=dialect, dry_run=dry_run)))


def test_axis_words(read, sheet):
    plan = read()
    assert "G1 Z45.0000 F9000.000" in list(gcode(plan, sheet, axis_word="z"))
    assert "G1 X1=45.0000 F9000.000" in list(gcode(plan, sheet, axis_word="X1", dialect="siemens"))
    with pytest.raises(InputError, match="X1"):
        gcode(plan, sheet, axis_word="X123", dialect="siemens")


@pytest.mark.parametrize("dialect", ["ISO", "heidenhain", "", None, ["iso"]])
def test_a_dialect_that_is_not_known(read, sheet, dialect):
    with pytest.raises(InputError, match=r"the dialect is .*; it must be one of iso, fanuc, siemens"):
        gcode(read(), sheet, dialect=dialect)


def test_stops_that_a_program_cannot_tell_apart(sheet):
    plan = Plan((0.0, 1e-8), 1, (0.0,), (Motion(1e-6, 1e4, 1e9, 0.1),))
    with pytest.raises(InputError, match=r"stops less than 0\.1 um apart"):
        gcode(plan, sheet)


def test_a_program_that_no_controller_would_hold(read, sheet):
    with pytest.raises(InputError, match=r"a program of 1050000 blocks; they must make 1000000 or fewer"):
        gcode(replace(read(), repetitions=25_000), sheet)


def test_the_header_has_the_preloads_of_the_nut_and_the_torque_of_the_highest(read, sheet):
    plain = remarks(list(gcode(read(), sheet)))
    assert "preload of the nut" not in plain
    plans = [replace(read(), preloads=preloads) for preloads in ((300.0,), (300.0, 900.0))]
    low, high = (remarks(list(gcode(plan, sheet))) for plan in plans)
    assert "preload of the nut: 300, 900 N, each with every load" in high
    assert "preload of the nut: 300 N, each with every load" in low
    torques = [float(re.search(r"motor torque ([\d.]+) N m", text)[1]) for text in (low, plain, high)]
    assert torques == sorted(set(torques))  # the nominal preload is 600 N
