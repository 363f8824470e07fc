"""Answers about the cells of a run, and how they have changed since another run."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Literal

from fastapi import APIRouter
from fastapi.responses import Response
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.result import csv_text
from ballscrew.estimation.frequency_change import frequency_changes
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import Run
from ballscrew.report.canvas import CONDITION_COLOURS
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.serving import RefusedError
from ballscrew.service.stored_runs import StoredRun, locate_run, neighbours, result_document
from ballscrew.store.tables import RunRow

router = APIRouter(prefix="/api/v1/runs/{run}")

_LEAST = 1e-12  # Hz, of a standard uncertainty that is divided by


@router.get("/cells")
def show_cells(
    run: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    against: str = "baseline",
    format: Literal["json", "csv"] = "json",  # noqa: A002
) -> Any:
    """Cells of a run, and their changes since another run; as CSV the table of ``analyze --export`` alone.

    ``against`` is ``baseline``, the run that the states of its epoch are relative to, ``previous``, or the id
    of a run, of any axis.
    """
    with service.store.read() as session:
        found = locate_run(session, run)
        if format == "json":
            return cells_document(session, found, against)
        if found.row is None:
            raise RefusedError(404, "the run has no result.")
        table = run_of(session, found).to_dataframe()
    return Response(csv_text(table), media_type="text/csv")


def cells_document(session: Session, found: StoredRun, against: str = "baseline") -> dict[str, Any]:
    """Cells of a run by position, condition and motion, and their changes since another run.

    Parameters
    ----------
    session : Session
        Reading.
    found : StoredRun
        The run.
    against : str
        ``baseline``, ``previous``, or the id of a run; where a run is its own baseline, the previous one.

    Returns
    -------
    dict
        ``against`` is None without another run; ``moved_most`` is the number of the cell with the largest
        relative change among those whose 95 % intervals exclude 0, or else among all.

    Raises
    ------
    RefusedError
        404 if the run has no result, or there is no such other run.
    """
    if found.row is None:
        raise RefusedError(404, "the run has no result.")
    run = run_of(session, found)
    other, kind = _other_run(session, found, against)
    document: dict[str, Any] = {
        "schema": SCHEMA, "axis": found.axis.name, **head_of(found.row), "against": None, "reason": None,
        "moved_most": None, "colours": CONDITION_COLOURS,
    }  # fmt: skip
    cells = [_cell_document(number, cell) for number, cell in enumerate(run.cells)]
    if other is not None and other.row is not None:
        document["against"] = {"axis": other.axis.name, "kind": kind, **head_of(other.row)}
        try:
            _add_changes(cells, run, run_of(session, other))
        except InputError as error:
            document["reason"] = str(error)
        document["moved_most"] = _moved_most(cells)
    document["cells"] = cells
    result: dict[str, Any] = plain(document)
    return result


def head_of(row: RunRow) -> dict[str, Any]:
    """Id, time, load and temperature of a run."""
    names = ("run", "measured_at", "mass_kg", "temperature_C")
    return {name: getattr(row, name) for name in names}


def run_of(session: Session, found: StoredRun) -> Run:
    """Result of a run that has one."""
    assert found.row is not None  # noqa: S101
    return Run.from_json(result_document(session, found.axis, found.row), f"run {found.row.run[:12]}")


def _other_run(session: Session, found: StoredRun, against: str) -> tuple[StoredRun | None, str]:
    """Run to compare with, and what it is to the run: baseline, previous or other."""
    if against not in ("baseline", "previous"):
        other = locate_run(session, against)
        if other.row is None:
            raise RefusedError(404, "the run to compare with has no result.")
        return other, "other"
    near = neighbours(session, found)
    if against == "baseline" and near["baseline"] not in (None, found.id):
        return locate_run(session, str(near["baseline"])), "baseline"
    if near["previous"] is None:
        return None, "previous"
    return locate_run(session, near["previous"]), "previous"


def _cell_document(number: int, cell: CellResult) -> dict[str, Any]:
    names = (
        "position_m", "condition", "motion", "repetitions", "frequency_Hz", "standard_uncertainty_Hz",
        "verdict", "reasons", "coherence", "band_Hz", "damping_ratio",
    )  # fmt: skip
    values = asdict(cell)
    change = dict.fromkeys(
        ("other_frequency_Hz", "other_uncertainty_Hz", "change_Hz", "change_uncertainty_Hz")
    )
    return {"cell": number, **{name: values[name] for name in names}, **change, "differs": None}


def _add_changes(cells: list[dict[str, Any]], run: Run, other: Run) -> None:
    """Add the frequency in the other run, and the change since then, to cells that both runs have."""
    changes = frequency_changes(run, other)
    others = {(round(cell.position_m, 6), cell.condition, cell.motion): cell for cell in other.cells}
    for document, cell in zip(cells, run.cells, strict=True):
        same = others.get((round(cell.position_m, 6), cell.condition, cell.motion))
        if same is not None:
            document["other_frequency_Hz"] = same.frequency_Hz
            document["other_uncertainty_Hz"] = same.standard_uncertainty_Hz
        change = changes.get(cell.key)
        if change is not None:
            document["change_Hz"] = change.value
            document["change_uncertainty_Hz"] = change.standard_uncertainty
            document["differs"] = abs(change.value) > NORMAL_95 * max(change.standard_uncertainty, _LEAST)


def _moved_most(cells: list[dict[str, Any]]) -> int | None:
    """Number of the cell whose frequency has changed most, see :func:`cells_document`."""
    changed = [cell for cell in cells if cell["change_Hz"] is not None]
    certain = [cell for cell in changed if cell["differs"]]
    if not changed:
        return None
    moved = max(certain or changed, key=lambda cell: abs(cell["change_Hz"]) / cell["other_frequency_Hz"])
    return int(moved["cell"])
