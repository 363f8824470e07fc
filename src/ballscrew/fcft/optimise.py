"""Most informative stops and loads per minute, by an exchange algorithm over a plan's candidates."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.axis.axial import AxialModel
from ballscrew.axis.information import d_information
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.result import PlottedResult
from ballscrew.base.settings import check_setting
from ballscrew.base.threads import single_threaded
from ballscrew.fcft.plan import Plan, validate_plan
from ballscrew.fcft.plan_information import (
    PlanInformation,
    change_time,
    determined_parameters,
    marginal_precision,
    plan_information,
)
from ballscrew.fcft.run_information import (
    known_preload_information,
    preload_ratio,
    reference_preload,
    run_rows,
    sheet_prior,
)
from ballscrew.fcft.scatter import FrequencyScatter, default_scatter
from ballscrew.fcft.schedule import trip_time, trips

if TYPE_CHECKING:
    import pandas as pd

CHANGE_MINUTES = 10.0
"""Default time to change the load on the table, min."""

ADJUST_MINUTES = 30.0
"""Default time to set another preload of an adjustable nut and run it in, min."""

_STOPS = 11  # candidates at most
_MOST_LOADS, _MOST_MINUTES = 50, 10_000.0
_GAIN = 1e-9  # least relative gain of information per minute of an exchange
_Design = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]  # stops, loads, preloads


@dataclass(frozen=True, slots=True, repr=False)
class Optimised(PlottedResult):
    """Plan with the stops, loads and preloads that have the most information per minute.

    Parameters
    ----------
    plan : Plan
        Chosen plan; motions, repetitions and the rest are those of the given plan.
    chosen, given : PlanInformation
        Information of the chosen and of the given plan.
    change_minutes, adjust_minutes : float
        Time to change the load, and to set another preload, min.
    loads, stops, preloads : tuple of float
        Candidates, kg, m and N; no preloads if the nut stays as it is.
    scatter : FrequencyScatter
        Assumed scatter of runs.
    known_from : str
        Prior knowledge of the axis: ``"data sheet"`` or ``"model"``.
    """

    plan: Plan
    chosen: PlanInformation
    given: PlanInformation
    change_minutes: float
    loads: tuple[float, ...]
    stops: tuple[float, ...]
    scatter: FrequencyScatter
    known_from: str = "data sheet"
    preloads: tuple[float, ...] = ()
    adjust_minutes: float = ADJUST_MINUTES

    _drawing = "planning_figure:draw_information"

    def _lines(self) -> list[str]:
        stops = ", ".join(f"{1e3 * stop:g}" for stop in self.plan.positions)
        loads = ", ".join(f"{load:g}" for load in self.plan.masses)
        title = f"{self.ratio:.3g} times the information per minute of the given plan"
        if not self.given.per_minute:
            title = "the given plan does not determine all parameters"
        return [
            f"{title}, by the {self.known_from}",
            f"stops at {stops} mm",
            f"loads of {loads} kg",
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the given and the chosen plan: time and information."""
        import pandas as pd

        names = ["minutes", "measuring_minutes", "information", "information_per_minute", "bits"]
        plans = {"given": self.given.to_json(), "chosen": self.chosen.to_json()}
        return pd.DataFrame([{"plan": name} | row for name, row in plans.items()], columns=["plan", *names])

    @property
    def ratio(self) -> float:
        """Information per minute of the chosen plan over that of the given one; infinite if that has none."""
        if self.given.per_minute == 0:
            return math.inf
        return self.chosen.per_minute / self.given.per_minute

    def to_json(self) -> dict[str, Any]:
        """Document with units in the keys; ``information_per_minute_ratio`` is null if infinite."""
        return {
            "plan": self.plan.to_settings(),
            "chosen": self.chosen.to_json(),
            "given": self.given.to_json(),
            "information_per_minute_ratio": self.ratio if math.isfinite(self.ratio) else None,
            "change_minutes": self.change_minutes,
            "candidate_loads_kg": list(self.loads),
            "candidate_stops_m": list(self.stops),
            "candidate_preloads_N": list(self.preloads),
            "adjust_minutes": self.adjust_minutes,
            "known_from": self.known_from,
            "scatter": {
                "cell_Hz": self.scatter.cell,
                "trip_Hz": self.scatter.trip,
                "run_Hz": self.scatter.run,
                "lasting_Hz": self.scatter.lasting,
                "load": self.scatter.load,
                "source": self.scatter.source,
            },
        }


def candidate_stops(plan: Plan) -> tuple[float, ...]:
    """Candidate stops: at most 11 from first to last, whole mm, as close as the motions allow."""
    first, last = plan.positions[0], plan.positions[-1]
    gap = 2 * max(motion.acceleration_distance for motion in plan.motions)
    count = int(min(_STOPS - 1, max(1, math.floor((last - first) / gap * (1 + 1e-9)))))
    exact = first + (last - first) * np.arange(count + 1) / count
    rounded = np.concatenate([[first], np.round(exact[1:-1], 3), [last]])
    if np.diff(rounded).min() >= gap:
        return tuple(rounded.tolist())
    return tuple(exact.tolist())


@single_threaded
def optimise(
    plan: Plan,
    sheet: DataSheet,
    *,
    loads: Sequence[float] | None = None,
    preloads: Sequence[float] | None = None,
    change_minutes: float = CHANGE_MINUTES,
    adjust_minutes: float = ADJUST_MINUTES,
    scatter: FrequencyScatter | None = None,
    model: AxialModel | None = None,
    covariance: Array | None = None,
    centre: bool = True,
) -> Optimised:
    """Choose the stops and loads of a plan with the most information per minute.

    Every candidate stop and load is added, removed or exchanged as long as that gains
    information per minute, from several starts (Fedorov's exchange, here of whole rows and columns: a
    plan has the same stops with every load). The information is det^(1/p) of the parameters that frequencies
    at one preload determine, see :class:`~ballscrew.fcft.plan_information.PlanInformation`; the rotor is
    known from the data sheet. The first and the last stop stay, so that nothing is extrapolated.

    Parameters
    ----------
    plan : Plan
        Plan with the travel, motions, repetitions and warm-up, which stay.
    sheet : DataSheet
        The axis.
    loads : sequence of float, optional
        Candidate loads, kg; by default the plan's.
    preloads : sequence of float, optional
        Candidate preloads of an adjustable nut, N; by default the plan's. The nut's share of the compliance
        counts as information if there are several. The one nearest to the nominal preload stays.
    change_minutes, adjust_minutes : float
        Time to change the load, and to set another preload, min.
    scatter : FrequencyScatter, optional
        Scatter of the runs; by default :func:`~ballscrew.fcft.scatter.default_scatter`.
    model : AxialModel, optional
        Expected axis; by default that of the data sheet.
    covariance : ndarray, shape (7, 7), optional
        Covariance of its working vector; by default the data sheet's.
    centre : bool
        Whether a stop in the middle third of the travel and, where there are three loads or preloads, one in
        the middle third of them are required: without them a misfit of the model would not show.

    Returns
    -------
    Optimised
        Chosen plan with its information and that of the given plan.

    Raises
    ------
    InputError
        If the plan does not fit the axis, a load or time is out of range, or a model lacks its covariance.
    """
    weights = _loads(plan, loads)
    forces = _preloads(plan, preloads)
    validate_plan(plan, sheet)
    validate_plan(replace(plan, preloads=forces), sheet)
    times = change_minutes, adjust_minutes
    for minutes, what in ((change_minutes, "change the load"), (adjust_minutes, "set another preload")):
        check_setting(f"the time to {what}, in minutes,", minutes, least=0.0, most=_MOST_MINUTES)
    if scatter is None:
        scatter = default_scatter(sheet)
    span = plan.positions[0], plan.positions[-1]
    if (model is None) != (covariance is None):
        raise InputError("a model and its covariance belong together; one of them was given alone.")
    known_from = "model"
    if model is None or covariance is None:
        known_from = "data sheet"
        model, covariance = sheet_prior(replace(plan, preloads=forces), sheet)
    stops = candidate_stops(plan)
    candidates = stops, weights, forces
    search = _Search(plan, model, covariance, scatter, times, span, candidates, centre)
    best = max((search.climb(start) for start in search.starts()), key=search.value)
    chosen = search.plan_of(best)
    information = partial(
        plan_information,
        model=model,
        covariance=covariance,
        scatter=scatter,
        change_minutes=change_minutes,
        span=span,
        adjust_minutes=adjust_minutes,
        preloads=len(forces),
    )
    return Optimised(
        plan=chosen,
        chosen=information(chosen),
        given=information(plan),
        change_minutes=change_minutes,
        loads=weights,
        stops=stops,
        scatter=scatter,
        known_from=known_from,
        preloads=forces,
        adjust_minutes=adjust_minutes,
    )


def _loads(plan: Plan, given: Sequence[float] | None) -> tuple[float, ...]:
    loads = plan.masses
    if given is not None:
        loads = tuple(given)
    if not loads or len(loads) > _MOST_LOADS or len(set(loads)) < len(loads):
        raise InputError(f"the loads must be 1 to {_MOST_LOADS}, each given once; {len(loads)} were given.")
    for load in loads:
        check_setting("a load, in kg,", load, least=0.0, most=1e6)
    return tuple(sorted(loads))


def _preloads(plan: Plan, given: Sequence[float] | None) -> tuple[float, ...]:
    preloads = plan.preloads if given is None else tuple(given)
    if len(preloads) > _MOST_LOADS or len(set(preloads)) < len(preloads):
        raise InputError(
            f"the preloads must be {_MOST_LOADS} or fewer, each given once; {len(preloads)} were given."
        )
    for preload in preloads:
        check_setting("a preload, in N,", preload, above=0.0)
    return tuple(sorted(preloads))


class _Search:
    """Candidates of one plan, and the information per minute of a choice of them."""

    def __init__(
        self,
        plan: Plan,
        model: AxialModel,
        covariance: Array,
        scatter: FrequencyScatter,
        minutes: tuple[float, float],
        span: tuple[float, float],
        candidates: _Design,
        centre: bool,
    ) -> None:
        self.given, self.model, self.minutes = plan, model, minutes
        self.stops, self.loads, self.preloads = candidates
        self.centre = centre
        self.reference = reference_preload(self.preloads, model.preload)
        self.trips = Counter(trip.executed for trip in trips(plan))
        self.precision = marginal_precision(covariance)
        all_stops = replace(plan, positions=self.stops)
        self.determined = determined_parameters(model, len(self.preloads))
        self.ratios = {
            preload: preload_ratio(preload, self.reference, model) for preload in self.preloads or (None,)
        }
        self.rows = {
            (load, preload): run_rows(all_stops, load, model, scatter, span, ratio)
            for load in self.loads
            for preload, ratio in self.ratios.items()
        }
        self.runs: dict[tuple[tuple[float, ...], float, float | None], Array] = {}
        self.values: dict[_Design, float] = {}

    def plan_of(self, design: _Design) -> Plan:
        stops, loads, preloads = design
        return replace(
            self.given, positions=stops, masses=loads, preloads=preloads, source="the optimised plan"
        )

    def value(self, design: _Design) -> float:
        """Information per minute."""
        if design not in self.values:
            stops, loads, preloads = design
            settings = preloads or (None,)
            of_runs = np.sum([self._at_preload(stops, loads, preload) for preload in settings], axis=0)
            information = d_information(of_runs, self.determined, self.precision)
            self.values[design] = information / self._minutes(design)
        return self.values[design]

    def _at_preload(self, stops: tuple[float, ...], loads: tuple[float, ...], preload: float | None) -> Array:
        """Information of the runs at one preload about the working vector, shape (7, 7)."""
        runs = np.sum([self._information(stops, load, preload) for load in loads], axis=0)
        if preload is None:
            return np.asarray(runs[:-1, :-1])
        return known_preload_information(runs, self.ratios[preload] == 1.0)

    def _information(self, stops: tuple[float, ...], load: float, preload: float | None) -> Array:
        """Information of one run; the ends stay, so a stop has as many cells as among all candidates."""
        key = stops, load, preload
        if key not in self.runs:
            self.runs[key] = self.rows[load, preload].information(list(map(self.stops.index, stops)))
        return self.runs[key]

    def _minutes(self, design: _Design) -> float:
        """As :func:`~ballscrew.fcft.plan_information.test_minutes`, each kind of trip computed once."""
        plan = self.plan_of(design)
        seconds = sum(count * trip_time(plan, motion) for motion, count in self.trips.items())
        return plan.run_count * seconds / 60 + change_time(plan, *self.minutes)

    def starts(self) -> Iterator[_Design]:
        """Ends with their middle, all candidates, and all loads at the end stops with their middle."""
        preloads: tuple[float, ...] = ()
        if self.preloads:
            preloads = tuple(sorted({*_corners(self.preloads), self.reference}))
        yield _corners(self.stops), _corners(self.loads), preloads
        yield self.stops, self.loads, self.preloads
        yield _corners(self.stops), self.loads, self.preloads

    def climb(self, design: _Design) -> _Design:
        """Make the best exchange until none gains."""
        while True:
            best = max(self._neighbours(design), key=self.value, default=design)
            if not self.value(best) > self.value(design) * (1 + _GAIN):
                return design
            design = best

    def _neighbours(self, design: _Design) -> Iterator[_Design]:
        required: tuple[set[float], ...] = ({self.stops[0], self.stops[-1]}, set(), set())
        if self.preloads:
            required[2].add(self.reference)
        for factor, candidates in enumerate((self.stops, self.loads, self.preloads)):
            for other in _exchanged(design[factor], candidates):
                if required[factor] <= set(other) and (not self.centre or _has_middle(other, candidates)):
                    changed = list(design)
                    changed[factor] = other
                    stops, loads, preloads = changed
                    yield stops, loads, preloads


def _exchanged(chosen: tuple[float, ...], candidates: tuple[float, ...]) -> Iterator[tuple[float, ...]]:
    """Choices with one candidate more, one less, or one exchanged."""
    others = [candidate for candidate in candidates if candidate not in chosen]
    for added in others:
        yield tuple(sorted((*chosen, added)))
    for index in range(len(chosen)):
        rest = chosen[:index] + chosen[index + 1 :]
        if rest:
            yield rest
            for added in others:
                yield tuple(sorted((*rest, added)))


def _corners(candidates: tuple[float, ...]) -> tuple[float, ...]:
    """The ends, and the candidate nearest to their middle."""
    middle = (candidates[0] + candidates[-1]) / 2
    nearest = min(candidates, key=lambda candidate: abs(candidate - middle))
    return tuple(sorted({candidates[0], nearest, candidates[-1]}))


def _has_middle(chosen: tuple[float, ...], candidates: tuple[float, ...]) -> bool:
    """Return True if the middle third of the choice has a candidate, or there are fewer than three."""
    low, high = chosen[0], chosen[-1]
    third = (high - low) / 3 * (1 + 1e-9)
    if len(chosen) > 2:
        return any(high - third * 2 <= value <= low + 2 * third for value in chosen)
    return len(candidates) < 3
