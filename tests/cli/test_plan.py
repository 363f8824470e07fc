"""``ballscrew plan``: what it prints, writes and refuses."""

from __future__ import annotations

import json
import re

import pytest

from ballscrew.fcft.plan import read_plan

AXIS = ("--axis", "axis.toml")


def edit(folder, name, old, new):
    text = (folder / name).read_text(encoding="utf-8")
    assert old in text
    (folder / name).write_text(text.replace(old, new), encoding="utf-8")


def test_it_prints_cells_time_and_every_stop(say):
    outcome = say("plan.toml", *AXIS)
    assert (outcome.status, outcome.err) == (0, "")
    assert "20 cells" in outcome.out
    assert "2 round trips" in outcome.out
    for stop in ("0.0", "30.0", "150.0"):
        assert re.search(rf"│ +{stop} │", outcome.out)
    assert "Two acceleration levels" in outcome.out
    assert "No problems found." in outcome.out


def test_json_holds_the_document_alone(say, folder):
    outcome = say("plan.toml", *AXIS, "--json", "--gcode", "a.nc")
    document = json.loads(outcome.out)
    assert len(document["cells"]) == 20
    assert (folder / "a.nc").is_file()


def test_it_writes_what_is_asked_for(say, folder):
    pytest.importorskip("matplotlib")
    outcome = say(
        "plan.toml", *AXIS, "--plot", "a.png", "--gcode", "a.nc", "--csv", "a.csv", "--levels", "b.toml",
        "--gentle", "g.toml",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert (folder / "a.png").stat().st_size > 10_000
    assert {path.name for path in folder.glob("a*.nc")} == {"a.nc", "a-dry-run.nc"}
    assert (folder / "a.csv").stat().st_size > 1000
    assert "a-dry-run.nc" in outcome.out
    two = read_plan(folder / "b.toml")
    assert len(two.motions) == 2
    assert two.positions == pytest.approx(read_plan(folder / "plan.toml").positions)
    (gentle,) = read_plan(folder / "g.toml").motions
    assert gentle.acceleration < read_plan(folder / "plan.toml").motions[0].acceleration
    assert "A gentler motion" in outcome.out
    again = say("b.toml", *AXIS)
    assert "40 cells" in again.out
    assert re.search(r"┃ +motion +┃", again.out)
    assert "No problems found." in again.out


def test_a_null_on_the_mode_is_a_warning(say, folder):
    edit(folder, "plan.toml", "1500 m/s^3", "400 m/s^3")
    outcome = say("plan.toml", *AXIS)
    assert outcome.status == 0
    assert "Warning: the motion: the torque has a null at 160.0 Hz" in outcome.out


def test_a_limit_of_the_machine_stops_the_export_and_not_the_report(say, folder):
    with (folder / "axis.toml").open("a", encoding="utf-8") as stream:
        stream.write('limits.speed = "100 mm/s"\n')
    outcome = say("plan.toml", *AXIS, "--gcode", "a.nc", "--csv", "a.csv", "--levels", "b.toml")
    assert outcome.status == 2
    assert "20 cells" in outcome.out
    assert "limits.speed of axis.toml allows 0.1 m/s" in outcome.err
    assert "nothing was exported" in outcome.err
    assert not [*folder.glob("a*.nc"), *folder.glob("a.csv")]


def test_a_plan_that_leaves_the_screw_is_refused(say, folder):
    edit(folder, "plan.toml", 'stop = "150 mm"', 'stop = "900 mm"')
    outcome = say("plan.toml", *AXIS, "--gcode", "a.nc", "--csv", "a.csv")
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
    assert "which is not on the screw of axis.toml" in outcome.err
    assert not [*folder.glob("a*")] or {path.name for path in folder.glob("a*")} == {"axis.toml"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("no.toml", *AXIS), "no.toml: cannot be read"),
        (("plan.toml",), "--axis"),
        (("plan.toml", "--axis", "plan.toml"), "plan.toml: positions is not a known field"),
        (("plan.toml", *AXIS, "--gcode", "no/a.nc"), "no/a.nc: cannot be written"),
        (("plan.toml", *AXIS, "--gcode", "a.nc", "--dialect", "latin"), "latin"),
        (("plan.toml", *AXIS, "--gcode", "a.nc", "--axis-word", "F"), "'F'"),
        (("plan.toml", *AXIS, "--csv", "a.csv", "--rate", "1 kg"), "1 kg"),
        (("plan.toml", *AXIS, "--csv", "a.csv", "--rate", "0 Hz"), "rate"),
        (("plan.toml", *AXIS, "--csv", "a.x", "--gcode", "a.x"), "same name"),
        (("plan.toml", *AXIS, "--gcode", "plan.toml"), "plan.toml: is an input"),
        (("plan.toml", *AXIS, "--levels", "axis.toml"), "axis.toml: is an input"),
        (("plan.toml", *AXIS, "--csv", "a-dry-run.nc", "--gcode", "a.nc"), "same name"),
        (("plan.toml", *AXIS, "--gcode", "."), "cannot be written"),
        (("plan.toml", *AXIS, "--plot", "a.doc"), "must end in .png"),
    ],
)
def test_bad_input_is_one_sentence_and_no_file(say, folder, arguments, message):
    before = set(folder.iterdir())
    outcome = say(*arguments)
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
    assert message in outcome.err.replace("\\", "/")
    assert "Traceback" not in outcome.err
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize("more", [("--dialect", "FANUC"), ("--rate", "0 Hz"), ("--axis-word", "A")])
def test_a_wrong_option_is_refused_before_anything_is_printed(say, more):
    outcome = say("plan.toml", *AXIS, *more)
    assert (outcome.status, outcome.out) == (2, "")


def test_two_levels_that_cannot_be_had_stop_everything(say, folder):
    edit(folder, "axis.toml", 'guide.friction = "25 N"', 'guide.friction = "400 N"')
    outcome = say("plan.toml", *AXIS, "--levels", "b.toml", "--gcode", "a.nc", "--csv", "a.csv")
    assert (outcome.status, outcome.out) == (2, "")
    assert "there are no two suitable acceleration levels" in outcome.err
    assert {path.name for path in folder.iterdir()} == {"axis.toml", "plan.toml"}


def test_a_plan_with_preloads_prints_its_runs_and_what_they_determine(say, folder):
    text = (folder / "plan.toml").read_text(encoding="utf-8")
    (folder / "two.toml").write_text('preloads = ["600 N", "300 N"]\n' + text, encoding="utf-8")
    outcome = say("two.toml", "--axis", "axis.toml", "--plot", "two.svg")
    assert (outcome.status, outcome.err) == (0, "")
    for preload in (600, 300):
        assert re.search(rf"│ +{preload} │ +0\.0 │", outcome.out)
    words = " ".join(outcome.out.split())
    assert "2 runs: 1 load at 2 preloads (600, 300 N)" in words
    assert "determine 3 of 4 parameters" in words
    assert "1 load does not determine the moving mass" in words
    assert "state that of every run: --known-preload RUN.json=600N" in words
    document = json.loads(say("two.toml", "--axis", "axis.toml", "--json").out)
    assert document["runs"] == [{"preload_N": p, "mass_kg": 100} for p in (600, 300)]
    assert document["total_s"] == pytest.approx(2 * document["duration_s"])
    first, last = document["cells"][0], document["cells"][-1]
    assert abs(last["nut_load_N"]) / last["nut_load_ratio"] == pytest.approx(300)
    assert first["preload_N"] == pytest.approx(600)
    best = json.loads(say("two.toml", "--axis", "axis.toml", "--optimize", "--adjust", "5 min", "--json").out)
    assert best["optimized"]["plan"]["preloads"] == [300, 600]
    (folder / "high.toml").write_text('preloads = ["600 N", "9 kN"]\n' + text, encoding="utf-8")
    refused = say("high.toml", "--axis", "axis.toml")
    assert refused.status == 2
    assert "cannot have" in refused.err


def test_the_settings_of_a_trace(say):
    plain = say("plan.toml", *AXIS, "--trace").out
    document = json.loads(say("plan.toml", *AXIS, "--json").out)
    trace, cells = document["trace"], document["cells"]
    highest = max(cell["frequency_Hz"] + 2 * cell["standard_uncertainty_Hz"] for cell in cells)
    assert trace["sample_rate_Hz"] == pytest.approx(10 * highest)
    assert trace["interval_s"] <= 1 / trace["sample_rate_Hz"] < 2 * trace["interval_s"]
    assert trace["record_s"] == [pytest.approx(document["motions"][0]["trip_s"] + 2)]
    text = " ".join(plain.split())
    assert f"rate: {trace['sample_rate_Hz']:.0f} Hz or more" in text
    assert f"an interval of {1e3 * trace['interval_s']:g} ms" in text
    assert "$AA_SCTRACE" not in text
    assert "$AA_SCTRACE[X]=1" in say("plan.toml", *AXIS, "--trace", "--dialect", "siemens").out
    assert "Trace by the drive" not in say("plan.toml", *AXIS).out


def test_round_trips_that_warm_up_are_named(say, folder):
    assert "warm up" not in say("plan.toml", *AXIS).out
    edit(folder, "plan.toml", "repetitions = 2", "repetitions = 2\nwarm_up = 1")
    assert "3 round trips, 1 of them to warm up: " in say("plan.toml", *AXIS).out


def test_a_long_table_has_its_first_and_its_last_rows(say, folder):
    assert "…" not in re.findall(r"^│ +(\S+) │", say("plan.toml", *AXIS).out, re.MULTILINE)
    edit(folder, "plan.toml", '["100 kg"]', '["0 kg", "20 kg", "40 kg", "80 kg", "100 kg"]')
    rows = re.findall(r"^│ +(\S+) │ +(\S+) │", say("plan.toml", *AXIS).out, re.MULTILINE)
    loads = ["0", "20", "…", "80", "100"]
    assert [load for load, _ in rows] == [load for load in loads for _ in range(1 if load == "…" else 6)]
    assert rows[12] == ("…", "…")
    assert [stop for _, stop in rows[13:19]] == ["0.0", "30.0", "60.0", "90.0", "120.0", "150.0"]


def test_a_table_fits_a_terminal_and_has_no_column_of_a_single_load(say, folder):
    single = say("plan.toml", *AXIS).out
    assert "Prediction for each stop, rotor free, load 100 kg" in single
    table = [line for line in single.splitlines() if line.startswith(("┃", "│"))]
    assert max(len(line) for line in table) <= 80
    assert "load ┃" not in table[0]
    assert "PD PA NA ND" in single
    edit(folder, "plan.toml", '["100 kg"]', '["0 kg", "100 kg"]')
    several = say("plan.toml", *AXIS).out
    assert "┃ load ┃" in several
    assert "…" not in several


def test_where_friction_alone_unloads_the_nut_no_motion_is_gentler(say, folder):
    edit(folder, "axis.toml", 'guide.friction = "25 N"', 'guide.friction = "700 N"')
    reason = "friction and weight alone (700 N) unload the nut at 41% of its preload"
    assert f"no motion is gentler: {reason}." in " ".join(say("plan.toml", *AXIS).out.split())
    outcome = say("plan.toml", *AXIS, "--gentle", "g.toml")
    assert outcome.status == 2
    assert f"g.toml: cannot be written: no motion is gentler, since {reason}." in outcome.err
    assert not (folder / "g.toml").exists()


def test_on_an_inclined_axis_the_loads_of_both_departures_are_printed(say, folder):
    name = 'name = "synthetic"'
    edit(folder, "axis.toml", name, f'{name}\norientation = "inclined"\ninclination = "5 deg"')
    words = " ".join(say("plan.toml", *AXIS).out.split())
    loads = re.findall(r"nut load (\S+) of the preload in PA, (\S+) in NA", words)
    assert len(loads) == 2
    assert all(float(first) > float(second) for first, second in loads)
