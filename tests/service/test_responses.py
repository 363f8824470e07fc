"""FRF of a cell from raw files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from fastapi.testclient import TestClient
from tests.conftest import BenchRun
from tests.service import raw_runs
from tests.service.conftest import send_result
from tests.store.stored import RUNS

from ballscrew.base.errors import InputError
from ballscrew.report.measured import response_of
from ballscrew.service import responses
from ballscrew.service.on_demand import OnDemand
from ballscrew.service.serving import RefusedError, Service
from ballscrew.store.copying import archive


@pytest.fixture
def run(client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch) -> str:
    """Id of a run with raw files, whose analysis takes no time."""

    raw_runs.compute_here(monkeypatch)
    raw_runs.analyse_at_once(monkeypatch)
    service.scratch.mkdir()
    found = raw_runs.send_raw(client)
    raw_runs.analyse(service, found)
    return found


def test_the_frf_of_a_cell_has_its_interval_and_coherence(client: TestClient, run: str) -> None:
    found = client.get(f"/api/v1/runs/{run}/response?cell=3").json()
    cell = RUNS[0].cells[3]
    assert (found["position_m"], found["condition"]) == (cell.position_m, cell.condition)
    assert found["natural_frequency_Hz"] == pytest.approx(cell.frequency_Hz, rel=1e-5)
    assert found["frequency_Hz"] == raw_runs.FREQUENCY.tolist()
    assert set(found["magnitude"]) == {3.0}
    assert set(found["phase_deg"][0]) == {90.0}
    spread = np.sqrt(0.2 / (2 * cell.repetitions * 0.8))
    assert found["relative_half_width"][0] == pytest.approx(1.96 * spread, rel=1e-4)
    assert found["responses"] == ["<b>:x"]


def test_a_cell_that_is_not_there_is_404(client: TestClient, run: str) -> None:
    answer = client.get(f"/api/v1/runs/{run}/response?cell=999")
    assert (answer.status_code, "none of the number 999" in answer.json()["detail"]) == (404, True)
    assert client.get("/api/v1/runs/none/response").status_code == 404


@pytest.mark.parametrize("is_removed", [True, False])
def test_a_result_that_is_removed_while_it_is_read_is_computed_again(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *, is_removed: bool
) -> None:
    folder = tmp_path / "result"
    if not is_removed:
        folder.mkdir()  # and without the file of the cell
    with monkeypatch.context() as patch:
        patch.setattr(OnDemand, "find", lambda *_: folder)
        answer = client.get(f"/api/v1/runs/{run}/response?cell=3")
        assert answer.status_code == (202 if is_removed else 404)
    assert client.get(f"/api/v1/runs/{run}/response?cell=3").status_code == 200


@pytest.mark.usefixtures("run")
def test_a_run_without_raw_files_has_no_frf(client: TestClient) -> None:
    send_result(client, 3)
    answer = client.get(f"/api/v1/runs/{RUNS[3].id}/response")
    assert (answer.status_code, "not kept" in answer.json()["detail"]) == (404, True)


def test_an_analysis_that_is_refused_is_a_sentence(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise InputError("trip.npz: has no channel.")

    monkeypatch.setattr("ballscrew.store.analysing.analyse_files", refuse)
    answer = client.get(f"/api/v1/runs/{run}/response")
    assert (answer.status_code, answer.json()["detail"]) == (422, "trip.npz: has no channel.")


def test_the_spectra_of_both_methods_are_the_same(bench_run: BenchRun) -> None:
    joint, paper = (bench_run("preload-4-percent", method) for method in ("joint", "paper"))
    xr.testing.assert_equal(joint.frequency_response, paper.frequency_response)


def test_the_map_has_the_magnitude_of_a_cell_of_each_run_with_raw_files(client: TestClient, run: str) -> None:
    send_result(client, 3)  # without raw files
    found = client.get("/api/v1/axes/bench/responses?cell=3").json()
    cells = [(cell["position_m"], cell["condition"], cell["motion"]) for cell in found["cells"]]
    assert cells == sorted(cell.key for cell in RUNS[0].cells)
    assert (len(found["run"]), found["stored"], found["waiting"], found["refused"]) == (2, 1, [], 0)
    place = found["run"].index(client.get(f"/api/v1/runs/{run}").json()["run"]["id"])
    numbers = [cell.key for cell in RUNS[0].cells]
    number = numbers.index(cells[3])  # the magnitude of the simulated FRF
    assert found["magnitude_dB"][place] == pytest.approx([20 * np.log10(number)] * 200, rel=1e-3)
    assert found["magnitude_dB"][1 - place] is None
    cell = RUNS[0].cells[number]
    assert found["natural_frequency_Hz"][place] == pytest.approx(cell.frequency_Hz)
    lines = found["frequency_Hz"]
    assert (
        len(lines),
        raw_runs.FREQUENCY[0] <= lines[0] < cell.frequency_Hz < lines[-1] <= raw_runs.FREQUENCY[-1],
    ) == (
        200,
        True,
    )


def test_the_map_computes_one_run_for_each_request_and_says_how_many_wait(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(OnDemand, "find", lambda *_: None)  # longer than a request waits
        found = client.get("/api/v1/axes/bench/responses").json()
        assert (found["waiting"], found["frequency_Hz"]) == (found["run"], [])
        assert set(found["magnitude_dB"]) == {None}
    assert client.get("/api/v1/axes/bench/responses").json()["waiting"] == []
    monkeypatch.setattr(OnDemand, "_answer", lambda *_: pytest.fail("it is cached"))
    assert client.get("/api/v1/axes/bench/responses?cell=1").json()["waiting"] == []
    assert client.get(f"/api/v1/runs/{run}/response").status_code == 200  # by the same result


def test_a_run_that_cannot_be_analysed_is_blank_on_the_map(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise InputError("trip.npz: has no channel.")

    monkeypatch.setattr("ballscrew.store.analysing.analyse_files", refuse)
    found = client.get("/api/v1/axes/bench/responses").json()
    assert (found["waiting"], found["refused"], found["magnitude_dB"]) == ([], 1, [None])
    assert run


@pytest.mark.parametrize("status", [429, 503, 507])
def test_a_run_that_is_refused_for_a_while_waits(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch, status: int
) -> None:
    def refuse(*_: Any) -> None:
        raise RefusedError(status, "for a while.")

    monkeypatch.setattr(OnDemand, "find", refuse)
    found = client.get("/api/v1/axes/bench/responses").json()
    assert (found["waiting"], found["refused"]) == (found["run"], 0)
    assert run


def test_a_column_of_the_map_is_asked_for_alone(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = client.get("/api/v1/axes/bench/responses?cell=3").json()
    monkeypatch.setattr(responses, "used_columns", lambda *_, **__: pytest.fail("reads the whole axis"))
    address = f"/api/v1/runs/{run}/magnitude"
    lines = found["frequency_Hz"]
    asked = {"low": lines[0], "high": lines[-1]} | found["cells"][3]
    assert client.get(address, params=asked).json()["magnitude_dB"] == found["magnitude_dB"][0]
    wider = client.get(address, params=asked | {"high": 1e4}).json()["magnitude_dB"]
    assert (wider[0], wider[-1]) == (found["magnitude_dB"][0][0], None)
    assert client.get(address, params=asked | {"motion": 99}).json()["magnitude_dB"] is None
    assert client.get(address, params=asked | {"condition": "../x"}).status_code == 422
    monkeypatch.setattr(OnDemand, "find", lambda *_: None)
    assert client.get(address, params=asked).status_code == 202


def test_a_corrected_run_is_on_the_map(client: TestClient, run: str) -> None:
    correction = {"measured_at": "2026-06-01T09:00Z", "reason": "clock"}
    number = client.get(f"/api/v1/runs/{run}").json()["run"]["id"]
    answer = client.post(f"/api/v1/axes/bench/runs/{number}/correct", json=correction)
    assert answer.status_code == 200, answer.json()
    found = client.get("/api/v1/axes/bench/responses?cell=3")
    assert found.status_code == 200
    assert found.json()["magnitude_dB"] != [None]


def test_a_cell_or_an_axis_that_is_not_there_has_no_map(client: TestClient, run: str) -> None:
    answer = client.get("/api/v1/axes/bench/responses?cell=999")
    assert (answer.status_code, "none of the number 999" in answer.json()["detail"]) == (404, True)
    assert client.get("/api/v1/axes/none/responses").status_code == 404
    assert run


def test_a_run_whose_raw_files_were_archived_has_no_frf(
    client: TestClient, service: Service, run: str, tmp_path: Path
) -> None:
    archive(service.store, "bench", tmp_path / "archive", newest=0)
    answer = client.get(f"/api/v1/runs/{run}/response")
    assert (answer.status_code, "not kept" in answer.json()["detail"]) == (404, True)


def test_a_cell_without_a_spectrum_has_no_frf_and_the_others_have_theirs(
    client: TestClient, run: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def response_without(run: Any, *key: Any) -> Any:
        return None if key == RUNS[0].cells[1].key else response_of(run, *key)

    monkeypatch.setattr("ballscrew.report.measured.response_of", response_without)
    found = [client.get(f"/api/v1/runs/{run}/response?cell={number}") for number in range(3)]
    assert [answer.status_code for answer in found] == [200, 404, 200]
    assert set(found[2].json()["magnitude"]) == {2.0}
