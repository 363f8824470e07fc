"""``ballscrew calibrate``."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.axis.conftest import Sheets
from tests.calibration.tables import table

from ballscrew.axis.axial import frequency, from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.modelfile import read_model
from ballscrew.calibration.sampler import SamplerCheck
from ballscrew.cli.shell import run
from ballscrew.modal.cell import SharedError
from ballscrew.modal.run import Run


def test_the_model_does_not_depend_on_the_order_of_sets(tmp_path: Path) -> None:
    """Strings have another hash in each process, and sets of them another order."""
    sheet = Sheets(tmp_path).read()
    model = from_vector(prior(sheet, 0.2)[0], 0.2)
    random, paths = np.random.default_rng(0), []
    for number, load in enumerate((0.0, 50.0, 100.0)):
        run = table(lambda x, m=load: float(frequency(model, x, m)), (0.0, 0.2, 0.4), load, number)  # type: ignore[misc]
        more = []
        for name in ("balls", "clock", "profile", "sensor", "softening"):
            effects = random.uniform(-0.1, 0.1, len(run.cells))
            more.append(SharedError(name, repeats=True, effects_Hz=tuple(effects.tolist())))
        run = replace(run, shared_errors=(*run.shared_errors, *more))
        paths.append(tmp_path / f"run{number}.json")
        paths[-1].write_text(write_json(run.to_json()), encoding="utf-8")
    found = set()
    for seed in "12":
        out = tmp_path / f"model{seed}.json"
        command = ["-m", "ballscrew", "calibrate", *paths, "--axis", tmp_path / "axis.toml", "--out", out]
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        subprocess.run([sys.executable, *map(str, command)], env=environment, check=True)  # noqa: S603
        found.add(out.read_bytes())
    assert len(found) == 1


@pytest.fixture
def runs(tmp_path: Path) -> list[str]:
    """Three runs of the small sheet's axis, and the sheet beside them."""
    sheet = Sheets(tmp_path).read()
    model = from_vector(prior(sheet, 0.2)[0], 0.2)
    paths = []
    for i, load in enumerate((0.0, 50.0, 100.0)):
        one = table(lambda x, m=load: float(frequency(model, x, m)), (0.0, 0.2, 0.4), load, i)  # type: ignore[misc]
        path = tmp_path / f"run{i}.json"
        path.write_text(write_json(one.to_json()), encoding="utf-8")
        paths.append(str(path))
    return paths


def test_says_what_is_known_and_by_whom(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "model.json"
    given = ["calibrate", *runs, "--axis", str(tmp_path / "axis.toml"), "--out", str(out)]
    assert run(given) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert "by 3 runs, good" in first
    assert any("one more load" in line for line in rest)
    assert not any("χ²" in line for line in rest)
    assert run([*given, "--verbose"]) == 0
    outcome = capsys.readouterr().out
    for words in (
        "3 runs", "36 cells", "free rotor", "chosen", "preload in newtons: only the sheet", "No anchor",
        "one more load", "θ of Eqs.",
    ):  # fmt: skip
        assert words in outcome
    assert read_model(out).axis == "bench"


def test_the_printed_verdict_names_each_doubt_and_the_other_conventions(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["calibrate", *runs, "--out", str(tmp_path / "model.json"), "--axis"]
    assert run([*given, str(tmp_path / "axis.toml")]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "3 runs, good" in words
    assert "K of the data sheet may be stated in another convention" in words
    assert "a nut with clearance at 0.30 Ca of load" in words
    (tmp_path / "soft").mkdir()
    Sheets(tmp_path / "soft").read(screw__rigidity="100 N/um")
    assert run([*given, str(tmp_path / "soft" / "axis.toml")]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "3 runs, suspect" in words
    assert "• rigidity: " in words


def test_runs_are_named_by_their_files(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ids = [f"{i}" * 64 for i in range(len(runs))]
    for path, run_id in zip(map(Path, runs), ids, strict=True):
        document = json.loads(path.read_text(encoding="utf-8"))
        document["id"], document["run"]["measured_at"] = run_id, None
        path.write_text(json.dumps(document), encoding="utf-8")
    given = ["--axis", "axis.toml", "--out", "m.json"]
    assert run(["calibrate", *(Path(path).name for path in runs), *given]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "3 runs have no time (run0.json, run1.json, run2.json)" in printed
    assert not any(run_id[:12] in printed for run_id in ids)
    model = Path("m.json").read_text(encoding="utf-8")
    assert all(run_id[:12] in model for run_id in ids)  # the file does not depend on names


def test_json_and_a_known_preload_and_a_picture(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out, picture = tmp_path / "model.json", tmp_path / "model.png"
    status = run(
        ["calibrate", *runs, "--axis", str(tmp_path / "axis.toml"), "--out", str(out), "--json", "--plot",
         str(picture), "--known-preload", "run0.json=590N±10N"]
    )  # fmt: skip
    document = json.loads(capsys.readouterr().out)
    assert status == 0
    assert document == json.loads(out.read_text(encoding="utf-8"))
    assert document["anchors"][0]["preload"] == pytest.approx(590)
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ("run9.json=600N", "must be one of the runs"),
        ("600N", "must be RUN.json=600N"),
        ("run0.json=6 kg", "turned"),
    ],
)
def test_a_known_preload_that_cannot_be(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], known: str, words: str
) -> None:
    given = ["calibrate", *runs, "--axis", str(tmp_path / "axis.toml"), "--out", str(tmp_path / "m.json")]
    assert run([*given, "--known-preload", known]) == 2
    outcome = capsys.readouterr().err
    assert words in outcome
    assert "Traceback" not in outcome
    assert not (tmp_path / "m.json").exists()


def test_a_preload_that_is_given_twice(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["calibrate", *runs, "--axis", str(tmp_path / "axis.toml"), "--out", str(tmp_path / "m.json")]
    twice = ["--known-preload", "run0.json=600N", "--known-preload", "run0.json=610N"]
    assert run([*given, *twice]) == 2
    assert "twice" in capsys.readouterr().err


def test_all_refused_is_a_bad_measurement(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(runs[0])
    document = json.loads(path.read_text(encoding="utf-8"))
    for cell in document["cells"]:
        cell["verdict"] = "refused"
    path.write_text(json.dumps(document), encoding="utf-8")
    given = ["--axis", str(tmp_path / "axis.toml"), "--out", str(tmp_path / "m.json")]
    assert run(["calibrate", runs[0], *given]) == 1
    assert "refused" in capsys.readouterr().err


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("text", ["", "[]", '{"schema": 2}', '{"schema": 2, "cells": 3}'])
def test_files_that_are_no_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    (tmp_path / "odd.json").write_text(text, encoding="utf-8")
    given = ["--axis", str(tmp_path / "axis.toml"), "--out", str(tmp_path / "m.json")]
    assert run(["calibrate", str(tmp_path / "odd.json"), *given]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_an_output_that_cannot_be_written(runs: list[str], tmp_path: Path) -> None:
    axis = str(tmp_path / "axis.toml")
    assert run(["calibrate", *runs, "--axis", axis, "--out", str(tmp_path)]) == 2
    assert run(["calibrate", *runs, "--axis", axis, "--out", str(tmp_path / "none" / "m.json")]) == 2


def test_brackets_in_names_are_no_markup(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    sheet = tmp_path / "axis.toml"
    sheet.write_text(sheet.read_text(encoding="utf-8").replace('"bench"', '"[/x] $axis_{"'), encoding="utf-8")
    for i, path in enumerate(runs):
        document = json.loads(Path(path).read_text(encoding="utf-8"))
        document["run"]["axis"] = "[/x] $axis_{"
        document["id"] = f"[/{i}]" + document["id"]
        Path(path).write_text(json.dumps(document), encoding="utf-8")
    given = ["--axis", str(sheet), "--out", str(tmp_path / "m.json"), "--plot", str(tmp_path / "m.png")]
    assert run(["calibrate", *runs, *given, "--known-preload", "run0.json=600N"]) == 0
    outcome = capsys.readouterr().out
    assert "[/x] $axis_{" in outcome
    assert "[/2]" in outcome


def test_how_long_a_bearing_keeps_is_an_option(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second preload, a month later: what it tells of the nut's share hangs on the bearing."""
    document = json.loads(Path(runs[2]).read_text(encoding="utf-8"))
    document["run"]["measured_at"] = "2026-03-01T08:00:00+00:00"
    document["id"] = "later-" + document["id"]
    for cell in document["cells"]:
        cell["frequency_Hz"] *= 0.97
    (tmp_path / "later.json").write_text(json.dumps(document), encoding="utf-8")
    for path in runs:
        later = json.loads(Path(path).read_text(encoding="utf-8"))
        later["run"]["measured_at"] = "2026-02-01T08:00:00+00:00"
        Path(path).write_text(json.dumps(later), encoding="utf-8")
    given = [
        "calibrate",
        *runs,
        str(tmp_path / "later.json"),
        "--axis",
        str(tmp_path / "axis.toml"),
        "--json",
    ]
    known = ["--known-preload", "run0.json=600N", "--known-preload", "later.json=450N"]
    spread = []
    for part in ("0", "0.1"):
        assert run([*given, *known, "--out", str(tmp_path / "m.json"), "--bearing-drift", part]) == 0
        capsys.readouterr()
        spread.append(math.sqrt(read_model(tmp_path / "m.json").covariance[5, 5]))
    assert spread[1] > 1.1 * spread[0]
    assert run([*given, "--out", str(tmp_path / "m.json"), "--bearing-drift", "2"]) == 2
    assert "bearing-drift" in capsys.readouterr().err


def printed(capsys: pytest.CaptureFixture[str], *command: str) -> str:
    """What ``calibrate`` prints, on one line."""
    capsys.readouterr()
    assert run(["calibrate", *command]) == 0
    return " ".join(capsys.readouterr().out.split())


def given(tmp_path: Path) -> list[str]:
    """The sheet and the model of a command."""
    return ["--axis", str(tmp_path / "axis.toml"), "--out", str(tmp_path / "m.json")]


def test_samples_are_compared_with_the_model(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sampled = SamplerCheck(("slope", "mass"), (0.05, -0.12), (0.97, 1.04), 20_000, 0.4)
    monkeypatch.setattr("ballscrew.cli.calibrate.sample_posterior", lambda _: sampled)
    words = printed(capsys, *runs, *given(tmp_path), "--sample")
    assert (
        "sampler: 20000 samples agree with the model; the largest shift, of mass, is -0.12 standard "
        "uncertainties; widths are 0.97 to 1.04 of the model's" in words
    )
    assert run(["calibrate", *runs, *given(tmp_path), "--sample", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sample"] == {
        "agrees": True, "samples": 20_000, "acceptance": 0.4,
        "shift": {"slope": 0.05, "mass": -0.12}, "ratio": {"slope": 0.97, "mass": 1.04},
    }  # fmt: skip
    assert "sample" not in json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    assert "sampler" not in printed(capsys, *runs, *given(tmp_path))


@pytest.mark.parametrize(
    ("shift", "ratio", "agrees"),
    [
        ((0.29, -0.29), (0.81, 1.24), True),
        ((0.0, -0.31), (1.0, 1.0), False),
        ((0.0, 0.0), (0.79, 1.0), False),
        ((0.0, 0.0), (1.0, 1.26), False),
    ],
)
def test_samples_agree_up_to_a_shift_and_a_width(
    runs: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    shift: tuple[float, float],
    ratio: tuple[float, float],
    agrees: bool,
) -> None:
    sampled = SamplerCheck(("slope", "mass"), shift, ratio, 20_000, 0.4)
    assert sampled.agrees == agrees
    monkeypatch.setattr("ballscrew.cli.calibrate.sample_posterior", lambda _: sampled)
    words = printed(capsys, *runs, *given(tmp_path), "--sample")
    assert ("20000 samples agree with" in words) == agrees
    assert ("20000 samples do not agree with" in words) == (not agrees)


def test_verbose_prints_groups_of_preload_anchors_and_a_cell_that_does_not_fit(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for number, path in enumerate(runs):
        Path(path).write_text(
            write_json(replace(Run.read(path), measured_at=f"2026-01-01T0{number}:00:00+00:00").to_json()),
            encoding="utf-8",
        )
    first = Run.read(runs[0])
    cells = list(first.cells)
    assert cells[3].frequency_Hz is not None
    cells[3] = replace(cells[3], frequency_Hz=1.1 * cells[3].frequency_Hz)
    replace(first, cells=tuple(cells)).write("run0.json")
    model = from_vector(prior(Sheets(tmp_path).read(), 0.2)[0], 0.2)
    worn = table(
        lambda x: float(frequency(model, x, 100.0, 0.7)), (0.0, 0.2, 0.4), 100.0, 7,
        measured_at="2026-03-01T08:00:00+00:00",
    )  # fmt: skip
    worn.write("worn.json")
    names = ["run0.json", "run1.json", "run2.json", "worn.json"]
    words = printed(capsys, *names, *given(tmp_path), "--verbose", "--known-preload", "run1.json=590N±10N")
    cell = f"{1e3 * cells[3].position_m:g} mm {cells[3].condition}"
    assert f"• run0.json: cell {cell} (" in words
    assert "run1.json: cell" not in words
    document = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    (other,) = (each for each in document["runs"] if each["group"] == 1)
    ratio = math.exp(other["log_ratio"])
    row = f"│ {ratio:.3f} ± {ratio * other['log_ratio_uncertainty']:.3f} │"
    assert words.count(row) == 1
    assert ratio == pytest.approx(0.7, abs=0.1)
    (anchor,) = document["anchors"]
    numbers = (anchor[f"{name}_{part}"] for name in ("log_preload", "share") for part in ("without", "with"))
    texts = " │ ".join(f"{number:.3f}" for number in numbers)
    assert f"│ known preload │ run1.json │ 590 ± 10 N │ {texts} │" in words
    assert "No anchor" not in words


def test_a_model_without_a_rotor_has_an_infinite_one(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "∞" not in printed(capsys, *runs, *given(tmp_path), "--verbose")
    model = replace(from_vector(prior(Sheets(tmp_path).read(), 0.2)[0], 0.2), rotor=math.inf)
    for number, load in enumerate((0.0, 50.0, 100.0)):
        one_load = table(
            lambda x, m=load: float(frequency(model, x, m)),  # type: ignore[misc]
            (0.0, 0.2, 0.4), load, number,
        )  # fmt: skip
        one_load.write(runs[number])
    assert "│ rotor │ ∞ │ │ │" in printed(capsys, *runs, *given(tmp_path), "--verbose")


def test_a_measured_rigidity_has_no_other_convention(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "in another convention" in printed(capsys, *runs, *given(tmp_path))
    Sheets(tmp_path).write(screw__rigidity_convention="measured")
    words = printed(capsys, *runs, *given(tmp_path))
    assert "3 runs, good" in words
    assert "convention" not in words
