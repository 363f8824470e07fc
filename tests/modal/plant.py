"""A two-mass plant with known truth: torque → rotor, spring and damper → table, on a jerk-limited motion.

A servo holds the rotor to the wanted motion. The equations of motion are integrated exactly for forces that
run straight between samples; no formula of the package is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete, lfilter

from ballscrew.fcft.plan import Motion
from ballscrew.recording.aligned import Aligned

MOTION = Motion(speed=0.15, acceleration=2.5, jerk=1500.0, dwell=0.35)


@dataclass(frozen=True)
class Truth:
    """One acceleration or deceleration: where it starts and stops, what it is, at which stop."""

    start: float
    stop: float
    condition: str
    place: float


@dataclass(frozen=True)
class Way:
    """A wanted motion: sampled exactly, with its phases."""

    rate: float
    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    truth: tuple[Truth, ...]

    @property
    def time(self):
        return np.arange(len(self.position)) / self.rate

    @property
    def direction(self):
        """Sign of the speed; 0 at rest, where the speed is rounding only."""
        return np.where(np.abs(self.speed) > 1e-9, np.sign(self.speed), 0.0)


def way(
    stops: Sequence[float], rate: float, motions: Motion | Sequence[Motion] = MOTION, *, lead=0.3, offset=0.0
) -> Way:
    """Move from stop to stop; each move has its own motion where several are given.

    ``dwell`` is the standstill after a move. ``lead`` is the standstill before the first.
    """
    moves = len(stops) - 1
    motions = [motions] * moves if isinstance(motions, Motion) else list(motions)
    pieces, truth, now = [(lead, 0.0)], [], lead
    for (a, b), motion in zip(pairwise(stops), motions, strict=True):
        sign, tj, ta = np.sign(b - a), motion.jerk_time, motion.acceleration_time
        cruise = (abs(b - a) - 2 * motion.acceleration_distance) / motion.speed
        assert cruise >= 0, "the stops are too near for this speed"
        up = [(tj, sign * motion.jerk), (ta - 2 * tj, 0.0), (tj, -sign * motion.jerk)]
        pieces += [*up, (cruise, 0.0), *((d, -j) for d, j in up), (motion.dwell, 0.0)]
        letter = "P" if sign > 0 else "N"
        truth.append(Truth(now, now + ta, letter + "A", a + offset))
        truth.append(Truth(now + ta + cruise, now + 2 * ta + cruise, letter + "D", b + offset))
        now += 2 * ta + cruise + motion.dwell
    return Way(rate, *_sampled(pieces, stops[0] + offset, rate), tuple(truth))


def _sampled(pieces, x0, rate):
    duration, jerk = np.array(pieces).T
    begin = np.concatenate([[0.0], np.cumsum(duration)])
    x, v, a, states = x0, 0.0, 0.0, []
    for d, j in pieces:
        states.append((x, v, a))
        x, v, a = x + v * d + a * d**2 / 2 + j * d**3 / 6, v + a * d + j * d**2 / 2, a + j * d
    t = np.arange(int(begin[-1] * rate)) / rate
    at = np.clip(np.searchsorted(begin, t, side="right") - 1, 0, len(pieces) - 1)
    (x, v, a), j, s = np.array(states)[at].T, jerk[at], t - begin[at]
    return x + v * s + a * s**2 / 2 + j * s**3 / 6, v + a * s + j * s**2 / 2, a + j * s


@dataclass(frozen=True)
class Plant:
    """Masses (kg), mode (Hz, damping ratio), friction (N s/m, N), servo (Hz), and noise (one sigma)."""

    rotor: float = 160.0
    table: float = 135.0
    frequency: float = 150.0
    damping: float = 0.04
    viscous: float = 300.0
    coulomb: float = 25.0
    offset: float = -5.0
    servo: float = 40.0  # bandwidth of the velocity loop around the rotor; it damps the ringing
    ripple: float = 3.0  # N of white force noise that drives the plant
    force_noise: float = 0.3  # N that is measured and drives nothing
    acceleration_noise: float = 0.03  # m/s²
    position_noise: float = 2e-7  # m

    @property
    def mass(self) -> float:
        return self.rotor + self.table

    @property
    def quiet(self) -> Plant:
        return replace(self, ripple=0.0, force_noise=0.0, acceleration_noise=0.0, position_noise=0.0)

    def run(self, move: Way, seed: int = 0, *, responses: int = 1) -> Aligned:
        """Measured force, position and accelerations of the table."""
        rng = np.random.default_rng(seed)
        n, a = len(move.position), move.acceleration
        friction = self.viscous * move.speed + self.coulomb * move.direction + self.offset
        ahead = self.mass * a + friction + self.ripple * rng.standard_normal(n)
        # All deviations from the wanted motion, so that the motion itself is never integrated.
        inputs = np.stack([ahead - self.rotor * a, -friction - self.table * a])
        rotor, speed, table, bend = self._deviations(inputs, move.rate)
        loop = self._loop()

        def noisy(x, size):
            return x + size * rng.standard_normal(n)

        return Aligned(
            rate=move.rate,
            input=noisy(ahead - loop[0] * rotor - loop[1] * speed, self.force_noise),
            quantity="force",
            position=noisy(move.position + table, self.position_noise),
            response=np.stack(
                [noisy(move.acceleration + bend, self.acceleration_noise) for _ in range(responses)]
            ),
            responses=tuple(f"acceleration:nut-{i + 1}:x" for i in range(responses)),
        )

    def _loop(self):
        """Gains of the servo on the rotor's position and speed."""
        speed = self.mass * 2 * np.pi * self.servo
        return speed * 2 * np.pi * self.servo / 8, speed

    def _deviations(self, inputs, rate):
        """Rotor's way and speed, table's way and acceleration; exact for inputs straight between samples."""
        mu = self.rotor * self.table / self.mass
        w = 2 * np.pi * self.frequency
        k, c = mu * w * w, 2 * self.damping * w * mu
        kp, kd = self._loop()
        mr, mt = self.rotor, self.table
        a = np.array(
            [
                [0, 1, 0, 0],
                [-(k + kp) / mr, -(c + kd) / mr, k / mr, c / mr],
                [0, 0, 0, 1],
                [k / mt, c / mt, -k / mt, -c / mt],
            ]
        )
        b = np.array([[0, 0], [1 / mr, 0], [0, 0], [0, 1 / mt]])
        out = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], a[3]])
        through = np.array([[0.0, 0], [0, 0], [0, 0], b[3]])
        ad, bd, cd, dd, _ = cont2discrete((a, b, out, through), 1 / rate, method="foh")
        # Parted into its modes, each a recurrence of the first order.
        poles, modes = np.linalg.eig(ad)
        drive = np.linalg.solve(modes, bd @ inputs)
        state = np.stack([lfilter([0, 1], [1, -p], row) for p, row in zip(poles, drive, strict=True)])
        return ((cd @ modes) @ state).real + dd @ inputs


def trip(plan_stops: Sequence[float]) -> list[float]:
    """There and back again."""
    return [*plan_stops, *plan_stops[-2::-1]]


def write_h5(path: Path, aligned: Aligned, *, scale: float = 1.0, name: str = "torque") -> Path:
    """Write a recording as a dataset per channel; ``scale`` turns the force into what is measured."""
    import h5py

    with h5py.File(path, "w") as file:
        file[name] = aligned.input * scale
        file["position"] = aligned.position
        for index, values in enumerate(aligned.response):
            file[f"acc{index + 1}_x"] = values
    return path
