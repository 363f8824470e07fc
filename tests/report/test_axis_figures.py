from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib import pyplot as plt
from tests.report.axis_m import (
    AXIS,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    curves,
    texts,
)

from ballscrew.base.errors import InputError
from ballscrew.report.axis_figures import ROTOR_COLOURS, draw_supports, draw_theory

RATIOS, LOADS = (0.04, 0.02, 0.01), (0.0, 20.0, 50.0)


def theory(sheet=AXIS):
    return draw_theory(sheet, preload_ratios=RATIOS, loads=LOADS, travel=(0.0, 0.45))


def supports():
    return draw_supports(AXIS, travel=(0.0, 0.45), heaviest=200.0, preload_ratios=(0.001, 0.08))


@pytest.mark.parametrize("draw", [theory, supports])
def test_units_room_and_the_same_file(draw, tmp_path):
    before = plt.get_fignums()
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)
    assert plt.get_fignums() == before, "pyplot knows nothing of it"


def test_theory_falls_with_position_rises_with_preload_and_falls_with_load():
    figure = theory()
    for axes in figure.axes:
        found = curves(axes)
        assert len(found) == 3
        for x, f in found:
            assert (x[0], x[-1]) == (0.0, 450.0)
            assert np.all(np.diff(f) < 0)
        # Less preload and more load are both lower, at every position.
        for (_, upper), (_, lower) in pairwise(found):
            assert np.all(lower < upper)


def test_theory_has_the_numbers_of_eq_3_above_and_the_free_rotor_below():
    held, _, free, _ = theory().axes
    assert [f[0] for _, f in curves(held)] == pytest.approx([150.37, 144.06, 137.14], abs=0.005)
    assert [f[0] for _, f in curves(free)][::2] == pytest.approx([181.3, 165.4], abs=0.05)


def test_theory_names_each_curve_apart_from_the_others():
    figure = theory()
    figure.draw_without_rendering()
    assert {"4 %", "2 %", "1 %", "0 kg", "20 kg", "50 kg"} <= set(texts(figure).splitlines())
    for axes in figure.axes:
        heights = sorted(text.get_window_extent().y0 for text in axes.texts)
        assert np.all(np.diff(heights) > 0.9 * axes.texts[0].get_window_extent().height)


def test_supports_rise_with_preload_and_fall_with_load():
    figure = supports()
    panels = [axes for axes in figure.axes if curves(axes)]
    assert len(panels) == 9
    for number, axes in enumerate(panels):
        for _, f in curves(axes):
            slope = np.diff(f)
            if number % 3 == 1:
                assert np.all(slope > 0)
            elif number % 3 == 2 or number < 6:
                assert np.all(slope < 0)


def test_fixed_at_both_ends_is_lowest_in_the_middle_of_the_screw_and_never_softer():
    last = [axes for axes in supports().axes if curves(axes)][6]
    lines = {line.get_color(): [] for line in last.get_lines()}
    for line in last.get_lines():
        if len(line.get_xdata()) > 2:
            lines[line.get_color()].append(line)
    for colour in ROTOR_COLOURS.values():
        both, one_end = lines[colour]
        x, f = both.get_xdata(), both.get_ydata()
        assert x[np.argmin(f)] == pytest.approx(330, abs=5)
        assert np.all(f > one_end.get_ydata())
        assert both.get_linestyle() != one_end.get_linestyle()


def test_supported_is_free():
    panels = [axes for axes in supports().axes if curves(axes)]
    for free, supported in zip(panels[:3], panels[3:6], strict=True):
        for (_, one), (_, other) in zip(curves(free), curves(supported), strict=True):
            np.testing.assert_array_equal(one, other)


def test_the_free_rotor_is_the_higher_one_and_says_so():
    figure = supports()
    for axes in (axes for axes in figure.axes if curves(axes)):
        # The first of each colour is the support's own.
        own = {line.get_color(): line for line in reversed(axes.get_lines()) if len(line.get_xdata()) > 2}
        free, held = (own[ROTOR_COLOURS[rotor]].get_ydata() for rotor in ("free", "held"))
        assert np.all(free > held)
    assert {"rotor free", "rotor held", "fixed-free", "fixed-supported", "fixed-fixed"} <= set(
        texts(figure).splitlines()
    )


def test_a_travel_that_leaves_the_screw_is_refused():
    with pytest.raises(InputError, match=r"a position of 0\.78.* was given"):
        draw_theory(AXIS, preload_ratios=RATIOS, loads=LOADS, travel=(0.0, 0.9))


def test_any_support_and_name_draw():
    theory(replace(AXIS, support="fixed-supported", name="$\\frac{"))
