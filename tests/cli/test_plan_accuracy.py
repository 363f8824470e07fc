"""``ballscrew plan --optimize`` and ``--capability``."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from ballscrew.axis.axial import from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.axis.sheet_file import read_axis
from ballscrew.fcft.plan import read_plan

AXIS = ("--axis", "axis.toml")
LOADS = ("--loads", "0 kg, 25kg, 50 kg, 100 kg")


def test_the_best_plan_is_printed_with_its_accuracy_and_written(say, folder):
    outcome = say("plan.toml", *AXIS, "--optimize", *LOADS, "--change", "5 min", "--out", "best.toml")
    assert (outcome.status, outcome.err) == (0, "")
    assert "20 cells" in outcome.out
    assert "Most information per minute" in outcome.out
    assert re.search(r"nut's share of the compliance │ +\d+ % │ +\d+ % │", outcome.out)
    assert "5 min to change the load" in outcome.out
    best = read_plan(folder / "best.toml")
    assert best.masses[0] == 0.0
    assert best.masses[-1] == 100.0
    assert best.repetitions == 2
    assert say("best.toml", *AXIS).status == 0


def test_json_has_the_answers_beside_the_plan(say, folder):
    outcome = say("plan.toml", *AXIS, "--optimize", *LOADS, "--capability", "--out", "best.toml", "--json")
    document = json.loads(outcome.out)
    assert len(document["cells"]) == 20
    best, shown = document["optimized"], document["capability"]
    assert best["change_minutes"] == 10
    assert best["information_per_minute_ratio"] is None  # the plan has one load
    assert best["candidate_loads_kg"] == [0, 25, 50, 100]
    assert [one["name"] for one in best["chosen"]["accuracy"]][:3] == ["compliance", "slope", "mass"]
    assert [one["runs"] for one in shown["smallest"]] == [1, 3, 10]
    assert (folder / "best.toml").is_file()


def test_without_a_question_there_is_no_answer(say):
    document = json.loads(say("plan.toml", *AXIS, "--json").out)
    assert not {"optimized", "capability"} & set(document)


def test_capability_is_reported_with_its_probabilities(say):
    outcome = say("plan.toml", *AXIS, "--capability")
    assert (outcome.status, outcome.err) == (0, "")
    words = " ".join(outcome.out.split())
    assert "a false alarm in one of 1000 tests, a loss detected in 90 of 100" in words
    assert "none measured yet" in words
    assert len(re.findall(r"│ +100 │ +(?:1|3|10) │", outcome.out)) == 3


def test_a_calibrated_model_is_taken(say, folder):
    calibrated = pytest.importorskip("ballscrew.calibration.calibrated_axis")
    modelfile = pytest.importorskip("ballscrew.calibration.modelfile")
    mean, covariance = prior(read_axis(folder / "axis.toml"), 0.075)
    model = calibrated.CalibratedAxis(
        axis="synthetic",
        model=from_vector(mean, 0.075),
        covariance=covariance / 9,
        free=("compliance",),
        runs=(calibrated.CalibrationRun("a" * 64, 100.0, None, 0, 20),),
        log_ratios=np.zeros(1),
        log_ratio_covariance=np.zeros((1, 1)),
        cross_covariance=np.zeros((7, 1)),
        prior_covariance=covariance,
        chi2=1.0,
        degrees=10.0,
        candidates=(),
        anchors=(),
        load_rating=15e3,
        nut_mass=32.0,
        bearing_share=0.3,
    )
    modelfile.write_model(model, folder / "model.json")
    asked = ("plan.toml", *AXIS, "--optimize", *LOADS)
    plain, known = (say(*asked, *more, "--json").document for more in ((), ("--model", "model.json")))
    assert [one["optimized"]["known_from"] for one in (plain, known)] == ["data sheet", "model"]
    before = [one["optimized"]["given"]["accuracy"][0]["before"] for one in (plain, known)]
    assert before[1] == pytest.approx(before[0] / 3)
    assert re.search(r"┃ +model ┃", say(*asked, "--model", "model.json").out)
    sheet = say("plan.toml", *AXIS, "--capability", "--json").document["capability"]
    outcome = say("plan.toml", *AXIS, "--capability", "--model", "model.json", "--json")
    assert outcome.status == 0, outcome.err
    model = outcome.document["capability"]
    assert model["known_from"] == "model"
    widths = [np.ptp(one["smallest"][0]["interval95"]) for one in (sheet, model)]
    assert widths[1] < 0.5 * widths[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "b.toml"), "--out was given without --optimize"),
        (("--loads", "1 kg"), "--loads was given without --optimize"),
        (("--change", "1 min"), "--change was given without --optimize"),
        (("--model", "m.json"), "--model was given without --optimize or --capability"),
        (("--optimize", "--model", "no.json"), "no.json: cannot be read"),
        (("--optimize", "--model", "plan.toml"), "plan.toml: is not JSON"),
        (("--baseline", "r.json"), "--baseline was given without --capability"),
        (("--optimize", "--loads", "1 m"), "--loads is '1 m'"),
        (("--optimize", "--loads", "5 kg,"), "--loads is ''"),
        (("--optimize", "--loads", "5 kg, 5 kg"), "each given once"),
        (("--optimize", "--loads", "-5 kg"), "a load, in kg, is -5.0; it must be a number, 0 or more"),
        (("--optimize", "--change", "1 kg"), "--change is '1 kg'"),
        (("--optimize", "--change", "-1 min"), "the time to change the load, in minutes, is -1.0"),
        (("--optimize", "--change", "10"), "--change is '10'; state its unit, such as '10 min'"),
        (("--optimize", "--out", "plan.toml"), "plan.toml: is an input"),
        (("--optimize", "--out", "a.nc", "--gcode", "a.nc"), "same name"),
        (("--optimize", "--out", "no/b.toml"), "b.toml: cannot be written"),
        (("--capability", "--model", "no.json"), "no.json: cannot be read"),
        (("--capability", "--model", "plan.toml"), "plan.toml: is not JSON"),
        (("--capability", "--baseline", "no.json"), "no.json: cannot be read"),
        (("--capability", "--baseline", "plan.toml"), "plan.toml: is not JSON"),
    ],
)
def test_bad_input_is_one_sentence_and_no_file(say, folder, arguments, message):
    before = set(folder.iterdir())
    outcome = say("plan.toml", *AXIS, *arguments)
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    assert message in outcome.err.replace("\\", "/")
    assert set(folder.iterdir()) == before


def test_a_plan_that_breaks_a_limit_is_not_written_anew(say, folder):
    with (folder / "axis.toml").open("a", encoding="utf-8") as stream:
        stream.write('limits.speed = "100 mm/s"\n')
    outcome = say("plan.toml", *AXIS, "--optimize", "--out", "best.toml")
    assert outcome.status == 2
    assert "nothing was exported" in outcome.err
    assert not (folder / "best.toml").exists()


def test_the_information_of_a_plan_with_two_loads_is_compared(say, folder):
    text = (folder / "plan.toml").read_text(encoding="utf-8")
    (folder / "plan.toml").write_text(text.replace('["100 kg"]', '["0 kg", "100 kg"]'), encoding="utf-8")
    asked = ("plan.toml", *AXIS, "--optimize", *LOADS)
    ratio = say(*asked, "--json").document["optimized"]["information_per_minute_ratio"]
    words = " ".join(say(*asked).out.split())
    assert f"Information per minute: {ratio:.2f} times that of the given plan." in words
    assert "leaves a parameter undetermined" not in words
    assert "two runs at two known preloads do" in words


def test_preloads_are_chosen_too(say):
    asked = ("plan.toml", *AXIS, "--optimize", *LOADS, "--preloads", "300 N, 600 N", "--adjust", "20 min")
    best = say(*asked, "--json").document["optimized"]
    assert best["plan"]["preloads"] == [300, 600]
    words = " ".join(say(*asked).out.split())
    assert "and 2 preloads of 300, 600 N, chosen from" in words
    assert "4 loads and 2 preloads" in words
    assert "10 min to change the load, 20 min to set another preload; the given plan" in words
    undetermined = "it has one load, fewer than two preloads, or too few stops"
    assert f"The given plan leaves a parameter undetermined: {undetermined}." in words
    assert "nut's share of the compliance, by the ratio of the known preloads." in words
    wrong = say("plan.toml", *AXIS, "--optimize", "--preloads", "300 kg")
    assert (wrong.status, wrong.out) == (2, "")
    assert "--preloads is '300 kg'; it must be a quantity in N" in wrong.err
