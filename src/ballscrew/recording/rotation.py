"""Pitch and yaw of the table, from the crosswise axes of two accelerometers.

The two ends of a table that pitches move up and down against each other, those of one that yaws sideways.
Half their difference r follows the motion x along the screw as a mode of the table does on its base,

    r (1 + jbω − cω²) = x (g + jdω − eω²),

beside the sensors' cross-axis sensitivity, which is constant. The relation is linear in its five unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.sensors import phase_spectra

_DIRECTIONS = {"pitch": "z", "yaw": "y"}
_BAND = (20.0, 400.0)  # Hz; a pitching mode lies at up to 2.2 times the axial mode
_UNIT = 2 * math.pi * 100.0  # rad/s, in which all unknowns are near one
_COHERENT = 0.5  # below, noise determines a line
_FEWEST_LINES = 10
_EXPLAINED = 0.75  # share of r that the mode explains: 0.82 to 0.96 with windows this short
_MOST_DAMPING = 0.15
_LEAST_RATIO = 0.1  # of r to x at the mode; less is cross-axis sensitivity
_MOSTLY = 1.0  # ratio of r to x from which a mode of the run is more rotation than axial motion

Cross = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class RotationSums:
    """Sums of spectra over transients.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    axial, rotation : ndarray, shape (n,)
        Power of x and of r.
    cross : ndarray, shape (n,)
        Conjugate of x times r.
    """

    frequency: Array
    axial: Array
    rotation: Array
    cross: Cross


@dataclass(frozen=True, slots=True)
class TableRotation:
    """Pitch or yaw of the table beside its motion along the screw.

    Parameters
    ----------
    direction : str
        ``"pitch"`` or ``"yaw"``.
    ratio_at_mode : float or None
        Half the difference of the two sensors' crosswise motion over their motion along the screw, at the
        median of the axial natural frequencies; None without these, or where noise determines it.
    frequency_Hz, damping_ratio, ratio : float or None
        Frequency at which the table rotates most beside its motion along the screw, the damping of this mode
        and the same ratio there; None if no mode shows.
    """

    direction: str
    ratio_at_mode: float | None = None
    frequency_Hz: float | None = None  # noqa: N815  the unit's own letters
    damping_ratio: float | None = None
    ratio: float | None = None


def rotation_sums(aligned: Aligned, phases: Sequence[MotionPhase]) -> dict[str, RotationSums]:
    """Spectra of pitch and yaw of one recording.

    Parameters
    ----------
    aligned : Aligned
        Channels of the recording.
    phases : sequence of MotionPhase
        Its phases.

    Returns
    -------
    dict of str to RotationSums
        By direction; only those that two sensors at different locations measure.
    """
    found = {}
    for direction, axis in _DIRECTIONS.items():
        rows = []
        for place in dict.fromkeys(name.rpartition(":")[0] for name in aligned.responses):
            along, across = f"{place}:x", aligned.across.get(f"{place}:{axis}")
            if along in aligned.responses and across is not None:
                rows.append((aligned.response[aligned.responses.index(along)], across))
        if len(rows) < 2:
            continue
        (first, first_across), (second, second_across), *_ = rows
        values = np.stack([0.5 * (first + second), 0.5 * (first_across - second_across)])
        spectra = phase_spectra(values, aligned.rate, phases)
        if spectra is not None:
            frequency, (x, r) = spectra
            power_x, power_r = np.sum(np.abs(x) ** 2, axis=0), np.sum(np.abs(r) ** 2, axis=0)
            found[direction] = RotationSums(frequency, power_x, power_r, np.sum(x.conj() * r, axis=0))
    return found


def table_rotations(
    trips: Sequence[Mapping[str, RotationSums]], modes: Sequence[float]
) -> tuple[TableRotation, ...]:
    """Pitch and yaw of a run.

    Parameters
    ----------
    trips : sequence of mapping
        From :func:`rotation_sums`, of each recording.
    modes : sequence of float
        Axial natural frequencies of the cells, Hz.

    Returns
    -------
    tuple of TableRotation
        Empty where the sensors do not measure them.
    """
    rotations = []
    for direction, lines in _coherent_lines(trips).items():
        ratio = None
        if len(modes):
            ratio = _ratio_at(lines, float(np.median(modes)))
        rotations.append(TableRotation(direction, ratio, *(_mode(lines) or ())))
    return tuple(rotations)


def rotating_modes(
    trips: Sequence[Mapping[str, RotationSums]], modes: Sequence[float | None]
) -> list[tuple[str, float] | None]:
    """Modes that are more a rotation of the table than a motion along the screw.

    Parameters
    ----------
    trips : sequence of mapping
        From :func:`rotation_sums`, of each recording.
    modes : sequence of float or None
        Axial natural frequencies of the cells, Hz.

    Returns
    -------
    list of (direction, ratio) or None
        For each cell; None for an axial mode, and where the ratio is not known.
    """
    found: list[tuple[str, float] | None] = [None] * len(modes)
    for direction, lines in _coherent_lines(trips).items():
        for index, mode in enumerate(modes):
            ratio = None if mode is None else _ratio_at(lines, mode)
            if ratio is not None and ratio >= _MOSTLY:
                found[index] = direction, ratio
    return found


@dataclass(frozen=True, slots=True)
class _Lines:
    """Lines at which r follows x: frequency (Hz), power of x, and r over x."""

    frequency: Array
    axial: Array
    ratio: Cross
    spacing: float


def _coherent_lines(trips: Sequence[Mapping[str, RotationSums]]) -> dict[str, _Lines]:
    found = {}
    for direction in _DIRECTIONS:
        known = [trip[direction] for trip in trips if direction in trip]
        if not known:
            continue
        frequency = known[0].frequency
        axial = np.sum([each.axial for each in known], axis=0)
        power = np.sum([each.rotation for each in known], axis=0)
        cross = np.sum([each.cross for each in known], axis=0)
        coherent = np.abs(cross) ** 2 > _COHERENT * axial * power
        inside = (frequency >= _BAND[0]) & (frequency <= _BAND[1]) & coherent
        ratio = cross[inside] / axial[inside]
        found[direction] = _Lines(frequency[inside], axial[inside], ratio, float(frequency[1]))
    return found


def _ratio_at(lines: _Lines, mode: float) -> float | None:
    """Size of r over x at a frequency between coherent lines; None elsewhere."""
    if not np.any(np.abs(lines.frequency - mode) <= lines.spacing):
        return None
    return float(np.interp(mode, lines.frequency, np.abs(lines.ratio)))


def _mode(lines: _Lines) -> tuple[float, float, float] | None:
    """Frequency (Hz), damping ratio and ratio of the mode among the lines; None if none shows."""
    if len(lines.frequency) < _FEWEST_LINES:
        return None
    axial, ratio = lines.axial, lines.ratio
    w = 2 * math.pi * lines.frequency / _UNIT
    weight = np.sqrt(axial) / (1 + w**2)  # else the highest frequencies dominate
    columns = np.stack([1j * w * ratio, -(w**2) * ratio, -np.ones_like(ratio), -1j * w, w**2]) * weight
    wanted = -ratio * weight
    matrix = np.concatenate([columns.real, columns.imag], axis=1).T
    b, c, g, d, e = np.linalg.lstsq(matrix, np.concatenate([wanted.real, wanted.imag]), rcond=1e-12)[0]
    if c <= 0:
        return None
    natural = 1 / math.sqrt(c)
    damping = 0.5 * b * natural
    if not (0 < damping < _MOST_DAMPING and w[0] < natural < w[-1]):
        return None
    model = (g + 1j * d * w - e * w**2) / (1 + 1j * b * w - c * w**2)
    explained = 1 - np.sum(np.abs(ratio - model) ** 2 * axial) / np.sum(np.abs(ratio) ** 2 * axial)
    size = abs(complex(g - e * natural**2, d * natural) / (1j * b * natural))
    if explained < _EXPLAINED or size < _LEAST_RATIO:
        return None
    return natural * _UNIT / (2 * math.pi), float(damping), float(size)
