"""A run whose raw files can be read, and the computation of results in this process."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np
import pytest
import xarray as xr
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import SETUP, send, work_off
from tests.store.stored import RUNS

from ballscrew.base.provenance import FileRef
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.run import Run
from ballscrew.service import on_demand
from ballscrew.service.serving import Service
from ballscrew.store.service_tables import Upload

HOSTILE = "<img src=x onerror=alert(1)>'\".npz"
RATE, COUNT = 1000.0, 40_000
FREQUENCY = np.linspace(10.0, 300.0, 291)
CHANNELS = """sample_rate = "1 kHz"
[[channel]]
source = "a"
quantity = "torque"
unit = "mN m"
[[channel]]
source = "<b>'"
quantity = "position"
unit = "mm"
location = "<b>'"
"""
RUN_TOML = f"""channels = "c.toml"
load = "100 kg"
measured_at = 2026-01-01T08:00:00Z
files = ["trip.npz", '''{HOSTILE}''']
"""


def npz(seed: int) -> bytes:
    """A file of two channels; a spike at 20 s."""
    torque = np.random.default_rng(seed).normal(size=COUNT)
    torque[20_000] = 500.0
    stream = BytesIO()
    np.savez(stream, **{"a": torque, "<b>'": np.linspace(0, 100, COUNT)})
    return stream.getvalue()


def send_raw(client: TestClient) -> str:
    """Send a run of two files, whose names and channels are hostile; the id of its content."""
    files = {"trip.npz": npz(0), HOSTILE: npz(1)}
    assert client.put("/api/v1/axes/bench", json=SETUP | {"channels": CHANNELS}).status_code == 200
    answer = send(client, files=files, run_toml=RUN_TOML)
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def analyse(service: Service, run: str) -> None:
    """Give the run of :func:`send_raw` a result with a transient of its first cell in each of its files."""
    with service.store.read() as session:
        upload = session.scalars(select(Upload).where(Upload.content == run)).one()
        files = tuple(FileRef(file["name"], file["sha256"]) for file in upload.files or ())
    cell = RUNS[0].cells[0]
    rows = tuple(
        TransientRow(file, 2.0 + file, 2.1 + file, cell.position_m, cell.condition, cell.motion, repetition)
        for file, repetition in ((0, 0), (1, 1))
    )
    result = replace(RUNS[0], files=files, transients=rows, measured_at="2026-01-01T08:00:00+00:00")
    work_off(service, lambda _: ("done", (result.to_json(), ["npz, ballscrew 0.1.0"] * 2)))


def compute_here(patched: pytest.MonkeyPatch) -> list[Any]:
    """Compute results in this process; the tasks."""
    tasks: list[Any] = []

    def ask(self: on_demand.OnDemand, task: Any, target: Any) -> on_demand.TaskFailure | None:  # noqa: ARG001
        tasks.append(task)
        return on_demand.compute(task, target)

    patched.setattr(on_demand.OnDemand, "_start_process", lambda self: None)  # noqa: ARG005
    patched.setattr(on_demand.OnDemand, "_ask", ask)
    return tasks


def table(run: Run, coherence: float) -> xr.Dataset:
    """FRF of the cells of a run, whose magnitude is the number of the cell."""
    cells, shape = len(run.cells), (len(run.cells), 1, len(FREQUENCY))
    numbers = np.broadcast_to(np.arange(cells)[:, None, None], shape)
    per = "cell"
    return xr.Dataset(
        {
            "H1": ((per, "response", "frequency"), numbers * 1j),
            "coherence": ((per, "response", "frequency"), np.full(shape, coherence)),
        },
        {
            "frequency": FREQUENCY,
            "response": ["acceleration:<b>:x"],
            "position_m": (per, [cell.position_m for cell in run.cells]),
            "condition": (per, [cell.condition for cell in run.cells]),
            "motion": (per, [cell.motion for cell in run.cells]),
        },
        {"input_unit": "N m"},
    )


def analyse_at_once(patched: pytest.MonkeyPatch) -> None:
    """Let the analysis for an FRF give :func:`table` of the first run, in no time."""

    def analyse(*given: Any, method: str) -> tuple[Run, list[str]]:  # noqa: ARG001
        return replace(RUNS[0], frequency_response=table(RUNS[0], 0.8)), []

    patched.setattr("ballscrew.store.analysing.analyse_files", analyse)
