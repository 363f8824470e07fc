"""The axial mode along the axis: its compliance and damping, with a worn nut and local wear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

_MOST_DAMPING = 0.9  # largest damping ratio along the axis: above 1 the mode would not oscillate
INITIAL_DAMPING = 0.03  # damping ratio at the start of a search

FORM_MEAN = 0.5
"""Mean of the field ``form`` of :class:`AxialMode` before the run.

Mass and twist of a real screw are distributed along it (1), and Eq. (3) is that of a lumped screw (0): each
is one standard deviation, :data:`FORM_DEVIATION`, from the mean."""

FORM_DEVIATION = 0.5
"""Standard deviation of the field ``form`` before the run."""

GUIDE_PART_MEAN = 0.5
"""Mean of the field ``guide_part`` of :class:`AxialMode` before the run."""

GUIDE_PART_DEVIATION = 0.3
"""Its standard deviation, about that of a uniform distribution between 0 and 1."""

TYPICAL_SCREW_SHIFT = 0.02
"""Field ``screw_shift`` of :class:`AxialMode` without a data sheet: 0.013 to 0.022 on ten random axes."""


@dataclass(frozen=True, slots=True)
class AxialMode:
    """The axial mode along the axis: 1/w² = compliance (1 + slope x + whole_curve x² + local(x)).

    w is the undamped angular natural frequency, x the position from the middle of the axis (m). 1/w² is the
    compliance at the nut times the effective mass: linear in x where the screw has one thrust bearing and its
    mass is lumped. It is called compliance here, although its unit is s².

    Parameters
    ----------
    compliance : float
        1/w² in the middle, s².
    slope, curve : float
        Coefficients of x (1/m) and x² (1/m²) in the relative compliance along the axis.
    damping : float
        Damping ratio in the middle.
    mass_over_preload : float
        Moving mass over preload, kg/N: times the table's acceleration it is the load on the nut over its
        preload. 0 for a nut that no load softens.
    nut_over_rest : float
        Compliance of the nut in the middle over that of all other parts, at a ``mass_over_preload`` of
        1 kg/N. At another value the ratio is this times the cube root of ``mass_over_preload``, since the
        compliance of the nut is proportional to P^(-1/3) (Hertz).
    friction : float
        Coulomb friction of the table over the moving mass, m/s².
    pitch, pitch_damping : float
        Frequency (Hz) and damping ratio of the mode in which the table pitches.
    stops : tuple of float
        Positions of the stops from the middle, m, ascending; empty for an axis that is worn evenly.
    local : tuple of float
        Compliance that local wear adds at each of ``stops``, over the compliance in the middle; linear
        between stops.
    damping_exponent : float
        Exponent of the frequency in the damping ratio along the axis: 1 for viscous damping in the springs,
        -1 for viscous damping in the guide, 0 for hysteresis.
    weight : float
        Constant force on the nut over the moving mass, m/s²: the weight of an axis that is not horizontal.
    frame, frame_damping : float
        Frequency (Hz) and damping ratio of the mode of the machine's frame without the table, or of the
        pitching of a part σ of the table's mass: 1/sqrt(1 - σ) of that on a table at rest.
    coupling : float
        Moving mass over the frame's mass, or σ/(1 - σ); 0 for a frame that does not move.
    rotor_part : float
        Factor of ``coupling``: 1 with the rotor held; with it free, the table's share of the mode's kinetic
        energy over that with the rotor held. By Eq. (3) it is (f_held/f_free)².
    rotor_correction : float
        Factor of this square, since the screw turns too; 1 by Eq. (3).
    screw_shift : float
        Relative excess of the frequency in these equations over that with the frame blocked, divided by
        ``coupling``, if the screw's mass is distributed along it: a part of it moves with the frame. 0 for a
        lumped screw.
    form : float
        Factor of ``form_curve`` and ``screw_shift``: 0 for a lumped screw, 1 for a screw whose mass and twist
        are distributed along it as expected.
    form_curve : float
        Coefficient of x² (1/m²) in the relative compliance that the distribution of mass and twist is
        expected to cause.
    viscous : float
        Viscous friction of the whole axis over the moving mass, 1/s.
    guide_part : float
        Part of ``viscous`` in the guide, 0 to 1, which loads the nut; the rest is in motor, bearings and nut.
    """

    compliance: float
    slope: float
    curve: float
    damping: float
    mass_over_preload: float
    nut_over_rest: float
    friction: float
    pitch: float
    pitch_damping: float
    stops: tuple[float, ...] = ()
    local: tuple[float, ...] = ()
    damping_exponent: float = 0.0
    weight: float = 0.0
    frame: float = 0.0
    frame_damping: float = 0.05
    coupling: float = 0.0
    rotor_part: float = 1.0
    rotor_correction: float = 1.0
    screw_shift: float = TYPICAL_SCREW_SHIFT
    form: float = 0.0
    form_curve: float = 0.0
    viscous: float = 0.0
    guide_part: float = 0.0

    @property
    def whole_curve(self) -> float:
        """Coefficient of x² in the relative compliance along the axis, 1/m²."""
        return self.curve + self.form * self.form_curve

    @property
    def frame_coupling(self) -> float:
        """Coupling ν in the equations of motion of :mod:`ballscrew.modal.joint.simulation`."""
        return self.coupling * self.rotor_part

    @property
    def nut_share(self) -> float:
        """The nut's share of the compliance in the middle."""
        ratio = self.nut_over_rest * math.pow(self.mass_over_preload, 1 / 3)
        return ratio / (1 + ratio)

    @property
    def middle_frequency(self) -> float:
        """Undamped natural frequency in the middle, Hz."""
        return float(mode_frequency(self, np.zeros(1))[0])


def compliance_of(frequency: float) -> float:
    """1/w² (s²) of a frequency in Hz."""
    return 1 / (2 * math.pi * frequency) ** 2


def mode_frequency(mode: AxialMode, centred_position: Array) -> Array:
    """Undamped natural frequency of the unloaded nut, Hz, at positions from the middle (m)."""
    compliance = mode.compliance * relative_compliance(mode, centred_position)  # 1/w², s²
    positive = np.maximum(compliance, 1e-12)  # a trial step of the fit may be negative somewhere
    return np.asarray(1 / (2 * math.pi * np.sqrt(positive)))


def relative_compliance(mode: AxialMode, centred_position: Array) -> Array:
    """Compliance at positions from the middle (m), as a fraction of that in the middle."""
    smooth = 1 + mode.slope * centred_position + mode.whole_curve * centred_position**2
    return np.asarray(smooth + local_compliance(mode, centred_position))


def damping_ratio(mode: AxialMode, frequency: Array) -> Array:
    """Damping ratio at positions where the undamped natural frequency is ``frequency`` (Hz)."""
    middle = 1 / (2 * math.pi * math.sqrt(mode.compliance))  # Hz
    return np.asarray(np.minimum(mode.damping * (frequency / middle) ** mode.damping_exponent, _MOST_DAMPING))


def local_compliance(mode: AxialMode, centred_position: Array) -> Array:
    """Compliance added by local wear at positions from the middle (m), over the compliance in the middle."""
    if not mode.local:
        return np.zeros_like(centred_position)
    return np.asarray(np.interp(centred_position, mode.stops, mode.local))


def coupled_poles(mode: AxialMode, frequency: Array) -> tuple[Array, Array]:
    """Poles of the axial mode coupled with that of the frame.

    Parameters
    ----------
    mode : AxialMode
        The mode.
    frequency : ndarray, shape (n,)
        Undamped natural frequency with the frame blocked, Hz.

    Returns
    -------
    omega, damping : ndarray, shape (n, 2)
        Angular frequencies (rad/s, ascending) and damping ratios of both modes. If the frame does not move,
        those of the axial mode alone, shape (n, 1).
    """
    blocked, zeta = 2 * math.pi * frequency, damping_ratio(mode, frequency)  # rad/s, without unit
    if not mode.coupling > 0:
        return blocked[:, None], zeta[:, None]
    # Roots of (s² + D s + K)(s² + d s + k) + coupling s² (D s + K): damping and stiffness of the axis, D and
    # K, and of the frame's mounts, d and k, each over a mass. First row of the companion matrix: the
    # coefficients of s³ to s⁰, with the opposite sign.
    angular = 2 * math.pi * mode.frame
    mount_damping, mount_stiffness = 2 * mode.frame_damping * angular, angular**2
    axis_damping, axis_stiffness = 2 * zeta * blocked, blocked * blocked
    coupling = mode.frame_coupling
    companion = np.zeros((len(blocked), 4, 4))
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    companion[:, 0, 0] = -(mount_damping + axis_damping + coupling * axis_damping)
    companion[:, 0, 1] = -(
        mount_stiffness + axis_damping * mount_damping + axis_stiffness + coupling * axis_stiffness
    )
    companion[:, 0, 2] = -(axis_damping * mount_stiffness + axis_stiffness * mount_damping)
    companion[:, 0, 3] = -(axis_stiffness * mount_stiffness)
    roots = np.linalg.eigvals(companion)
    # One of each conjugate pair: the two with the largest imaginary parts.
    poles = np.take_along_axis(roots, (-roots.imag).argsort(axis=1)[:, :2], axis=1)
    poles = np.take_along_axis(poles, np.abs(poles).argsort(axis=1), axis=1)
    return np.abs(poles), -poles.real / np.abs(poles)
