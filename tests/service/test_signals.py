"""Raw signals of a run: exact samples, minima and maxima, and raw data that is gone."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from tests.service import raw_runs
from tests.service.conftest import SETUP, send, send_result, wait_for
from tests.store.stored import RUNS

from ballscrew.service import on_demand
from ballscrew.service.serving import Service
from ballscrew.store.copying import archive

POSITION = quote("position:<b>'")


@pytest.fixture
def run(client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch) -> str:
    """Id of a run with raw files."""
    raw_runs.compute_here(monkeypatch)
    service.scratch.mkdir()
    found = raw_runs.send_raw(client)
    raw_runs.analyse(service, found)
    return found


def signals(client: TestClient, run: str, query: str = "") -> dict[str, Any]:
    answer = client.get(f"/api/v1/runs/{run}/signals?{query}")
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def test_the_channels_of_a_file_are_listed_in_si(client: TestClient, run: str) -> None:
    found = signals(client, run, "file=1")
    names = [(each["name"], each["unit"], each["samples"], each["not_finite"]) for each in found["channels"]]
    assert names == [("torque", "N m", raw_runs.COUNT, 0), ("position:<b>'", "m", raw_runs.COUNT, 0)]
    assert found["file_name"] == raw_runs.HOSTILE


def test_a_whole_channel_is_minima_and_maxima_with_every_spike(client: TestClient, run: str) -> None:
    found = signals(client, run, "channel=torque&points=100")
    assert not found["each_sample"]
    assert len(found["time_s"]) == len(found["low"]) == len(found["high"]) <= 200
    assert max(found["high"]) == pytest.approx(0.5)
    spike = found["time_s"][found["high"].index(max(found["high"]))]
    assert spike == pytest.approx(20.0, abs=raw_runs.COUNT / raw_runs.RATE / 100)


def test_a_short_part_is_every_sample_at_its_time(client: TestClient, run: str) -> None:
    found = signals(client, run, f"channel={POSITION}&from=10&to=10.02&points=100")
    assert (found["each_sample"], found["high"]) == (True, None)
    assert found["time_s"] == pytest.approx([10 + n / 1000 for n in range(21)])
    assert found["low"][5] == pytest.approx(0.1 * 10_005 / 39_999, rel=1e-10)


@pytest.mark.parametrize("query", ["from=-5&to=-4", "from=1e6&to=2e6", "from=30&to=10", "from=40&to=40"])
def test_a_part_beyond_the_file_is_its_nearest_sample(client: TestClient, run: str, query: str) -> None:
    assert len(signals(client, run, f"channel=torque&{query}")["low"]) >= 1


@pytest.mark.parametrize(
    ("query", "status", "message"),
    [
        ("file=2", 404, "has 2 files"),
        ("file=-1", 422, "file"),
        ("channel=speed", 404, "no channel 'speed'"),
        ("channel=torque&from=nan", 422, "from"),
        ("channel=torque&points=1", 422, "points"),
        ("channel=torque&points=1000000000", 422, "points"),
    ],
)
def test_what_cannot_be_shown_is_a_sentence(
    client: TestClient, run: str, query: str, status: int, message: str
) -> None:
    answer = client.get(f"/api/v1/runs/{run}/signals?{query}")
    assert (answer.status_code, message in answer.json()["detail"]) == (status, True), answer.text


@pytest.mark.usefixtures("run")
def test_a_run_without_raw_files_says_so(client: TestClient) -> None:
    send_result(client, 3)
    answer = client.get(f"/api/v1/runs/{RUNS[3].id}/signals")
    assert (answer.status_code, "not kept" in answer.json()["detail"]) == (404, True)
    assert client.get("/api/v1/runs/none/signals").status_code == 404


def test_files_that_were_archived_are_not_kept(
    client: TestClient, service: Service, run: str, tmp_path: Path
) -> None:
    archive(service.store, "bench", tmp_path / "archive", newest=0)
    answer = client.get(f"/api/v1/runs/{run}/signals")
    assert (answer.status_code, "not kept" in answer.json()["detail"]) == (404, True)


def test_a_file_that_cannot_be_read_is_refused_with_its_name_alone(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = raw_runs.compute_here(monkeypatch)
    service.scratch.mkdir()
    run = send(client).json()["id"]
    answers = [client.get(f"/api/v1/runs/{run}/signals") for _ in range(2)]
    assert [answer.status_code for answer in answers] == [422, 422]
    assert "a.h5" in answers[0].json()["detail"]
    assert str(service.store.path) not in answers[0].json()["detail"]
    assert len(tasks) == 1  # it is not read again


def test_a_file_is_read_once(client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch) -> None:
    signals(client, run)
    monkeypatch.setattr(on_demand.OnDemand, "_ask", lambda *_: pytest.fail("it is read again"))
    signals(client, run, "channel=torque")


def test_a_file_that_takes_long_is_202_and_comes_later(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(on_demand, "_PATIENCE", 0.0)
    answers = []

    def comes() -> bool:
        answers.append(client.get(f"/api/v1/runs/{run}/signals?file=1"))
        return bool(answers[-1].status_code != 202)

    wait_for(comes)
    assert all(answer.json()["detail"] for answer in answers[:-1])
    assert answers[-1].status_code == 200


def test_the_same_bytes_under_two_names_are_two_results(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name may decide by which reader a file is read, and is in the sentence why it cannot be."""
    tasks = raw_runs.compute_here(monkeypatch)
    service.scratch.mkdir()
    toml = raw_runs.RUN_TOML.replace(f"'''{raw_runs.HOSTILE}'''", '"trip.txt"')
    files = {"trip.npz": raw_runs.npz(0), "trip.txt": raw_runs.npz(0)}
    assert client.put("/api/v1/axes/bench", json=SETUP | {"channels": raw_runs.CHANNELS}).status_code == 200
    run = send(client, files=files, run_toml=toml).json()["id"]
    for number in (0, 1):
        signals(client, run, f"file={number}")
    assert [task.file[0] for task in tasks] == ["trip.npz", "trip.txt"]


@pytest.mark.parametrize("query", ["", "channel=torque"])
def test_a_result_that_is_removed_while_it_is_read_is_computed_again(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, query: str
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(on_demand.OnDemand, "find", lambda *_: tmp_path / "removed")
        answer = client.get(f"/api/v1/runs/{run}/signals?{query}")
        assert (answer.status_code, answer.headers["Retry-After"]) == (202, "1")
    assert signals(client, run, query)
