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
from tests.report.some_runs import crosses, intervals, line_named

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.report.backlash_figure import WornAxis, draw_backlash

GIVEN = {
    "days": (0.0, 30.0, 60.0, 70.0, 80.0),
    "frequency": (180.0, 176.0, 168.0, None, None),
    "standard_uncertainty": (0.5, 0.5, 1.0, None, None),
    "backlash": (0.1e-7, -0.1e-7, 0.0, 2e-7, 4e-7),
    "backlash_uncertainty": (3e-8,) * 5,
    "backlash_day": 66.0,
    "truth": (179.0, 175.0, 167.0, float("nan"), float("nan")),
    "true_backlash": (0.0, 0.0, 0.0, 2e-7, 4e-7),
    "cell": "0 mm, PA, $1",
}
BARE = dict.fromkeys(("backlash_day", "truth", "true_backlash"))


def draw(**changes):
    return draw_backlash(**{**GIVEN, **changes})


@pytest.mark.parametrize("changes", [{}, BARE], ids=["all", "least"])
def test_units_margins_and_the_same_file(changes, tmp_path):
    figure = draw(**changes)
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(lambda: draw(**changes), tmp_path)


def test_frequencies_with_their_intervals_and_the_refused_as_crosses():
    upper = draw().axes[0]
    rows = intervals(upper)["measured, 95 %"]
    assert [x for x, _, _ in rows] == [0, 30, 60]
    assert [low for _, low, _ in rows] == pytest.approx(
        [180, 176, 168] - NORMAL_95 * np.array([0.5, 0.5, 1.0])
    )
    assert [x for x in crosses(upper) if x] == [70, 80]
    assert "refused" in texts(draw())


def test_backlash_in_micrometres_with_its_interval():
    lower = draw().axes[1]
    rows = intervals(lower)["backlash, 95 %"]
    middle = [(low + high) / 2 for _, low, high in rows]
    assert middle == pytest.approx([0.01, -0.01, 0, 0.2, 0.4])
    assert rows[0][2] - rows[0][1] == pytest.approx(2 * NORMAL_95 * 0.03)


def test_both_truths():
    upper, lower = draw().axes
    assert line_named(upper, "true")[1][:3] == pytest.approx([179, 175, 167])
    assert line_named(lower, "true backlash")[1] == pytest.approx([0, 0, 0, 0.2, 0.4])
    assert "true" not in texts(draw(**BARE))


def test_stages_meet_on_the_first_day_of_backlash():
    for axes in draw().axes:
        one, two = axes.patches[:2]
        assert one.get_x() + one.get_width() == pytest.approx(66)
        assert two.get_x() == pytest.approx(66)
    words = texts(draw())
    assert "Stage I: preload decreases" in words
    assert "Stage II: backlash" in words
    assert "Stage II" not in texts(draw(backlash_day=None))


def test_the_stated_fall_ends_before_any_backlash():
    assert "−12.0 Hz before any backlash" in texts(draw())
    assert "−4.0 Hz before any backlash" in texts(draw(backlash_day=50.0))
    assert "before any" not in texts(draw(backlash_day=None))


def test_a_cell_that_is_always_refused_is_still_a_picture():
    figure = draw(frequency=(None,) * 5, standard_uncertainty=(None,) * 5, **BARE)
    assert len(crosses(figure.axes[0])) == 5
    assert_nothing_leaves_the_picture(figure)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frequency": (1.0,)}, "frequency 1"),
        ({"truth": (1.0, 2.0)}, "truth 2"),
        ({"days": (0.0, 30.0, 30.0, 70.0, 80.0)}, "ascending"),
        ({name: () for name in GIVEN if isinstance(GIVEN[name], tuple)}, "2 days or more"),
    ],
)
def test_impossible_pictures_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        draw(**changes)


def test_a_nan_is_a_refusal_too():
    assert [x for x in crosses(draw(frequency=(180.0, np.nan, 168.0, None, None)).axes[0]) if x] == [
        30,
        70,
        80,
    ]


def test_beyond_the_test_there_are_gentler_motion_peak_and_upper_limits():
    below = Quantity(0.05, 0.03, "", (0.0, 0.1))
    ratio = (Quantity(1.0, 0.01), Quantity(0.5, 0.02), Quantity(0.2, 0.03), below, below)
    worn = WornAxis(
        peak=(None, None, None, 150.0, 149.0),
        gentle=((None, None),) * 3 + ((160.0, 1.0), (None, None)),
        ratio=ratio,
        gentle_ratio=(None, None, None, Quantity(0.08, 0.02), None),
        true_ratio=(1.0, 0.5, 0.2, 0.09, 0.0),
    )
    figure = draw(worn=worn)
    above, middle, _ = figure.axes
    assert [x for x, _, _ in intervals(above)["by a gentler motion, 95 %"]] == [70]
    assert [x for x in crosses(above) if x] == [80]
    assert [x for x, _, _ in intervals(middle)["as axial stiffness, 95 %"]] == [0, 30, 60]
    ends = next(c for c in middle.containers if c.get_label() == "below, 95 %").lines[0].get_xydata()
    assert ends.tolist() == [[70, 10], [80, 10]]
    assert_every_axis_has_its_unit(figure)


def test_the_alarm_is_a_line_with_its_days_before_backlash():
    figure = draw(alarm_day=54.0)
    assert "alarm: day 54" in texts(figure)
    assert "12 days before backlash" in texts(figure)
    for axes in figure.axes:
        assert any(np.all(np.asarray(line.get_xdata()) == 54.0) for line in axes.get_lines())
    alone = texts(draw(alarm_day=54.0, backlash_day=None))
    assert "alarm: day 54" in alone
    assert "before backlash" not in alone
    assert "alarm" not in texts(draw())
