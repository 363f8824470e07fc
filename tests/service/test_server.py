"""The server as a process, its page, and requests that nobody thought of."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from sqlalchemy import select
from tests.service.conftest import SETUP, NewService, client_of, send, send_result, sha256, wait_for
from tests.store.stored import RUNS

from ballscrew.base.errors import InputError
from ballscrew.cli.shell import run
from ballscrew.service.app import create_app
from ballscrew.service.server import serve
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token
from ballscrew.store.folder import DataFolder
from ballscrew.store.opened import OpenStore
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit

_EXAMPLES = 450  # requests


@contextmanager
def serving(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """A process that serves, and a client."""
    command = [sys.executable, "-m", "ballscrew", "serve", "--data", str(folder), "--port", "0", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        match = re.search(r"http://127\.0\.0\.1:\d+", line)
        assert match is not None, line
        with httpx.Client(base_url=match[0], timeout=60) as client:
            wait_for(lambda: client.get("/readyz").status_code == 200)
            yield process, client
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@pytest.mark.slow
def test_a_server_from_an_upload_to_its_verdict(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A fresh folder; two recordings; kill -9 of the server between; a graceful end."""
    folder = tmp_path / "data"
    (tmp_path / "server.toml").write_text('method = "paper"\nworkers = 1\n')
    texts = {name: (bench / f"{name}.toml").read_text() for name in ("axis", "plan", "channels")}
    setup = {"machine": "mill", "sheet": texts["axis"], "plan": texts["plan"], "channels": texts["channels"]}
    names = [f"preload-4-percent-trip{number}.h5" for number in (1, 2)]
    contents = {name: (bench / name).read_bytes() for name in names}
    files = [{"name": name, "sha256": sha256(content)} for name, content in contents.items()]
    url = "/api/v1/axes/bench/runs/r1"
    config = ("--config", str(tmp_path / "server.toml"))
    with serving(folder, *config) as (process, client):
        assert client.put("/api/v1/axes/bench", json=setup).status_code == 200
        for content in contents.values():
            assert client.put(f"{url}/files/{sha256(content)}", content=content).status_code == 201
        assert run(["store", "add", str(bench / "axis.toml"), "--store", str(folder)]) == 2
        assert "in use by serve, process" in capsys.readouterr().err
        answer = client.post(f"{url}/complete", json={"files": files})
        assert answer.status_code == 202
        process.kill()
        process.wait()
    with serving(folder, *config) as (process, client):
        identity = answer.json()["id"]
        wait_for(lambda: client.get(f"/api/v1/runs/{identity}").json()["sent"][0]["status"] != "queued")
        found = client.get(f"/api/v1/runs/{identity}").json()
        assert (found["sent"][0]["status"], found["sent"][0]["verdict"]) == (
            "done",
            "suspect",
        )  # a trip is missing
        assert len(found["run"]["cells"]) == 40
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
    assert Store.verify(folder).faults == ()


def test_a_second_server_is_refused(tmp_path: Path, service: Service) -> None:
    with (
        DataFolder(service.store.path).locked("serve", serving=True),
        pytest.raises(InputError, match="the store is in use by serve, process"),
    ):
        serve(service.store.path, port=0)
    with pytest.raises(InputError, match="is no address of this computer"):
        serve(tmp_path / "new", host="192.0.2.1.example", allow_plain_http=True)
    with pytest.raises(InputError, match="cannot be listened on"):
        serve(tmp_path / "new", host="192.0.2.1", allow_plain_http=True)


def test_tokens_are_created_listed_and_revoked_by_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = ["--data", str(tmp_path / "data")]
    assert run(["token", "create", "--admin", *data]) == 0
    text = capsys.readouterr().out.strip()
    assert text.startswith("bs_")
    assert run(["token", "create", *data]) == 2
    assert run(["token", "create", "--machine", "lathe", *data]) == 2
    assert "no machine of the name 'lathe'" in capsys.readouterr().err
    assert run(["token", "revoke", "1", *data]) == 0
    assert run(["token", "revoke", "2", *data]) == 2
    capsys.readouterr()
    assert run(["token", "list", "--json", *data]) == 0
    printed = capsys.readouterr().out
    assert '"revoked_at": "2' in printed
    assert text not in printed


def test_tokens_are_created_and_revoked_by_command_while_a_server_runs(
    new_service: NewService, capsys: pytest.CaptureFixture[str]
) -> None:
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    data = ["--data", str(service.store.path)]
    with DataFolder(service.store.path).locked("serve", serving=True), client_of(service) as client:
        assert run(["token", "create", "--admin", *data]) == 0
        headers = {"Authorization": f"Bearer {capsys.readouterr().out.strip()}"}
        assert client.get("/api/v1/axes", headers=headers).status_code == 200
        assert client.post("/api/v1/tokens", json={"admin": True}, headers=headers).status_code == 201
        assert run(["token", "list", *data]) == 0
        assert run(["token", "revoke", "1", *data]) == 0
        assert client.get("/api/v1/axes", headers=headers).status_code == 401
        with service.store.read() as session:
            assert [row.action for row in session.scalars(select(Audit))][-3:] == ["create"] * 2 + ["revoke"]
    assert not service.store.folder.is_served()
    assert Store.verify(service.store.path).faults == ()


def test_commands_and_a_server_write_tokens_in_turn(service: Service) -> None:
    """None is lost, and each row of the audit follows the one before it."""
    beside = OpenStore(service.store.path)

    def create(number: int) -> int:
        store = (service.store, beside)[number % 2]
        return create_token(store, None, role="admin")[0]

    with DataFolder(service.store.path).locked("serve", serving=True), ThreadPoolExecutor(4) as pool:
        numbers = list(pool.map(create, range(16)))
    assert sorted(numbers) == list(range(1, 17))
    assert Store.verify(service.store.path).faults == ()


def test_metrics_are_text_of_prometheus(client: TestClient) -> None:
    send(client)
    client.get("/api/v1/axes/none")
    text = client.get("/metrics").text
    for line in text.splitlines():
        assert re.fullmatch(r'# (HELP|TYPE) \w+ .+|ballscrew_\w+(\{\w+="[^"]*"\})? [\d.e+]+', line), line
    assert "ballscrew_queue_jobs 1\n" in text
    assert 'ballscrew_sent_runs{status="queued"} 1\n' in text
    assert 'ballscrew_refusals_total{status="404"} 1\n' in text


@pytest.mark.slow
def test_no_request_that_fits_the_schema_is_an_unexpected_error(new_service: NewService) -> None:
    """A few hundred, the same ones; as many others as BALLSCREW_FUZZ states."""
    given_number = os.environ.get("BALLSCREW_FUZZ")
    service = new_service()
    local = {"Host": "localhost"}
    service.stopping.set()  # a stream of events ends at once
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        send_result(client, 0)
    schema = schemathesis.openapi.from_asgi("/openapi.json", create_app(service), headers=local)
    operations = list(schema.get_all_operations())
    statuses: Counter[int] = Counter()
    for result in operations:

        @settings(
            max_examples=max(1, int(given_number or _EXAMPLES) // len(operations)),
            deadline=None,
            derandomize=given_number is None,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=result.ok().as_strategy(), known=st.booleans())
        def answers(case: Any, known: bool) -> None:
            if known and "axis" in (case.path_parameters or {}):
                case.path_parameters["axis"] = "bench"
            if known and "run" in (case.path_parameters or {}):
                case.path_parameters["run"] = RUNS[0].id
            response = case.call(headers=local)
            assert response.status_code < 500 or response.status_code == 503, case.as_curl_command()
            statuses[response.status_code] += 1

        answers()
    print(f"{sum(statuses.values())} requests: {dict(sorted(statuses.items()))}")  # noqa: T201
    assert {200, 404, 422} <= set(statuses)
