"""What differs between two experiments beside the preload: the bearing, and what the test's load leaves.

``preload`` allows for both between a run and its baseline. A calibration with runs of another day, or at
another preload, allows for them too: else a second known preload would teach the nut what the bearing did.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.axis.axial import AxialModel, frequency
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.preload_groups import groups as by_day
from ballscrew.calibration.worn_nut import is_nut_load, nut_load_uncertainty

__all__ = ["WORN", "Between", "apart", "covariance_between", "loads_repeat", "worn_slopes"]


WORN = 1e-3
"""What a run that tells nothing of the nut's own load may be off in its level at another preload.

On random axes at 60 % of their preload the frequency was 0.5 to 1.5e-3 too low. It does not repeat."""

_MOST = 10.0  # of ln compliance: beyond it no frequency is of this axis
_LEAST = 0.2  # of (P/P_ref)^(−1/3): more than a hundred times the preload is no preload


@dataclass(frozen=True, slots=True)
class Between:
    """What is taken for granted between experiments.

    Parameters
    ----------
    bearing : float
        The thrust bearing's part of the compliance at the model's centre.
    kept : Assumptions
        Its ``bearing_drift``, ``nut_load`` and ``nut_load_spread`` count.
    """

    bearing: float = 0.0
    kept: Assumptions = field(default_factory=Assumptions)


def loads_repeat(run: FrequencyTable) -> FrequencyTable:
    """The run with what it tells of the nut's load as an error that repeats.

    A run tells it as one that does not, since it does not know how worn the nut is. At one preload it is the
    same every time, and at another :func:`worn_slopes` and :func:`apart` say what becomes of it: to draw it
    anew in every run besides would count it twice.
    """
    soft = np.array([is_nut_load(name) for name in run.shared_names], dtype=bool)
    return replace(run, repeats=run.repeats | soft) if soft.any() else run


def worn_slopes(runs: Sequence[FrequencyTable], kept: Assumptions) -> Array:
    """∂ ln f by ln(P/P_ref) of each cell by the test's own load, beside what the nut's rigidity makes.

    As :func:`~ballscrew.calibration.worn_nut.frequency_loss_under_load` puts it back.
    """
    return np.concatenate([kept.nut_load * nut_load_uncertainty(run) / run.frequency for run in runs])


def apart(run: FrequencyTable, model: AxialModel, between: Between, log_ratio: float) -> tuple[Array, Array]:
    """Effects on ln f of one standard deviation of the two causes, against the reference.

    Parameters
    ----------
    run : FrequencyTable
        Of n cells, of another day, at another preload.
    model : AxialModel
        Of the axis.
    between : Between
        How large.
    log_ratio : float
        ln(P/P_ref), about.

    Returns
    -------
    bearing, worn : ndarray, shape (n,)
        Of a bearing that has drifted, and of what is put back for the load on the nut.
    """
    away = run.position - model.centre
    whole = 1 + model.slope * away + model.curve * away**2
    bearing = between.kept.bearing_drift / NORMAL_95 * between.bearing / (2 * whole)
    if not any(is_nut_load(name) for name in run.shared_names):
        return bearing, np.full_like(run.frequency, WORN)
    return bearing, between.kept.nut_load_spread * abs(log_ratio) * nut_load_uncertainty(run) / run.frequency


def covariance_between(
    runs: Sequence[FrequencyTable], groups: Sequence[int], model: AxialModel, between: Between
) -> Array:
    """Covariance of ln f over all cells by what differs between days and between preloads.

    Parameters
    ----------
    runs, groups : sequence
        Of n cells together; of each run the number of its preload, 0 the reference.
    model : AxialModel
        Of the axis, as far as it is known.
    between : Between
        How large.

    Returns
    -------
    ndarray, shape (n, n)
        The bearing is one on each day, the nut one at each preload; those of the first are the reference.
    """
    days = by_day([run.id for run in runs], [run.measured_at for run in runs], {})
    ratios = _log_ratios(runs, groups, model)
    effects = [apart(run, model, between, ratio) for run, ratio in zip(runs, ratios, strict=True)]
    counts = [len(run.frequency) for run in runs]
    whole = np.zeros((sum(counts), sum(counts)))
    for which, labels in ((0, days), (1, groups)):
        at = np.repeat(np.asarray(labels), counts)
        effect = np.concatenate([pair[which] for pair in effects])
        whole += np.where((at[:, None] == at[None, :]) & (at[:, None] > 0), np.outer(effect, effect), 0.0)
    return whole


def _log_ratios(runs: Sequence[FrequencyTable], groups: Sequence[int], model: AxialModel) -> list[float]:
    """ln(P/P_ref) of each run's group by the model as known beforehand: the size of a doubt, no result."""
    off = np.array([np.mean(np.log(r.frequency / frequency(model, r.position, r.load))) for r in runs])
    of = np.asarray(groups)
    levels = {group: float(off[of == group].mean()) for group in set(groups)}
    reference = levels.get(0, 0.0)
    roots = {
        group: max(1 + math.expm1(min(-2 * (level - reference), _MOST)) / model.share, _LEAST)
        for group, level in levels.items()
    }
    return [-3 * math.log(roots[group]) for group in groups]
