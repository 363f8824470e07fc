"""Page of the calibration of an axis: choose runs, wait, and read what the data determine."""

from __future__ import annotations

import math
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.base.jsonfile import write_json
from ballscrew.base.provenance import digest
from ballscrew.calibration.calibrated_axis import UNITS, CalibratedAxis
from ballscrew.calibration.modelfile import model_from_json
from ballscrew.service.access import AdminCaller, RunningService, ViewerCaller
from ballscrew.service.axes import add_axis_model
from ballscrew.service.calibrating import (
    MOST_RUNS,
    CalibrationRequest,
    Calibrator,
    RunningCalibrator,
    start_calibration,
)
from ballscrew.service.pages.forms import Outcome, PostedForm, entered, go_to, refusal
from ballscrew.service.pages.rendering import (
    address_of,
    format_moment,
    language_of,
    render,
    significant,
)
from ballscrew.service.reading import axis_document
from ballscrew.service.serving import RefusedError, Service

router = APIRouter(include_in_schema=False)

_LISTED = 100  # runs of the beginning and of the end of a history
_ID = 12  # characters of an id in sentences
_LABELS = {"runs": "The choice of runs", "known_preloads": "The known preloads"}
_SCALES = {"compliance": (1e9, "µm/kN")}  # of a parameter for people, with its unit


@router.get("/axes/{axis}/calibration")
def show_page(
    request: Request,
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    calibrator: RunningCalibrator,
) -> HTMLResponse:
    """Runs to choose from, and the newest calibration of the axis."""
    return _page(request, axis, service, calibrator, Outcome())


@router.post("/axes/{axis}/calibration")
def post_calibration(
    request: Request,
    axis: str,
    form: PostedForm,
    caller: AdminCaller,
    service: RunningService,
    calibrator: RunningCalibrator,
) -> Response:
    """Begin a calibration, or use the model of the newest one."""
    try:
        if form.get("do") == "use":
            found = calibrator.document(axis)
            if found is None or found["model"] is None:
                raise InputError("there is no calibration to use; calibrate the axis first.")
            if digest(found["model"]) != form.get("model"):
                raise InputError("another calibration has ended since this page was loaded; read it first.")
            add_axis_model(axis, found["model"], caller, service, use=True)
            return go_to(address_of(axis, "calibration"), "use")
        runs = form.getlist("run")
        known = {}
        for run in runs:
            if form.get(f"known {run}", "").strip():
                known[run] = form[f"known {run}"]
        body = entered(CalibrationRequest, _LABELS, runs=runs, known_preloads=known)
        start_calibration(axis, body, caller, service, calibrator)
    except BallscrewError as error:
        return _page(request, axis, service, calibrator, refusal("calibration", error, form))
    return go_to(address_of(axis, "calibration"), "start")


@router.get("/axes/{axis}/calibration/model")
def download_model(
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    calibrator: RunningCalibrator,
) -> Response:
    """MODEL.json of the newest calibration."""
    found = calibrator.document(axis)
    if found is None or found["model"] is None:
        raise RefusedError(404, "there is no calibration of this axis since the server was started.")
    headers = {"Content-Disposition": 'attachment; filename="MODEL.json"'}
    return Response(write_json(found["model"]), media_type="application/json", headers=headers)


def _page(
    request: Request, axis: str, service: Service, calibrator: Calibrator, outcome: Outcome
) -> HTMLResponse:
    document = axis_document(service, axis)
    runs = [run for run in document["runs"] if run["counts"] and run["quality"] is not None]
    listed = runs
    if len(runs) > 2 * _LISTED:
        listed = runs[:_LISTED] + runs[-_LISTED:]
    found = calibrator.document(axis)
    report, shown_digest = None, ""
    if found is not None and found["model"] is not None:
        times = {run["run"]: run["measured_at"] for run in document["runs"] if run["measured_at"]}
        model = model_from_json(found["model"], "MODEL.json")
        report = report_of(model, times, language_of(request))
        shown_digest = digest(found["model"])
    chosen: set[str] = set()
    if hasattr(outcome.values, "getlist"):
        chosen = set(outcome.values.getlist("run"))
    return render(
        request,
        "calibration.html",
        outcome.status,
        axis=document["axis"],
        missing=document["missing"],
        runs=listed,
        total=len(runs),
        most=MOST_RUNS,
        chosen=chosen,
        found=found,
        digest=shown_digest,
        report=report,
        outcome=outcome,
        done=request.query_params.get("done", ""),
    )


def report_of(model: CalibratedAxis, times: dict[str, str], language: str) -> dict[str, Any]:
    """What a calibration found, in numbers and sentences of a page.

    Parameters
    ----------
    model : CalibratedAxis
        The model.
    times : dict of str to str
        Time of each run by its id.
    language : str
        Of the numbers.

    Returns
    -------
    dict
        ``preload`` and its ``spread``, ``doubts``, ``notes``, ``runs``, ``parameters``, ``determined``,
        ``offers``, ``anchors`` and ``forms``.
    """
    preload = model.quantity("preload")
    named = {run: format_moment(time, language) for run, time in times.items()}
    offers: list[dict[str, Any]] = []
    determined: list[str] = []
    for item in model.knowledge:
        if item["kind"] == "offer":
            offers.append(dict(item))
        else:
            determined.append(_named(str(item["sentence"]), named))
    return {
        "model": model,
        "preload": preload.value,
        "spread": 2 * preload.standard_uncertainty,
        "doubts": [_named(doubt.text, named) for doubt in model.reasons],
        "notes": [_named(text, named) for text in model.notes],
        "runs": [_run_row(run, times) for run in model.runs],
        "parameters": _parameters(model, language),
        "determined": determined,
        "offers": offers,
    }


def _named(text: str, times: dict[str, str]) -> str:
    """Text with runs named by their times."""
    for run, time in times.items():
        text = text.replace(run[:_ID], time)
    return text


def _run_row(run: Any, times: dict[str, str]) -> dict[str, Any]:
    ratio = math.exp(run.log_ratio)
    return {
        "id": run.id,
        "measured_at": times.get(run.id),
        "load": run.load,
        "cells": run.cells,
        "ratio": ratio,
        "ratio_uncertainty": ratio * run.log_ratio_uncertainty,
        "is_reference": run.group == 0,
        "level": 100 * run.level,
        "weight": 100 * run.weight,
        "outliers": run.outliers,
    }


def _parameters(model: CalibratedAxis, language: str) -> list[tuple[str, str, str, str, str]]:
    """Name, unit, value, standard uncertainty, and that by the data sheet alone, of each parameter."""
    after, before = model.covariance.diagonal() ** 0.5, model.prior_covariance.diagonal() ** 0.5
    rows = []
    for index, name in enumerate(PARAMETERS):
        value = float(getattr(model.model, name))
        if before[index] > 0 and math.isfinite(value):
            factor, unit = _SCALES.get(name, (1.0, UNITS[name]))
            scale = factor * model.working_scale(name)
            spreads = [significant(float(part[index]) * scale, 2, language) for part in (after, before)]
            rows.append((name, unit, significant(value * factor, 4, language), *spreads))
    return rows  # type: ignore[return-value]  # two spreads
