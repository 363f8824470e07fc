"""The application: all routes of the service."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import FastAPI

from ballscrew._version import __version__
from ballscrew.service import alarms, axes, health, reading, runs, tokens, uploads
from ballscrew.service.access import Guard
from ballscrew.service.pages import fleet, rendering, status
from ballscrew.service.serving import Service, answer_errors
from ballscrew.service.working import Worker


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
    for resource in (uploads, runs, axes, reading, alarms, tokens, health):
        app.include_router(resource.router)
    if service.settings.on_loopback:
        for page in (fleet.router, rendering.router, status.router):
            app.include_router(page)
    answer_errors(app)
    app.add_middleware(Guard, service=service)
    return app
