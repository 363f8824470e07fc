"""The server as a process, its page, and requests that nobody thought of."""

from __future__ import annotations

import json
import logging
import os
import re
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from sqlalchemy import delete, select
from tests.service.bad_worker import give_result
from tests.service.conftest import SETUP, NewService, client_of, send, send_result, sha256, wait_for
from tests.store.stored import MODEL, RUNS

from ballscrew.base.errors import InputError
from ballscrew.calibration.modelfile import model_json
from ballscrew.cli.shell import run
from ballscrew.service import server
from ballscrew.service.app import create_app
from ballscrew.service.jobs import lease_job
from ballscrew.service.server import GracefulServer, delete_by_policy, serve
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token
from ballscrew.service.users import ADDRESS_FILE
from ballscrew.store.folder import DataFolder
from ballscrew.store.opened import OpenStore
from ballscrew.store.retention import RetentionPolicy
from ballscrew.store.service_tables import JobRow
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit, Axis

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


class Served:
    """A server in a thread of this process."""

    def __init__(self, folder: Path, patched: pytest.MonkeyPatch, **options: Any) -> None:
        self.servers: list[GracefulServer] = []
        patched.setattr(server, "GracefulServer", self._make)
        patched.setattr(server, "Worker", partial(server.Worker, target=give_result))
        given = {"port": 0, "workers": 1, "min_free_bytes": 0} | options
        self.thread = threading.Thread(target=serve, args=(folder,), kwargs=given, daemon=True)

    def _make(self, *given: Any) -> GracefulServer:
        self.servers.append(GracefulServer(*given))
        return self.servers[-1]

    def end(self) -> None:
        """As after a signal."""
        self.servers[0].handle_exit(signal.SIGTERM, None)
        self.thread.join(600)
        assert not self.thread.is_alive()


@contextmanager
def served(folder: Path, patched: pytest.MonkeyPatch, **options: Any) -> Iterator[Served]:
    """A server in this process, which ends."""
    found = Served(folder, patched, **options)
    found.thread.start()
    try:
        wait_for(lambda: not found.thread.is_alive() or (found.servers and found.servers[0].started))
        yield found
    finally:
        if found.servers:
            found.end()


def test_a_server_goes_on_where_one_that_was_killed_ended(
    service: Service, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The run that it analysed is analysed, and its temporary files and the part of a copy are gone."""
    folder = service.store.path
    (folder / "result.json").write_text(json.dumps([RUNS[0].to_json(), []]))
    with client_of(service) as client:
        send(client)
    assert lease_job(service) is not None
    remains = [service.scratch / "7" / "x", service.store.folder.files / ".incoming-x"]
    for path in remains:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    with served(folder, monkeypatch) as found:
        (address,) = re.findall(r"at (http://127\.0\.0\.1:\d+)\n", capsys.readouterr().out)
        with httpx.Client(base_url=address, timeout=60) as client:
            wait_for(lambda: client.get(f"/api/v1/runs/{RUNS[0].id}").status_code == 200)
            assert client.get("/readyz").json()["ready"]
        assert (folder / ADDRESS_FILE).read_text(encoding="utf-8") == address
        assert DataFolder(folder).is_served()
        found.end()
        assert found.servers[0].service.stopping.is_set()
        assert not found.servers[0].force_exit
    assert not any(path.exists() for path in remains)
    assert not DataFolder(folder).is_served()


def test_an_axis_that_was_changed_before_the_server_ended_is_assessed_after_the_start(
    client: TestClient, service: Service
) -> None:
    send_result(client, 0)
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    found = []
    for changed_at in (None, "2026-03-01T00:00:00+00:00"):
        with service.store.write("test") as session:
            session.execute(delete(JobRow))
            session.scalars(select(Axis)).one().changed_at = changed_at
        server._recover(service)
        found.append([job["kind"] for job in client.get("/api/v1/jobs").json()["jobs"]])
    assert found == [[], ["assess"]]


def test_a_server_on_another_address_prints_the_link_of_the_first_administrator(
    service: Service, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with served(service.store.path, monkeypatch, host="0.0.0.0", allow_plain_http=True):  # noqa: S104
        text = capsys.readouterr().out
        (port,) = re.findall(r"at http://0\.0\.0\.0:(\d+)\n", text)
        (link,) = re.findall(rf"administrator signs in, once, .*, at http://\S+:{port}(/link/\S+)", text)
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60) as client:
            assert client.get("/api/v1/axes").status_code == 401
            assert client.get(link, headers={"Accept": "text/html"}).status_code == 200


def test_a_quiet_server_prints_no_address(
    service: Service, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with served(service.store.path, monkeypatch, quiet=True) as found:
        found.end()
    assert capsys.readouterr().out == ""


def test_a_second_interrupt_does_not_wait_for_requests(service: Service) -> None:
    found = GracefulServer(server._uvicorn_config(service, []), service)
    found.handle_exit(signal.SIGINT, None)
    assert (found.should_exit, found.force_exit, service.stopping.is_set()) == (True, False, True)
    found.handle_exit(signal.SIGTERM, None)
    assert not found.force_exit
    found.handle_exit(signal.SIGINT, None)
    assert found.force_exit


def test_settings_that_are_wrong_together_make_no_store(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a loopback address: give certificate"):
        serve(tmp_path / "new", host="0.0.0.0")  # noqa: S104
    assert not (tmp_path / "new").exists()


def test_regular_tasks_go_on_after_an_error_and_unused_files_are_removed_once_an_hour(
    new_service: NewService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    service = new_service(retention_days=30.0, retention_newest=3)
    done: list[object] = []

    def watch(service: Service) -> None:
        done.append("watch")
        if len(done) == 1:
            raise ValueError("unknown")
        if done.count("watch") == 3:
            service.stopping.set()

    monkeypatch.setattr(server, "_PERIOD", 0.0)
    monkeypatch.setattr(server, "watch_for_silence", watch)
    monkeypatch.setattr(server, "remove_unused", lambda _: done.append("remove"))
    monkeypatch.setattr(server, "delete_by_policy", lambda _, policy: done.append(policy))
    with caplog.at_level(logging.ERROR, "ballscrew.service"):
        server._run_regularly(service)
    assert done == ["watch", "watch", "remove", RetentionPolicy(30.0, 3), "watch"]
    assert [record.getMessage() for record in caplog.records] == ["regular tasks"]


@pytest.mark.parametrize(
    ("files", "lines", "changes"), [([2, 1], ["3 raw files deleted by policy, 30 bytes"], 1), ([], [], 0)]
)
def test_the_log_says_how_many_raw_files_were_deleted_by_policy(
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    files: list[int],
    lines: list[str],
    changes: int,
) -> None:
    """Those who look at a page then see it; nothing is said of a day without any."""
    document = {"axes": [{"files": number * ["x"]} for number in files], "bytes": 10 * sum(files)}
    asked: list[object] = []
    monkeypatch.setattr(server, "retain", lambda *given: asked.append(given) or document)
    policy = RetentionPolicy(days=30.0, newest=0)
    with caplog.at_level(logging.INFO, "ballscrew.service"):
        delete_by_policy(service, policy)
    assert asked == [(service.store, policy)]
    assert [record.getMessage() for record in caplog.records] == lines
    assert service.changes == changes


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
