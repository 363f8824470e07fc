from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from docs.pictures.conditions import draw_conditions
from matplotlib.colors import to_hex
from tests.report.axis_m import (
    PLAN,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    texts,
)

from ballscrew.base.errors import InputError
from ballscrew.report.canvas import CONDITION_COLOURS


def draw():
    return draw_conditions(PLAN)


def coloured(axes):
    """Condition to the curves in its colour."""
    of = {colour.lower(): name for name, colour in CONDITION_COLOURS.items()}
    found: dict[str, list] = {}
    for line in axes.get_lines():
        name = of.get(to_hex(line.get_color()))
        if name:
            found.setdefault(name, []).append((np.asarray(line.get_xdata()), np.asarray(line.get_ydata())))
    return found


@pytest.mark.slow
def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_the_trip_has_4n_minus_4_phases_and_each_lies_at_its_stop():
    found = coloured(draw().axes[0])
    assert {name: len(phases) for name, phases in found.items()} == {"PA": 3, "PD": 3, "NA": 3, "ND": 3}
    for name, phases in found.items():
        at = [place[0] if name[1] == "A" else place[-1] for _, place in phases]
        # Positive ones leave from all but the last stop, and arrive at all but the first.
        expected = {"PA": (0, 100, 200), "PD": (100, 200, 300), "NA": (300, 200, 100), "ND": (200, 100, 0)}
        assert at == pytest.approx(expected[name], abs=1e-6)


def test_at_a_stop_the_table_arrives_before_it_leaves_and_every_speed_has_its_sign():
    figure = draw()
    up, down = figure.axes[2], figure.axes[4]
    for axes, arrival, departure, sign in ((up, "PD", "PA", 1), (down, "ND", "NA", -1)):
        found = coloured(axes)
        assert set(found) == {arrival, departure}
        ((t_in, v_in),), ((t_out, v_out),) = found[arrival], found[departure]
        assert t_in[-1] == pytest.approx(0, abs=1e-9)
        assert t_out[0] == pytest.approx(PLAN.motions[0].dwell)
        assert t_out[-1] - t_out[0] == pytest.approx(0.15 / 2.5 + 2.5 / 1500)
        assert (v_in[0], v_in[-1]) == pytest.approx((sign * 150, 0), abs=1e-6)
        assert (v_out[0], v_out[-1]) == pytest.approx((0, sign * 150), abs=1e-6)
        assert np.all(sign * np.diff(v_out) >= 0)


def test_table_1_has_a_chip_for_what_exists():
    table = draw().axes[-1]
    colours = [to_hex(patch.get_facecolor()) for patch in table.patches]
    of = {colour.lower(): name for name, colour in CONDITION_COLOURS.items()}
    rows = [[of[c] for c in colours[4 * i : 4 * i + 4] if c in of] for i in range(3)]
    assert rows == [["PA", "ND"], ["PD", "PA", "NA", "ND"], ["PD", "NA"]]


def test_every_condition_is_spelled_out():
    words = texts(draw())
    for part in ("PD: positive/deceleration", "PA: positive/acceleration", "NA: negative/acceleration",
                 "ND: negative/deceleration", "first stop", "inner stops", "last stop"):  # fmt: skip
        assert part in words


def test_a_plan_without_a_stop_between_is_refused():
    with pytest.raises(InputError, match=r"the plan has 2 stops; .* 3 or more"):
        draw_conditions(replace(PLAN, positions=(0.0, 0.1)))


def test_stops_too_close_are_refused():
    with pytest.raises(InputError, match="to reach"):
        draw_conditions(replace(PLAN, positions=(0.0, 0.001, 0.002)))
