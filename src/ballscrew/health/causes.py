"""What else may have changed the frequencies, and how well each explains what was seen.

Every cause has its own signature: along the axis, and in the masses and the friction of the same run. What a
run shows against its baseline is one list of numbers, with one covariance; a cause is a direction in it of a
stated plausible size. The evidence of each is then Gaussian and exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from ballscrew.health.assumptions import Assumptions
from ballscrew.health.change import Change, covariance_of

__all__ = ["Cause", "Masses", "Seen", "causes", "possible_beside", "seen", "words"]

Array = NDArray[np.float64]
_NUT = 0.3  # of u: a loss of half of the preload is 0.26
_BEARING = 0.10
_POSITION = 2e-3  # m
_LOCAL = 0.15  # of the nut's compliance at a stop; a loss of 30 % is 0.13
_NEAR = 0.06  # m over which a local loss hangs together
_AS_GOOD = 6.0  # of χ², by which a cause may be worse than the nut and still be possible
_PLAUSIBLE = 2.5  # standard deviations of its prior size
_COVERED = ("declared load", "position", "bearing")  # terms that are causes here
_CHANCE = {"nut": 0.6, "bearing": 0.08, "load": 0.08, "torque": 0.08, "position": 0.04, "local": 0.08}
_TEMPERATURE = 0.08
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
    """

    values: Array
    covariance: Array
    signatures: dict[str, Array]
    sizes: dict[str, float]


@dataclass(frozen=True, slots=True)
class Cause:
    """One cause, and what speaks for it.

    Parameters
    ----------
    name : str
        nut, bearing, load, torque, position, temperature or local.
    probability : float
        Among those compared, with their stated chances beforehand.
    chi2 : float
        What it leaves unexplained.
    amount, standard_uncertainty : float
        How large it would be.
    unit : str
        Of the amount.
    possible : bool
        Whether it explains the run about as well as the nut does, at a plausible size.
    text : str
        The same in words.
    """

    name: str
    probability: float
    chi2: float
    amount: float
    standard_uncertainty: float
    unit: str
    possible: bool
    text: str

    def to_json(self) -> dict[str, Any]:
        """As ``preload --json`` prints it."""
        return {
            "cause": self.name,
            "probability": self.probability,
            "chi2": self.chi2,
            "amount": {
                "value": self.amount,
                "standard_uncertainty": self.standard_uncertainty,
                "unit": self.unit,
            },
            "possible": self.possible,
            "text": self.text,
        }


def seen(
    change: Change,
    masses: Masses | None,
    assumptions: Assumptions,
    *,
    warmer: float | None = None,
    model_covariance: Array | None = None,
) -> Seen:
    """List what a run shows, and what each cause would do to it.

    Parameters
    ----------
    change : Change
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
        For :func:`causes`.
    """
    cells = covariance_of(change, less=_COVERED)
    if model_covariance is not None and change.model is not None:
        cells = cells + change.model.T @ model_covariance @ change.model
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
        "nut": _NUT,
        "bearing": _BEARING,
        "load": assumptions.wrong_load * moving,
        "torque": assumptions.torque_constant,
        "position": _POSITION,
        "local": _LOCAL,
    }
    grown = 1 + change.y
    signatures = {
        "nut": only(_NUT * change.nut),
        # A bearing that grows softer by a part δ is more compliant by −δ.
        "bearing": only(-_BEARING * change.bearing),
        "load": (sizes["load"] * by_load)[None],
        "torque": (sizes["torque"] * by_torque)[None],
        "position": only(_POSITION * grown * change.along),
        "local": only(_bumps(change)),
    }
    if not masses:
        del signatures["torque"]
    if warmer:
        sizes["temperature"] = assumptions.temperature * abs(warmer)
        signatures["temperature"] = only(sizes["temperature"] / 3 * change.nut)
    return Seen(np.concatenate([change.y, [row[0] for row in rows]]), covariance, signatures, sizes)


def causes(shown: Seen) -> tuple[Cause, ...]:
    """Compare the causes: nut, bearing, zero or warmth alone, and the nut with each of the others.

    Parameters
    ----------
    shown : Seen
        Of a run.

    Returns
    -------
    tuple of Cause
        The most probable first.
    """
    nut = shown.signatures["nut"]
    found = {}
    for name, own in shown.signatures.items():
        alone = name in _ALONE
        found[name] = _fit(shown, own if alone else np.vstack([own, nut]), len(own))
    chance = {name: _CHANCE.get(name, _TEMPERATURE) for name in found}
    most = max(fit[0] + math.log(chance[name]) for name, fit in found.items())
    odds = {name: chance[name] * math.exp(fit[0] - most) for name, fit in found.items()}
    whole = sum(odds.values())
    listed = []
    for name, (_, chi2, amount, spread) in found.items():
        size = shown.sizes[name]
        significant = abs(amount) > 2 * spread
        possible = (
            chi2 < found["nut"][1] + _AS_GOOD and abs(amount) < _PLAUSIBLE and (name == "nut" or significant)
        )
        value, deviation, unit = amount * size, spread * size, _UNITS[name]
        listed.append(
            Cause(name, odds[name] / whole, chi2, value, deviation, unit, possible, words(name, value))
        )
    return tuple(sorted(listed, key=lambda each: -each.probability))


_UNITS = dict.fromkeys(_CHANCE, "") | {"load": "kg", "position": "m", "temperature": ""}


def words(name: str, amount: float) -> str:
    """Say a cause.

    Parameters
    ----------
    name : str
        Its name.
    amount : float
        Its size, in its unit.

    Returns
    -------
    str
        Half a sentence.
    """
    up = amount > 0
    part = f"{abs(100 * amount):.1f} %"
    return {
        "nut": _nut(amount),
        "bearing": f"the thrust bearing, {part} {'stiffer' if up else 'softer'}",
        "load": f"a load {abs(amount):.2g} kg {'heavier' if up else 'lighter'} than declared",
        "torque": f"a torque that reads {part} too {'high' if up else 'low'}",
        "position": f"a zero that has moved by {1e3 * amount:+.1f} mm",
        "temperature": f"warmth, {part} of the preload",
        "local": "wear at some stops and not at others",
    }[name]


def _nut(softer: float) -> str:
    change = max(1 + softer, 0.1) ** -3 - 1
    return f"the nut, {abs(100 * change):.1f} % {'more' if change > 0 else 'less'} preload"


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


def _bumps(change: Change) -> Array:
    """Independent directions of a loss that is smooth over some centimetres, shape (k, n)."""
    stops = np.unique(change.position)
    near = np.exp(-0.5 * ((stops[:, None] - stops[None]) / _NEAR) ** 2)
    size, axes = np.linalg.eigh(near)
    root = axes * np.sqrt(np.clip(size, 0.0, None))
    at = np.searchsorted(stops, change.position)
    return np.asarray(_LOCAL * (root[at] * change.nut[:, None]).T)


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


def possible_beside(found: Sequence[Cause]) -> tuple[Cause, ...]:
    """Causes other than the nut that explain a run about as well."""
    return tuple(cause for cause in found if cause.possible and cause.name != "nut")
