"""Cells of a run and their changes since its baseline, the previous run, and any other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import SETUP, other_files, send, send_result, work_off
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS

from ballscrew.base.jsonfile import plain
from ballscrew.estimation.frequency_change import frequency_changes
from ballscrew.service.serving import Service
from ballscrew.store.adding import add_model


@pytest.fixture
def filled(client: TestClient, service: Service) -> TestClient:
    """Client of an axis with four runs; the second one is excluded."""
    add_model(service.store, MODEL)
    for number in range(4):
        send_result(client, number)
    client.post(f"/api/v1/axes/bench/runs/{RUNS[1].id}/exclusion", json={"reason": "loose"})
    work_off(service, lambda _: ("failed", "no analysis"))
    return client


def cells(client: TestClient, run: str, against: str = "") -> Any:
    answer = client.get(f"/api/v1/runs/{run}/cells", params={"against": against} if against else {})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_changes_are_since_the_baseline_which_itself_has_none(filled: TestClient) -> None:
    found = cells(filled, RUNS[3].id)
    assert (found["against"]["kind"], found["against"]["run"]) == ("baseline", RUNS[0].id)
    expected = list(frequency_changes(RUNS[3], RUNS[0]).values())
    assert [cell["change_Hz"] for cell in found["cells"]] == plain([change.value for change in expected])
    spreads = plain([change.standard_uncertainty for change in expected])
    assert [cell["change_uncertainty_Hz"] for cell in found["cells"]] == spreads
    assert cells(filled, RUNS[0].id)["against"] is None


def test_the_previous_run_is_the_one_before_that_counts(filled: TestClient) -> None:
    found = cells(filled, RUNS[2].id, "previous")
    assert (found["against"]["kind"], found["against"]["run"]) == ("previous", RUNS[0].id)
    assert cells(filled, RUNS[3].id, "previous")["against"]["run"] == RUNS[2].id


def test_the_cell_that_moved_most_is_a_certain_one(filled: TestClient) -> None:
    frequency = RUNS[0].cells[5].frequency_Hz
    assert frequency is not None
    moved = list(RUNS[0].cells)
    moved[5] = replace(moved[5], frequency_Hz=frequency * 0.98)
    vague = moved[7].frequency_Hz
    assert vague is not None
    moved[7] = replace(moved[7], frequency_Hz=vague * 0.95, standard_uncertainty_Hz=20.0)
    run = "f" * 64
    send_result(
        filled,
        0,
        "moved",
        id=run,
        cells=tuple(moved),
        measured_at="2026-06-01T00:00:00+00:00",
        files=other_files("f"),
    )
    found = cells(filled, run, RUNS[0].id)
    assert found["moved_most"] == 5
    assert (found["cells"][5]["differs"], found["cells"][7]["differs"]) == (True, False)


def test_runs_of_two_axes_are_compared_without_common_errors(filled: TestClient) -> None:
    filled.put("/api/v1/axes/Y axis", json=SETUP | {"sheet": AXIS.replace('"bench"', '"Y axis"')})
    same = cells(filled, RUNS[3].id, RUNS[0].id)
    assert same["against"]["kind"] == "other"
    assert all(cell["change_Hz"] is not None for cell in same["cells"])


def test_a_run_without_a_load_has_no_change_and_a_reason(filled: TestClient) -> None:
    send_result(filled, 4, "no load", id="e" * 64, mass_kg=None)
    found = cells(filled, "e" * 64, RUNS[0].id)
    assert "mass_kg" in found["reason"]
    assert found["moved_most"] is None


@pytest.mark.parametrize(
    ("path", "status", "message"),
    [
        ("none/cells", 404, "no run 'none'"),
        ("{run}/cells?against=none", 404, "no run 'none'"),
        ("{sent}/cells", 404, "no result"),
        ("{run}/cells?against={sent}", 404, "no result"),
        ("%25/cells", 404, "no run"),
    ],
)
def test_what_is_not_there_is_a_sentence(filled: TestClient, path: str, status: int, message: str) -> None:
    sent = send(filled).json()["id"]
    answer = filled.get("/api/v1/runs/" + path.format(run=RUNS[3].id, sent=sent))
    assert (answer.status_code, message in answer.json()["detail"]) == (status, True), answer.text


def test_the_beginning_of_an_id_is_enough_if_it_is_that_of_one_run(filled: TestClient) -> None:
    assert cells(filled, RUNS[3].id[:12])["run"] == RUNS[3].id
    for letter in "ab":
        send_result(filled, 5, f"twin {letter}", id="01234567" + 56 * letter, files=other_files(letter))
    answer = filled.get("/api/v1/runs/01234567/cells")
    assert answer.status_code == 409
    assert answer.json()["runs"] == ["01234567" + 56 * letter for letter in "ab"]


def test_the_cells_of_a_run_without_a_result_are_404_in_each_format(client: TestClient) -> None:
    identity = send(client).json()["id"]
    for name in ("json", "csv"):
        answer = client.get(f"/api/v1/runs/{identity}/cells?format={name}")
        assert (answer.status_code, answer.json()["detail"]) == (404, "the run has no result.")
