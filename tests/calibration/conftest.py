"""A known axis, a sheet that is about right, and runs at five loads of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.tables import Errors, table

from ballscrew.axis.axial import AxialModel, frequency, from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.modal.run import Run

STOPS = (0.0, 0.1, 0.2, 0.3, 0.4)
LOADS = (0.0, 25.0, 50.0, 75.0, 100.0)


@pytest.fixture(scope="session")
def sheet() -> DataSheet:
    return DataSheet(
        name="bench",
        support="fixed-free",
        screw=Screw(0.010, 0.0176, 0.0176, 0.65, 0.08, 15e3, 480e6, 0.1, 0.04),
        bearing=Bearing(160e6),
        table=Table(32.0),
        drive=Drive(4.2e-4, coupling_stiffness=4000.0),
        guide=Guide(25.0),
    )


@pytest.fixture(scope="session")
def truth(sheet: DataSheet) -> AxialModel:
    """An axis of the model's own form, one sigma off the sheet here and there."""
    mean, spread = prior(sheet, 0.2)
    half = np.linalg.cholesky(spread[np.ix_([0, 1, 3, 4, 5, 6], [0, 1, 3, 4, 5, 6])])
    moved = mean.copy()
    moved[[0, 1, 3, 4, 5, 6]] += half @ np.array([0.8, -0.5, 0.7, -0.6, 0.4, 1.0])
    return from_vector(moved, 0.2)


Runs = Callable[..., list[Run]]


@pytest.fixture(scope="session")
def experiment(truth: AxialModel) -> Runs:
    """Runs of the axis at five loads: ``experiment(seed, errors=…, ratio=…, measured_at=…)``."""

    def make(
        seed: int = 0,
        *,
        model: AxialModel | None = None,
        errors: Errors | None = Errors(),  # noqa: B008  frozen
        ratio: float = 1.0,
        measured_at: str | None = None,
        loads: tuple[float, ...] = LOADS,
        bias: tuple[float, float] = (0.0, 0.0),
    ) -> list[Run]:
        axis = model or truth
        return [
            table(
                lambda x, load=load: float(frequency(axis, x, load, ratio)),  # type: ignore[misc]
                STOPS, load, 1000 * seed + i, errors=errors, measured_at=measured_at, bias=bias,
                name=f"{seed:04d}{i:02d}{round(1000 * ratio):06d}" + "0" * 52,
            )
            for i, load in enumerate(loads)
        ]  # fmt: skip

    return make


@pytest.fixture(scope="session")
def heavier(experiment: Runs) -> Runs:
    """The same with one run's declared load wrong."""

    def make(seed: int = 0, which: int = 2, by: float = -5.0) -> list[Run]:
        runs = experiment(seed)
        runs[which] = replace(runs[which], mass_kg=(runs[which].mass_kg or 0.0) + by)
        return runs

    return make
