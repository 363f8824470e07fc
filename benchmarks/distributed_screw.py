"""Frequencies from recordings of a screw whose mass and twist lie along it, by a simulator of its own.

    python -m benchmarks.distributed_screw [--axes 10] [--trips 4] [--page PAGE]

Nothing is shared with the testbed but the data sheets, plans and errors of the sheet of
:func:`benchmarks.axis_sampling.random_axis`. The screw is made of finite elements that stretch and twist; nut
and bearing are preloaded pairs of Hertzian contacts; the guide has LuGre friction, the drive a sampled
cascade of controllers, cogging and a current loop, the nut an error of its lead and of its balls; the base
floats on soft mounts. True frequencies are those of the linearised elements, with a hundred of them.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from numba import njit
from scipy.linalg import eigh

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.arrays import Array
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.planfile import plan_toml
from ballscrew.fcft.profile import profile, set_points
from ballscrew.fcft.schedule import trips
from benchmarks.axis_sampling import random_axis
from benchmarks.identification_tables import write
from benchmarks.machine import heading

RATE = 12_800.0  # Hz
YOUNG, SHEAR, DENSITY = 2.06e11, 7.92e10, 7850.0  # Pa, Pa, kg/m³
ELEMENTS, FINE = 14, 100
DAY = "2026-01-05T10:00Z"
CHANNELS = (
    ("torque", "torque", "N m", ""),
    ("position", "position", "m", ""),
    ("acc1_x", "acceleration", "m/s^2", "nut-1"),
    ("acc2_x", "acceleration", "m/s^2", "nut-2"),
)
UNITS = {source: unit for source, _, unit, _ in CHANNELS}


@njit(cache=True, fastmath=True)
def pair(way: float, stiffness: float, approach: float) -> float:
    """Force of two Hertzian contacts that are pressed against each other."""
    force = 0.0
    if approach + way > 0:
        force += stiffness * (approach + way) ** 1.5
    if approach - way > 0:
        force -= stiffness * (approach - way) ** 1.5
    return force


@njit(cache=True, fastmath=True)
def integrate(
    machine: Array, waves: Array, place: Array, speed: Array, acceleration: Array, noise: Array, steps: int
) -> Array:
    """Torque, motor's and table's acceleration of a trip, by semi-implicit Euler steps, shape (n, 3).

    ``machine`` holds the numbers of :meth:`Machine.numbers`; ``waves`` the amplitude, order and phase of the
    motor's cogging (row 0 of each is 1) and of the lead's error.
    """
    (
        length,
        offset,
        stretch,
        twist,
        node_mass,
        node_inertia,
        nut,
        nut_approach,
        nut_damping,
        bearing,
        bearing_approach,
        bearing_damping,
        table,
        rotor,
        coupling,
        beta,
        base,
        base_stiffness,
        base_damping,
        coulomb,
        static,
        bristle,
        viscous,
        motor_viscous,
        drag,
        gain,
        loop_gain,
        integral,
        lag,
        ahead,
    ) = machine
    n = ELEMENTS
    dt = 1 / (RATE * steps)
    u, du, p, dp = np.zeros(n + 1), np.zeros(n + 1), np.full(n + 1, place[0] / beta), np.zeros(n + 1)
    au, ap = np.zeros(n + 1), np.zeros(n + 1)
    angle, spin, x, v, b, db, z = place[0] / beta, 0.0, place[0], 0.0, 0.0, 0.0, 0.0
    summed, torque, wanted, measured_speed, last = 0.0, 0.0, 0.0, 0.0, place[0]
    records = np.zeros((len(place), 3))
    element = length / n
    for k in range(len(place)):
        if k % 3 == 0:  # the controllers
            encoder = round(beta * angle / 2e-8) * 2e-8
            measured_speed += ((encoder - last) * RATE / 3 - measured_speed) / 2
            last = encoder
            error = loop_gain * (place[k] - encoder) + 0.97 * speed[k] - measured_speed
            summed += error * 3 / RATE / integral
            wanted = gain * (error + summed) + ahead * acceleration[k]
        for _ in range(steps):
            torque += (wanted * beta + noise[k] - torque) * dt / lag
            at = (offset + x) / element
            i = min(int(at), n - 1)
            w = at - i
            turn, turning = (1 - w) * p[i] + w * p[i + 1], (1 - w) * dp[i] + w * dp[i + 1]
            way = (1 - w) * u[i] + w * u[i + 1] + beta * turn - x
            rate = (1 - w) * du[i] + w * du[i + 1] + beta * turning - v
            cogging = 0.0
            for is_motor, size, order, phase in waves:
                if is_motor:
                    cogging += size * math.sin(order * angle + phase)
                else:
                    way += size * math.sin(order * turn + phase)
                    rate += size * order * math.cos(order * turn + phase) * turning
            # An element is stiffer between its nodes: the missing compliance is in series with the nut's.
            soft = w * (1 - w) * element * (1 / stretch + beta * beta / twist)
            force = pair(way, nut, nut_approach)
            for _ in range(3):
                force = pair(way - soft * force, nut, nut_approach)
            force += nut_damping * rate
            slip = v - db
            limit = coulomb + (static - coulomb) * math.exp(-((slip / 0.002) ** 2))
            dz = slip - bristle * abs(slip) / limit * z
            z += dz * dt
            friction = bristle * z + 0.6 * math.sqrt(bristle * table) * dz + viscous * slip
            support_force = pair(u[0] - b, bearing, bearing_approach) + bearing_damping * (du[0] - db)
            to_screw = coupling * ((angle - p[0]) + 1e-5 * (spin - dp[0]))
            for j in range(n + 1):
                pull, moment = 0.0, 0.0
                if j > 0:
                    pull -= stretch / element * (u[j] - u[j - 1] + 2e-6 * (du[j] - du[j - 1]))
                    moment -= twist / element * (p[j] - p[j - 1] + 2e-6 * (dp[j] - dp[j - 1]))
                if j < n:
                    pull += stretch / element * (u[j + 1] - u[j] + 2e-6 * (du[j + 1] - du[j]))
                    moment += twist / element * (p[j + 1] - p[j] + 2e-6 * (dp[j + 1] - dp[j]))
                if j == 0:
                    pull -= support_force
                    moment += to_screw
                part = 1 - w if j == i else (w if j == i + 1 else 0.0)
                pull -= part * force
                moment -= part * (beta * force + drag * math.tanh(turning / 0.05))
                inside = 1.0 if 0 < j < n else 0.5
                au[j], ap[j] = pull / (inside * node_mass), moment / (inside * node_inertia)
            du += au * dt
            dp += ap * dt
            u += du * dt
            p += dp * dt
            spin += (torque + cogging - to_screw - motor_viscous * spin) / rotor * dt
            angle += spin * dt
            push = (force - friction) / table
            v += push * dt
            x += v * dt
            db += (support_force + friction - base_stiffness * b - base_damping * db) / base * dt
            b += db * dt
            records[k, 0] += torque / steps
            records[k, 1] += beta * angle / steps
            records[k, 2] += push / steps
    return records


@dataclass(frozen=True)
class Machine:
    """A random machine with true values of its sheet; ``seed`` decides all that no sheet states."""

    sheet: DataSheet
    load: float
    seed: int

    @property
    def beta(self) -> float:
        """Travel per angle, m/rad."""
        return self.sheet.screw.lead / (2 * math.pi)

    @property
    def moving(self) -> float:
        """Mass of table and load, kg."""
        return self.sheet.table.mass + self.load

    @property
    def base(self) -> tuple[float, float]:
        """Mass (kg) and frequency (Hz) of the base."""
        random = np.random.default_rng([self.seed, 77])
        return self.moving * random.uniform(10, 20), random.uniform(16, 30)

    def screw(self) -> tuple[float, float, float, float]:
        """EA (N), GJ (N m²), mass (kg/m) and inertia (kg m) per length."""
        root, outside = self.sheet.screw.root_diameter, 0.98 * self.sheet.screw.nominal_diameter
        area, polar = math.pi * root**2 / 4, math.pi * root**4 / 32
        heavy, inert = math.pi * outside**2 / 4, math.pi * outside**4 / 32
        return YOUNG * area, SHEAR * polar, DENSITY * heavy, DENSITY * inert

    def contacts(self) -> tuple[float, float, float, float]:
        """Constants (N/m^1.5) and approaches (m) of nut and bearing."""
        screw = self.sheet.screw
        reference = (screw.rigidity_preload_ratio or 0.1) * screw.dynamic_load_rating
        # A catalogue's K is that of the raceways alone: the nut has 0.8 of it.
        nut = (0.8 * screw.rigidity / (3 * reference ** (1 / 3))) ** 1.5
        approach = 12e-6  # m, of the bearing
        bearing = self.sheet.bearing.stiffness / (3 * math.sqrt(approach))
        return nut, (self.sheet.nominal_preload / nut) ** (2 / 3), bearing, approach

    def frequency(self, place: float) -> float:
        """Axial natural frequency at a place, rotor free, on the floating base, Hz."""
        stretch, twist, mass, inertia = self.screw()
        nut, approach, bearing, bearing_approach = self.contacts()
        sheet, at = self.sheet, self.sheet.screw.bearing_to_zero + place
        nodes = np.unique(np.append(np.linspace(0, sheet.screw.length, FINE + 1), at))
        count = len(nodes)
        table, rotor, base = 2 * count, 2 * count + 1, 2 * count + 2
        stiffness, masses = np.zeros((base + 1,) * 2), np.zeros((base + 1,) * 2)

        def spring(value: float, *ends: tuple[int, float]) -> None:
            way = np.zeros(base + 1)
            for index, factor in ends:
                way[index] = factor
            stiffness[:] += value * np.outer(way, way)

        for i, size in enumerate(np.diff(nodes)):
            for first, rigidity, heavy in ((0, stretch, mass), (count, twist, inertia)):
                spring(rigidity / size, (first + i, -1), (first + i + 1, 1))
                pair_of = np.ix_([first + i, first + i + 1], [first + i, first + i + 1])
                masses[pair_of] += heavy * size / 6 * np.array([[2, 1], [1, 2]])
        heavy, own = self.base
        masses[table, table], masses[rotor, rotor] = self.moving, sheet.drive.rotor_inertia
        masses[base, base] = heavy
        nearest = int(np.argmin(np.abs(nodes - at)))
        spring(3 * nut * math.sqrt(approach), (nearest, 1), (count + nearest, self.beta), (table, -1))
        spring(3 * bearing * math.sqrt(bearing_approach), (0, 1), (base, -1))
        spring(sheet.drive.coupling_stiffness or 1e9, (rotor, 1), (count, -1))
        spring(heavy * (2 * math.pi * own) ** 2, (base, 1))
        squares, shapes = eigh(stiffness, masses, subset_by_index=[0, 6])
        elastic = squares > (2 * math.pi * 1.5 * own) ** 2
        motion = np.where(elastic, np.abs(shapes[table] - shapes[base]), 0)
        return float(math.sqrt(squares[np.argmax(motion)]) / (2 * math.pi))

    def numbers(self, middle: float) -> tuple[Array, Array, float]:
        """Numbers and waves of :func:`integrate`, and the torque of the noise, N m."""
        r, sheet, beta = np.random.default_rng([self.seed, 991]), self.sheet, self.beta
        stretch, twist, mass, inertia = self.screw()
        nut, approach, bearing, bearing_approach = self.contacts()
        element = sheet.screw.length / ELEMENTS
        damping = 2 * r.uniform(0.008, 0.025) / (2 * math.pi * middle)  # s
        heavy, own = self.base
        friction = sheet.guide.friction or 0.0
        whole = self.moving + (sheet.drive.rotor_inertia + inertia * sheet.screw.length) / beta**2
        band = 2 * math.pi * r.uniform(22, 45)
        torque = sheet.screw.lead * sheet.nominal_preload / 6.8  # over that of a 25 x 10 mm axis
        numbers = (
            sheet.screw.length, sheet.screw.bearing_to_zero, stretch, twist,
            mass * element, inertia * element,
            nut, approach, damping * 3 * nut * math.sqrt(approach), bearing, bearing_approach,
            damping * sheet.bearing.stiffness, self.moving, sheet.drive.rotor_inertia,
            sheet.drive.coupling_stiffness or 1e5, beta, heavy, heavy * (2 * math.pi * own) ** 2,
            0.1 * heavy * 2 * math.pi * own, friction, r.uniform(1.1, 1.5) * friction,
            friction / r.uniform(2e-6, 8e-6), r.uniform(3, 7) * friction,
            r.uniform(1.5, 4) * friction * beta**2, 0.15 * beta * sheet.nominal_preload * r.uniform(0.7, 1.4),
            whole * band, 0.18 * band, 6 / band, r.uniform(1.5e-4, 3e-4), r.uniform(0.3, 0.9) * whole,
        )  # fmt: skip
        waves = [
            (1.0, 0.006 * torque * r.uniform(0.2, 1), order, r.uniform(0, 2 * math.pi))
            for order in (1.0, 2.0, 6.0, 12.0, 24.0, 36.0)
        ]
        for size, order in ((0.3e-6, 1.0), (0.02e-6, r.uniform(5.5, 9.5))):
            waves.append((0.0, size * r.uniform(0.5, 1.5), order, r.uniform(0, 2 * math.pi)))
        return np.array(numbers), np.array(waves), torque

    def trip(self, plan: Plan, motion: Motion, seed: int) -> dict[str, Array]:
        """Recorded channels of a trip."""
        random = np.random.default_rng([seed, 5])
        pace = 1 + random.uniform(-0.005, 0.005)
        paced = replace(
            motion, speed=pace * motion.speed, acceleration=pace**2 * motion.acceleration,
            jerk=pace**3 * motion.jerk,
        )  # fmt: skip
        move, lead = profile(plan, paced), random.uniform(0.02, 0.22)
        points = set_points(move, np.arange(int((move.duration + lead + 0.05) * RATE)) / RATE - lead)
        middle = self.frequency((plan.positions[0] + plan.positions[-1]) / 2)
        numbers, waves, torque = self.numbers(middle)
        stretch, _, mass, _ = self.screw()
        element = self.sheet.screw.length / ELEMENTS
        nut = 6 * self.contacts()[0] * math.sqrt(self.contacts()[1]) / (mass * element)
        steps = max(8, math.ceil(math.sqrt(4 * stretch / mass / element**2 + nut) / RATE))
        noise = 0.003 * torque * random.standard_normal(len(points.time))
        records = integrate(numbers, waves, points.position, points.speed, points.acceleration, noise, steps)
        noisy = records[:, 0] + 0.002 * torque * random.standard_normal(len(records))
        channels = {"torque": noisy, "position": np.round(records[:, 1], 8)}
        for name in ("acc1_x", "acc2_x"):
            channels[name] = records[:, 2] + 0.02 * random.standard_normal(len(records))
        return channels


def record(machine: Machine, plan: Plan, folder: Path, sheet: DataSheet) -> Path:
    """RUN.toml of a simulated run."""
    names = []
    for number, trip in enumerate(trip for trip in trips(plan) if trip.repetition):
        names.append(f"trip{number}.h5")
        with h5py.File(folder / names[-1], "w") as file:
            file.attrs["sample_rate"] = RATE
            for name, values in machine.trip(plan, trip.executed, 1000 * machine.seed + number).items():
                file.create_dataset(name, data=values).attrs["unit"] = UNITS[name]
    blocks = []
    for source, quantity, unit, location in CHANNELS:
        block = f'[[channel]]\nsource = "{source}"\nquantity = "{quantity}"\nunit = "{unit}"\n'
        blocks.append(block + (f'location = "{location}"\naxis = "x"\n' if location else ""))
    (folder / "channels.toml").write_text("\n".join(blocks), encoding="utf-8")
    (folder / "axis.toml").write_text(axis_toml(sheet), encoding="utf-8")
    (folder / "plan.toml").write_text(plan_toml(plan), encoding="utf-8")
    listed = ", ".join(f'"{name}"' for name in names)
    text = (
        f'axis = "axis.toml"\nplan = "plan.toml"\nchannels = "channels.toml"\nload = "{machine.load:g} kg"\n'
    )
    run = folder / "run.toml"
    run.write_text(f'{text}measured_at = "{DAY}"\nfiles = [{listed}]\n', encoding="utf-8")
    return run


def row(seed: int, count: int) -> tuple[str, Array]:
    """Line of the table of an axis, and errors over their standard uncertainties of its good cells."""
    sampled = random_axis(seed)
    plan = replace(sampled.plan, repetitions=count)
    machine = Machine(sampled.rig.machine.sheet, sampled.load, seed)
    with tempfile.TemporaryDirectory() as folder:
        run = ballscrew.analyze(record(machine, plan, Path(folder), sampled.data_sheet))
    true = {place: machine.frequency(place) for place in plan.positions}
    found = [
        (cell.frequency_Hz - true[cell.position_m], cell.standard_uncertainty_Hz, cell.verdict == "good")
        for cell in run.cells
        if cell.frequency_Hz is not None and cell.standard_uncertainty_Hz is not None
    ]
    errors, spreads, good = (np.array(column) for column in zip(*found, strict=True))
    ratios = np.abs(errors / spreads)[good.astype(bool)]
    first, last = true[plan.positions[0]], true[plan.positions[-1]]
    line = (
        f"| {seed} | {machine.sheet.support} | {first:.0f} to {last:.0f} "
        f"| {np.median(np.abs(errors)):.3f} | {np.abs(errors).max():.3f} | {np.median(spreads):.3f} "
        f"| {len(ratios)} of {len(run.cells)} | {np.count_nonzero(ratios > 1.96)} |"
    )
    return line, ratios


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=10)
    parser.add_argument("--trips", type=int, default=4)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    command = f"python -m benchmarks.distributed_screw --axes {given.axes} --trips {given.trips}"
    lines = [
        heading(command), "",
        "| axis | support | true, Hz | median error, Hz | largest | median u | good | of these outside |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    every = []
    for seed in range(given.axes):
        line, ratios = row(seed, given.trips)
        lines.append(line)
        every.append(ratios)
        print(line, flush=True)
    together = np.concatenate(every)
    outside = np.count_nonzero(together > 1.96)
    lines.append(f"| all | | | | | | {len(together)} | {outside} |")
    print("\n" + "\n".join(lines))
    if given.page is not None:
        write(given.page, "distributed screw", lines)


if __name__ == "__main__":
    main()
