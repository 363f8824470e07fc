from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ballscrew.axis.hertz import apparent_preload
from ballscrew.modal.joint.mode import AxialMode, coupled_poles
from ballscrew.modal.joint.simulation import SOFTENING, simulate_mode
from ballscrew.modal.joint.windows import band_filter

RATE = 3200.0


def rung(
    frequency: float,
    damping: float,
    drive: np.ndarray,
    load: float = 0.0,
    softer: float = 0.0,
    power: float = 0.0,
    constant: float = 0.0,
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    band = band_filter(0.02, 0.42 * RATE, RATE)
    out = np.empty(len(drive))
    shape = np.array([1 / (2 * math.pi * frequency) ** 2, 0.0, 0.0, damping, load, 0.5, power, *frame])
    simulate_mode(
        drive,
        np.zeros(len(drive)),
        np.full(len(drive), softer),
        np.full(len(drive), constant),
        np.empty((len(drive), 0)),
        np.array([0, len(drive)]),
        np.array([0]),
        shape,
        SOFTENING,
        band.numerator,
        band.denominator,
        1 / RATE,
        out,
        np.empty((len(drive), 0)),
    )
    return out


@pytest.mark.parametrize(("frequency", "damping"), [(60.0, 0.01), (170.0, 0.05), (330.0, 0.03)])
def test_it_rings_at_the_given_frequency_and_damping(frequency: float, damping: float) -> None:
    drive = np.zeros(2000)
    drive[3] = 100.0
    free = rung(frequency, damping, drive)[20:400]
    # Two lags foretell a decaying sine exactly: their poles are its own. The filter adds next to nothing.
    found = poles(free)
    assert found[0] == pytest.approx(frequency, rel=3e-4)
    assert found[1] == pytest.approx(damping, rel=0.03)


def poles(free: np.ndarray) -> tuple[float, float]:
    rows = np.stack([free[1:-1], free[:-2]], axis=1)
    one, two = np.linalg.lstsq(rows, free[2:], rcond=None)[0]
    pole = np.log(np.roots([1.0, -one, -two]).astype(complex)[0]) * RATE
    return abs(pole) / (2 * math.pi), -pole.real / abs(pole)


@pytest.mark.parametrize(("power", "softer"), [(1.0, 0.3), (-1.0, 0.3), (0.0, 0.3), (1.0, -0.2)])
def test_the_damping_ratio_goes_with_a_power_of_the_frequency(power: float, softer: float) -> None:
    drive = np.zeros(2000)
    drive[3] = 100.0
    frequency, ratio = poles(rung(150.0, 0.03, drive, softer=softer, power=power)[20:400])
    assert frequency == pytest.approx(150.0 / math.sqrt(1 + softer), rel=3e-4)
    assert ratio == pytest.approx(0.03 * (1 + softer) ** (-power / 2), rel=0.03)


def test_a_nut_that_softens_under_load_rings_lower() -> None:
    drive = np.zeros(4000)
    drive[3:] = 3.0
    crossings = [
        int(np.sum(np.diff(np.sign(rung(100.0, 0.001, drive, s)[5:3000] - 3.0)) != 0)) for s in (0.0, 0.6)
    ]
    assert crossings[1] < crossings[0]


@pytest.mark.parametrize("softer", [-0.8, -0.667, -0.5, 0.3, 4.0, 8.0])
def test_a_step_is_the_same_inside_its_table_and_beyond(softer: float) -> None:
    """The table reaches from 0.2 to 3 times the stiffness of the middle."""
    drive = np.random.default_rng(5).standard_normal(1500)
    drive[:3] = 0.0
    away = rung(150.0, 0.03, drive, softer=softer)
    there = rung(150.0 / math.sqrt(1 + softer), 0.03, drive)
    assert away == pytest.approx(there, abs=1e-7 * float(np.abs(there).max()))


def test_where_one_node_gives_way_to_the_next_there_is_no_corner() -> None:
    """The jacobian is made of small steps: a corner of the table would be seen in them."""
    drive = np.random.default_rng(6).standard_normal(1500)
    drive[:3] = 0.0
    between = 1 / (0.2 + 2.8 / 700 * 170.5) - 1
    ends = [rung(150.0, 0.03, drive, softer=between + step) for step in (-1e-5, 0.0, 1e-5)]
    one, other = ends[1] - ends[0], ends[2] - ends[1]
    assert one == pytest.approx(other, abs=5e-4 * float(np.abs(one).max()))


@pytest.mark.parametrize("ratio", [0.5, 1.4, 2.5])
def test_under_a_constant_force_it_rings_with_the_tangent_stiffness_of_the_nut(ratio: float) -> None:
    """With a mass over preload of 1 kg/N the force per mass is F/P; the nut is half of the compliance."""
    drive = np.zeros(2000)
    drive[3] = 1.0
    free = rung(150.0, 0.02, drive, load=1.0, constant=ratio)[20:400]
    nut = np.cbrt(apparent_preload(ratio, 1.0))
    assert poles(free)[0] == pytest.approx(150 / math.sqrt(0.5 / nut + 0.5), rel=5e-4)


def test_what_pushes_besides_moves_the_table_as_the_drive_does() -> None:
    """Without a load on the nut the answer to a force is the same whether it drives or pushes."""
    drive = np.random.default_rng(1).standard_normal((400, 3))
    band = band_filter(60.0, 400.0, RATE)
    shape = np.array([1 / (2 * math.pi * 150) ** 2, -0.3, 0.1, 0.03, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0])
    place = np.linspace(-0.2, 0.3, 400)
    still = np.zeros(400)
    first, order = np.array([0, 170, 400]), np.array([1, 0])

    def moved(force: np.ndarray, pushes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out, beside = np.empty(400), np.empty(pushes.shape)
        sections = (band.numerator, band.denominator)
        simulate_mode(
            force,
            place,
            still,
            still,
            pushes,
            first,
            order,
            shape,
            SOFTENING,
            *sections,
            1 / RATE,
            out,
            beside,
        )
        return out, beside

    _, beside = moved(still, drive)
    for k in range(3):
        alone, none = moved(np.ascontiguousarray(drive[:, k]), np.empty((400, 0)))
        assert beside[:, k] == pytest.approx(alone, abs=1e-12)
        assert none.shape == (400, 0)


def test_a_push_meets_the_spring_as_the_drive_leaves_it() -> None:
    """Under a load on the nut the drive softens the spring; pushed as it drives, the table answers alike."""
    drive = 8.0 * np.random.default_rng(2).standard_normal(600)
    band = band_filter(60.0, 400.0, RATE)
    still = np.zeros(600)
    answers = []
    for load in (0.0, 0.4):
        shape = np.array([1 / (2 * math.pi * 150) ** 2, 0.0, 0.0, 0.03, load, 0.4, 1.0, 0.0, 0.0, 0.0])
        out, moved = np.empty(600), np.empty((600, 1))
        sections = (band.numerator, band.denominator)
        rest = (np.array([0, 600]), np.array([0]), shape, SOFTENING, *sections, 1 / RATE, out, moved)
        simulate_mode(drive, still, still, still, drive[:, None].copy(), *rest)
        assert moved[:, 0] == pytest.approx(out, abs=1e-9)
        answers.append(moved[:, 0])
    assert np.std(answers[1] - answers[0]) > 0.05 * np.std(answers[0])


@pytest.mark.parametrize("ratio", [0.7, 0.9, 1.0, 1.2])
@pytest.mark.parametrize("coupling", [0.03, 0.25])
def test_with_a_frame_it_rings_at_the_poles_of_two_bodies(ratio: float, coupling: float) -> None:
    """Of the free vibration, as of the matrix of two degrees of freedom; exact but for the step."""
    own, frame, ratios = 2 * math.pi * 170, 2 * math.pi * 170 * ratio, (0.03, 0.05)
    drive = np.zeros(3000)
    drive[3] = 100.0
    free = rung(170.0, ratios[0], drive, frame=(coupling, frame, ratios[1]))[60:400]
    rows = np.stack([free[7 - k : len(free) - 1 - k] for k in range(8)], axis=1)
    found = np.log(np.roots([1.0, *-np.linalg.lstsq(rows, free[8:], rcond=None)[0]]).astype(complex)) * RATE
    spring, rate, mounts = own**2, 2 * ratios[0] * own, (frame**2, 2 * ratios[1] * frame)
    push = [-coupling * spring, -coupling * rate, -mounts[0], -mounts[1]]  # of the frame
    deflection = [push[0] - spring, push[1] - rate, push[2], push[3]]
    expected = np.linalg.eigvals([[0, 1, 0, 0], deflection, [0, 0, 0, 1], push])
    mode = AxialMode(1 / own**2, 0, 0, ratios[0], 0, 1, 0, 300, 0.03)
    mode = replace(mode, frame=170.0 * ratio, frame_damping=ratios[1], coupling=coupling)
    omega, damping = coupled_poles(mode, np.array([170.0]))
    for k, pole in enumerate(sorted(expected[expected.imag > 0], key=abs)):
        near = found[np.argmin(np.abs(found - pole))]
        assert abs(near) == pytest.approx(abs(pole), rel=1e-4 + 4e-3 * coupling)
        assert -near.real / abs(near) == pytest.approx(-pole.real / abs(pole), rel=0.01)
        assert omega[0, k] == pytest.approx(abs(pole), rel=1e-9)
        assert damping[0, k] == pytest.approx(-pole.real / abs(pole), rel=1e-9)


def test_with_more_than_critical_damping_there_are_still_two_poles() -> None:
    mode = replace(AxialMode(1e-6, 0, 0, 0.85, 0, 1, 0, 300, 0.03), frame=150.0, coupling=0.9)
    omega, damping = coupled_poles(mode, np.array([100.0, 150.0, 250.0]))
    assert omega.shape == damping.shape == (3, 2)
    assert (damping <= 1).all()


@pytest.mark.parametrize("frame", [(0.0, 0.0, 0.0), (0.1, 900.0, 0.05)])
@pytest.mark.parametrize("ripples", [0, 3])
def test_windows_of_any_length_are_simulated_as_if_alone(frame: tuple[float, ...], ripples: int) -> None:
    """More of them than are simulated in step, with a load that softens the nut."""
    random = np.random.default_rng(5)
    first = np.cumsum([0, 300, 1, 40, 2000, 7, 300, 41, 90, 5, 640, 12])
    drive, place, local = random.standard_normal((3, first[-1])) * [[3.0], [0.1], [0.02]]
    forces = 0.1 * random.standard_normal((first[-1], ripples))
    parameters = np.array([1 / 1000.0**2, 0.3, -0.2, 0.03, 0.3, 0.5, 0.5, *frame])
    band = band_filter(90.0, 400.0, RATE)

    def simulated(start: int, stop: int, borders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out, to_ripple = np.empty(stop - start), np.empty((stop - start, ripples))
        constant = np.full(stop - start, 0.2)
        simulate_mode(
            drive[start:stop], place[start:stop], local[start:stop], constant, forces[start:stop],
            borders - start, np.argsort(borders[:-1] - borders[1:]), parameters, SOFTENING, band.numerator,
            band.denominator, 1 / RATE, out, to_ripple,
        )  # fmt: skip
        return out, to_ripple

    together = simulated(0, int(first[-1]), first)
    for start, stop in pairwise(first.tolist()):
        alone = simulated(start, stop, np.array([start, stop]))
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[start:stop], part)


def test_a_drive_that_is_no_number_gives_none_and_reads_nothing_beyond_the_tables() -> None:
    drive = np.zeros(50)
    drive[10] = np.nan
    found = rung(150.0, 0.03, drive, load=0.3)
    assert np.isfinite(found[:10]).all()
    assert np.isnan(found[11:]).all()
