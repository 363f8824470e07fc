"""The paper's run-to-failure experiment as a duty and a life: production moves, jittering, 80 days."""

from __future__ import annotations

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.testbed.duty import Duty, jitter, production
from ballscrew.testbed.exposure import exposure
from ballscrew.testbed.life import Life, calibrated
from ballscrew.testbed.pace import Pace

__all__ = ["run_to_failure_duty", "run_to_failure_life"]


def run_to_failure_duty(travel: float = 0.45, load: float = 100.0) -> Duty:
    """A day of production over the whole travel, and of jittering about a few places.

    The paper says that its duty jitters, not how: strokes, places and numbers are the testbed's own.

    Parameters
    ----------
    travel : float
        From 0, m.
    load : float
        What lies on the table, kg.

    Returns
    -------
    Duty
        Some ten hours of motion.
    """
    stops = [0.0, 0.25 * travel, 0.6 * travel, travel]
    moves = production(stops, 0.2, 2.0, 4000.0, {load: 1.0})
    places = [0.3 * travel, 0.5 * travel, 0.7 * travel]
    return Duty(moves + jitter(places, 0.03 * travel, 0.1, 2.0, 50_000.0, load))


def run_to_failure_life(
    sheet: DataSheet,
    days: float = 80.0,
    *,
    travel: float = 0.45,
    load: float = 100.0,
    preload: float | None = None,
    law: str = "contact-pressure",
    screw_share: float = 0.2,
    cells: int = 45,
) -> Life:
    """A life in which the preload falls from its nominal value to nothing in so many days.

    Parameters
    ----------
    sheet : DataSheet
        The axis as it is.
    days : float
        Until no preload is left where it is gone first.
    travel : float
        Of the duty, from 0, m.
    load : float
        kg.
    preload : float, optional
        P₀, N; nominal where not given.
    law : str
        A key of :data:`ballscrew.axis.wear.WEAR_LAWS`.
    screw_share : float
        Part of the wear that differs from place to place; jittering wears balls and nut above all.
    cells : int
        Of the grid over the travel.

    Returns
    -------
    Life
        Greased every 28 days.

    Raises
    ------
    InputError
        If a number cannot be.
    """
    seen = exposure(run_to_failure_duty(travel, load), sheet, np.linspace(0, travel, cells + 1))
    start = sheet.nominal_preload if preload is None else preload
    greased = tuple(float(day) for day in np.arange(28.0, max(days, 28.0) + 1, 28.0))
    life = Life(sheet, seen, start, law=law, pace=Pace(greased=greased), screw_share=screw_share)
    return calibrated(life, days)
