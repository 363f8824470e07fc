from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.frequency import axial_natural_frequency, theta
from ballscrew.axis.relative import frequency_change, preload_change
from ballscrew.base.errors import InputError


def nut_share(sheet, x, preload):
    t = theta(sheet)
    nut = preload ** (-1 / 3)
    return nut / (nut - t.a * x - t.b)


@given(ratio=st.floats(1e-3, 10), share=st.floats(0.05, 1))
def test_there_and_back(ratio, share):
    f = 150.0 * frequency_change(ratio, share)
    back = float(preload_change(f, 150.0, share))
    assert back == pytest.approx(ratio, rel=1e-12)


@pytest.mark.parametrize("rotor", ["held", "free"])
@given(x=st.floats(0, 0.45), load=st.floats(0, 200), ratio=st.floats(0.01, 2))
def test_it_is_equation_3_exactly(axes, rotor, x, load, ratio):
    sheet = axes["M"]
    start = sheet.nominal_preload
    f0, f = axial_natural_frequency(sheet, x, load, np.array([1.0, ratio]) * start, rotor)
    share = nut_share(sheet, x, start)
    assert float(preload_change(f, f0, share)) == pytest.approx(ratio, rel=1e-12)
    assert f0 * float(frequency_change(ratio, share)) == pytest.approx(f, rel=1e-12)


def test_the_m_axis_from_new_to_a_quarter(axes):
    share = nut_share(axes["M"], 0.0, 680.0)
    assert share == pytest.approx(0.344, abs=5e-4)
    assert float(preload_change(137.14, 150.37, share)) == pytest.approx(0.25, abs=2e-4)


def test_an_error_of_the_share_scales_the_loss_and_keeps_its_sign():
    for f in (145.0, 155.0):
        seen = preload_change(f, 150.0, np.array([0.25, 0.34, 0.45])) - 1
        assert np.all(np.sign(seen) == np.sign(f - 150.0))
        assert np.all(np.diff(np.abs(seen)) < 0)


def test_above_an_infinitely_stiff_nut_there_is_no_preload():
    limit = 150.0 / np.sqrt(1 - 0.34)
    assert float(preload_change(0.99 * limit, 150.0, 0.34)) > 1
    for f in (limit * (1 + 1e-9), 2 * limit):
        with pytest.raises(
            InputError, match=r"it must be below 184\.6372\d+ Hz, which this axis has with an inf"
        ):
            preload_change([150.0, f], 150.0, 0.34)


def test_a_nut_that_is_all_there_is_has_no_limit():
    assert float(preload_change(300.0, 150.0, 1.0)) == pytest.approx(2.0**6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: preload_change(0.0, 150.0, 0.3), "a frequency of 0 was given"),
        (lambda: preload_change(150.0, np.nan, 0.3), "a reference frequency of nan was given"),
        (lambda: preload_change(150.0, 150.0, 0.0), "a nut's share of the compliance of 0 was given"),
        (lambda: preload_change(150.0, 150.0, 1.1), "of 1.1 was given; it must be more than 0, 1 at most"),
        (lambda: frequency_change(0.0, 0.3), "a preload over its reference of 0 was given"),
        (lambda: frequency_change([1.0, np.inf], 0.3), "a preload over its reference of inf was given"),
    ],
)
def test_impossible_values(call, message):
    with pytest.raises(InputError, match=message):
        call()
