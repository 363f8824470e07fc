"""The application: all routes of the service."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

from fastapi import FastAPI

from ballscrew._version import __version__
from ballscrew.service import (
    alarms,
    axes,
    calibrating,
    comparing,
    curves,
    health,
    message_log,
    reading,
    records,
    responses,
    runs,
    signals,
    tokens,
    uploads,
)
from ballscrew.service.calibrating import Calibrator
from ballscrew.service.guard import Guard
from ballscrew.service.logs import RequestLog
from ballscrew.service.on_demand import OnDemand
from ballscrew.service.pages import (
    account,
    actions,
    alarm_list,
    axis,
    calibration_page,
    compare,
    fleet,
    help_topics,
    message_page,
    record_pages,
    rendering,
    run,
    setup,
    sign_in,
    status,
    users,
)
from ballscrew.service.serving import Service, answer_errors
from ballscrew.service.signing_in import Throttle
from ballscrew.service.working import Worker

_RESOURCES = (
    uploads, runs, axes, calibrating, curves, reading, comparing, signals, responses, alarms, records, tokens,
    message_log, health,
)  # fmt: skip
_PAGES = (
    fleet, run, compare, alarm_list, record_pages, actions, setup, calibration_page, help_topics, status,
    message_page, rendering, sign_in, account, users, axis,
)  # fmt: skip
# The page of an axis comes last: the name of an axis may contain slashes.


def create_app(service: Service, workers: Sequence[Worker] = ()) -> FastAPI:
    """Application of a service.

    Parameters
    ----------
    service : Service
        The service.
    workers : sequence of Worker
        Its workers.

    Returns
    -------
    FastAPI
        For uvicorn.
    """
    app = FastAPI(
        title="ballscrew",
        version=__version__,
        summary="Early detection of preload loss in ball screws",
        docs_url=None,
        redoc_url=None,
    )
    app.state.service = service
    app.state.workers = workers
    app.state.receiving = set()
    app.state.calibrator = Calibrator(service)
    app.state.signals, app.state.responses = OnDemand(service, "signals"), OnDemand(service, "responses")
    app.state.throttle = Throttle()
    modules: tuple[ModuleType, ...] = _RESOURCES + _PAGES
    for module in modules:
        app.include_router(module.router)
    answer_errors(app)
    help_topics.answer_browsers(app)
    app.add_middleware(Guard, service=service)
    app.add_middleware(RequestLog)
    return app
