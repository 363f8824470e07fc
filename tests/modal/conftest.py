"""Cells of a known plant, cut by the package itself."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import xarray as xr
from tests.modal.plant import Plant, Way, trip, way

from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Plan
from ballscrew.modal.cell import CellKey, CellResult
from ballscrew.modal.paper.cell import identify
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.spectra import Spectra
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.transients import cut, label

RATE = 5000
STOPS = (0.0, 0.06, 0.12)


def table_of(
    plant: Plant,
    *,
    move: Way | None = None,
    trips: int = 3,
    seed: int = 0,
    responses: int = 1,
    plan: Plan | None = None,
    top: float | None = None,
) -> xr.Dataset:
    """The table *Transients* of several round trips."""
    move = move or way(trip(STOPS), RATE)
    segments = []
    for file in range(trips):
        aligned = plant.run(move, 100 * seed + file, responses=responses)
        phases = find_phases(kinematics(aligned.position, aligned.rate))
        segments += cut(aligned, phases, file, top)
    return label(segments, aligned, 100.0, plan)


def cell_of(table: xr.Dataset, condition: Condition | str, place: float = 0.06) -> xr.Dataset:
    """The rows of one cell."""
    here = (abs(table["position_m"].values - place) < 0.01) & (table["condition"].values == str(condition))
    return table.isel(transient=here & table["complete"].values)


def estimate(
    rows: xr.Dataset,
    condition: Condition | str,
    expected: float | None,
    slope: float = 0.0,
    settings: PaperSettings | None = None,
) -> tuple[CellResult, Spectra | None]:
    """Result of one cell by the paper's method, and its spectra."""
    key = CellKey(0.06, str(condition), 0)
    return identify(rows, key, expected, slope, settings or PaperSettings())


@pytest.fixture(scope="session")
def quiet_table() -> xr.Dataset:
    """Three trips of the plain plant without a servo."""
    return table_of(Plant(servo=0.5))


@pytest.fixture
def cell(quiet_table: xr.Dataset) -> Callable[..., xr.Dataset]:
    """One cell of the plain plant: ``cell("PA")``."""
    return lambda condition, place=0.06: cell_of(quiet_table, condition, place)
