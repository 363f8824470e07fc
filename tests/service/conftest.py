"""Services without a process: a store, an application, and a client that calls it."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from argon2 import PasswordHasher
from fastapi.testclient import TestClient
from tests.simulated_bench import AXIS, PLAN
from tests.store.stored import RUNS

from ballscrew.base.jsonfile import write_json
from ballscrew.base.provenance import FileRef
from ballscrew.service import passwords
from ballscrew.service.app import create_app
from ballscrew.service.jobs import ASSESS, lease_job
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.working import do_task, finish, task_of
from ballscrew.store.migrating import create_store

CHANNELS = '[[channel]]\nsource = "a"\nquantity = "torque"\nunit = "N m"\n'
RUN_TOML = """channels = "c.toml"
load = "100 kg"
measured_at = 2026-01-01T08:00:00Z
files = ["a.h5", "b.h5"]
"""
SETUP = {"machine": "mill 4", "site": "hall 2", "sheet": AXIS, "plan": PLAN, "channels": CHANNELS}
RUN = "/api/v1/axes/bench/runs/r1"
FILES = {"a.h5": b"trip 1 " * 1000, "b.h5": b"trip 2 " * 1000}

NewService = Callable[..., Service]
_NUMBERS = count()


@pytest.fixture(autouse=True, scope="session")
def cheap_hashes() -> Iterator[None]:
    """Hashes of passwords that cost a millisecond."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(passwords, "hasher", PasswordHasher(time_cost=1, memory_cost=8, parallelism=1))
        yield


@pytest.fixture(scope="module", autouse=True)
def _few_members(few_members: None) -> None:
    """The service does the same with the forecast of any number of members."""


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty store, to be copied."""
    return create_store(tmp_path_factory.mktemp("service") / "store").path


@pytest.fixture(scope="session")
def set_up_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with an axis that is set up, to be copied."""
    path = create_store(tmp_path_factory.mktemp("service") / "store").path
    with client_of(Service(ServedStore(path), ServerSettings(min_free_bytes=0))) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
    return path


@pytest.fixture
def new_service(tmp_path: Path, empty_store: Path) -> NewService:
    """Makes services with the given settings."""

    def make(store: Path = empty_store, **settings: Any) -> Service:
        folder = tmp_path / f"store{next(_NUMBERS)}"
        shutil.copytree(store, folder)
        service = Service(ServedStore(folder), ServerSettings(**({"min_free_bytes": 0} | settings)))
        service.partial.mkdir()
        return service

    return make


@pytest.fixture
def service(new_service: NewService, set_up_store: Path) -> Service:
    """A service on loopback, with an axis that is set up."""
    return new_service(set_up_store)


@pytest.fixture
def client(service: Service) -> Iterator[TestClient]:
    """Client of :func:`service`."""
    with client_of(service) as client:
        yield client


@pytest.fixture(scope="session")
def worn_store(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Path:
    """A store with an axis that is worn, assessed and in alarm, to be copied."""
    from tests.service.pages.forms import fill_axis

    folder = tmp_path_factory.mktemp("worn") / "store"
    shutil.copytree(empty_store, folder)
    service = Service(ServedStore(folder), ServerSettings(min_free_bytes=0))
    service.partial.mkdir()
    with client_of(service) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
        fill_axis(client, service)
    return folder


@pytest.fixture
def worn_service(tmp_path: Path, worn_store: Path) -> Service:
    """A service of an axis that is in alarm."""
    shutil.copytree(worn_store, tmp_path / "worn")
    return Service(ServedStore(tmp_path / "worn"), ServerSettings(min_free_bytes=0))


@pytest.fixture
def worn(worn_service: Service) -> Iterator[TestClient]:
    """Its client."""
    with client_of(worn_service) as found:
        yield found


def client_of(service: Service, **options: Any) -> TestClient:
    """A client on this computer."""
    return TestClient(create_app(service), base_url="http://localhost", **options)


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def put(client: TestClient, content: bytes, run: str = RUN, **headers: str) -> Any:
    """Send a file."""
    return client.put(f"{run}/files/{sha256(content)}", content=content, headers=headers)


def body(files: dict[str, bytes] = FILES, **others: Any) -> dict[str, Any]:
    """What ``complete`` takes."""
    named = [{"name": name, "sha256": sha256(content)} for name, content in files.items()]
    return {"files": named, "run_toml": RUN_TOML, "run_json": None, "measured_at": None} | others


def send(client: TestClient, run: str = RUN, files: dict[str, bytes] = FILES, **others: Any) -> Any:
    """Send files and complete the run."""
    for content in files.values():
        assert put(client, content, run).status_code in (200, 201)
    return client.post(f"{run}/complete", json=body(files, **others))


def send_result(client: TestClient, number: int, key: str | None = None, **changes: Any) -> Any:
    """Send a run that was analysed at the machine."""
    content = write_json(replace(RUNS[number], **changes).to_json()).encode()
    run = f"/api/v1/axes/bench/runs/{key or f'analysed-{number}'}"
    assert put(client, content, run).status_code in (200, 201)
    return client.post(f"{run}/complete", json={"files": [], "run_json": sha256(content)})


def other_files(letter: str) -> tuple[FileRef, ...]:
    """Recordings that no other run has."""
    return (FileRef("trip1.h5", 64 * letter),)


def work_off(service: Service, outcome: Callable[[Any], tuple[str, Any]]) -> int:
    """Analyse by a function instead of workers, and assess, until no job is due; the number of jobs."""
    done = 0
    while (lease := lease_job(service)) is not None:
        if lease.kind == ASSESS:
            finish(service, lease, *do_task(task_of(service, lease)))
        else:
            finish(service, lease, *outcome(lease))
        done += 1
    return done


def wait_for(condition: Callable[[], object]) -> None:
    """Wait until a condition is true, for minutes: a shared machine can be slow."""
    for _ in range(6000):
        if condition():
            return
        time.sleep(0.1)
    pytest.fail("nothing happens")


def events_of(text: str) -> list[dict[str, Any]]:
    """Documents of server-sent events."""
    return [json.loads(line[6:]) for line in text.splitlines() if line.startswith("data: ")]
