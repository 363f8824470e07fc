from __future__ import annotations

import pytest
from tests.cli.test_analyze import flags

from ballscrew.base.errors import InputError
from ballscrew.cli.explain import CellSelection, parse_cell

TITLES = (
    "Measurement",
    "Frequency, rotor free: ",
    "Peak of the FRF (method of the paper)",
    "Verdict: ",
    "Improvements",
)


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("45mm:PD", CellSelection(0.045, "PD", 0)),
        ("45 mm:pd", CellSelection(0.045, "PD", 0)),
        (" 0.045 m : nd : 2 ", CellSelection(0.045, "ND", 2)),
        ("-20mm:PA", CellSelection(-0.02, "PA", 0)),
        ("4.5e1mm:NA:0", CellSelection(0.045, "NA", 0)),
    ],
)
def test_how_a_cell_is_named(text, cell):
    read = parse_cell(text)
    assert read.position == pytest.approx(cell.position)
    assert (read.condition, read.motion) == (cell.condition, cell.motion)


@pytest.mark.parametrize(
    "text",
    ["", ":", "::", "45mm", "45mm:", "45mm:PD:", "45mm:PD:0:0", "mm:PD", "45mm:PD:٣", "nan:PD", "4²:PD"],
)
def test_what_names_no_cell(text):
    with pytest.raises(InputError, match="--explain is"):
        parse_cell(text)


@pytest.mark.parametrize("method", ["joint", "paper"])
def test_a_cell_in_words(ballscrew, rig, method):
    said = ballscrew("analyze", rig / "run.toml", "--method", method, "--explain", "60mm:NA")
    assert (said.status, said.err) == (0, "")
    wanted_titles = TITLES if method == "joint" else [t for t in TITLES if "paper" not in t]
    places = [said.out.index(title) for title in wanted_titles]
    assert places == sorted(places)
    assert said.out.startswith("synthetic, 60 mm NA, load 100 kg: ")
    assert max(map(len, said.out.splitlines())) <= 110


def test_a_cell_as_json_says_what_the_run_says(ballscrew, rig):
    run = ballscrew("analyze", rig / "run.toml", "--json").document
    said = ballscrew("analyze", rig / "run.toml", "--explain", "60mm:NA", "--json").document
    (cell,) = [c for c in run["cells"] if (c["position_m"], c["condition"]) == (0.06, "NA")]
    assert (said["schema"], said["id"], said["cell"]) == (2, run["id"], cell)
    paper = ballscrew("analyze", rig / "run.toml", "--method", "paper", "--json").document
    assert said["paper"] in paper["cells"]
    assert said["transients"] == {"found": 2, "whole": 2}
    assert [each["title"] for each in said["words"]]


def test_a_picture_of_the_cell_and_not_of_the_run(ballscrew, rig, tmp_path):
    run, cell = tmp_path / "run.png", tmp_path / "cell.png"
    assert ballscrew("analyze", rig / "run.toml", "--plot", run).status == 0
    assert ballscrew("analyze", rig / "run.toml", "--explain", "60mm:NA", "--plot", cell).status == 0
    assert cell.stat().st_size > 5000
    assert cell.read_bytes() != run.read_bytes()


def test_a_bad_measurement_is_explained_and_1(ballscrew, rig, tmp_path):
    picture = tmp_path / "bad.png"
    said = ballscrew("analyze", rig / "bad.h5", *flags(rig), "--explain", "60mm:NA", "--plot", picture)
    assert said.status == 1
    assert "no frequency" in said.out
    assert "Correct what the reasons of the measurement name" in said.out
    assert picture.exists()


def test_a_refused_cell_is_explained_and_0(ballscrew, rig):
    said = ballscrew(
        "analyze", rig / "trip1.h5", "--channels", rig / "channels.toml", "--method", "paper",
        "--explain", "60mm:NA",
    )  # fmt: skip
    assert said.status == 0
    assert "no frequency: refused" in said.out
    assert "neither a data sheet (--axis) nor --band" in " ".join(said.out.split())
