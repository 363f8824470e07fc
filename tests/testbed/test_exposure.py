from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Duty, Stroke, jitter, phases, production
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.exposure import exposure, uniform_exposure

EDGES = np.linspace(0, 0.45, 46)
DUTY = Duty(
    production([0.0, 0.2, 0.45], 0.2, 2.0, 500.0, {40.0: 1.0}) + jitter([0.3], 0.02, 0.1, 2.0, 4e4, 40.0)
)


def test_a_plain_histogram_counts_every_pass():
    duty = Duty((Stroke(0.1, 0.205, 0.2, 2.0, 7.0),))
    seen = exposure(duty, AXIS, [0.0, 0.1, 0.15, 0.2, 0.3], nut_length=0.0)
    np.testing.assert_allclose(seen.travel, [0, 0.35, 0.35, 0.035], atol=1e-12)
    friction, inertia = AXIS.guide.friction, 2.0 * AXIS.table.mass
    first = (0.01 * (inertia + friction) + 0.04 * friction) / 0.05
    np.testing.assert_allclose(seen.nut_load[:2], [0, first])
    assert seen.nut_load[3] == pytest.approx(inertia - friction)


@given(nut=st.floats(0.001, 0.2), place=st.floats(-0.5, 0.5), stroke=st.floats(1e-3, 0.3))
def test_no_travel_is_lost_on_a_grid_that_holds_it(nut, place, stroke):
    duty = Duty(jitter([place], stroke, 0.1, 2.0, 100.0))
    seen = exposure(duty, AXIS, np.linspace(-1, 1, 101), nut)
    assert seen.travel.sum() == pytest.approx(duty.travel_per_day, rel=1e-6)
    assert seen.travel.min() >= 0
    assert (seen.travel * seen.x).sum() / seen.travel.sum() == pytest.approx(place, abs=0.01)
    assert seen.mean_nut_load == pytest.approx(
        (seen.travel * seen.nut_load).sum() / seen.travel.sum(), rel=1e-6
    )


def test_it_is_what_sampling_finds():
    nut, marks = 0.06, np.linspace(-0.2, 0.7, 91)
    fine = np.linspace(-0.3, 0.8, 11_001)
    box = np.ones(601) / 601
    passes = np.zeros_like(fine)
    for phase in phases(DUTY, AXIS):
        passes += phase.per_day * ((fine > phase.low) & (fine < phase.high))
    spread = np.convolve(np.convolve(passes, box, "same"), box, "same")
    sampled = np.histogram(fine, marks, weights=spread * 1e-4)[0]
    np.testing.assert_allclose(exposure(DUTY, AXIS, marks, nut).travel, sampled, rtol=0.03, atol=0.5)


def test_jittering_is_local():
    seen = exposure(DUTY, AXIS, EDGES)
    assert seen.x[np.argmax(seen.density)] == pytest.approx(0.3, abs=0.006)
    assert seen.density.max() > 3 * np.median(seen.density)
    assert seen.travel_per_day == DUTY.travel_per_day


def test_an_even_duty():
    seen = uniform_exposure(EDGES, 200.0, 30.0)
    np.testing.assert_allclose(seen.density, 1)
    np.testing.assert_allclose(seen.nut_load, 30)
    assert seen.travel.sum() == pytest.approx(200)
    assert len(seen.x) == 45


@pytest.mark.parametrize(
    "edges", [[0.0], [], [0.1, 0.1], [0.2, 0.1], [[0, 1], [2, 3]], [0, float("nan")], "x"]
)
def test_grids_that_cannot_be(edges):
    for make in (lambda: exposure(DUTY, AXIS, edges), lambda: uniform_exposure(edges, 1.0)):
        with pytest.raises(InputError):
            make()


def test_numbers_that_cannot_be():
    with pytest.raises(InputError, match="length of the nut"):
        exposure(DUTY, AXIS, EDGES, -0.1)
    with pytest.raises(InputError, match="travel per day"):
        uniform_exposure(EDGES, 0.0)
