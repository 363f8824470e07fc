"""The columns against plain arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from ballscrew.modal.joint.blocks import orthonormaliser
from ballscrew.modal.joint.columns import differences, fill_columns, pitching_response

RATE = 3200.0


@pytest.mark.parametrize("nut", [True, False])
def test_answers_stand_beside_their_slopes(nut: bool) -> None:
    random = np.random.default_rng(1)
    answers, beside, moved = (random.standard_normal(shape) for shape in ((2, 30), (30, 3), (30, 4)))
    columns = np.empty((30, (6 if nut else 3) + 7))
    stop = random.standard_normal(30)
    pitching = answers[1] if nut else np.empty(0)
    fill_columns(answers[0], pitching, beside, moved, stop, np.array([0, 30]), columns)
    once = np.gradient(answers, axis=1)
    own = [answers[0], once[0], *((np.gradient(once[0]), answers[1], once[1]) if nut else ())]
    own.append(stop * answers[0])
    np.testing.assert_allclose(columns, np.column_stack([*own, beside, moved]), atol=1e-14)


def test_derivatives_end_at_the_border_of_a_window() -> None:
    values = np.random.default_rng(4).standard_normal(13)
    pieces = values[:7], values[7:8], values[8:10], values[10:]
    expected = [np.gradient(piece) if len(piece) > 1 else np.zeros(1) for piece in pieces]
    found = differences(values, np.array([0, 7, 8, 10, 13]))
    np.testing.assert_allclose(found, np.concatenate(expected), rtol=1e-15)


def test_columns_become_orthonormal_and_alike_ones_count_once() -> None:
    columns = np.random.default_rng(2).standard_normal((40, 4)) * [1, 1e6, 1e-6, 1]
    columns[:, 3] = columns[:, 0]
    ways = orthonormaliser(columns.T @ columns, 1e-8)
    basis = columns @ ways
    assert ways.shape == (4, 3)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(basis @ (basis.T @ columns), columns, rtol=1e-6, atol=1e-12)


def test_the_pitching_mode_is_a_second_order_system_in_each_window() -> None:
    """Bilinear transform of w² / (s² + 2 ζ w s + w²), warped so that the resonance stays in place."""
    angular, damping = 2 * math.pi * 300, 0.03
    acceleration = np.random.default_rng(3).standard_normal(500)
    out = np.empty(500)
    pitching_response(acceleration, np.array([0, 180, 500]), angular, damping, 1 / RATE, out)
    warped = angular / (2 * RATE * math.tan(angular / RATE / 2))
    b, a = bilinear([1.0], [1 / angular**2, 2 * damping / angular, 1.0], fs=RATE * warped)
    for start, stop in ((0, 180), (180, 500)):
        expected = lfilter(b, a, acceleration[start:stop])
        np.testing.assert_allclose(out[start:stop], expected, rtol=1e-9, atol=1e-12)
