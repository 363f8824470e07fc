from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tests.report.axis_m import (
    AXIS,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    texts,
)
from tests.report.some_runs import PLACES, crosses, intervals, line_named, run_of_modes, true_frequencies

from ballscrew.axis.frequency import axial_natural_frequency, predicted_frequency
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.base.errors import InputError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.report.comparison_figure import draw_against_load, draw_against_position
from ballscrew.report.measured import beside, cell_of

HALF = NORMAL_95 * 0.5
TRUE = true_frequencies(180.0)
FIRST = {0.0: 200.0, 20.0: 185.0, 40.0: 170.0}


def runs(**changes):
    return {load: run_of_modes(f, load=load, **changes) for load, f in FIRST.items()}


def along(**changes):
    return draw_against_position(run_of_modes(**changes), AXIS, truth=TRUE)


def over():
    return draw_against_load(runs(), AXIS, 0.1, truth={load: f - 10 for load, f in FIRST.items()})


@pytest.mark.parametrize("draw", [along, over])
def test_units_margins_and_the_same_file(draw, tmp_path):
    figure = draw()
    assert len(figure.axes) == 3
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_every_cell_has_its_95_percent_interval():
    shown = intervals(along().axes[0])
    assert set(shown) == {"PA", "PD", "NA", "ND"}
    for condition, rows in shown.items():
        there = [x for x in PLACES if cell_of(run_of_modes(), x, condition)]
        assert [x for x, _, _ in rows] == pytest.approx(
            [1e3 * (x + beside(PLACES, condition)) for x in there]
        )
        assert [low for _, low, _ in rows] == pytest.approx([TRUE[x] + 1 - HALF for x in there])
        assert [high for _, _, high in rows] == pytest.approx([TRUE[x] + 1 + HALF for x in there])


def test_the_theory_is_that_of_the_given_sheet():
    right = along().axes[1]
    x, free = line_named(right, "rotor free, torsion of the shaft included")
    assert free == pytest.approx(predicted_frequency(AXIS, x / 1e3, 50.0))
    x, held = line_named(right, "rotor held: Eq. (3) of the paper")
    assert held == pytest.approx(axial_natural_frequency(AXIS, x / 1e3, 50.0, rotor="held"))
    (band,) = [part for part in right.collections if part.get_label() == "tolerances, 95 %"]
    free = with_uncertainty(AXIS, PLACES[0], 50.0)
    heights = [y for x, y in band.get_paths()[0].vertices if x == 0]
    assert min(heights) == pytest.approx(float(free.value - NORMAL_95 * free.standard_uncertainty))
    assert max(heights) == pytest.approx(float(free.value + NORMAL_95 * free.standard_uncertainty))


def test_the_theory_against_load_is_that_of_the_stop():
    x, free = line_named(over().axes[1], "rotor free, torsion of the shaft included")
    assert free == pytest.approx(predicted_frequency(AXIS, 0.1, x))


@pytest.mark.parametrize("index", [0, 1])
def test_true_values_are_shown_in_both_panels(index):
    x, f = line_named(along().axes[index], "true")
    assert np.array_equal(x, 1e3 * np.array(PLACES))
    assert np.array_equal(f, [TRUE[place] for place in PLACES])


def test_the_residual_is_measured_less_true():
    figure = along()
    for rows in intervals(figure.axes[2]).values():
        for _, low, high in rows:
            assert (low, high) == pytest.approx((1 - HALF, 1 + HALF))
    assert "8 of 8 cells, median +1.0 Hz; 0 of 8 intervals contain the true value" in texts(figure)


def test_a_refused_cell_is_a_cross_in_both_panels():
    figure = along(refused={(0.1, "PA"), (0.2, "NA")})
    wanted = [1e3 * (0.1 + beside(PLACES, "PA")), 1e3 * (0.2 + beside(PLACES, "NA"))]
    for axes in (figure.axes[0], figure.axes[2]):
        assert crosses(axes) == pytest.approx(wanted)
    assert "refused" in texts(figure)
    assert "6 of 8 cells" in texts(figure)


def test_all_refused_is_still_a_picture():
    gone = {(x, c) for x in PLACES for c in ("PA", "PD", "NA", "ND")}
    figure = along(refused=gone)
    assert len(crosses(figure.axes[0])) == 8
    assert "every cell is refused" in texts(figure)
    assert_nothing_leaves_the_picture(figure)


def test_nothing_refused_no_cross():
    assert crosses(along().axes[0]) == []
    assert "refused" not in texts(along())


def test_without_truth_there_is_no_residual():
    figure = draw_against_position(run_of_modes(), AXIS)
    assert len(figure.axes) == 2
    assert "true" not in texts(figure)


def test_one_load_is_a_picture_too():
    figure = draw_against_load({0.0: run_of_modes(load=0.0)}, AXIS, 0.0, truth={0.0: 180.0})
    assert set(intervals(figure.axes[0])) == {"PA", "ND"}


def test_impossible_pictures_are_refused():
    with pytest.raises(InputError, match="states no load"):
        draw_against_position(run_of_modes(load=None), AXIS)
    with pytest.raises(InputError, match="nothing to draw"):
        draw_against_position(run_of_modes(), AXIS, motion=1)
    with pytest.raises(InputError, match="nothing to draw"):
        draw_against_load(runs(), AXIS, 0.37)
    with pytest.raises(InputError, match="nothing to draw"):
        draw_against_load({}, AXIS)


def test_a_run_from_json_has_all_that_is_needed():
    draw_against_position(run_of_modes(spectra=False), AXIS, truth=TRUE)
