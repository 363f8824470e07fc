from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.estimation.made_runs import calibrated, run_of
from tests.monitoring.histories import unloading

from ballscrew.axis.hertz import RELEASE
from ballscrew.base.jsonfile import write_json
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.modelfile import write_model
from ballscrew.modal.run import Run
from ballscrew.recording.quality.finding import Quality


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, a baseline and four runs."""
    path = tmp_path_factory.mktemp("preload")
    write_model(calibrated(), path / "model.json")
    runs = {
        "base": run_of(name="base", measured_at="2026-01-01T08:00:00+00:00"),
        "worn": run_of(0.6, name="worn", measured_at="2026-03-01T08:00:00+00:00"),
        "dent": run_of(
            lambda x: np.where(np.abs(x - 0.225) < 0.05, 0.6, 0.9),
            local=True,
            name="dent",
            measured_at="2026-04-01T08:00:00+00:00",
        ),
        "bad": run_of(name="bad", quality=Quality("bad", ("clipped",))),
        "other": run_of(name="other", axis="another"),
    }
    for name, run in runs.items():
        (path / f"{name}.json").write_text(write_json(run.to_json()), encoding="utf-8")
    return path


def test_a_run_against_its_baseline(ballscrew, folder: Path) -> None:
    outcome = ballscrew(
        "preload", folder / "worn.json", "--model", folder / "model.json", "--baseline", folder / "base.json"
    )
    assert outcome.status == 0
    assert outcome.out.startswith("bench: 60 % of the baseline preload (95 %: ")
    named = f"Run {folder / 'worn.json'}, baseline {folder / 'base.json'} Axial stiffness: good"
    assert named in " ".join(outcome.out.split())
    assert "Possible causes" not in outcome.out
    assert "corresponds to 60 % of the baseline preload" in outcome.out
    assert "Preload of the nut: suspect" in outcome.out
    assert "relative to the baseline" in outcome.out
    assert "0.600" in outcome.out
    assert "360 ±" in outcome.out
    assert "whether the nut or the support bearing has changed" in " ".join(outcome.out.split())


def test_json(ballscrew, folder: Path) -> None:
    outcome = ballscrew(
        "preload", folder / "worn.json", "--model", folder / "model.json", "--baseline", folder / "base.json",
        "--json",
    )  # fmt: skip
    document = outcome.document
    assert outcome.status == 0
    assert document["relative_to_baseline"]["value"] == pytest.approx(0.6)
    low, high = document["relative_to_baseline"]["interval95"]
    assert low < 0.6 < high
    assert document["preload_N"]["value"] == pytest.approx(360)
    assert document["stiffness_relative_to_baseline"]["value"] == pytest.approx(0.6)
    assert (document["verdict"], document["nut_verdict"]) == ("good", "suspect")
    assert {cause["cause"] for cause in document["causes"]} >= {"nut or bearing", "load", "torque"}
    assert document["made"]["inputs"] == {"run": "worn", "baseline": "base"}
    assert document["made"]["settings"]["bearing_drift"] is None


def test_a_warning_of_the_calibration_binds_until_it_is_accepted(
    ballscrew, folder: Path, tmp_path: Path
) -> None:
    model = tmp_path / "doubtful.json"
    write_model(dataclasses.replace(calibrated(), reasons=(Doubt("rigidity", "it is too stiff"),)), model)
    common = ("preload", folder / "worn.json", "--model", model, "--baseline", folder / "base.json")
    printed = ballscrew(*common)
    assert printed.status == 0
    assert "Axial stiffness: suspect" in printed.out
    assert "the calibration is suspect (rigidity): it is too stiff" in " ".join(printed.out.split())
    assert "--accept NAME" in printed.out
    accepted = ballscrew(*common, "--accept", "rigidity", "--json").document
    assert accepted["verdict"] == "good"
    assert "--accept NAME" not in ballscrew(*common, "--accept", "rigidity").out
    assert accepted["made"]["settings"]["accept"] == ["rigidity"]
    wrong = ballscrew(*common, "--accept", "misfit")
    assert wrong.status == 2
    assert "'misfit'; it must be one of 'rigidity'" in wrong.err


def test_assumptions_are_options(ballscrew, folder: Path) -> None:
    common = (
        "preload",
        folder / "worn.json",
        "--model",
        folder / "model.json",
        "--baseline",
        folder / "base.json",
    )
    wide = ballscrew(*common, "--bearing-drift", "0.1", "--trust-torque", "--json").document
    narrow = ballscrew(*common, "--bearing-drift", "0", "--json").document
    widths = [np.ptp(d["relative_to_baseline"]["interval95"]) for d in (wide, narrow)]
    assert widths[0] > 1.5 * widths[1]
    assert wide["made"]["settings"]["torque_trusted"] is True


def test_many_runs(ballscrew, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    names = [folder / f"{name}.json" for name in ("base", "worn", "dent", "bad")]
    common = ("--model", folder / "model.json", "--baseline", folder / "base.json")
    outcome = ballscrew("preload", *names, *common, "--plot", tmp_path / "map.png")
    assert outcome.status == 1  # one is a bad measurement
    assert "clipped" in outcome.err
    assert "4 runs" in outcome.out
    assert (tmp_path / "map.png").stat().st_size > 10_000
    document = ballscrew("preload", *names, *common, "--json").document
    assert [run["verdict"] for run in document["runs"]] == ["good", "good", "suspect", "refused"]
    assert document["runs"][2]["profile"]["local"]["found"] is True


def test_a_single_run_has_a_picture(ballscrew, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    picture = tmp_path / "one.svg"
    outcome = ballscrew(
        "preload", folder / "dent.json", "--model", folder / "model.json", "--figure", picture
    )
    assert outcome.status == 0
    assert picture.stat().st_size > 10_000


def test_a_bad_measurement_is_status_1_and_its_json_is_printed(ballscrew, folder: Path) -> None:
    outcome = ballscrew("preload", folder / "bad.json", "--model", folder / "model.json", "--json")
    assert outcome.status == 1
    assert outcome.document["verdict"] == "refused"
    assert outcome.document["preload_N"] is None
    assert "refused: the measurement is bad: clipped" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("other.json", "--model", "model.json"), "must be of one axis"),
        (("worn.json", "--model", "worn.json"), "worn.json"),
        (("no.json", "--model", "model.json"), "cannot be read"),
        (
            ("worn.json", "--model", "model.json", "--baseline", "base.json", "--baseline", "base.json"),
            "twice",
        ),
        (("worn.json", "--model", "model.json", "--plot", "x.doc"), "must end in"),
        (("worn.json", "--model", "model.json", "--bearing-drift", "2"), "bearing-drift"),
    ],
)
def test_what_is_wrong_is_said(ballscrew, folder: Path, monkeypatch, arguments, words) -> None:
    monkeypatch.chdir(folder)
    outcome = ballscrew("preload", *arguments)
    assert outcome.status == 2
    assert words in outcome.err
    assert "Traceback" not in outcome.err
    assert outcome.out == ""


def test_a_spoilt_number_in_a_run_is_one_sentence(ballscrew, folder: Path, tmp_path: Path) -> None:
    document = json.loads((folder / "worn.json").read_text(encoding="utf-8"))
    for wrong in (-1.0, "fast", 1e400):
        document["cells"][3]["frequency_Hz"] = wrong
        path = tmp_path / "spoilt.json"
        path.write_text(json.dumps(document).replace("Infinity", "1e999"), encoding="utf-8")
        outcome = ballscrew(
            "preload", path, "--model", folder / "model.json", "--baseline", folder / "base.json"
        )
        assert outcome.status == 2
        assert outcome.err.count("\n") == 1


@pytest.mark.parametrize("what", ["no cell", "too stiff"])
def test_a_refusal_is_not_taken_for_a_preload(ballscrew, folder: Path, tmp_path: Path, what: str) -> None:
    run = run_of(1.0, name="stiff", level=0.15)
    if what == "no cell":
        cells = tuple(dataclasses.replace(c, verdict="refused", frequency_Hz=None) for c in run.cells)
        run = dataclasses.replace(run, cells=cells)
    path = tmp_path / "none.json"
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    outcome = ballscrew("preload", path, "--model", folder / "model.json")
    assert outcome.status == (0 if what == "no cell" else 1)
    assert "Comparison with the model: refused" in outcome.out
    assert f"ballscrew: {path}: refused: " in outcome.err
    assert outcome.out.startswith("bench: no estimate of the preload\n")


def test_the_list_tells_uncertainties_reasons_and_notes(ballscrew, folder: Path) -> None:
    names = [folder / f"{name}.json" for name in ("base", "worn", "dent")]
    common = ("--model", folder / "model.json", "--baseline", folder / "base.json")
    outcome = ballscrew("preload", *names, *common, "--verbose")
    flat = " ".join(outcome.out.split())
    assert "was not recorded" not in ballscrew("preload", *names, *common).out
    assert outcome.status == 0
    assert "0.600 ± 0." in flat
    assert "whether the nut or the support bearing has changed" in flat
    assert "all runs: the temperature of the axis was not recorded" in flat
    assert "wear is local" in flat
    assert flat.count("was not recorded") == 1  # once, and not once a run


def test_marks_in_names_are_printed_as_they_are(
    ballscrew, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = dataclasses.replace(run_of(0.6), id="[/x]run")
    path = Path("[/x]") / "odd.json"
    path.parent.mkdir(parents=True)
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    common = ("--model", folder / "model.json", "--baseline", folder / "base.json")
    assert "[/x]" in ballscrew("preload", path, *common).out
    assert "[/x]" in ballscrew("preload", path, folder / "worn.json", *common).out


def test_the_table_of_several_runs(ballscrew, folder: Path, tmp_path: Path) -> None:
    runs = [folder / "base.json", folder / "worn.json"]
    common = ("preload", *runs, "--model", folder / "model.json", "--export")
    assert ballscrew(*common, tmp_path / "table.csv").status == 0
    table = pd.read_csv(tmp_path / "table.csv")
    assert [time[:10] for time in table["measured_at"].unique()] == ["2026-01-01", "2026-03-01"]
    assert table.columns[-4:].tolist() == ["standard_uncertainty", "low95", "high95", "unit"]
    wrong = ballscrew(*common, tmp_path / "table.xlsx")
    assert (wrong.status, wrong.err.count("\n")) == (2, 1)
    assert "ends with .csv or .parquet" in wrong.err
    assert ballscrew(*common, folder / "base.json").status == 2


def written(run: Run, path: Path) -> Path:
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    return path


def test_verbose_prints_the_uncertainty_the_checks_and_the_possible_causes(ballscrew, folder: Path) -> None:
    common = ("preload", folder / "worn.json", "--model", folder / "model.json")
    against = (*common, "--baseline", folder / "base.json")
    document = ballscrew(*against, "--json").document
    flat = " ".join(ballscrew(*against, "--verbose").out.split())
    parts, fit = document["parts"], document["fit"]
    random, systematic = parts["relative"]["random"], parts["relative"]["systematic"]
    assert f"{random:.3f} is random (differs in every run), {systematic:.3f} is systematic:" in flat
    largest = parts["terms"][0]
    assert f"systematic: {largest['standard_uncertainty']:.3f} {largest['name']}" in flat
    assert f"χ² {fit['chi2']:.1f}, expected {fit['degrees_of_freedom']:.1f}" in flat
    assert f"Along the axis: {document['profile']['text']}" in flat
    assert f"Load: {document['mass']['text']}" in flat
    assert "Nut or bearing" not in flat  # nothing separates them
    assert "Possible causes of the change" in flat
    for cause in document["causes"]:
        assert re.search(rf"│ {cause['cause']} │ {cause['probability']:.2f} │ {cause['chi2']:.1f} │", flat)
    assert "• the temperature of the axis was not recorded" in flat
    assert "--verbose" not in flat
    alone = ballscrew(*common, "--verbose").out
    assert "Along the axis" in alone
    assert "Load: " not in alone  # nothing to compare the masses with


def test_verbose_separates_nut_and_bearing_by_the_softening_of_the_nut(
    ballscrew, folder: Path, tmp_path: Path
) -> None:
    paths = []
    for name, ratio in (("base", 1.0), ("worn", 0.6)):
        softening = Quantity(132.0 / (600.0 * ratio), 0.005, "kg/N")
        run = run_of(ratio, name=name, mass_over_preload_kg_per_N=softening)
        paths.append(written(run, tmp_path / f"{name}.json"))
    common = ("--model", folder / "model.json", "--baseline", paths[0], "--verbose")
    flat = " ".join(ballscrew("preload", paths[1], *common).out.split())
    assert "Nut or bearing: nut 1.00, support bearing 0.00, both 0.00" in flat
    assert "Corrected: " not in flat


def test_verbose_names_the_correction_of_a_load_that_was_declared_wrong(
    ballscrew, folder: Path, tmp_path: Path
) -> None:
    worn = written(run_of(0.6, true_load=106.0), tmp_path / "worn.json")
    common = ("--model", folder / "model.json", "--baseline", folder / "base.json", "--verbose")
    assert "Corrected: load: +6.00 kg\n" in ballscrew("preload", worn, *common).out


def test_a_refused_run_has_no_parts_of_the_uncertainty(ballscrew, folder: Path) -> None:
    outcome = ballscrew("preload", folder / "bad.json", "--model", folder / "model.json", "--verbose")
    assert outcome.status == 1
    assert "Standard uncertainty" not in outcome.out
    assert "Possible causes" not in outcome.out


def test_a_nut_that_the_test_unloads_is_printed_by_its_upper_limit_alone(
    ballscrew, folder: Path, tmp_path: Path
) -> None:
    base = written(unloading(1.0, [run_of(name="base")])[0], tmp_path / "base.json")
    worn = written(unloading(4.0, [run_of(0.2)])[0], tmp_path / "worn.json")
    common = ("preload", worn, "--model", folder / "model.json", "--baseline", base)
    limit = ballscrew(*common, "--json").document["relative_to_baseline"]["interval95"][1]
    assert limit > 1 / RELEASE
    printed = ballscrew(*common).out
    first, *rest = printed.splitlines()
    assert first.startswith(f"bench: below {100 * limit:.0f} % of the baseline preload, ")
    assert f"  below {100 * limit:.0f} % of the baseline preload" in rest
    assert " N, 95 %" not in printed
