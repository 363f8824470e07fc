"""``ballscrew plan``: check of a plan on an axis before it is run."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballscrew.axis.rigidity import at_preload
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.axis.tolerances import tolerances
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.provenance import Made, digest
from ballscrew.base.result import PlottedResult, first_sentences
from ballscrew.base.words import duration as in_words
from ballscrew.base.words import plural
from ballscrew.fcft.concerns import notes, warnings
from ballscrew.fcft.excitation import nulls, torque_spectrum
from ballscrew.fcft.expected import ExpectedCell, executed, expected_cells
from ballscrew.fcft.levels import GentleMotion, Levels, gentle_motion, two_levels
from ballscrew.fcft.limits import check_limits, required_torque
from ballscrew.fcft.nutload import hardest
from ballscrew.fcft.plan import STEP_TIME, Motion, Plan, read_plan, validate_plan
from ballscrew.fcft.plan_information import PlanInformation, plan_information
from ballscrew.fcft.run_information import sheet_prior
from ballscrew.fcft.scatter import default_scatter
from ballscrew.fcft.schedule import duration, settings_changes, trip_time, trips
from ballscrew.fcft.trace import TraceSettings, trace_settings

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """One motion of a plan, with the demands on the axis.

    Parameters
    ----------
    motion : Motion
        The motion of the plan.
    trip_s : float
        One round trip, s.
    nulls : tuple of float
        Nulls of the torque up to twice the highest expected frequency, the first in any case, Hz.
    torque : float
        Highest motor torque, with the heaviest load, N m.
    torque_excitation : float
        Torque per hertz of one blow at the expected frequency where it is least, N m s.
    """

    motion: Motion
    trip_s: float
    nulls: tuple[float, ...]
    torque: float
    torque_excitation: float

    def to_json(self) -> dict[str, Any]:
        """Document with units in the keys."""
        document: dict[str, Any] = _motion(self.motion)
        document["trip_s"] = self.trip_s
        document["nulls_Hz"] = list(self.nulls)
        document["torque_Nm"] = self.torque
        document["torque_excitation_Nms"] = self.torque_excitation
        return document


@dataclass(frozen=True, slots=True, repr=False)
class PlannedTest(PlottedResult):
    """A plan on an axis, before anything moves.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    plan : Plan
        The test.
    cells : tuple of ExpectedCell
        By preload, mass, motion, position, condition.
    motions : tuple of PlannedMotion
        Motions of the plan.
    trip_count : int
        Round trips of one run, warm-up included.
    duration_s : float
        Duration of all trips of one run, s.
    levels : Levels
        Two suggested acceleration levels, or why there are none.
    gentle : GentleMotion
        A motion that still measures a worn nut, or why there is none.
    warnings : tuple of str
        Problems that would spoil the measurement.
    broken : tuple of str
        Limits of the machine that the plan breaks; such a plan is not exported.
    notes : tuple of str
        Facts to know.
    made : Made
        How this was computed.
    calibration : PlanInformation or None
        Expected accuracy of a calibration by all runs; None of a plan without preloads.
    """

    sheet: DataSheet
    plan: Plan
    cells: tuple[ExpectedCell, ...]
    motions: tuple[PlannedMotion, ...]
    trip_count: int
    duration_s: float
    levels: Levels
    gentle: GentleMotion
    warnings: tuple[str, ...]
    broken: tuple[str, ...]
    notes: tuple[str, ...]
    made: Made
    calibration: PlanInformation | None = None

    _drawing = "plan_panels:draw_expected"

    def _lines(self) -> list[str]:
        loads = ", ".join(f"{mass:g}" for mass in self.plan.masses)
        trips = f"{plural(self.trip_count, 'trip')}, {in_words(self.duration_s)}"
        return [
            f"{self.sheet.name}: {plural(len(self.cells), 'cell')}; with each load ({loads} kg) {trips}",
            *first_sentences([*self.broken, *self.warnings]),
        ]

    @property
    def trace(self) -> TraceSettings:
        """Settings of a trace by the drive."""
        return trace_settings(self.cells, [planned.trip_s for planned in self.motions])

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the cells, with the names of the JSON's keys."""
        import pandas as pd

        return pd.DataFrame(list(map(_cell, self.cells)))

    def to_json(self) -> dict[str, Any]:
        """Document with the schema's version and units in the keys."""
        trace = self.trace
        return {
            "schema": SCHEMA,
            "axis": self.sheet.name,
            "plan": self.plan.to_settings(),
            "trips": self.trip_count,
            "duration_s": self.duration_s,
            "total_s": self.duration_s * self.plan.run_count,
            "runs": _runs(self.plan),
            "motions": list(map(PlannedMotion.to_json, self.motions)),
            "cells": list(map(_cell, self.cells)),
            "levels": {
                "motions": list(map(_motion, self.levels.motions)),
                "nut_load_ratio": list(map(dict, self.levels.nut_load_ratio)),
                "shift_Hz": self.levels.shift,
                "reason": self.levels.reason,
            },
            "gentle": {
                "motion": None if self.gentle.motion is None else _motion(self.gentle.motion),
                "unloads_below": self.gentle.unloads_below,
                "own_unloads_below": self.gentle.own_unloads_below,
                "excitation": self.gentle.excitation,
                "reason": self.gentle.reason,
            },
            "trace": {
                "sample_rate_Hz": trace.rate,
                "interval_s": trace.interval,
                "record_s": list(trace.durations),
            },
            "calibration": None if self.calibration is None else self.calibration.to_json(),
            "warnings": list(self.warnings),
            "broken": list(self.broken),
            "notes": list(self.notes),
            "made": asdict(self.made),
        }


def plan(plan: str | Path | Plan, *, axis: str | Path | DataSheet) -> PlannedTest:
    """Check a plan on an axis: cells, duration, excitation of the natural frequency, nut load, limits.

    Parameters
    ----------
    plan : path-like or Plan
        The test.
    axis : path-like or DataSheet
        The axis.

    Returns
    -------
    PlannedTest
        The check, with warnings and broken limits.

    Raises
    ------
    InputError
        If a file is wrong, a stop not on the screw, or two stops too close for the speed.

    Examples
    --------
    >>> test = plan("plan.toml", axis="axis.toml")  # doctest: +SKIP
    >>> len(test.cells), test.duration_s, test.warnings  # doctest: +SKIP
    """
    sheet, test = axis, plan
    if not isinstance(sheet, DataSheet):
        sheet = read_axis(sheet)
    if not isinstance(test, Plan):
        test = read_plan(test)
    validate_plan(test, sheet)
    expected = expected_cells(test, sheet)
    limits = check_limits(test, sheet)
    softest = at_preload(sheet, min(test.preloads, default=None))
    return PlannedTest(
        sheet=sheet,
        plan=test,
        cells=expected,
        motions=tuple(_planned(test, sheet, index, expected) for index in range(len(test.motions))),
        trip_count=len(trips(test)),
        duration_s=duration(test),
        levels=two_levels(test, softest),
        gentle=gentle_motion(test, softest),
        warnings=warnings(test, sheet, expected),
        broken=limits.broken,
        notes=(*notes(test, sheet, expected), *_steps(test), *_stops(test), *_unchecked(sheet)),
        made=Made(
            settings={"tolerances": tolerances(sheet)},
            inputs={"axis": digest(sheet.to_settings()), "plan": digest(test.to_settings())},
        ),
        calibration=_calibration(test, sheet),
    )


def _calibration(test: Plan, sheet: DataSheet) -> PlanInformation | None:
    if not test.preloads:
        return None
    return plan_information(test, *sheet_prior(test, sheet), default_scatter(sheet), 0.0)


def _runs(test: Plan) -> list[dict[str, float | None]]:
    """Load and preload of each run, in their order."""
    preloads = test.preloads or (None,)
    return [{"preload_N": preload, "mass_kg": mass} for preload in preloads for mass in test.masses]


def _steps(test: Plan) -> tuple[str, ...]:
    """Note on a plan without a jerk."""
    if all(motion.jerk_time > STEP_TIME for motion in test.motions):
        return ()
    return (
        (
            f"the acceleration changes within {STEP_TIME * 1e3:g} ms or less, as is assumed without "
            "motion.jerk; a controller that limits the jerk more excites the mode less: state its limit."
        ),
    )


def _stops(test: Plan) -> tuple[str, ...]:
    count = settings_changes(test)
    if not count:
        return ()
    return (
        (
            f"acceleration or jerk change {count} times from trip to trip; G-code cannot set them, so its "
            "program stops (M0) each time to have them set by hand."
        ),
    )


def _unchecked(sheet: DataSheet) -> tuple[str, ...]:
    missing = [f"limits.{name}" for name, value in asdict(sheet.limits).items() if value is None]
    if not missing:
        return ()
    return (f"not checked, since {sheet.source} does not state it: {', '.join(missing)}.",)


def _planned(test: Plan, sheet: DataSheet, index: int, cells: tuple[ExpectedCell, ...]) -> PlannedMotion:
    motion = test.motions[index]
    highest = max(cell.frequency for cell in cells)
    runs = executed(test, index)
    modes = {(cell.mass, cell.frequency) for cell in cells if cell.motion == index}
    return PlannedMotion(
        motion=motion,
        trip_s=trip_time(test, motion),
        nulls=nulls(motion, max(2 * highest, 1 / motion.jerk_time)),
        torque=required_torque(sheet, hardest(runs), max(test.masses), max(test.preloads, default=None)),
        torque_excitation=min(float(torque_spectrum(sheet, runs, mass, f)) for mass, f in modes),
    )


def _motion(motion: Motion) -> dict[str, float]:
    return {
        "speed_m_per_s": motion.speed,
        "peak_acceleration_m_per_s2": motion.peak_acceleration,
        "jerk_m_per_s3": motion.jerk,
        "dwell_s": motion.dwell,
        "jerk_time_s": motion.jerk_time,
        "acceleration_time_s": motion.acceleration_time,
    }


def _cell(cell: ExpectedCell) -> dict[str, Any]:
    return {
        "preload_N": cell.preload,
        "mass_kg": cell.mass,
        "position_m": cell.position,
        "condition": str(cell.condition),
        "motion": cell.motion,
        "frequency_Hz": cell.frequency,
        "standard_uncertainty_Hz": cell.standard_uncertainty,
        "second_frequency_Hz": cell.second_frequency,
        "excitation": cell.excitation,
        "least_excitation": cell.least_excitation,
        "nut_load_N": cell.nut_load,
        "nut_load_ratio": cell.nut_load_ratio,
        "nut_load_shift_Hz": cell.nut_load_shift,
    }
