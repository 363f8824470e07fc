from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from docs.pictures.supports import draw_supports
from tests.report.axis_m import (
    AXIS,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    curves,
    texts,
)

from ballscrew.report.axis_figures import ROTOR_COLOURS


def supports():
    return draw_supports(AXIS, travel=(0.0, 0.45), heaviest=200.0, preload_ratios=(0.001, 0.08))


@pytest.mark.slow
def test_units_margins_and_the_same_file(tmp_path):
    figure = supports()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(supports, tmp_path)


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
        for (_, first), (_, second) in zip(curves(free), curves(supported), strict=True):
            np.testing.assert_array_equal(first, second)


def test_the_free_rotor_is_higher_and_named():
    figure = supports()
    for axes in (axes for axes in figure.axes if curves(axes)):
        # The first of each colour is the support's own.
        own = {line.get_color(): line for line in reversed(axes.get_lines()) if len(line.get_xdata()) > 2}
        free, held = (own[ROTOR_COLOURS[rotor]].get_ydata() for rotor in ("free", "held"))
        assert np.all(free > held)
    assert {"rotor free", "rotor held", "fixed-free", "fixed-supported", "fixed-fixed"} <= set(
        texts(figure).splitlines()
    )
