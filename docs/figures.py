"""Draws the pictures of the pages *The machine and the test* and *Plan a test*.

Usage: python -m docs.figures [FOLDER]

FOLDER is docs/_static where it is not given. The axis, the plan and all that is chosen for the pictures stand
here and nowhere else; tests/docs/test_machine_page.py compares the page's numbers with them. With the same
matplotlib, the same figure becomes the same file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from docs.pictures.conditions import draw_conditions
from docs.pictures.nut import draw_nut
from docs.pictures.quarter import draw_quarter
from docs.pictures.supports import draw_supports

from ballscrew.axis.sheet import Drive
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.planned import plan
from ballscrew.report.axis_figures import draw_theory
from ballscrew.report.canvas import save_figure
from ballscrew.report.degradation_figure import draw_degradation
from ballscrew.report.plan_figure import draw_plan
from ballscrew.testbed.example import AXIS as EXAMPLE
from ballscrew.testbed.example import PLAN as EXAMPLE_PLAN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DAY = 86400.0
TRAVEL = (0.0, 0.450)
LIFE = 80 * DAY  # until the preload is gone, as in the paper's run to failure

# The 25 × 10 mm screw of the page "Where we depart from the paper"; table 100 kg and nut 1.5 kg.
AXIS = replace(
    EXAMPLE, name="M 25x10", table=replace(EXAMPLE.table, mass=101.5), drive=Drive(rotor_inertia=3.0e-4)
)
MOTION = Motion(speed=0.150, acceleration=2.5, jerk=1500.0, dwell=0.350)
PLAN = Plan(EXAMPLE_PLAN.positions, repetitions=30, masses=(0.0,), motions=(MOTION,))
# Fewer stops, so that one can be seen.
SHORT_PLAN = Plan(positions=PLAN.positions[:5], repetitions=1, masses=(0.0,), motions=(MOTION,))
LEFT = 0.75  # of the preload, in the picture of a quarter of it
UNCERTAINTIES = (0.3, 0.9)  # Hz, of a cell: what is hoped for, and the median of the page "Uncertainty"

FIGURES: dict[str, Callable[[], Figure]] = {
    "degradation": lambda: draw_degradation(
        AXIS, preload_gone=LIFE, end=100 * DAY, position=0.0, load=0.0, falls=(1, 5, 10, 20), backlash=0.4e-6
    ),
    "theory": lambda: draw_theory(
        AXIS, preload_ratios=(0.04, 0.03, 0.02, 0.01, 0.005), loads=(0, 10, 20, 30, 40, 50), travel=TRAVEL
    ),
    "conditions": lambda: draw_conditions(SHORT_PLAN),
    "supports": lambda: draw_supports(AXIS, travel=TRAVEL, heaviest=200.0, preload_ratios=(0.001, 0.08)),
    "quarter": lambda: draw_quarter(AXIS, PLAN, left=LEFT, uncertainties=UNCERTAINTIES),
    "nut": lambda: draw_nut(AXIS, parts=(1, 0.5, 0.2), furthest=8.0, heaviest=3000.0),
}


def main(folder: Path) -> None:
    """Draw all of them."""
    for name, draw in FIGURES.items():
        save_figure(draw(), folder / f"{name}.png")
    save_figure(draw_plan(plan(replace(PLAN, repetitions=3), axis=AXIS)), folder / "plan.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "_static")
