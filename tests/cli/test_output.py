"""Files to write, compared with the inputs of a command."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ballscrew import InputError
from ballscrew.cli.output import check_outputs, console, progress_bar


def test_an_output_is_neither_an_input_nor_another_output(tmp_path: Path) -> None:
    given, link, new = tmp_path / "run.json", tmp_path / "link.json", tmp_path / "new.json"
    given.write_text("{}", encoding="utf-8")
    os.link(given, link)
    check_outputs((new, None), (given, None))
    for written in (given, tmp_path / "." / "run.json", link):
        with pytest.raises(InputError, match="is an input"):
            check_outputs((written,), (given,))
    with pytest.raises(InputError, match="same name"):
        check_outputs((new, tmp_path / "x" / ".." / "new.json"), ())


def test_a_sentence_is_wrapped_at_words_below_its_first(capsys: pytest.CaptureFixture[str]) -> None:
    console().print("  • " + "word " * 40 + "[1]", markup=False)
    first, *others = capsys.readouterr().out.splitlines()
    assert first.startswith("  • word word")
    assert all(line.startswith("    word") for line in others)
    assert max(map(len, (first, *others))) <= 100
    assert others[-1].endswith("word [1]")


@pytest.mark.parametrize("as_lines", [False, True])
def test_progress_is_lines_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str], as_lines: bool
) -> None:
    with progress_bar("making", as_lines=as_lines) as progress:
        progress(1, 2, "mill 4 X\x1b")
    expected = ["making …", "making: 1 of 2, mill 4 X\\x1b"] if as_lines else []
    assert capsys.readouterr().err.splitlines() == expected


@pytest.mark.parametrize("option", ["--spectra", "--plot"])
def test_analyze_does_not_write_onto_what_it_reads(ballscrew, rig: Path, option: str) -> None:
    if option == "--plot":
        pytest.importorskip("matplotlib")
    for name in ("trip1.h5", "channels.toml", "run.toml"):
        before = (rig / name).read_bytes()
        outcome = ballscrew("analyze", rig / "run.toml", option, rig / name)
        assert outcome.status == 2
        assert ("is an input" in outcome.err) or ("must end in" in outcome.err)
        assert (rig / name).read_bytes() == before


def test_calibrate_and_monitor_do_not_write_onto_what_they_read(ballscrew, tmp_path: Path) -> None:
    run = tmp_path / "run.json"
    run.write_text("{}", encoding="utf-8")
    sheet = tmp_path / "axis.toml"
    for outcome in (
        ballscrew("calibrate", run, "--axis", sheet, "--out", run),
        ballscrew("calibrate", run, "--axis", sheet, "--out", sheet),
        ballscrew(
            "calibrate", run, "--axis", sheet, "--out", tmp_path / "a.png", "--plot", tmp_path / "a.png"
        ),
    ):
        assert outcome.status == 2
        assert "overwritten" in outcome.err or "same name" in outcome.err
    assert run.read_text(encoding="utf-8") == "{}"


def test_monitor_does_not_write_onto_the_counters_of_the_machine(ballscrew, tmp_path: Path) -> None:
    duty = tmp_path / "duty.csv"
    duty.write_text("date,hours\n2026-01-01,0\n2026-02-01,100\n", encoding="utf-8")
    for command in (("monitor", tmp_path / "run.json", "--export"), ("watch", tmp_path, "--page")):
        outcome = ballscrew(*command, duty, "--model", tmp_path / "model.json", "--duty", duty)
        assert outcome.status == 2
        assert "is an input" in outcome.err


def test_init_does_not_write_onto_a_recording(ballscrew, tmp_path: Path) -> None:
    recording = tmp_path / "run.toml"
    recording.write_text("torque [Nm];position [mm]\n" + "1;2\n" * 50, encoding="utf-8")
    outcome = ballscrew("init", recording, "--out", tmp_path, "--force")
    assert outcome.status == 2
    assert "is an input" in outcome.err


@pytest.mark.parametrize("name", ["axis.toml", "run.toml", "truth.json", "trip001.h5"])
def test_simulate_does_not_write_onto_what_it_reads(ballscrew, folder: Path, name: str) -> None:
    (folder / "axis.toml").rename(folder / name)
    before = (folder / name).read_bytes()
    plan = folder / "plan.toml"
    (folder / "load-0kg").mkdir()
    (folder / "load-0kg" / name).write_bytes(before)
    for command in (
        ("run", plan, "--axis", folder / name),
        ("multi-level-mass", "--loads", "0 kg", "--axis", folder / "load-0kg" / name),
    ):
        outcome = ballscrew("simulate", *command, "--out", folder)
        assert (outcome.status, outcome.out) == (2, "")
        assert "is an input" in outcome.err
