"""What else may have changed the frequencies, and how well each explains what was seen.

Every cause has its own signature: along the axis, and in the masses and the friction of the same run. What a
run shows against its baseline is one list of numbers, with one covariance; a cause is a direction in it of a
stated plausible size. The evidence of each is then Gaussian and exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ballscrew.base.arrays import Array
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.priors import Priors
from ballscrew.estimation.cause import UNITS, Cause, possible_beside, words
from ballscrew.estimation.change import ComplianceChange, covariance_of
from ballscrew.estimation.fusion import misfit

__all__ = ["Cause", "Masses", "Seen", "compare_causes", "gather_evidence", "possible_beside", "words"]

_COVERED = ("declared load", "position", "bearing")  # terms that are causes here
_ALONE = ("nut", "bearing", "position", "temperature")  # along the axis they look like the nut


@dataclass(frozen=True, slots=True)
class Masses:
    """What the masses and the friction of a run say against the baseline's: changes of logarithms.

    Parameters
    ----------
    inertia, inertia_spread : float
        Of the equivalent mass, the declared change of the load taken out.
    by_load : float
        What it grows by a kg, 1/kg.
    parted, parted_spread : float or None
        Of (f_free/f_held)², which the masses alone decide.
    parted_by_load : float
        What it grows by a kg, 1/kg.
    friction : tuple of (float, float)
        Changes of viscous and Coulomb friction, each with its standard uncertainty.
    """

    inertia: float
    inertia_spread: float
    by_load: float
    parted: float | None
    parted_spread: float | None
    parted_by_load: float
    friction: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """All that a run shows against its reference.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Y of each cell, then what the masses tell.
    covariance : ndarray, shape (n, n)
        Regular; without the causes that are compared.
    signatures : mapping of str to ndarray, shape (k, n)
        Of each cause, by one standard deviation of its plausible size; more rows where it has a form too.
    sizes : mapping of str to float
        That standard deviation, in the cause's own unit.
    cells : ndarray, shape (m, m)
        Covariance of the cells alone, without the floor.
    floor : ndarray, shape (m,)
        Standard deviation of the cells below which no model is right.
    """

    values: Array
    covariance: Array
    signatures: dict[str, Array]
    sizes: dict[str, float]
    cells: Array
    floor: Array


def gather_evidence(
    change: ComplianceChange,
    masses: Masses | None,
    assumptions: Assumptions,
    *,
    warmer: float | None = None,
    model_covariance: Array | None = None,
) -> Seen:
    """List what a run shows, and what each cause would do to it.

    Parameters
    ----------
    change : ComplianceChange
        Of the cells.
    masses : Masses, optional
        Where both runs have them.
    assumptions : Assumptions
        What is plausible.
    warmer : float, optional
        By how much the axis is warmer than at the baseline, K.
    model_covariance : ndarray, shape (7, 7), optional
        Where the reference is the model's.

    Returns
    -------
    Seen
        For :func:`compare_causes`.
    """
    priors = assumptions.priors
    cells = covariance_of(change, less=_COVERED)
    true = covariance_of(change, floor=False)
    if model_covariance is not None and change.model is not None:
        by_model = change.model.T @ model_covariance @ change.model
        cells, true = cells + by_model, true + by_model
    rows = _rows(masses, assumptions)
    count, more = len(change.y), len(rows)
    covariance = np.zeros((count + more, count + more))
    covariance[:count, :count] = cells
    covariance[range(count, count + more), range(count, count + more)] = [row[1] ** 2 for row in rows]
    by_load = np.concatenate([change.mass, [row[2] for row in rows]])
    by_torque = np.concatenate([np.zeros(count), [row[3] for row in rows]])

    def only(part: Array) -> Array:
        return np.hstack([np.atleast_2d(part), np.zeros((len(np.atleast_2d(part)), more))])

    moving = 1 / masses.by_load if masses is not None else 1 / float(np.max(change.mass))
    sizes = {
        "nut": priors.nut_size,
        "bearing": priors.bearing_size,
        "load": assumptions.wrong_load * moving,
        "torque": assumptions.torque_constant,
        "position": priors.position_size,
        "local": priors.local_size,
    }
    grown = 1 + change.y
    signatures = {
        "nut": only(priors.nut_size * change.nut),
        # A bearing that grows softer by a part δ is more compliant by −δ.
        "bearing": only(-priors.bearing_size * change.bearing),
        "load": (sizes["load"] * by_load)[None],
        "torque": (sizes["torque"] * by_torque)[None],
        "position": only(priors.position_size * grown * change.along),
        "local": only(_bumps(change, priors)),
    }
    if not masses:
        del signatures["torque"]
    if warmer:
        sizes["temperature"] = assumptions.temperature * abs(warmer)
        signatures["temperature"] = only(sizes["temperature"] / 3 * change.nut)
    values = np.concatenate([change.y, [row[0] for row in rows]])
    return Seen(values, covariance, signatures, sizes, true, change.floor)


def compare_causes(shown: Seen, assumptions: Assumptions | None = None) -> tuple[Cause, ...]:
    """Compare the causes: nut, bearing, zero or warmth alone, and the nut with each of the others.

    Parameters
    ----------
    shown : Seen
        Of a run.
    assumptions : Assumptions, optional
        What is believed of each cause, and from which misfit on none explains the cells.

    Returns
    -------
    tuple of Cause
        The most probable first.
    """
    kept = assumptions or Assumptions()
    priors, nut = kept.priors, shown.signatures["nut"]
    found = {}
    for name, own in shown.signatures.items():
        alone = name in _ALONE
        found[name] = _fit(shown, own if alone else np.vstack([own, nut]), len(own))
    chance = {name: priors.chance(name) for name in found}
    most = max(fit[0] + math.log(chance[name]) for name, fit in found.items())
    odds = {name: chance[name] * math.exp(fit[0] - most) for name, fit in found.items()}
    whole = sum(odds.values())
    listed = []
    for name, (log, chi2, amount, spread) in found.items():
        size = shown.sizes[name]
        # One of several directions has no single amount that could be zero.
        several = len(shown.signatures[name]) > 1
        significant = log > found["nut"][0] if several else abs(amount) > 2 * spread
        fit = _fits(shown, name)
        possible = (
            fit >= kept.false_alarm
            and chi2 < found["nut"][1] + priors.as_good
            and abs(amount) < priors.plausible
            and (name == "nut" or significant)
        )
        value, deviation, text = amount * size, spread * size, words(name, amount * size)
        listed.append(
            Cause(name, odds[name] / whole, chi2, value, deviation, UNITS[name], possible, text, fit)
        )
    return tuple(sorted(listed, key=lambda each: -each.probability))


def _rows(masses: Masses | None, assumptions: Assumptions) -> list[tuple[float, float, float, float]]:
    """What the masses say: value, standard deviation, by a kg, by the torque's scale."""
    if masses is None:
        return []
    rows = [(masses.inertia, masses.inertia_spread, masses.by_load, 1.0)]
    if masses.parted is not None and masses.parted_spread:
        rows.append((masses.parted, masses.parted_spread, masses.parted_by_load, 0.0))
    for value, spread in masses.friction:
        rows.append((value, math.hypot(spread, assumptions.friction), 0.0, 1.0))
    return rows


def _bumps(change: ComplianceChange, priors: Priors) -> Array:
    """Independent directions of a loss that hangs together over some centimetres and may have an edge.

    Shape (k, n).
    """
    stops = np.unique(change.position)
    near = np.exp(-np.abs(stops[:, None] - stops[None]) / priors.local_length)
    size, axes = np.linalg.eigh(near)
    root = axes * np.sqrt(np.clip(size, 0.0, None))
    at = np.searchsorted(stops, change.position)
    return np.asarray(priors.local_size * (root[at] * change.nut[:, None]).T)


def _fit(shown: Seen, directions: Array, own: int) -> tuple[float, float, float, float]:
    """Log evidence, χ² left over, amount and its standard deviation in units of the plausible size.

    A cause of several directions tells its length as its amount.
    """
    factor = cho_factor(shown.covariance, lower=True)
    pulled = cho_solve(factor, directions.T)
    inner = directions @ pulled
    told = pulled.T @ shown.values
    posterior = np.linalg.inv(inner + np.eye(len(directions)))
    amounts = posterior @ told
    base = float(shown.values @ cho_solve(factor, shown.values))
    log = -0.5 * (base - float(told @ amounts) + float(np.linalg.slogdet(inner + np.eye(len(inner)))[1]))
    chi2 = base - 2 * float(amounts @ told) + float(amounts @ inner @ amounts)
    if own == 1:
        return log, chi2, float(amounts[0]), math.sqrt(float(posterior[0, 0]))
    size = math.sqrt(float(np.mean(amounts[:own] ** 2)))
    return log, chi2, size, math.sqrt(float(np.mean(np.diag(posterior)[:own])))


def _fits(shown: Seen, name: str) -> float:
    """Probability of a misfit of the cells as large as is left with a cause, of whatever size it is.

    A cause of several directions has its plausible size; free, it would fit anything.
    """
    count = len(shown.floor)
    own, nut = (shown.signatures[key][:, :count] for key in (name, "nut"))
    true, fitted = shown.cells, own
    if name not in _ALONE:
        if len(own) > 1:
            true, fitted = true + own.T @ own, nut
        else:
            fitted = np.vstack([own[np.any(own != 0, axis=1)], nut])
    return misfit(shown.values[:count], fitted.T, true, shown.floor)[2]
