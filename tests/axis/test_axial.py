"""The axial model: against the data sheet's formulas, Eq. (3), numbers of the physics page, and itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis import axial
from ballscrew.axis.axial import AxialModel, frequency, from_sheet, gradient
from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError

MODEL = AxialModel(0.2, 1.6e-8, 1.4, 0.0, 32.4, 185.0, 0.22, 600.0)

models = st.builds(
    AxialModel,
    centre=st.just(0.2),
    compliance=st.floats(5e-9, 5e-8),
    slope=st.floats(0.0, 1.5),
    curve=st.floats(-1.0, 0.0),
    mass=st.floats(5, 500),
    rotor=st.one_of(st.floats(20, 2000), st.just(math.inf)),
    share=st.floats(0.05, 0.6),
    preload=st.floats(50, 5000),
)


@pytest.mark.parametrize("support", ["fixed-free", "fixed-supported", "fixed-fixed"])
@pytest.mark.parametrize("rotor", ["free", "held"])
@pytest.mark.parametrize("name", ["S", "M", "L"])
def test_is_the_data_sheets_formula(axes: dict[str, DataSheet], name: str, rotor: str, support: str) -> None:
    sheet = replace(axes[name], support=support)
    model = from_sheet(sheet, 0.17)
    x = np.linspace(0.0, 0.4, 5)
    for ratio in (1.0, 0.25):
        by_model = frequency(model, x, 40.0, ratio, rotor)  # type: ignore[arg-type]
        wanted = axial_natural_frequency(
            sheet,
            x,
            40.0,
            ratio * sheet.nominal_preload,
            rotor,
            torsion=True,  # type: ignore[arg-type]
        )
        np.testing.assert_allclose(by_model, wanted, rtol=1e-12)


@given(model=models, x=st.floats(0, 0.4), load=st.floats(0, 200), ratio=st.floats(0.05, 3))
def test_the_ratio_comes_back(model: AxialModel, x: float, load: float, ratio: float) -> None:
    whole = 1 / (model.mass + load) + 1 / model.rotor
    whole /= model.compliance * (2 * math.pi * frequency(model, x, load, ratio)) ** 2
    rest = 1 + model.slope * (x - model.centre) + model.curve * (x - model.centre) ** 2 - model.share
    assert ((whole - rest) / model.share) ** -3 == pytest.approx(ratio, rel=1e-6)


@given(model=models, x=st.floats(0, 0.4), load=st.floats(0, 200), ratio=st.floats(0.05, 3))
def test_the_gradient_is_the_derivative(model: AxialModel, x: float, load: float, ratio: float) -> None:
    vector, step = axial.to_vector(model), 1e-5
    found = gradient(model, x, load, ratio)
    for k in range(7):
        if not math.isfinite(vector[k]):
            assert found[k] == 0
            continue
        there, back = (
            axial.from_vector(np.where(np.arange(7) == k, vector + s, vector), 0.2) for s in (step, -step)
        )
        numeric = np.log(frequency(there, x, load, ratio) / frequency(back, x, load, ratio)) / (2 * step)
        assert found[k] == pytest.approx(float(numeric), abs=1e-6)
    up, down = (
        frequency(model, x, load, ratio * math.exp(step)),
        frequency(model, x, load, ratio * math.exp(-step)),
    )
    assert found[7] == pytest.approx(float(np.log(up / down)) / (2 * step), abs=1e-6)


def test_at_one_preload_theta_has_rank_3_and_a_free_rotor_takes_the_fourth() -> None:
    x, load = (part.ravel() for part in np.meshgrid([0.0, 0.2, 0.4], [0.0, 50.0, 100.0]))
    free = [0, 1, 3, 5, 6]
    for model, names, rank in ((replace(MODEL, rotor=math.inf), free, 3), (MODEL, [*free, 4], 4)):
        slopes = gradient(model, x, load)[:, names]
        assert np.linalg.matrix_rank(slopes, tol=1e-9) == rank
    worn = gradient(replace(MODEL, rotor=math.inf), x, load, 0.25)[:, free]
    both = np.vstack([gradient(replace(MODEL, rotor=math.inf), x, load)[:, free], worn])
    assert np.linalg.matrix_rank(both, tol=1e-9) == 4  # a known ratio: the share, but never newtons


@pytest.mark.parametrize(
    ("field", "value"),
    [("compliance", 0.0), ("compliance", math.nan), ("mass", -1.0), ("rotor", 0.0), ("rotor", math.nan),
     ("share", 1.0), ("share", 0.0), ("preload", math.inf), ("slope", math.nan), ("centre", math.inf)],
)  # fmt: skip
def test_what_cannot_be_is_refused(field: str, value: float) -> None:
    with pytest.raises(InputError, match=field):
        replace(MODEL, **{field: value})


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_points_that_are_no_numbers_are_refused(bad: float) -> None:
    for arguments in ((bad, 0.0, 1.0), (0.0, bad, 1.0), (0.0, 0.0, bad)):
        with pytest.raises(InputError):
            frequency(MODEL, *arguments)
    with pytest.raises(InputError):
        frequency(MODEL, 0.0, -1.0)
    with pytest.raises(InputError):
        frequency(MODEL, -3.0, 0.0)  # off the screw: no compliance left
    with pytest.raises(InputError, match="rotor"):
        frequency(MODEL, 0.0, 0.0, 1.0, "loose")  # type: ignore[arg-type]


def test_a_vector_has_seven_numbers() -> None:
    with pytest.raises(InputError, match="7"):
        axial.from_vector([1.0, 2.0], 0.2)
    with pytest.raises(InputError):
        axial.from_vector([1e4, 0, 0, 0, 0, 0, 0], 0.2)


def test_a_centre_off_the_screw_is_refused(axes: dict[str, DataSheet]) -> None:
    with pytest.raises(InputError, match="centre"):
        from_sheet(axes["S"], 3.0)
