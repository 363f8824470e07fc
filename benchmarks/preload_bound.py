"""How exact P/P₀ can be at best, whoever estimates it: the bound beside which the tables stand.

The posterior standard deviation of P/P₀, linearised at the truth (the Bayesian bound of Cramér and Rao; H. L.
Van Trees, 1968, section 2.4): given the true frequencies of the experiment, of the second known preload and
of the state, with the errors that the mode tables really have, and beforehand the sheet with its tolerances
as they are sampled. Of the machine K, k_b, P₀ and the bed are unknown, and what no sheet states: mass, rotor,
shaft, and what is soft beside the nut, as far as :data:`~ballscrew.axis.axial_prior.DISCREPANCY` says: who
knew these exactly would know the testbed, and no machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.axis.axial_prior import DISCREPANCY
from ballscrew.axis.tolerances import DEFAULT_TOLERANCES
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import FORM, Assumptions
from ballscrew.calibration.covariance import FLOOR
from ballscrew.fcft.plan import Plan
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import Machine, constants
from benchmarks.mode_tables import Analyst, true_effects

__all__ = ["Bound"]

_STEP = 1e-4
_ANY = 3.0  # of a ln ratio beforehand: nothing is known
_UNKNOWN = {
    **{name: DEFAULT_TOLERANCES[name] / math.sqrt(3) for name in ("rigidity", "stiffness", "preload_ratio")},
    "bed": 0.20,  # of its mass
    "table": DISCREPANCY["mass"],
    "shaft": DISCREPANCY["slope"] / 2,  # of its diameter
    "rotor": DISCREPANCY["rotor"],
}
"""Standard deviations of the logarithms."""

_PRIOR = np.array([*_UNKNOWN.values(), _ANY, _ANY])
_BEARING, _PRELOAD, _SECOND, _STATE = 1, 2, len(_UNKNOWN), len(_UNKNOWN) + 1


@dataclass(frozen=True)
class _Rows:
    slopes: Array  # (stops, unknown) by the logarithm of each
    ratio: Array  # by ln of the run's own ratio
    repeating: Array
    fresh: Array
    load: Array  # by ln load


@dataclass(frozen=True)
class Bound:
    """Of one axis; what its runs are is worked out once.

    Parameters
    ----------
    machine : Machine
        As it is when new.
    plan : Plan
        The test.
    who : Analyst
        Says what frequencies err by.
    loads : tuple of float
        Of the experiment, kg; its last is that of all later runs.
    known : float
        Relative standard uncertainty of a known preload.
    """

    machine: Machine
    plan: Plan
    who: Analyst
    loads: tuple[float, ...]
    known: float
    _made: dict[tuple[float, float], _Rows] = field(default_factory=dict)

    def ratio(
        self,
        states: Sequence[float],
        second: float | None = None,
        first: bool = False,
        changes: Assumptions | None = None,
    ) -> Array:
        """Standard deviation of P/P₀ in each state.

        Parameters
        ----------
        states : sequence of float
            True P/P₀.
        second : float, optional
            P/P₀ of the second preload, which is known.
        first : bool
            Whether the first is known too.
        changes : Assumptions, optional
            Sizes of the random bearing drift and load; None where only the nut changes.

        Returns
        -------
        ndarray, shape (states,)
            Of P/P₀.
        """
        return np.array([self._one(state, second, first, changes) for state in states])

    def _one(self, state: float, second: float | None, first: bool, changes: Assumptions | None) -> float:
        runs = [(1.0, load) for load in self.loads]
        later = [_STATE]
        if second is not None:
            runs.append((second, self.loads[-1]))
            later.insert(0, _SECOND)
        runs.append((state, self.loads[-1]))
        new = len(self.loads)
        columns = [*[None] * new, *later]
        rows = [self._rows(*run) for run in runs]
        stops = len(self.plan.positions)
        slopes = np.zeros((len(runs) * stops, len(_PRIOR)))
        repeating = np.hstack([one.repeating for one in rows])
        noise = repeating.T @ repeating
        for i, (one, column) in enumerate(zip(rows, columns, strict=True)):
            at = slice(i * stops, (i + 1) * stops)
            slopes[at, : len(_UNKNOWN)] = one.slopes
            fresh = [*one.fresh]
            if column is not None:
                slopes[at, column] = one.ratio
            if changes is not None:
                fresh.append(changes.load * one.load)
                if column is not None:
                    spread = changes.bearing_spread
                    if column == _SECOND:
                        spread = changes.bearing_daily_drift / NORMAL_95
                    fresh.append(spread * one.slopes[:, _BEARING])
            noise[at, at] += np.array(fresh).T @ np.array(fresh)
        noise += _form(np.tile(self.plan.positions, len(runs)), np.repeat([load for _, load in runs], stops))
        # What is soft in bed and table acts as a bearing would: a part of the whole is more of the bearing's.
        part = 2 * float(np.mean(rows[0].slopes[:, _BEARING]))
        prior = _PRIOR.copy()
        prior[_BEARING] = math.hypot(prior[_BEARING], DISCREPANCY["compliance"] / max(part, 0.05))
        information = slopes.T @ np.linalg.solve(noise, slopes) + np.diag(prior**-2)
        statements = [(_PRELOAD, _SECOND)] if second is not None else []
        for which in [*statements, *([(_PRELOAD,)] if first else [])]:
            row = np.zeros(len(_PRIOR))
            row[list(which)] = 1.0
            information += np.outer(row, row) / self.known**2
        return state * math.sqrt(float(np.linalg.inv(information)[_STATE, _STATE]))

    def _rows(self, ratio: float, load: float) -> _Rows:
        if (ratio, load) not in self._made:
            self._made[ratio, load] = self._worked_out(ratio, load)
        return self._made[ratio, load]

    def _worked_out(self, ratio: float, load: float) -> _Rows:
        def slope(name: str) -> Array:
            up, down = (self._log_frequency(name, step, ratio, load) for step in (_STEP, -_STEP))
            return (up - down) / (2 * _STEP)

        slopes = np.stack([slope(name) for name in _UNKNOWN], axis=1)
        worn = replace(self.machine, preload=ratio * self.machine.preload)
        repeating, fresh = true_effects(self.who, worn, self.plan, load)
        return _Rows(slopes, slopes[:, _PRELOAD], repeating, fresh, slope("load"))

    def _log_frequency(self, name: str, step: float, ratio: float, load: float) -> Array:
        """Of every stop, where the logarithm of one thing is larger by a step."""
        more = dict.fromkeys((*_UNKNOWN, "load"), 1.0) | {name: math.exp(step)}
        sheet = self.machine.sheet
        screw, bearing, table, drive = sheet.screw, sheet.bearing, sheet.table, sheet.drive
        sheet = replace(
            sheet,
            screw=replace(
                screw,
                rigidity=screw.rigidity * more["rigidity"],
                root_diameter=screw.root_diameter * more["shaft"],
            ),
            bearing=replace(bearing, stiffness=bearing.stiffness * more["stiffness"]),
            table=replace(table, mass=table.mass * more["table"]),
            drive=replace(drive, rotor_inertia=drive.rotor_inertia * more["rotor"]),
        )
        machine = replace(
            self.machine,
            sheet=sheet,
            preload=ratio * self.machine.preload * more["preload_ratio"],
            bed_mass=self.machine.bed_mass * more["bed"],
        )
        stops = self.plan.positions
        c = constants(machine, load * more["load"], (stops[0] + stops[-1]) / 2)
        return np.log([true_frequency(c, x) for x in stops])


def _form(place: Array, load: Array) -> Array:
    """What the lumped model leaves: no estimate can use what is finer."""
    along, heavy = (2 * (v - v.min()) / max(float(np.ptp(v)), 1e-9) - 1 for v in (place, load))
    bends = np.array([1.5 * along**2 - 0.5, along * heavy, 1.5 * heavy**2 - 0.5])
    return np.asarray(FORM**2 * bends.T @ bends + FLOOR**2 * np.eye(len(place)))
