"""Fisher information: own and shared errors, what is known before, and what a plan adds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, gradient
from ballscrew.axis.information import (
    d_information,
    fisher_information,
    gained_bits,
    posterior,
)
from ballscrew.base.errors import InputError

MODEL = AxialModel(0.2, 3e-8, 0.8, 0.0, 40.0, 120.0, 0.25, 600.0)


def random_case(seed: int, n: int = 12, p: int = 4, k: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, p)), rng.uniform(0.1, 2, n), rng.normal(size=(k, n))


@given(st.integers(0, 2**32 - 1))
def test_it_is_the_information_of_the_full_covariance(seed):
    jacobian, own, shared = random_case(seed)
    whole = np.diag(own**2) + shared.T @ shared
    expected = jacobian.T @ np.linalg.solve(whole, jacobian)
    np.testing.assert_allclose(fisher_information(jacobian, own, shared), expected, rtol=1e-8, atol=1e-10)


def test_what_cells_share_is_not_averaged_out():
    one = np.ones((10_000, 1))
    level = np.full((1, 10_000), 0.5)
    assert fisher_information(one, np.ones(10_000))[0, 0] == pytest.approx(10_000)
    assert fisher_information(one, np.ones(10_000), level)[0, 0] == pytest.approx(1 / (0.25 + 1e-4))


def test_a_shared_cause_never_adds_information():
    jacobian, own, shared = random_case(3)
    lost = fisher_information(jacobian, own) - fisher_information(jacobian, own, shared)
    assert np.linalg.eigvalsh(lost).min() > -1e-9


def grid(stops: int = 5, loads: tuple[float, ...] = (0.0, 20.0, 50.0)) -> tuple[np.ndarray, np.ndarray]:
    x, m = np.meshgrid(np.linspace(0, 0.45, stops), loads)
    return x.ravel(), m.ravel()


def mode_information(x: np.ndarray, load: np.ndarray, rotor: str = "free") -> np.ndarray:
    """Information of cells with an error of 0.1 Hz each about the working vector and the log ratio."""
    own = 0.1 / frequency(MODEL, x, load, 1.0, rotor)
    return fisher_information(gradient(MODEL, x, load, 1.0, rotor), own)


def rank(information: np.ndarray) -> int:
    size = np.sqrt(np.where(np.diag(information) > 0, np.diag(information), 1.0))
    return int(np.linalg.matrix_rank(information / np.outer(size, size), tol=1e-9, hermitian=True))


def test_at_one_preload_three_numbers_are_known_and_neither_share_nor_newtons():
    x, load = grid()
    fisher = mode_information(x, load, "held")[:-1, :-1]
    keep = [PARAMETERS.index(name) for name in ("compliance", "slope", "mass")]
    silent = [PARAMETERS.index(name) for name in ("rotor", "share", "preload")]
    assert rank(fisher[np.ix_(keep, keep)]) == 3
    assert not fisher[silent].any()


def test_two_loads_leave_a_free_rotor_open_and_three_do_not():
    keep = [PARAMETERS.index(name) for name in ("compliance", "slope", "mass", "rotor")]
    for loads, expected in (((0.0, 50.0), 3), ((0.0, 20.0, 50.0), 4)):
        x, load = grid(loads=loads)
        fisher = mode_information(x, load)
        assert rank(fisher[np.ix_(keep, keep)]) == expected


@given(st.integers(0, 2**32 - 1))
def test_the_posterior_is_the_textbooks(seed):
    jacobian, own, shared = random_case(seed)
    root = np.random.default_rng(seed).normal(size=(4, 4)) + 3 * np.eye(4)
    before, fisher = root @ root.T, fisher_information(jacobian, own, shared)
    np.testing.assert_allclose(
        posterior(before, fisher), np.linalg.inv(np.linalg.inv(before) + fisher), rtol=1e-6, atol=1e-9
    )


def test_known_parameters_stay_known_and_undetermined_ones_stay_open():
    before = np.diag([1.0, 0.0, 4.0])
    fisher = np.array([[3.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(posterior(before, fisher), np.diag([0.25, 0.0, 4.0]), atol=1e-12)


def test_one_bit_halves_one_standard_deviation():
    assert gained_bits(np.diag([2.0, 5.0]), np.diag([3 / 2.0, 0.0])) == pytest.approx(1.0)
    assert gained_bits(np.eye(2), np.zeros((2, 2))) == pytest.approx(0.0, abs=1e-12)


def test_a_fit_scatters_as_the_information_predicts():
    jacobian, own, shared = random_case(5, n=40, p=3)
    fisher = fisher_information(jacobian, own, shared)
    whole = np.diag(own**2) + shared.T @ shared
    rng = np.random.default_rng(6)
    noise = own * rng.normal(size=(4000, 40)) + rng.normal(size=(4000, 3)) @ shared
    fitted = np.linalg.solve(fisher, jacobian.T @ np.linalg.solve(whole, noise.T))
    squares = np.einsum("in,ij,jn->n", fitted, fisher, fitted)  # chi-squared with three degrees of freedom
    assert squares.mean() == pytest.approx(3, abs=0.2)


def test_d_information_counts_measurements():
    jacobian, own, shared = random_case(7)
    fisher, open_ = fisher_information(jacobian, own, shared), np.zeros(4)
    once = d_information(fisher, (0, 1, 2, 3), open_)
    assert d_information(5 * fisher, (0, 1, 2, 3), open_) == pytest.approx(5 * once)
    assert once == pytest.approx(np.linalg.det(fisher) ** 0.25)


def test_d_information_of_some_is_what_the_others_leave():
    jacobian, own, shared = random_case(8)
    fisher = fisher_information(jacobian, own, shared)
    left = np.linalg.inv(np.linalg.inv(fisher)[:2, :2])
    assert d_information(fisher, (0, 1), np.zeros(4)) == pytest.approx(np.linalg.det(left) ** 0.5)
    known = np.array([0, 0, np.inf, np.inf])
    assert d_information(fisher, (0, 1), known) == pytest.approx(np.linalg.det(fisher[:2, :2]) ** 0.5)


def test_d_information_is_zero_where_a_wanted_number_is_open():
    assert d_information(np.diag([1.0, 0.0]), (0, 1), np.zeros(2)) == 0.0
    assert d_information(np.ones((2, 2)), (0, 1), np.zeros(2)) == 0.0


@pytest.mark.parametrize(
    ("jacobian", "own", "shared", "message"),
    [
        (np.ones((3, 2)), np.ones(2), None, "must be"),
        (np.ones(3), np.ones(3), None, "must be"),
        (np.ones((3, 2)), np.ones(3), np.ones((1, 2)), "shared errors of shape"),
        (np.ones((3, 2)), np.array([1.0, 0.0, 1.0]), None, "more than 0"),
        (np.full((3, 2), np.nan), np.ones(3), None, "finite"),
        (np.ones((3, 2)), np.ones(3), np.full((1, 3), np.inf), "finite"),
    ],
)
def test_bad_input_is_refused(jacobian, own, shared, message):
    with pytest.raises(InputError, match=message):
        fisher_information(jacobian, own, shared)


@pytest.mark.parametrize("covariance", [np.ones((2, 3)), np.diag([1.0, -1.0]), np.full((2, 2), np.nan)])
def test_no_covariance_is_refused(covariance):
    with pytest.raises(InputError, match="covariance"):
        posterior(covariance, np.eye(2))
