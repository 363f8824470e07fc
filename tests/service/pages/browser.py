"""A small plant that is served on loopback, and a browser whose complaints are recorded."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
import uvicorn
from playwright.sync_api import (
    Browser,
    ConsoleMessage,
    Dialog,
    Page,
    Request,
    Response,
    expect,
    sync_playwright,
)
from tests.service.conftest import SETUP, client_of, send, work_off
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS

from ballscrew.base.provenance import FileRef, digest
from ballscrew.calibration.modelfile import model_json
from ballscrew.service.app import create_app
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.adding import add_run
from ballscrew.store.migrating import create_store

_PATIENCE = 60_000  # ms: a shared machine can be slow
expect.set_options(timeout=_PATIENCE)

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
HOSTILE = "<img src=x onerror=alert(1)>"
MARKUP = "\"><script>alert(2)</script>{{ 7 * 7 }}' onmouseover='alert(3)"
LISTENER = """addEventListener("securitypolicyviolation", (event) =>
  console.error(`policy: ${event.violatedDirective} ${event.blockedURI} ${event.sourceFile}`));"""
CHARTS_ARE_DRAWN = """() => [...document.querySelectorAll("[data-chart]")].every(
  (each) => each.dataset.drawn === "done")"""


def find_chromium() -> str | None:
    """Path of Debian's Chromium, or of another; None without one."""
    for name in PROGRAMS:
        if (path := shutil.which(name)) is not None:
            return path
    return None


def make_plant(folder: Path) -> Service:
    """Store of an axis with an alarm, of one with hostile names, and of one that is only set up."""
    store = create_store(folder / "store")
    service = Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))
    service.partial.mkdir()
    with client_of(service) as client:
        for name, others in {
            "bench": {},
            HOSTILE: {"machine": MARKUP, "site": HOSTILE},
            "Y axis": {"machine": "mill 5", "schedule": {"period_s": 86400.0, "grace_s": 0.0}},
        }.items():
            sheet = AXIS.replace('"bench"', json.dumps(name))
            answer = client.put(
                f"/api/v1/axes/{quote(name, safe='')}", json={**SETUP, **others, "sheet": sheet}
            )
            assert answer.status_code == 200, answer.text
        for run in RUNS[:-1]:
            add_run(service.store, run)
        files = tuple(FileRef(file.name, digest(file.sha256)) for file in RUNS[0].files)
        add_run(service.store, replace(RUNS[0], axis=HOSTILE, id="hostile", files=files))
        event = [{"at": RUNS[0].measured_at, "kind": "note", "text": MARKUP}]
        for name in ("bench", HOSTILE):
            answer = client.post(f"/api/v1/axes/{quote(name, safe='')}/events", json=event)
            assert answer.status_code == 200, answer.text
        assert client.put("/api/v1/axes/bench/model", json=model_json(MODEL)).status_code == 200
        work_off(service, lambda _: pytest.fail("no analysis"))
        assert send(client, f"/api/v1/axes/bench/runs/{quote(HOSTILE, safe='')}").status_code == 202
        work_off(service, lambda _: ("refused", f"a.h5: has no channel {MARKUP}."))
    return service


@contextmanager
def serving(service: Service) -> Iterator[str]:
    """Address of a server of a service, as long as the block lasts."""
    config = uvicorn.Config(create_app(service), port=0, log_level="error", timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        service.stopping.set()
        server.should_exit = True
        thread.join()


@contextmanager
def chromium(program: str) -> Iterator[Browser]:
    """A browser that fetches nothing by itself."""
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=program, args=arguments)
        try:
            yield browser
        finally:
            browser.close()


class Window:
    """A window of a browser; ``problems`` lists what no page may do.

    Each error or warning of the console, violation of the policy, exception, dialog, failed answer and
    request to another host is one.
    """

    def __init__(self, browser: Browser, address: str, **options: Any) -> None:
        self.address = address
        self.problems: list[str] = []
        self.expected: set[int] = set()
        self.context = browser.new_context(base_url=address, **options)
        self.context.add_init_script(LISTENER)
        self.page: Page = self.context.new_page()
        self.page.set_default_timeout(_PATIENCE)
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.problems.append(f"exception: {error}"))
        self.page.on("dialog", self._dialog)
        self.page.on("request", self._request)
        self.page.on("response", self._response)

    def _console(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning") and "Failed to load resource" not in message.text:
            self.problems.append(f"console: {message.text}")

    def _dialog(self, dialog: Dialog) -> None:
        self.problems.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    def _request(self, request: Request) -> None:
        if not request.url.startswith((f"{self.address}/", "data:", f"blob:{self.address}/")):
            self.problems.append(f"request: {request.url}")

    def _response(self, response: Response) -> None:
        if response.status >= 400 and response.status not in self.expected:
            self.problems.append(f"{response.status}: {response.url}")

    def open(self, path: str) -> Page:
        """Open a page, and wait until its charts are drawn."""
        self.page.goto(path)
        self.page.wait_for_function(CHARTS_ARE_DRAWN)
        assert self.page.locator("[data-chart].message").all_inner_texts() == []
        assert self.page.locator("[data-chart]:empty").count() == 0
        return self.page

    def close(self) -> None:
        self.context.close()
