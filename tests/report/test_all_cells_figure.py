from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tests.report.axis_m import (
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    texts,
)
from tests.report.some_runs import PLACES, cell_names, points, run_of_modes

from ballscrew.base.errors import InputError
from ballscrew.report.all_cells_figure import changes, draw_all_cells

DAYS = (0.0, 3.0, 6.0)
RUNS = [
    run_of_modes(180.0, refused={(0.1, "PA")}),
    run_of_modes(176.0),
    run_of_modes(170.0, refused={(0.2, "NA"), (0.1, "ND")}),
]


def draw():
    return draw_all_cells(DAYS, RUNS, backlash_day=5.0)


def panel(figure, condition):
    (axes,) = [axes for axes in figure.axes if axes.get_title("left") == condition]
    return axes


def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_changes_since_the_first_reading_and_what_is_not_there():
    found = changes(RUNS, "PA", PLACES)
    assert found[0].tolist() == [0, -4, -10]
    assert np.isnan(found[1, 0])
    assert found[1, 1:].tolist() == [0, -6], "a cell that was refused at first starts later"
    assert np.all(found[2] == -np.inf), "the table never leaves the last stop upwards"
    assert np.isnan(changes(RUNS, "NA", PLACES)[2, 2])


@pytest.mark.parametrize("condition", ["PA", "PD", "NA", "ND"])
def test_the_colours_are_the_changes(condition):
    (mesh,) = [x for x in panel(draw(), condition).collections if type(x).__name__ == "QuadMesh"]
    values = np.ma.filled(mesh.get_array(), np.nan)
    wanted = changes(RUNS, condition, PLACES)
    assert np.array_equal(values, np.where(np.isfinite(wanted), wanted, np.nan), equal_nan=True)
    assert mesh.norm.vmin == -mesh.norm.vmax == -10


def test_every_refused_cell_is_hatched_and_no_other():
    hatched = 0
    for condition in ("PA", "PD", "NA", "ND"):
        for part in panel(draw(), condition).collections:
            if part.get_hatch():
                hatched += len(part.get_paths())
    assert hatched == 3
    assert "refused" in texts(draw())


def test_a_dot_on_the_first_reading_of_each_cell():
    dots = {c: points(panel(draw(), c), "o") for c in ("PA", "PD", "NA", "ND")}
    assert dots["PA"] == [(0, 0), (3, 1)]
    assert sum(map(len, dots.values())) == len(cell_names())


def test_the_backlash_is_marked_in_every_panel():
    figure = draw()
    assert "backlash: day 5" in texts(figure)
    for condition in ("PA", "PD", "NA", "ND"):
        assert any(list(x.get_xdata()) == [5.0, 5.0] for x in panel(figure, condition).get_lines())


def test_all_refused_and_nothing_changed_draw_too():
    draw_all_cells(DAYS, [run_of_modes(refused=cell_names())] * 3)
    draw_all_cells(DAYS, [run_of_modes(spectra=False)] * 3)


def test_impossible_pictures_are_refused():
    with pytest.raises(InputError, match="2 days, 3 runs"):
        draw_all_cells(DAYS[:2], RUNS)
    with pytest.raises(InputError, match="no run has a cell of motion 4"):
        draw_all_cells(DAYS, RUNS, motion=4)
