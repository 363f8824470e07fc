"""Page that compares two runs cell by cell, or the trends of two axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import shown
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.comparing import cells_document
from ballscrew.service.pages.rendering import render
from ballscrew.service.serving import RefusedError
from ballscrew.service.stored_runs import StoredRun, has_raw_files, locate_run
from ballscrew.store.reading import current_rows
from ballscrew.store.tables import Axis

router = APIRouter(include_in_schema=False)

_MOST_LISTED = 500  # runs of an axis, the newest


@dataclass(frozen=True, slots=True)
class Side:
    """One of two that are compared: an axis, or a run of it.

    Parameters
    ----------
    text : str
        As it was asked for.
    axis : Axis or None
        None where nothing was asked for.
    run : StoredRun or None
        None where an axis was asked for.
    runs : tuple
        Newest rows of the runs of the axis that count, the newest first.
    """

    text: str
    axis: Axis | None = None
    run: StoredRun | None = None
    runs: tuple[Any, ...] = ()


@router.get("/compare")
def show_comparison(
    request: Request,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    a: str = "",
    b: str = "",
) -> HTMLResponse:
    """Two runs by their ids, or two axes by their names, side by side; without both, forms to choose them."""
    cells, sentence, status = None, None, 200
    has_raw = False
    sides = [Side(a), Side(b)]
    with service.store.read() as session:
        axes = session.scalars(select(Axis.name).order_by(Axis.name)).all()
        try:
            sides = [_find_side(session, text.strip()) for text in (a, b)]
            first, second = (side.run for side in sides)
            if first is not None and second is not None:
                cells = cells_document(session, first, second.id)
                has_raw = has_raw_files(session, first)
            elif (first is None) != (second is None) and a and b:
                sentence = "choose two runs, or two axes."
        except RefusedError as error:
            sentence, status = str(error), error.status
    return render(
        request, "compare.html", status, axes=axes, a=sides[0], b=sides[1], cells=cells, sentence=sentence,
        has_raw=has_raw,
    )  # fmt: skip


def _find_side(session: Session, text: str) -> Side:
    if not text:
        return Side(text)
    axis, run = session.scalar(select(Axis).where(Axis.name == text)), None
    if axis is None:
        try:
            run = locate_run(session, text)
        except RefusedError as error:
            if error.status == 404:
                raise RefusedError(404, f"there is no axis and no run {shown(text)}.") from None
            raise
        axis = run.axis
    rows = current_rows(session, axis)[: -_MOST_LISTED - 1 : -1]
    return Side(text, axis, run, tuple(rows))
