from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.modal.conftest import table_of
from tests.modal.plant import Plant

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, Made
from ballscrew.modal.cell import CellResult
from ballscrew.modal.paper.cells import identify_cells
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality
from ballscrew.report.canvas import (
    CONDITION_COLOURS,
    CONDITION_MARKERS,
    FORMATS,
    POSITION_MAP,
    check_target,
    save_figure,
)
from ballscrew.report.run_figure import _colour, draw_run

plt = pytest.importorskip("matplotlib.pyplot")
figures = pytest.importorskip("matplotlib.figure")


def write_run(run, path):
    save_figure(draw_run(run), path)


SIGNATURE = {".png": b"\x89PNG\r\n\x1a\n", ".pdf": b"%PDF-", ".svg": b"<?xml"}


def run_of(cells=(), response=None, **changes):
    base = Run(
        "ab" * 32, "bench", 100.0, "2026-01-31T08:00:00", None, (FileRef("a.h5", "0" * 64),),
        Quality("good"), RigidBodyResult(), (), tuple(cells), Made({"estimator": "H1"}), response,
    )  # fmt: skip
    return replace(base, **changes)


@pytest.fixture(scope="module")
def run():
    table = table_of(Plant(servo=0.5), responses=2)
    settings = PaperSettings(band=(110.0, 190.0))
    cells, response = identify_cells(table, Quality("good"), None, None, 100.0, settings)
    assert sum(c.frequency_Hz is not None for c in cells) >= 4
    return run_of(cells, response)


REFUSED = [
    CellResult(x, c, 0, 3, None, None, None, "paper", "refused", (f"the FRF has no peak <&{x}> $\\frac$",))
    for x in (0.0, 0.1)
    for c in CONDITION_COLOURS
]


@pytest.mark.parametrize("ending", FORMATS)
def test_a_picture_in_each_format(run, tmp_path, ending):
    path = tmp_path / f"run{ending}"
    write_run(run, path)
    content = path.read_bytes()
    assert content.startswith(SIGNATURE[ending])
    assert len(content) > 10_000
    if ending == ".png":
        image = plt.imread(path)
        assert image.shape[0] == pytest.approx(9.5 * 150, abs=2)
        assert image.shape[1] == pytest.approx(13 * 150, abs=2)
        assert len(np.unique(image[..., :3].reshape(-1, 3), axis=0)) > 50, "there is something on it"
    elif ending == ".svg":
        assert ET.fromstring(content).tag.endswith("svg")  # noqa: S314  our own file
    else:
        assert b"%%EOF" in content[-1024:]


def test_the_ending_may_be_in_capitals(run, tmp_path):
    write_run(run, tmp_path / "RUN.PNG")
    assert (tmp_path / "RUN.PNG").read_bytes().startswith(SIGNATURE[".png"])


def test_the_same_run_the_same_picture(run, tmp_path):
    for name in ("a.svg", "b.svg"):
        write_run(run, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_words_of_the_picture(run):
    """Titles, axes with units, and every condition."""
    figure = draw_run(run)
    words = " ".join(
        text for axes in figure.axes for text in (axes.get_title(), axes.get_title("left"),
                                                  axes.get_xlabel(), axes.get_ylabel())
    )  # fmt: skip
    for part in ("PA: positive acceleration", "ND: negative deceleration", "frequency (Hz)", "coherence",
                 "m/s² per N", "position (mm)", "Axial natural frequency along the axis"):  # fmt: skip
        assert part in words
    assert figure.get_suptitle() == "bench, load 100 kg, 2026-01-31T08:00:00: measurement good"


def stars(figure):
    return sum(line.get_marker() == "*" for axes in figure.axes for line in axes.get_lines())


def test_a_star_on_every_natural_frequency(run):
    assert stars(draw_run(run)) == sum(c.frequency_Hz is not None for c in run.cells)


@pytest.mark.parametrize(
    "changes",
    [
        {"cells": tuple(REFUSED)},
        {"cells": ()},
        {"cells": tuple(REFUSED[:1])},
        {"quality": Quality("bad", ("torque is clipped",)), "cells": tuple(REFUSED)},
        {"axis": None, "mass_kg": None, "measured_at": None},
        {"axis": "$\\frac{ [red]<b>$ $", "cells": tuple(REFUSED)},
    ],
    ids=["all refused", "no cell", "one cell", "bad", "nothing said", "hostile name"],
)
def test_a_run_without_a_result_draws_too(tmp_path, changes):
    path = tmp_path / "run.svg"
    write_run(run_of(**changes), path)
    assert path.stat().st_size > 5000


def test_a_refused_run_with_spectra_draws_too(run, tmp_path):
    cells = [
        replace(c, frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused", reasons=("why $x",))
        for c in run.cells
    ]
    write_run(replace(run, cells=tuple(cells)), tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 5000


def test_nothing_is_left_open(run, tmp_path):
    before = plt.get_fignums()
    write_run(run, tmp_path / "run.png")
    assert plt.get_fignums() == before


@pytest.mark.parametrize("name", ["run.jpg", "run", "run.png.txt", ".png"])
def test_a_wrong_ending_is_refused(run, tmp_path, name):
    with pytest.raises(InputError, match=r"a picture's name must end in \.png, \.svg, \.pdf"):
        write_run(run, tmp_path / name)
    assert not (tmp_path / name).exists()


def test_a_folder_that_is_not_there_is_refused(run, tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        write_run(run, tmp_path / "no" / "run.png")


def test_a_folder_of_that_name_is_refused(run, tmp_path):
    (tmp_path / "run.png").mkdir()
    with pytest.raises(InputError, match=r"run\.png"):
        write_run(run, tmp_path / "run.png")


def test_a_disk_that_is_full_is_said(run, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    before = plt.get_fignums()
    with pytest.raises(InputError, match=r"run\.png: cannot be written \(No space left on device\)"):
        write_run(run, tmp_path / "run.png")
    assert plt.get_fignums() == before


def test_without_matplotlib_the_error_names_the_package_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match=r"install ballscrew\[plot\]"):
        check_target(Path(tmp_path / "run.png"))


def test_every_condition_has_a_look_of_its_own():
    assert set(CONDITION_COLOURS) == set(CONDITION_MARKERS) == {"PA", "PD", "NA", "ND"}
    assert len(set(CONDITION_COLOURS.values())) == len(set(CONDITION_MARKERS.values())) == 4


def test_a_run_of_one_stop_has_the_first_colour_of_the_positions():
    single, several = (
        run_of([CellResult(x, "PA", 0, 3, 170.0, 0.5, 0.03, "joint", "good", ()) for x in places])
        for places in ((0.1,), (0.1, 0.2))
    )
    first = plt.get_cmap(POSITION_MAP)(0.0)
    assert _colour(single, 0.1) == _colour(several, 0.1) == first
    assert _colour(several, 0.2) == plt.get_cmap(POSITION_MAP)(0.92)
