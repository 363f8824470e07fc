"""The axis M 25 × 10 and a plan, for tests of pictures; and what every picture must have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.report.canvas import save_figure

AXIS = DataSheet(
    name="M",
    support="fixed-free",
    screw=Screw(0.010, 0.0214, 0.025, 0.90, 0.12, 17e3, 450e6, 0.10, 0.04),
    bearing=Bearing(180e6),
    table=Table(101.5),
    drive=Drive(3.0e-4),
    guide=Guide(25.0),
)
PLAN = Plan((0.0, 0.1, 0.2, 0.3), 3, (0.0,), (Motion(0.15, 2.5, 1500.0, 0.35),))


def curves(axes: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lines of more than two points."""
    lines = [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in axes.get_lines()]
    return [(x, y) for x, y in lines if len(x) > 2]


def texts(figure: Any) -> str:
    """All that is written on a figure."""
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in figure.findobj(Text))


def assert_every_axis_has_its_unit(figure: Any) -> None:
    """Labels hold a unit in brackets, or name a pure number."""
    pure = {"nut load F over preload P", "rigidity k(F)/k(0)", "independent cells"}
    labels = {label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label}
    assert labels
    assert {label for label in labels if not label.endswith(")")} - pure == set()


def assert_nothing_leaves_the_picture(figure: Any) -> None:
    """No text is cut by the figure's edge."""
    from matplotlib.text import Text

    figure.draw_without_rendering()
    width, height = figure.bbox.width, figure.bbox.height
    cut = []
    for text in figure.findobj(Text):
        if text.get_text().strip() and text.get_visible() and text.axes is not None:
            box = text.get_window_extent()
            inside = box.x0 >= -1 and box.x1 <= width + 1 and box.y0 >= -1 and box.y1 <= height + 1
            ticks = [*text.axes.get_xticklabels(), *text.axes.get_yticklabels()]
            if not inside and text not in ticks:
                cut.append(text.get_text())
    assert cut == []


def assert_the_same_file_twice(draw: Any, folder: Path) -> None:
    """Drawn anew, byte for byte; ``test_plan_figure.py`` compares the other formats of a figure."""
    for name in ("a.svg", "b.svg"):
        save_figure(draw(), folder / name)
    content = (folder / "a.svg").read_bytes()
    assert len(content) > 10_000
    assert content == (folder / "b.svg").read_bytes()
