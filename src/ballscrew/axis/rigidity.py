"""Rigidity of a nut as catalogues state it: K and its convention become κ, with a tolerance.

A flank is a Hertz contact, F = K_h δ^1.5. Two flanks pressed together by P have a tangent rigidity of
3 K_h^(2/3) P^(1/3) = κ P^(1/3) at rest. Makers state K in one of these ways, each a part of Ca:

- of a preloaded nut at a preload ε Ca: load over deflection where one flank lets go; the nut then
  deflects as by the preload, δ₀. Makers round that load to 3 P, and 3 P/δ₀ is the tangent at rest; by
  Hertz it is 2√2 P, so that a measured K would be 6 % less, and 7 % at 3 P. The tolerance of K includes that.
- of a nut with clearance: load over deflection of its one flank at a load of 0.30 Ca,
  K_h^(2/3) (0.3 Ca)^(1/3). Two such flanks, preloaded, have three times that in κ.
- theoretical K times 0.8 is the makers' criterion for the nut, for its body and for balls that differ in
  size. R_nu,ar of ISO 3408-4 contains both (5.5.3, f_ar), and so does a measured K.

Sources: NSK *Precision Machine Components*, THK *General Catalog* (ball screws), HIWIN *Ballscrews technical
information*, on rigidity of the nut; Steinmeyer, *Rigidity of the nut and preload*; ISO 3408-4:2006, 5.5.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ballscrew.axis.compliance import nut_kappa
from ballscrew.axis.hertz import RELEASE
from ballscrew.axis.sheet import DataSheet, Screw

TOLERANCE = 0.20
"""Of a catalogue's K, natural logarithm: nuts about the makers' 0.8, and 7 % between secant and tangent."""

# Of a measured K: 7 % between secant and tangent, and 5 % for bearing and shaft beside the nut.
_MEASURED = 0.10
_FLANKS = 3.0  # tangent of two flanks preloaded by P, over load per deflection of one under P
_USUAL_PRELOAD = 0.10  # of Ca: NSK, THK, HIWIN
_OVERSIZE_PRELOAD = 0.05  # of Ca: NSK, oversize balls
# An offset lead divides the turns: half of them carry each way. Catalogues count half in Ca and K, or all.
_HALF_TURNS = 1 / math.cbrt(2)


_ALIKE = 0.1  # difference of ln κ below which two readings of a K are one: half of its tolerance


def kappa(screw: Screw) -> float:
    """κ of a nut from the K of its data sheet: its rigidity at rest is κ P^(1/3).

    Parameters
    ----------
    screw : Screw
        With K, its convention, and the preload or the load at which it is stated.

    Returns
    -------
    float
        κ, N^(2/3)/m. Half of a catalogue's where a spring makes the preload: one flank, beside a soft spring;
        a measured K is that of the nut with its spring.
    """
    if screw.rigidity_convention == "unknown":
        low, high = _unknown(screw)
        return math.sqrt(low * high)
    value = _two_flanks(screw)
    by_catalogue = screw.rigidity_convention != "measured"
    return value / 2 if screw.preload_by == "spring" and by_catalogue else value


def _unknown(screw: Screw) -> tuple[float, float]:
    """Least and largest κ of a K of unknown convention.

    Preloaded at the usual preload, or with clearance at 0.30, which is 3 / 3^(1/3) = 2.08 times as much. With
    a spring it is half of either, or a measured K, which is not halved.
    """
    least = nut_kappa(screw.rigidity, screw.dynamic_load_rating, _USUAL_PRELOAD)
    largest = least * _FLANKS / math.cbrt(3)
    if screw.preload_by != "spring":
        return least, largest
    measured = _two_flanks(replace(screw, rigidity_convention="measured"))
    return least / 2, max(largest / 2, measured)


def at_preload(sheet: DataSheet, preload: float | None) -> DataSheet:
    """Return the axis with its nut set to a preload, N; None is the nominal one. K stays as it is."""
    if preload is None:
        return sheet
    screw = sheet.screw
    stated = screw.rigidity_preload_ratio
    if screw.rigidity_convention in ("measured", "unknown"):
        stated = stated or screw.preload_ratio
    ratio = preload / screw.dynamic_load_rating
    return replace(sheet, screw=replace(screw, preload_ratio=ratio, rigidity_preload_ratio=stated))


def release_ratio(screw: Screw) -> float:
    """F/P at which a flank loses contact: 2√2, or 1 where a soft spring makes the preload."""
    return 1.0 if screw.preload_by == "spring" else RELEASE


def tolerance(screw: Screw) -> float:
    """Tolerance of a K for which the data sheet states none, as a natural logarithm."""
    if screw.rigidity_convention == "measured":
        return _MEASURED
    if screw.rigidity_convention == "unknown":
        low, high = _unknown(screw)
        return TOLERANCE + math.log(high / low) / 2
    if _turns_are_ambiguous(screw):
        return TOLERANCE - math.log(_HALF_TURNS)
    return TOLERANCE


def other_readings(screw: Screw) -> dict[str, float]:
    """What the K of a data sheet means in other conventions.

    Parameters
    ----------
    screw : Screw
        With K and its convention.

    Returns
    -------
    dict of str to float
        Convention in words to κ by it over the sheet's κ. Readings alike are one; those within a tenth of the
        sheet's are left out.
    """
    stated = screw.rigidity_preload_ratio or _USUAL_PRELOAD
    readings = {"a nut with clearance at 0.30 Ca of load": _read_as(screw, "clearance", None)}
    for ratio in sorted({_USUAL_PRELOAD, _OVERSIZE_PRELOAD, stated}, reverse=True):
        readings[f"a nut preloaded at {ratio:.2f} Ca"] = _read_as(screw, "preloaded", ratio)
    for ratio in sorted({_USUAL_PRELOAD, stated}, reverse=True):
        readings[f"R_nu,ar (ISO 3408-4) at {ratio:.2f} Ca"] = _read_as(screw, "iso", ratio)
    if screw.preload_by == "spring":
        readings["a nut measured with its spring"] = _read_as(screw, "measured", None)
    distinct: dict[str, float] = {}
    for words, reading in readings.items():
        if _alike(reading, 1.0):
            continue
        same = [other for other, ratio in distinct.items() if _alike(reading, ratio)]
        if same:
            distinct[f"{same[0]} or {words}"] = distinct.pop(same[0])
        else:
            distinct[words] = reading
    return distinct


def _alike(first: float, second: float) -> bool:
    return abs(math.log(first / second)) < _ALIKE


def _read_as(screw: Screw, convention: str, ratio: float | None) -> float:
    """κ of K in another convention, over the κ of the sheet."""
    other = replace(
        screw, rigidity_convention=convention, rigidity_preload_ratio=ratio, rigidity_load_ratio=None
    )
    return kappa(other) / kappa(screw)


def _two_flanks(screw: Screw) -> float:
    rigidity, rating = screw.rigidity, screw.dynamic_load_rating
    match screw.rigidity_convention:
        case "clearance":
            whole = _FLANKS * nut_kappa(rigidity, rating, screw.rigidity_load_ratio or 0.30)
            return whole * _HALF_TURNS if _turns_are_ambiguous(screw) else whole
        case "iso" | "measured":
            ratio = screw.rigidity_preload_ratio or screw.preload_ratio
            return nut_kappa(rigidity, rating, ratio, accuracy=1.0)
    return nut_kappa(rigidity, rating, screw.rigidity_preload_ratio or _USUAL_PRELOAD)


def _turns_are_ambiguous(screw: Screw) -> bool:
    return screw.rigidity_convention == "clearance" and screw.preload_by == "offset lead"
