"""``ballscrew simulate run``: its files go straight into ``analyze``."""

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


def test_what_it_writes_can_be_analysed(ballscrew, folder):
    said = ballscrew(*ARGUMENTS, "--out", "new", "--seed", 4)
    assert (said.status, said.err) == (0, "")
    assert "2 recordings" in said.out
    assert said.out.splitlines()[
        -1
    ] == f"Next: ballscrew analyze {folder.joinpath('new').name}/run.toml".replace(
        "/", "\\" if "\\" in said.out else "/"
    )
    assert ballscrew("analyze", "new/run.toml").status == 0


def test_json_tells_the_truth(ballscrew, folder):
    said = ballscrew(*ARGUMENTS, "--out", "worn", "--preload", "300 N", "--mass", "80 kg", "--json")
    document = json.loads(said.out)
    assert document["truth"]["preload_N"] == 300.0
    assert document["truth"]["load_kg"] == 80.0
    assert len(document["recordings"]) == 2
    assert document["truth"] == json.loads((folder / "worn" / "truth.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--preload", "3 kg"), "--preload is '3 kg'"),
        (("--preload", "-3 N"), "--preload is '-3 N'; it must be 0 N or more"),
        (("--mass", "heavy"), "--mass is 'heavy'"),
        (("--backlash", "1 um"), "backlash"),
        (("--out", "plan.toml"), "cannot be written"),
        (("--seed", "-1"), "--seed"),
    ],
)
def test_bad_input_is_one_sentence(ballscrew, folder, more, message):
    said = ballscrew(*ARGUMENTS, *more)
    assert said.status == 2
    assert said.err.count("\n") == 1
    assert message in said.err
    assert not (folder / "simulated").exists()


def test_several_loads_must_be_chosen_from(ballscrew, folder):
    text = (folder / "plan.toml").read_text(encoding="utf-8").replace('["100 kg"]', '["0 kg", "100 kg"]')
    (folder / "plan.toml").write_text(text, encoding="utf-8")
    said = ballscrew(*ARGUMENTS)
    assert said.status == 2
    assert "say which with --mass" in said.err
