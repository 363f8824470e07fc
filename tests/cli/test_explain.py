from __future__ import annotations

import pytest
from tests.cli.test_analyze import flags

from ballscrew.base.errors import InputError
from ballscrew.cli.explain import CellSelection, parse_cell

pytestmark = pytest.mark.usefixtures("fitted_once")

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
    outcome = ballscrew("analyze", rig / "run.toml", "--method", method, "--explain", "60mm:NA")
    assert (outcome.status, outcome.err) == (0, "")
    wanted_titles = TITLES if method == "joint" else [t for t in TITLES if "paper" not in t]
    places = [outcome.out.index(title) for title in wanted_titles]
    assert places == sorted(places)
    assert outcome.out.startswith("synthetic, 60 mm NA, load 100 kg: ")
    assert max(map(len, outcome.out.splitlines())) <= 110


def test_a_cell_as_json_agrees_with_the_run(ballscrew, rig, result):
    run = result.to_json()
    outcome = ballscrew("analyze", rig / "run.toml", "--explain", "60mm:NA", "--json").document
    (cell,) = [c for c in run["cells"] if (c["position_m"], c["condition"]) == (0.06, "NA")]
    assert (outcome["schema"], outcome["id"], outcome["cell"]) == (2, run["id"], cell)
    paper = ballscrew("analyze", rig / "run.toml", "--method", "paper", "--json").document
    assert outcome["paper"] in paper["cells"]
    assert outcome["transients"] == {"found": 2, "whole": 2}
    assert [each["title"] for each in outcome["words"]]


def test_a_picture_of_the_cell_and_not_of_the_run(ballscrew, rig, tmp_path):
    run, cell = tmp_path / "run.png", tmp_path / "cell.png"
    assert ballscrew("analyze", rig / "run.toml", "--method", "paper", "--plot", run).status == 0
    assert ballscrew("analyze", rig / "run.toml", "--explain", "60mm:NA", "--plot", cell).status == 0
    assert cell.stat().st_size > 5000
    assert cell.read_bytes() != run.read_bytes()


def test_a_bad_measurement_is_explained_and_1(ballscrew, rig, tmp_path):
    picture = tmp_path / "bad.png"
    outcome = ballscrew("analyze", rig / "bad.h5", *flags(rig), "--explain", "60mm:NA", "--plot", picture)
    assert outcome.status == 1
    assert "no frequency" in outcome.out
    assert "Correct what the reasons of the measurement name" in outcome.out
    assert picture.exists()


def test_a_refused_cell_is_explained_and_0(ballscrew, rig):
    outcome = ballscrew(
        "analyze", rig / "trip1.h5", "--channels", rig / "channels.toml", "--method", "paper",
        "--explain", "60mm:NA",
    )  # fmt: skip
    assert outcome.status == 0
    assert "no frequency: refused" in outcome.out
    assert "neither a data sheet (--axis) nor --band" in " ".join(outcome.out.split())
