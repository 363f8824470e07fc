from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("matplotlib")

from tests.report.axis_m import (
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    texts,
)
from tests.report.some_runs import points, run_of_modes, true_frequencies

from ballscrew.base.errors import InputError
from ballscrew.report.levels_figure import draw_levels

FIRST = {0.0: 200.0, 20.0: 185.0, 40.0: 170.0}
RUNS = {load: run_of_modes(f, load=load) for load, f in FIRST.items()}
TRUTHS = {load: true_frequencies(f) for load, f in FIRST.items()}


def draw(runs=RUNS, **changes):
    return draw_levels(runs, (0.0, 0.1), truths=TRUTHS, **changes)


def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_a_star_for_each_load_at_each_position():
    for axes, less in zip(draw().axes, (0, 10), strict=True):
        assert sorted(f for f, _ in points(axes, "*")) == [171.0 - less, 186.0 - less, 201.0 - less]


def test_the_truth_stands_below_in_the_loads_own_colour():
    for axes, less in zip(draw().axes, (0, 10), strict=True):
        curves = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
        marks = [line for line in axes.get_lines() if line.get_label() == "_true"]
        assert [line.get_xdata()[0] for line in marks] == [200.0 - less, 185.0 - less, 170.0 - less]
        assert [line.get_color() for line in marks] == [line.get_color() for line in curves]
        assert len({line.get_color() for line in marks}) == 3


def test_a_refused_load_is_dashed_and_named():
    figure = draw({**RUNS, 20.0: run_of_modes(185.0, load=20.0, refused={(0.0, "ND")})})
    first, second = figure.axes
    assert len(points(first, "*")) == 2
    assert len(points(second, "*")) == 3
    styles = [line.get_linestyle() for line in first.get_lines() if len(line.get_xdata()) > 2]
    assert styles == ["-", "--", "-"]
    assert "refused: 20 kg" in texts(figure)


def test_all_refused_and_a_load_without_spectra_draw_too():
    gone = {(x, "ND") for x in (0.0, 0.1)}
    figure = draw_levels(
        {0.0: run_of_modes(refused=gone, missing=gone), 10.0: run_of_modes(refused=gone)}, (0.0, 0.1)
    )
    assert "refused: 0 kg, 10 kg" in texts(figure)


@pytest.mark.parametrize(
    ("runs", "positions", "message"),
    [
        ({}, (0.0,), "no run or no position"),
        (RUNS, (), "no run or no position"),
        ({0.0: run_of_modes(spectra=False)}, (0.0,), "contains no frequency response"),
    ],
)
def test_impossible_pictures_are_refused(runs, positions, message):
    with pytest.raises(InputError, match=message):
        draw_levels(runs, positions)


def test_a_load_without_a_cell_or_a_frequency_has_no_star():
    one, *_ = RUNS
    absent = replace(RUNS[one], cells=tuple(cell for cell in RUNS[one].cells if cell.position_m != 0.0))
    first, second = draw({**RUNS, one: absent}).axes
    assert len(points(first, "*")) == 2
    assert len(points(second, "*")) == 3
