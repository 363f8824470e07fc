from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tests.report.axis_m import (
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    texts,
)

from ballscrew.base.errors import InputError
from ballscrew.report.segments_figure import TransientSignals, draw_segments

TIME = np.linspace(-0.1, 0.2, 301)
PA = TransientSignals(
    TIME, np.clip(2 * TIME, 0, 0.15), np.sin(40 * TIME), np.cos(90 * TIME), 0.0, 0.075, (-0.03, 0.06)
)
ND = TransientSignals(
    TIME, np.clip(2 * TIME - 0.15, -0.15, 0), np.cos(40 * TIME), np.sin(90 * TIME), 0.0, 0.075, (0.04, 0.13)
)


def draw():
    return draw_segments(PA, ND)


def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_each_signal_has_its_row():
    axes = iter(draw().axes)
    for name, factor in (("speed", 1e3), ("torque", 1), ("acceleration", 1)):
        for segment in (PA, ND):
            ((x, y),) = [
                (line.get_xdata(), line.get_ydata())
                for line in next(axes).get_lines()
                if len(line.get_xdata()) == 301
            ]
            assert np.array_equal(x, TIME)
            assert y == pytest.approx(factor * getattr(segment, name))


def test_window_and_phase_are_marked_in_every_panel():
    for index, axes in enumerate(draw().axes):
        segment = (PA, ND)[index % 2]
        (shade,) = axes.patches
        assert (shade.get_x(), shade.get_x() + shade.get_width()) == pytest.approx(segment.window)
        edges = {line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2}
        assert {segment.start, segment.stop} <= edges


def test_the_parts_are_named_in_their_order():
    words = texts(draw())
    order = [
        "standstill",
        "acceleration",
        "steady speed",
        "window",
        "steady speed",
        "deceleration",
        "standstill",
        "window",
    ]
    lines = [line for line in words.splitlines() if line in order]
    assert lines == order


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": TIME[:-1]}, r"shapes \(301,\), \(300,\)"),
        ({"time": TIME[:, None]}, "one row each"),
        ({"start": 0.08}, r"the phase goes from 0\.08 to 0\.075 s"),
        ({"window": (0.1, 0.1)}, "the window goes from"),
        ({"stop": float("nan")}, "the phase goes from"),
    ],
)
def test_what_is_no_segment_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        replace(PA, **changes)
