from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun, inertia_of

from ballscrew.modal.joint.blocks import make_block
from ballscrew.modal.joint.fit import JointFit, fit_blocks, with_local_parameters
from ballscrew.modal.joint.local_wear import (
    _SIGNIFICANT,
    _SPREADS,
    LocalVariation,
    _inflation,
    _log_likelihood,
    _smooth_basis,
    local_fields,
    local_priors,
    with_stops,
)
from ballscrew.modal.joint.mode import AxialMode, compliance_of, mode_frequency
from ballscrew.modal.joint.simulation import LOAD_STEP, SOFTENING
from ballscrew.modal.joint.windows import average_windows

PLACES = (-0.2, -0.1, 0.05, 0.2)


def test_the_inflation_is_the_scatter_of_cells_about_means_of_stops_and_conditions() -> None:
    """Of two stops in two conditions one degree of freedom remains, in which all four deviate alike."""
    cells = [SimpleNamespace(position=x, condition=c, motion=0) for x in (0.1, 0.3) for c in ("PA", "NA")]
    windows = SimpleNamespace(cells=cells, middle=0.2)
    steps = 3.0 * np.array([1, -1, -1, 1]) + np.array([5, 5, 7, 7]) + np.array([0, 2, 0, 2])
    fit = SimpleNamespace(
        blocks=[SimpleNamespace(windows=windows, rows=[slice(k, k + 1) for k in range(4)])],
        modes=[SimpleNamespace(stops=(-0.1, 0.1))],
        jacobian=[np.array([[9.0, 1, 0], [9, 1, 0], [9, 0, 1], [9, 0, 1]])],
        residual=[steps],
    )
    inflation, freedom = _inflation(cast(JointFit, fit), np.array([1, 2]))
    assert freedom == 1
    assert inflation == pytest.approx(4 * 3.0**2)


def test_the_smooth_course_is_a_line_or_a_parabola() -> None:
    places = np.array(PLACES)
    for curved, power in ((False, 1), (True, 2)):
        basis = _smooth_basis(PLACES, curved)
        assert basis.T @ basis == pytest.approx(np.eye(power + 1), abs=1e-12)
        assert basis @ (basis.T @ places**power) == pytest.approx(places**power)


def test_priors_of_local_compliances_are_0_within_the_spread_without_a_smooth_profile() -> None:
    found = local_priors(LocalVariation(0.02, 5.0), PLACES, curved=False)
    single = [p for p in found if len(p.fields) == 1]
    course = [p for p in found if len(p.fields) > 1]
    assert [p.fields[0][0] for p in single] == [f"local:{k}" for k in range(4)]
    assert all(p.deviation == pytest.approx(0.02) for p in single)
    assert len(course) == 2
    assert all(p.deviation < 0.001 for p in course)


def test_a_part_lowers_the_frequency_where_it_is() -> None:
    even = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)
    bent = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03, PLACES, (0.0, 0.1, 0.0, 0.0))
    ratio = mode_frequency(bent, np.array(PLACES)) / mode_frequency(even, np.array(PLACES))
    assert ratio[[0, 2, 3]] == pytest.approx(1.0)
    assert ratio[1] == pytest.approx(np.sqrt(0.9 / 1.0), rel=1e-3)


def test_the_nut_gives_as_two_flanks_do() -> None:
    load = np.arange(len(SOFTENING)) * LOAD_STEP
    # Small loads: 1 + (F/P)²/216. One flank lets go at u = 1, F/P = 2^1.5, where 3 u = 3.
    assert np.interp(0.5, load, SOFTENING) == pytest.approx(0.25 / 216, rel=0.01)
    assert np.interp(2**1.5, load, SOFTENING) == pytest.approx(3 / 2**1.5 - 1, rel=2e-3)
    assert SOFTENING.max() == pytest.approx(6 / 3**1.5 - 1, rel=1e-3)


def test_local_parameters_are_added_as_by_a_fit_without_steps(run: SmallRun) -> None:
    mass = inertia_of(run.trips)
    w = average_windows(run.trips, run.transients, mass, 90.0, 450.0)
    assert w is not None
    middle = float(np.mean(list(run.free.values())))
    shape = AxialMode(compliance_of(middle), 0.3, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)
    blocks = [make_block(name, w) for name in ("torque-nut", "motor-nut")]
    fields = ("compliance", "damping", "slope")
    ended = fit_blocks(blocks, [shape, shape], fields, most_steps=4)
    places = tuple(sorted({cell.position - w.middle for cell in w.cells}))
    wide = with_stops(ended.modes, places)
    found = with_local_parameters(ended, wide, local_fields(places))
    other = fit_blocks(blocks, wide, fields + local_fields(places), most_steps=0)
    order = [found.parameters.index(key) for key in other.parameters]
    for one, two in zip(found.jacobian, other.jacobian, strict=True):
        np.testing.assert_allclose(one[:, order], two, rtol=1e-6, atol=1e-6 * np.abs(two).max())
    np.testing.assert_allclose(found.hessian[np.ix_(order, order)], other.hessian, rtol=1e-6)


def test_few_cells_rarely_show_a_variation_by_chance() -> None:
    random, freedom, inflation, draws = np.random.default_rng(1), 4, 100.0, 1000
    values = np.array([1e6, 3e6])
    found = 0
    for _ in range(draws):
        scores = random.standard_normal(2) * np.sqrt(inflation * values)
        estimate = inflation * random.chisquare(freedom) / freedom
        likelihood = _log_likelihood(scores, values, estimate, freedom)
        found += likelihood.max() > likelihood[0] + _SIGNIFICANT
    assert found <= 15  # 4.5 expected; 50 where the scatter is taken as known


def test_the_likelihood_of_a_well_known_scatter_is_that_of_a_normal_distribution() -> None:
    scores, values, inflation = np.array([2e4, -4e4]), np.array([1e6, 3e6]), 100.0
    variance = values**2 * _SPREADS[:, None] ** 2 + inflation * values
    normal = -0.5 * np.sum(np.log(variance) + scores**2 / variance, axis=1)
    assert _log_likelihood(scores, values, inflation, 10**6) == pytest.approx(normal, abs=0.02)
