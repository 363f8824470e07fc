from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tests.report.axis_m import (
    AXIS,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    curves,
    texts,
)

from ballscrew.report.degradation_figure import draw_degradation

DAY = 86400.0


def draw(**changes):
    given = {"preload_gone": 80 * DAY, "end": 100 * DAY, "position": 0.0, "load": 0.0, "falls": (1, 10)}
    return draw_degradation(AXIS, **{**given, "backlash": 0.4e-6, **changes})


def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_preload_falls_to_nothing_and_slows_down():
    (days, outer), (_, alone) = curves(draw().axes[0])
    for preload in (outer, alone):
        assert preload[0] == pytest.approx(680)
        assert np.all(preload[days >= 80] == pytest.approx(0, abs=1e-9))
        falling = np.diff(preload[days < 80])
        assert np.all(falling < 0)
        assert np.all(np.diff(falling) > 0), "ever more slowly"
    assert np.all(alone[1:] <= outer[1:])
    assert np.interp(40, days, outer) / 680 == pytest.approx(0.5**1.5, abs=1e-3)
    assert np.interp(40, days, alone) / 680 == pytest.approx(0.5**3, abs=1e-3)


def test_no_backlash_before_the_preload_is_gone_and_twice_the_wear_beyond():
    ((days, backlash),) = curves(draw().axes[1])
    assert np.all(backlash[days <= 80] == 0)
    assert np.all(np.diff(backlash[days >= 80]) > 0)
    assert backlash[-1] == pytest.approx(2 * 7.69085 * 0.25, rel=1e-5)


def test_the_frequency_falls_from_the_first_day_and_ends_with_the_preload():
    for days, f in curves(draw().axes[2]):
        assert f[0] == pytest.approx(181.33, abs=0.005)
        assert np.all(np.diff(f) < 0)
        assert days[-1] <= 80


def test_days_are_named_at_their_points():
    words = texts(draw())
    assert "−1 Hz: day 5" in words
    assert "−10 Hz: day 36" in words
    assert "0.4 µm: day 82" in words
    assert "Stage I" in words
    assert "Stage II" in words


def test_another_life_moves_all_days_by_the_same_part():
    words = texts(draw(preload_gone=800 * DAY, end=1000 * DAY))
    assert "−1 Hz: day 49" in words
    assert "0.4 µm: day 821" in words
