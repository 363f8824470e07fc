from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.output_error.lines import cell_lines


def test_noise_keeps_its_size():
    noise = 3.0 * np.random.default_rng(0).standard_normal((40, 2000))
    lines = cell_lines(noise, noise, 1000.0, (50.0, 400.0))
    assert lines.response.shape == (1, 40, len(lines.omega))
    assert lines.force.real.std() == pytest.approx(3.0, rel=0.02)
    assert lines.force.imag.std() == pytest.approx(3.0, rel=0.02)
    assert lines.omega[0] / (2 * np.pi) >= 50.0 - 1e-9
    assert lines.omega[-1] / (2 * np.pi) <= 400.0 + 1e-9


def test_a_large_offset_and_float32_change_nothing():
    records = np.random.default_rng(1).standard_normal((3, 1000))
    plain = cell_lines(records, records, 1000.0, (50.0, 400.0))
    other = cell_lines((records + 100).astype(np.float32), records, 1000.0, (50.0, 400.0))
    np.testing.assert_allclose(other.force, plain.force, atol=1e-3)


@pytest.mark.parametrize(
    ("force", "response", "rate", "band", "words"),
    [
        (np.zeros((3, 100)), np.zeros((1, 4, 100)), 1e3, (50, 400), "must be"),
        (np.zeros(100), np.zeros(100), 1e3, (50, 400), "must be"),
        (np.zeros((0, 100)), np.zeros((1, 0, 100)), 1e3, (50, 400), "must be"),
        (np.full((3, 100), np.nan), np.zeros((1, 3, 100)), 1e3, (50, 400), "not finite"),
        (np.ones((3, 100)), np.full((1, 3, 100), np.inf), 1e3, (50, 400), "not finite"),
        (np.zeros((3, 100)), np.zeros((1, 3, 100)), 1e3, (400, 50), "must rise"),
        (np.zeros((3, 100)), np.zeros((1, 3, 100)), np.nan, (50, 400), "must rise"),
        (np.zeros((3, 100)), np.zeros((1, 3, 100)), 1e3, (50, 600), "must end at 450 Hz"),
        (np.zeros((3, 10)), np.zeros((1, 3, 10)), 1e3, (50, 400), "at least 8"),
    ],
)
def test_what_is_no_record_is_refused_in_a_sentence(force, response, rate, band, words):
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match=words):
        cell_lines(force, response, rate, band)
