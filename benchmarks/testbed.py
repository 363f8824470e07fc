"""One simulated second of the testbed beside scipy's solve_ivp on the same equations.

The machine is the example's, running along its trip. The drive's torque is recorded once, then all replay it
without control: sample by sample constant, so that all solve the same equations with the same input. The
right-hand side that scipy calls is compiled too. The reference is the kernel with 512 steps a sample. The
second table is how the kernel's error falls with its step.

    python -m benchmarks.testbed [--rounds 5]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from ballscrew.base.arrays import Array
from ballscrew.fcft.profile import profile, set_points
from ballscrew.testbed.example import LOAD, PLAN, example_rig
from ballscrew.testbed.forces import pressed_at, spring_forces, stiffnesses
from ballscrew.testbed.integrator import Loop, integrate
from ballscrew.testbed.machine import Constants
from ballscrew.testbed.servo import loop
from ballscrew.testbed.trip import prepared
from benchmarks.machine import heading

__all__ = [
    "NO_WAVES",
    "OFF",
    "convergence",
    "machine_and_torque",
    "potential",
    "relative",
    "replayed",
    "slope_of",
    "solved",
]

RATE, SECONDS = 12800.0, 1.0
OFF = Loop(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, np.inf, 0.0, 0.0, False)
NO_WAVES: Array = np.zeros((0, 4))
Method = Literal["LSODA", "RK45"]


def potential(c: Constants, motor: float, turn: float, rod: float, table: float, bed: float) -> float:
    """Potential of all springs, J, whose gradient :func:`.spring_forces` computes by hand."""
    twist, axial, _, _ = stiffnesses(c, table - bed)
    pressed, _ = pressed_at(c, table - bed)
    deflection = turn + rod - table
    up, down = max(pressed + deflection, 0.0), max(pressed - deflection, 0.0)
    return float(
        0.5 * twist * (motor - turn) ** 2
        + 0.5 * axial * (rod - bed) ** 2
        + 0.4 * c.flank * (up**2.5 + down**2.5)
        + 0.5 * c.bed_stiffness * bed**2
    )


def machine_and_torque() -> tuple[Constants, Array, Array]:
    """Constants, force on the motor (n,) and first state: the first second of the example's trip."""
    rig = example_rig()
    c = prepared(rig.machine, LOAD, PLAN)
    n = round(SECONDS * RATE)
    points = set_points(profile(PLAN, PLAN.motions[0]), 0.3 + np.arange(n) / RATE)
    wanted = np.stack([points.position, points.speed, points.acceleration], axis=1)
    servo = loop(rig.servo, rig.machine, c)
    records, _ = integrate(c, servo, wanted, np.zeros((n, 2)), NO_WAVES, 64, RATE, np.zeros(11))
    return c, records[:, 0].copy(), np.zeros(11)


def replayed(c: Constants, force: Array, state: Array, steps: int) -> Array:
    """Acceleration of the table, by the kernel."""
    pushed = np.stack([force, np.zeros_like(force)], axis=1)
    records, _ = integrate(c, OFF, np.zeros((len(force), 3)), pushed, NO_WAVES, steps, RATE, state)
    return np.asarray(records[:, 1])


def slope_of(c: Constants, force: Array) -> Callable[[float, Array], Array]:
    """Right-hand side of the same equations, the guide's bristle among them, compiled for one machine."""
    last = len(force) - 1

    @njit()
    def slope(t: float, y: Array) -> Array:
        m, p, s, x, b, vm, vt, vs, vx, vb, z = y
        fm, ft, fs, fx, fb, twist, axial, rigidity, _ = spring_forces(c, m, p, s, x, b)
        cut = c.structural * twist * (vm - vt)
        fm -= cut
        ft += cut
        cut = c.structural * axial * (vs - vb)
        fs -= cut
        fb += cut
        cut = c.structural * rigidity * (vt + vs - vx)
        ft -= cut
        fs -= cut
        fx += cut
        slide = vx - vb
        level = c.coulomb + (c.breakaway - c.coulomb) * np.exp(-((slide / c.stribeck) ** 2))
        bent = slide - c.bristle * abs(slide) / level * z
        drag = c.viscous * slide + c.bristle * z + c.bristle_damping * bent
        fx -= drag
        fb += drag - c.bed_viscous * vb
        ft -= c.drag * vt / np.sqrt(vt * vt + 2.5e-9)
        fm += force[min(int(t * RATE), last)] - c.motor_viscous * vm
        return np.array(
            [vm, vt, vs, vx, vb, fm / c.motor, ft / c.screw, fs / c.rod, fx / c.table, fb / c.bed, bent]
        )

    return slope


def solved(
    slope: Callable[[float, Array], Array], count: int, state: Array, method: Method, tolerance: float
) -> Array:
    """Acceleration of the table, a mean over each of so many samples, by solve_ivp."""
    times = np.arange(count + 1) / RATE
    scale = np.array([1e-5] * 5 + [1e-2] * 5 + [1e-5])
    answer = solve_ivp(
        slope,
        (0.0, float(times[-1])),
        state,
        method=method,
        t_eval=times,
        rtol=tolerance,
        atol=tolerance * scale,
        max_step=1 / RATE,  # the torque changes with every sample
    )
    assert answer.success, answer.message
    return np.asarray(np.diff(answer.y[8]) * RATE, dtype=np.float64)


def convergence(
    c: Constants, force: Array, state: Array, steps: tuple[int, ...], reference: Array
) -> list[tuple[int, float, float]]:
    """Steps a sample; error of the acceleration over its own size, root mean squares; seconds."""
    rows = []
    for count in steps:
        error = relative(replayed(c, force, state, count), reference)
        rows.append((count, error, _seconds(partial(replayed, c, force, state, count), 5)))
    return rows


def relative(found: Array, reference: Array) -> float:
    """Root mean square of the difference over that of the reference; inf where the integration ran away."""
    if not np.all(np.abs(found) < 1e6):
        return math.inf
    return float(np.sqrt(np.mean((found - reference) ** 2) / np.mean(reference**2)))


def _seconds(work: Callable[[], object], rounds: int) -> float:
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return float(best)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    c, force, state = machine_and_torque()
    reference = replayed(c, force, state, 512)
    print(heading("python -m benchmarks.testbed"), end="\n\n")
    rows: list[tuple[str, float, float]] = []
    ours = _seconds(lambda: replayed(c, force, state, 4), given.rounds)
    rows.append(("kernel, 4 steps a sample", ours, relative(replayed(c, force, state, 4), reference)))
    slope = slope_of(c, force)
    slope(0.0, state)
    methods: tuple[Method, ...] = ("LSODA", "RK45")
    for method in methods:
        for tolerance in (1e-3, 1e-4, 1e-5, 1e-6):
            start = time.perf_counter()
            found = solved(slope, len(force), state, method, tolerance)
            took = time.perf_counter() - start
            rows.append((f"solve_ivp {method}, {tolerance:g}", took, relative(found, reference)))
    print("| method | ms per simulated second | × kernel | error of the acceleration |\n|---|---|---|---|")
    for name, took, error in rows:
        print(f"| {name} | {1e3 * took:.1f} | {took / ours:.0f} | {100 * error:.3f} % |")
    print("\n| steps a sample | error of the acceleration | ms per simulated second |\n|---|---|---|")
    for steps, error, took in convergence(c, force, state, (1, 2, 4, 8, 16), reference):
        shown = f"{100 * error:.3f} %" if error < 1 else "unstable"
        print(f"| {steps} | {shown} | {1e3 * took:.1f} |")


if __name__ == "__main__":
    main()
