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
from tests.report.some_runs import (
    cell_names,
    crosses,
    intervals,
    line_named,
    points,
    run_of_modes,
    true_frequencies,
)

from ballscrew.base.errors import InputError
from ballscrew.report.measured import response_of
from ballscrew.report.shift_figure import day_edges, draw_shift

DAYS = (0.0, 3.0, 6.0, 12.0)
FIRST = (180.0, 175.0, 168.0, 160.0)
CELLS = ((0.0, "PA"), (0.1, "ND"))
LOST = {(0.0, "PA")}
RUNS = [run_of_modes(f) for f in FIRST[:3]] + [run_of_modes(FIRST[3], refused=LOST)]
TRUTHS = [*(true_frequencies(f) for f in FIRST[:3]), {}]


def draw(**changes):
    return draw_shift(
        **{"days": DAYS, "runs": RUNS, "cells": CELLS, "truths": TRUTHS, "backlash_day": 9.0, **changes}
    )


def mesh(axes):
    (found,) = [part for part in axes.collections if type(part).__name__ == "QuadMesh"]
    return found


@pytest.mark.parametrize(
    "cells", [CELLS[:1], CELLS, (*CELLS, (0.2, "PD")), (*CELLS, (0.2, "PD"), (0.2, "NA"))]
)
def test_units_and_margins(cells):
    figure = draw(cells=cells)
    assert len(figure.axes) == len(cells) + 1
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)


def test_the_same_file_twice(tmp_path):
    assert_the_same_file_twice(draw, tmp_path)


def test_the_colours_are_the_magnitudes_day_by_day():
    for axes, cell in zip(draw().axes, CELLS, strict=False):
        part = mesh(axes)
        values = np.asarray(part.get_array())
        edges = part.get_coordinates()
        assert edges[0, :, 0].tolist() == pytest.approx([-1.5, 1.5, 4.5, 9.0, 15.0])
        grid = (edges[1:, 0, 1] + edges[:-1, 0, 1]) / 2
        for column, run in zip(values.T, RUNS, strict=True):
            response = response_of(run, *cell)
            assert column == pytest.approx(np.interp(grid, response.frequency, response.magnitude))


def test_the_frequencies_are_those_around_the_mode():
    low, high = draw().axes[0].get_ylim()
    middle = 176.0  # median of what is read
    assert low == pytest.approx(0.65 * middle, abs=2.1)
    assert high == pytest.approx(1.35 * middle, abs=2.1)


def test_what_is_read_has_a_point_with_its_interval_and_the_rest_a_cross():
    first, second = draw().axes[:2]
    assert points(first, "*") == [(0, 181), (3, 176), (6, 169)]
    assert [low for _, low, _ in intervals(first)["ANF"]] == pytest.approx(
        [181 - 0.98, 176 - 0.98, 169 - 0.98]
    )
    assert crosses(first) == [12]
    assert len(points(second, "*")) == 4
    assert crosses(second) == []
    assert "refused" in texts(draw())


def test_the_truth_ends_where_there_is_none():
    _, f = line_named(draw().axes[1], "true")
    assert f[:3] == pytest.approx([170, 165, 158])
    assert np.isnan(f[3])
    assert "true" not in texts(draw(truths=None))


def test_the_backlash_is_marked():
    figure = draw()
    for axes in figure.axes[:2]:
        assert any(list(line.get_xdata()) == [9.0, 9.0] for line in axes.get_lines())
    assert "backlash: day 9" in texts(figure)
    assert "backlash" not in texts(draw(backlash_day=None))


def test_a_day_without_spectra_is_hatched():
    runs = [*RUNS[:3], run_of_modes(FIRST[3], refused=LOST, missing=LOST)]
    figure = draw(runs=runs)
    (shade,) = [part for part in figure.axes[0].patches if part.get_hatch()]
    assert (shade.get_x(), shade.get_width()) == (9.0, 6.0)
    assert np.asarray(mesh(figure.axes[0]).get_array().mask)[:, 3].all()
    assert "no FRF" in texts(figure)


def test_a_day_whose_measurement_was_bad_is_hatched_too():
    bad = run_of_modes(FIRST[2], refused=cell_names(), spectra=False)
    figure = draw(runs=[*RUNS[:2], bad, RUNS[3]])
    for axes in figure.axes[:2]:
        assert 6.0 in crosses(axes)
        (shade,) = [part for part in axes.patches if part.get_hatch()]
        assert (shade.get_x(), shade.get_width()) == (4.5, 4.5)


def test_all_refused_is_still_a_picture():
    draw(runs=[run_of_modes(f, refused=LOST) for f in FIRST], cells=CELLS[:1], truths=None)


def test_beyond_the_test_there_are_the_gentler_motion_and_the_peak():
    """A day with a frequency by the gentler motion is no cross; the peak is that of the test itself."""
    axes = draw(gentle={12.0: run_of_modes(FIRST[3]), 3.0: run_of_modes(150.0)}).axes[0]
    assert points(axes, "D") == [(12, 161)]
    assert crosses(axes) == []
    _, peak = line_named(axes, "peak")
    assert np.flatnonzero(np.isfinite(peak)).tolist() == [3]
    assert peak[3] == pytest.approx(160, abs=2)
    assert "FRF’s peak: depends on amplitude" in texts(draw())
    assert "by a gentler motion" not in texts(draw())


def test_edges_lie_half_way():
    assert day_edges((0, 2)).tolist() == [-1, 1, 3]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"days": DAYS[:3]}, "3 days, 4 runs and 4 truths"),
        ({"truths": TRUTHS[:2]}, "4 days, 4 runs and 2 truths"),
        ({"days": DAYS[:1], "runs": RUNS[:1], "truths": None}, "2 or more"),
        ({"days": (0.0, 3.0, 3.0, 4.0)}, "each later"),
        ({"days": (0.0, 3.0, float("nan"), 4.0)}, "each later"),
        ({"cells": ()}, "no cell"),
        ({"cells": ((0.3, "PA"),)}, "at 300 mm, PA"),
        ({"runs": [*RUNS[:3], run_of_modes(spectra=False)]}, "contains no frequency response"),
    ],
)
def test_impossible_pictures_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        draw(**changes)
