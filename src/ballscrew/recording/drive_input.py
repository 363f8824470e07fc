"""Input of an analysis: the torque, force or current that drives the axis, also from phase currents."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.recording.channels import PHASES
from ballscrew.recording.kinematics import rates
from ballscrew.recording.quantities import INPUTS
from ballscrew.recording.recording import Recording

_FIT_RATE = 2000.0  # Hz, at least, of the samples that determine the commutation
_SMOOTHING = 6e-3  # s, of speed and acceleration: the longest of kinematics
_LONGEST_SKEW = 4e-3  # s; longer ones are bad by the quality gate
_SKEWS = 41
_PASSES = 3  # of the linear fit; the second changes the torque by less than 1e-4
# Part of the currents that follows the angle of the position: 0.9998 in the bench, 0 with a wrong angle.
_EXPLAINED = 0.8
_SCALE = 0.01  # of a position's scale; the nearest other number of pole pairs differs by a fiftieth or more
_UNEQUAL = 0.1  # current sensors agree within some hundredths; an inverted phase makes 0.7 and more
# Electrical turns per metre that the search covers: 50 pole pairs at a lead of 1 mm.
_MOST_TURNS = 50e3
_MOST_CELLS = 1 << 20  # 5 m in cells of a quarter of that

Vector = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class DriveInput:
    """Channels that the input of an analysis was made of.

    Parameters
    ----------
    quantity : str
        One of :data:`~ballscrew.recording.quantities.INPUTS`.
    channels : tuple of str
        Names in the files.
    commutation : str or None
        Source of the electrical angle of phase currents: ``"data sheet"`` for the position with the number
        of pole pairs, ``"currents"`` for a number estimated from them; None for other inputs.
    """

    quantity: str
    channels: tuple[str, ...]
    commutation: str | None = None


def force_scale(quantity: str, sheet: DataSheet | None) -> float | None:
    """Force at the table per unit of the input.

    Parameters
    ----------
    quantity : str
        One of :data:`~ballscrew.recording.quantities.INPUTS`.
    sheet : DataSheet or None
        Gives lead and ratio, and the torque constant and the rated torque where it states them.

    Returns
    -------
    float or None
        N per unit of the input; None where the sheet does not state it.
    """
    if quantity == "force":
        return 1.0
    if sheet is None:
        return None
    per_torque = 2 * math.pi * sheet.drive.ratio / sheet.screw.lead
    if quantity == "torque":
        return per_torque
    per_unit = sheet.drive.rated_torque
    if quantity == "current":
        per_unit = sheet.drive.torque_constant
    return per_torque * per_unit if per_unit else None


def input_channels(recording: Recording) -> tuple[str, ...]:
    """Names of the channels that the input is made of.

    Parameters
    ----------
    recording : Recording
        Recording as read.

    Returns
    -------
    tuple of str
        The first torque, else the first force, else the first torque in percent, else the first current of
        the q axis, else the first current of each phase; empty without any.
    """
    names = list(chain.from_iterable(map(recording.of, INPUTS)))
    phases: dict[str, str] = {}
    for name in names:
        phase = recording.channels[name].attrs.get("phase", "")
        if phase not in PHASES:
            return (name,)
        phases.setdefault(phase, name)
    return tuple(phases[phase] for phase in sorted(phases))


def electrical_turns(sheet: DataSheet | None) -> float | None:
    """Turns of the electrical angle per metre of travel; None without the number of pole pairs."""
    if sheet is None or sheet.drive.pole_pairs is None:
        return None
    return sheet.drive.pole_pairs * sheet.drive.ratio / sheet.screw.lead


def q_current(
    currents: Mapping[str, Array], position: Array, rate: float, turns: float | None, file: str
) -> Array:
    """Current of the q axis from the currents of two or three phases of a synchronous motor.

    The electrical angle is that of the position; its zero, its direction, a delay between currents and
    position, and zeros and unequal gains of the sensors are fitted to what they leave in the d axis, whose
    current a drive holds at zero, or at a function of the speed.

    Parameters
    ----------
    currents : mapping of str to ndarray, shape (n,)
        Phase to current, A.
    position : ndarray, shape (n,)
        m.
    rate : float
        Sample rate, Hz.
    turns : float or None
        Electrical turns per metre; None where the currents have to determine them.
    file : str
        Name of the file, for messages.

    Returns
    -------
    ndarray, shape (n,)
        A, of the amplitude of a phase's current; positive where it accelerates towards larger positions.

    Raises
    ------
    InputError
        If there is one phase only, or another number of pole pairs than that of ``turns``.
    MeasurementError
        If the currents do not follow the position, or one is inverted.
    """
    with np.errstate(all="ignore"):  # the quality gate reports what overflows or is no number
        vector = _space_vector(currents, file)
        if not (np.isfinite(vector).all() and np.isfinite(position).all()):
            return np.full(len(vector), np.nan)
        motion = _Motion(position, *rates(position, rate, _SMOOTHING))
        step = max(1, int(rate / _FIT_RATE))
        fit = _commutation(vector[::step], motion.every(step), turns, file)
        return _correct(vector, motion, fit).real


@dataclass(frozen=True, slots=True)
class _Motion:
    position: Array
    speed: Array
    acceleration: Array

    def every(self, step: int) -> _Motion:
        return _Motion(self.position[::step], self.speed[::step], self.acceleration[::step])


@dataclass(frozen=True, slots=True)
class _Fit:
    """Electrical angle 2π ``turns`` (x − v ``late``) + ``zero``, and errors of the current sensors.

    ``offset`` is their zero, A, and ``unequal`` the gain of the conjugate, by which gains of phases differ.
    """

    turns: float
    late: float
    zero: float = 0.0
    offset: complex = 0.0
    unequal: complex = 0.0
    explained: float = 0.0


def _space_vector(currents: Mapping[str, Array], file: str) -> Vector:
    """Complex current whose amplitude is that of a phase; a missing phase is minus the sum of the others."""
    if len(currents) < 2:
        raise InputError(
            f"{file}: the current of one phase alone is no torque; the channel map must name two or three."
        )
    known = sum(currents.values())
    values = [currents.get(phase, -known) for phase in PHASES]
    turns = np.exp(2j * math.pi / 3 * np.arange(3))
    return np.asarray(2 / 3 * sum(turn * value for turn, value in zip(turns, values, strict=True)))


def _angle(motion: _Motion, fit: _Fit) -> Array:
    return 2 * math.pi * fit.turns * (motion.position - motion.speed * fit.late) + fit.zero


def _correct(vector: Vector, motion: _Motion, fit: _Fit) -> Vector:
    """Current in the frame of the rotor, q axis real."""
    true = vector - fit.offset - fit.unequal * vector.conj()
    return np.asarray(true * np.exp(-1j * _angle(motion, fit)))


def _searched_turns(vector: Vector, motion: _Motion) -> float:
    """Electrical turns per metre by the spectrum of the squared vector over the position.

    Its square does not depend on the sign of the torque.
    """
    x = motion.position - motion.position.min()
    span = float(x.max())
    if not math.isfinite(span):
        return 0.0
    cell = max(0.25 / _MOST_TURNS, span / _MOST_CELLS)  # wider where the position has a wrong unit
    size = 1 << (int(span / cell) + 2).bit_length()
    sums = np.zeros(size, dtype=np.complex128)
    np.add.at(sums, np.rint(x / cell).astype(np.intp), vector**2)
    spectrum = np.abs(np.fft.fft(sums))
    spectrum[0] = 0.0  # of currents that do not turn
    return float(np.fft.fftfreq(size, cell)[int(np.argmax(spectrum))]) / 2


def _commutation(vector: Vector, motion: _Motion, turns: float | None, file: str) -> _Fit:
    """Fit by the stated number of pole pairs, or by the number that the currents show."""
    fit = _Fit(0.0, 0.0)
    if turns is not None:
        fit = _fit_commutation(vector, motion, turns)
    if not fit.explained >= _EXPLAINED:
        fit = _fit_commutation(vector, motion, _searched_turns(vector, motion))
        _check_turns(file, fit, turns)
    if abs(fit.unequal) > _UNEQUAL:
        raise MeasurementError(
            f"{file}: the currents of the phases differ in amplitude: one is inverted or of another scale"
        )
    return fit


def _fit_commutation(vector: Vector, motion: _Motion, turns: float) -> _Fit:
    """Fit of the electrical angle and of the sensors' errors, from both directions of rotation."""
    square, total = vector**2, float(np.sum(np.abs(vector) ** 2))
    best, fit = -1.0, _Fit(turns, 0.0)
    for signed in (turns, -turns):
        for late in np.linspace(-_LONGEST_SKEW, _LONGEST_SKEW, _SKEWS):
            trial = _Fit(signed, float(late))
            size = abs(complex(np.sum(square * np.exp(-2j * _angle(motion, trial)))))
            if size > best:
                best, fit = size, trial
    for _ in range(_PASSES):
        fit = _refine(vector, motion, fit, total)
    return fit


def _refine(vector: Vector, motion: _Motion, fit: _Fit, total: float) -> _Fit:
    """Linear correction of all parameters, by the current of the d axis."""
    turned = _correct(vector, motion, fit)
    # The torque accelerates the axis: this is the q axis, with its sign, whatever the d axis holds.
    along = complex(np.sum(turned * motion.acceleration))
    zero = float(np.angle(along))
    turned = turned * np.exp(-1j * zero)
    q = turned.real
    frame = np.exp(-1j * (_angle(motion, fit) + zero))
    conjugate = vector.conj() * frame
    columns = np.stack(
        [
            np.ones_like(q),
            np.abs(motion.speed),
            q,
            q * (motion.position - motion.position.mean()),
            -q * motion.speed,
            frame.imag,
            frame.real,
            conjugate.imag,
            conjugate.real,
        ],
        axis=1,
    )
    if not np.isfinite(columns).all():  # values as of no machine
        return _Fit(fit.turns, 0.0)
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    answer = np.linalg.lstsq(columns / size, turned.imag, rcond=1e-10)[0] / size
    residual = turned.imag - columns @ answer
    explained = 1.0 - 2.0 * float(np.sum(residual**2)) / total if total > 0 else 0.0
    turns = fit.turns + float(answer[3]) / (2 * math.pi)
    shift = float(answer[2] - answer[3] * motion.position.mean())
    late = fit.late
    if fit.turns != 0:
        late += float(answer[4]) / (2 * math.pi * fit.turns)
    return _Fit(
        turns=turns,
        late=late,
        zero=fit.zero + zero + shift,
        offset=fit.offset + complex(answer[5], answer[6]),
        unequal=fit.unequal + complex(answer[7], answer[8]),
        explained=explained,
    )


def _check_turns(file: str, fit: _Fit, turns: float | None) -> None:
    """Refuse currents that do not follow the position, or do with another number of pole pairs."""
    text = f"{file}: the currents of the phases do not follow the position"
    if not fit.explained >= _EXPLAINED:
        raise MeasurementError(
            f"{text}: they are not those of this axis' motor, or it is not a synchronous one"
        )
    if turns is not None and abs(abs(fit.turns / turns) - 1) > _SCALE:
        ratio = abs(fit.turns / turns)
        raise InputError(f"{text}; they would with {ratio:.4g} times the drive.pole_pairs of the data sheet.")
