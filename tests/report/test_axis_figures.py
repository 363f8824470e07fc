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
from ballscrew.report.axis_figures import draw_theory

RATIOS, LOADS = (0.04, 0.02, 0.01), (0.0, 20.0, 50.0)


def theory(sheet=AXIS):
    return draw_theory(sheet, preload_ratios=RATIOS, loads=LOADS, travel=(0.0, 0.45))


def test_units_margins_and_the_same_file(tmp_path):
    before = plt.get_fignums()
    figure = theory()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(theory, tmp_path)
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


def test_theory_names_each_curve_without_overlap():
    figure = theory()
    figure.draw_without_rendering()
    assert {"4 %", "2 %", "1 %", "0 kg", "20 kg", "50 kg"} <= set(texts(figure).splitlines())
    for axes in figure.axes:
        heights = sorted(text.get_window_extent().y0 for text in axes.texts)
        assert np.all(np.diff(heights) > 0.9 * axes.texts[0].get_window_extent().height)


def test_a_travel_that_leaves_the_screw_is_refused():
    with pytest.raises(InputError, match=r"a position of 0\.78.* was given"):
        draw_theory(AXIS, preload_ratios=RATIOS, loads=LOADS, travel=(0.0, 0.9))


def test_any_support_and_name_draw():
    theory(replace(AXIS, support="fixed-supported", name="$\\frac{"))
