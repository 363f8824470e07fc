"""``ballscrew simulate``: its files go straight into ``analyze``."""

from __future__ import annotations

import json

import pytest
from tests.cli.conftest import FILES


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in ("axis.toml", "plan.toml"):
        (tmp_path / name).write_text(FILES[name], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


ARGUMENTS = ("simulate", "run", "plan.toml", "--axis", "axis.toml")


def test_it_names_the_next_command(ballscrew, folder):
    outcome = ballscrew(*ARGUMENTS, "--out", "new", "--seed", 4)
    assert (outcome.status, outcome.err) == (0, "")
    assert "2 recordings" in outcome.out
    assert outcome.out.splitlines()[
        -1
    ] == f"Next: ballscrew analyze {folder.joinpath('new').name}/run.toml".replace(
        "/", "\\" if "\\" in outcome.out else "/"
    )


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_what_it_writes_can_be_analysed(ballscrew):
    assert ballscrew(*ARGUMENTS, "--out", "new", "--seed", 4).status == 0
    assert ballscrew("analyze", "new/run.toml").status == 0


def test_json_tells_the_truth(ballscrew, folder):
    outcome = ballscrew(*ARGUMENTS, "--out", "worn", "--preload", "300 N", "--mass", "80 kg", "--json")
    document = json.loads(outcome.out)
    assert document["truth"]["preload_N"] == 300.0
    assert document["truth"]["load_kg"] == 80.0
    assert len(document["recordings"]) == 2
    assert document["truth"] == json.loads((folder / "worn" / "truth.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--preload", "3 kg"), "--preload is '3 kg'"),
        (("--preload", "-3 N"), "--preload is '-3 N'; it must be 0 N or more"),
        (("--preload", "50 kN"), "must be at most the dynamic load rating of the data sheet"),
        (("--mass", "heavy"), "--mass is 'heavy'"),
        (("--backlash", "1 um"), "backlash"),
        (("--out", "plan.toml"), "cannot be written"),
        (("--seed", "-1"), "--seed"),
        (("--warmer", "5 N"), "--warmer is '5 N'"),
        (("--warmer", "20 degC"), "It is a temperature difference"),
    ],
)
def test_bad_input_is_one_sentence(ballscrew, folder, more, message):
    outcome = ballscrew(*ARGUMENTS, *more)
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
    assert message in outcome.err
    assert not (folder / "simulated").exists()


def test_several_loads_must_be_chosen_from(ballscrew, folder):
    text = (folder / "plan.toml").read_text(encoding="utf-8").replace('["100 kg"]', '["0 kg", "100 kg"]')
    (folder / "plan.toml").write_text(text, encoding="utf-8")
    outcome = ballscrew(*ARGUMENTS)
    assert outcome.status == 2
    assert "choose one with --mass" in outcome.err


def test_multi_level_mass(ballscrew, folder):
    outcome = ballscrew(
        "simulate", "multi-level-mass", "--axis", "axis.toml", "--plan", "plan.toml",
        "--loads", "20 kg, 60 kg", "--repetitions", 1, "--out", "masses",
    )  # fmt: skip
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith("2 recordings, ")
    document = json.loads((folder / "masses" / "experiment.json").read_text(encoding="utf-8"))
    assert [run["load_kg"] for run in document["runs"]] == [20.0, 60.0]
    heavy = folder / "masses" / document["runs"][1]["run"]
    assert 'load = "60 kg"' in heavy.read_text(encoding="utf-8")
    assert outcome.out.splitlines()[-1].startswith("Next: ballscrew analyze masses")
    light, loaded = (run["truth"]["axial_natural_frequency_Hz"] for run in document["runs"])
    assert all(light[place] > loaded[place] for place in light)


def test_run_to_failure(ballscrew, folder):
    outcome = ballscrew(
        "simulate", "run-to-failure", "--axis", "axis.toml", "--plan", "plan.toml",
        "--days", 40, "--every", 13, "--repetitions", 1, "--out", "life", "--json",
    )  # fmt: skip
    assert (outcome.status, outcome.err) == (0, "")
    runs = json.loads(outcome.out)["runs"]
    assert [run["run"] for run in runs] == [f"day-{day:02d}/run.toml" for day in (0, 13, 26, 39)]
    preloads = [run["truth"]["preload_N"] for run in runs]
    assert preloads == sorted(preloads, reverse=True)
    assert runs[-1]["truth"]["backlash_m"] > 0 == runs[-2]["truth"]["backlash_m"]
    assert 'location = "table"' in (folder / "life" / "day-00" / "channels.toml").read_text(encoding="utf-8")
    assert ballscrew("analyze", folder / "life" / "day-13" / "run.toml").status == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("multi-level-mass", "--loads", "5 kg, 5 kg"), "each given once"),
        (("multi-level-mass", "--loads", ""), "--loads is ''"),
        (("run-to-failure", "--mass", "-5 kg"), "--mass is '-5 kg'"),
        (("run-to-failure", "--days", "0"), "number of days of 0"),
        (("run-to-failure", "--every", "90"), "every 90 days"),
        (("run-to-failure", "--repetitions", "0"), "--repetitions"),
        (("run-to-failure", "--plan", "none.toml"), "none.toml"),
        (("run-to-failure", "--out", "plan.toml"), "cannot be written"),
    ],
)
def test_bad_experiments_are_one_sentence(ballscrew, folder, arguments, message):
    outcome = ballscrew("simulate", *arguments)
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
    assert message in outcome.err
    assert {path.name for path in folder.iterdir()} == {"axis.toml", "plan.toml"}
