"""Write recording.csv: what a German data logger might have kept of a small ball-screw axis.

Usage: python make_recording.py [FILE]

Nothing in it is measured. A rotor drives a table through a spring, which is bearing, screw and nut in series
and softer the further the table is from the bearing; a servo moves it to three stops and back, three times.
"""

import itertools
import math
import random
import sys
from pathlib import Path

RATE, STEPS = 4000, 4  # samples per second; steps of the simulation a sample
STOPS = (0.0, 0.135, 0.27)  # m
TRIPS, DWELL = 3, 0.35  # round trips; s
SPEED, ACCELERATION, JERK = 0.15, 2.5, 2500.0  # m/s, m/s², m/s³
BETA = 0.010 / (2 * math.pi)  # m/rad: lead 10 mm
TABLE, ROTOR = 102.3, 225.4  # kg: table, nut and a third of the screw; rotor, referred to the table
AREA = math.pi / 4 * 0.0214**2  # m²: root diameter 21.4 mm
FRICTION, VISCOUS = 25.0, 150.0  # N, N s/m
DAMPING = 0.03  # of the axial mode


def stiffness(x: float) -> float:
    """Bearing, screw and nut in series, N/m, with the table at x."""
    nut = 2.41e8  # at a preload of 3 % of Ca; new it would be 2.65e8
    screw = (x + 0.12) * (1 / (206e9 * AREA) + 32 * BETA**2 / (math.pi * 0.0214**4 * 80e9))
    return 1 / (1 / nut + screw + 1 / 1.8e8)


def move(start: float, stop: float) -> list[tuple[float, float, float]]:
    """Wanted position, speed and acceleration of one jerk-limited move, then the dwell."""
    ramp, hold = ACCELERATION / JERK, SPEED / ACCELERATION - ACCELERATION / JERK
    way, sign = abs(stop - start), math.copysign(1.0, stop - start)
    phase = 2 * ramp + hold
    cruise = way / SPEED - phase
    marks = [0.0, ramp, ramp + hold, phase]
    marks += [phase + cruise + mark for mark in marks]
    jerks = [JERK, 0.0, -JERK, 0.0, -JERK, 0.0, JERK, 0.0]
    dt, rows, x, v, a, part = 1 / (RATE * STEPS), [], 0.0, 0.0, 0.0, 0
    for step in range(round((2 * phase + cruise + DWELL) * RATE * STEPS)):
        while part < 7 and step * dt > marks[part + 1] - dt / 2:
            part += 1
        a = a + jerks[part] * dt if part < 7 else 0.0
        v = v + a * dt if part < 7 else 0.0
        x = x + v * dt if part < 7 else way
        rows.append((start + sign * x, sign * v, sign * a))
    return rows


def simulate() -> list[tuple[float, float, float]]:
    """Torque (N m), position (m) and acceleration (m/s²) at the table, a row a sample."""
    dt, rows, noise = 1 / (RATE * STEPS), [], random.Random(1)  # noqa: S311
    path = [*STOPS, *reversed(STOPS[:-1])] * TRIPS
    wanted = [(STOPS[0], 0.0, 0.0)] * round(0.5 / dt)
    for start, stop in itertools.pairwise(path):
        if start != stop:
            wanted += move(start, stop)
    x = xt = STOPS[0]
    v = vt = a = at = held = 0.0
    for step, (want_x, want_v, want_a) in enumerate(wanted):
        held = min(max(held + 3e6 * (want_x - x) * dt, -500.0), 500.0)
        force = (TABLE + ROTOR) * want_a + 4e5 * (want_x - x) + 2.2e4 * (want_v - v) + held
        force += VISCOUS * want_v + FRICTION * math.tanh(want_v / 1e-2)
        k = stiffness(xt)
        c = 2 * DAMPING * math.sqrt(k / (1 / TABLE + 1 / ROTOR))
        # Speeds lie half a step before ways: without the last term the axis would ring 0.1 % too high.
        spring = k * (x - xt) + c * (v - vt + 0.5 * dt * (a - at))
        at = (spring - VISCOUS * vt - FRICTION * math.tanh(vt / 1e-2)) / TABLE
        a = (force - spring) / ROTOR
        v, vt = v + a * dt, vt + at * dt
        x, xt = x + v * dt, xt + vt * dt
        if step % STEPS == 0:
            torque = force * BETA + noise.gauss(0, 0.004)
            rows.append((torque, round(x / 1e-7) * 1e-7, at + noise.gauss(0, 0.03)))
    return rows


def write(path: Path) -> None:
    """Write the table as a logger in Germany does: semicolons, decimal commas, g and ms."""
    lines = ["Messung Achse 1", "Zeit [ms];Drehmoment [Nm];Istposition [mm];Beschl. X [g]"]
    for i, (torque, x, a) in enumerate(simulate()):
        row = f"{1e3 * i / RATE:.2f};{torque:.4f};{1e3 * x:.4f};{a / 9.80665:.5f}"
        lines.append(row.replace(".", ","))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1] if len(sys.argv) > 1 else "recording.csv"))
