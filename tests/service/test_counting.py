"""Runs that do not count by themselves: parts of more complete runs."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import send_result, work_off
from tests.store.stored import MODEL, RUNS

from ballscrew.base.provenance import FileRef
from ballscrew.calibration.modelfile import model_json
from ballscrew.service.serving import Service
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit

TRIPS = tuple(FileRef(f"trip{number}.h5", f"{number:02d}" * 32) for number in range(1, 5))
BAD = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))


def send_trips(client: TestClient, name: str, trips: str, **changes: Any) -> None:
    """Send a run that was analysed at the machine from the trips of these numbers."""
    files = tuple(TRIPS[int(number) - 1] for number in trips)
    number = {"incomplete": 5, "complete": 6, "more": 7}[name]
    assert send_result(client, number, key=name, id=name, files=files, **changes).status_code == 202


def counting(client: TestClient) -> set[str]:
    runs = client.get("/api/v1/axes/bench/runs").json()["runs"]
    return {each["run"] for each in runs if each["counts"]} - {run.id for run in RUNS}


def test_a_late_trip_makes_a_run_that_takes_the_place_of_the_incomplete_one(
    client: TestClient, service: Service
) -> None:
    for number in range(5):
        send_result(client, number)
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    send_trips(client, "incomplete", "12")
    send_trips(client, "complete", "123")
    work_off(service, lambda _: pytest.fail("no analysis"))
    assert counting(client) == {"complete"}
    axis = client.get("/api/v1/axes/bench").json()
    assert (axis["refusal"], axis["shared_recordings"]) == (None, [])
    (exclusion,) = axis["exclusions"]
    assert (exclusion["run"], exclusion["actor"], exclusion["ended_at"]) == ("incomplete", "local", None)
    assert "a part of those of the run complete, which counts" in exclusion["reason"]
    with service.store.read() as session:
        (row,) = session.scalars(select(Audit).where(Audit.action == "exclude"))
    assert (row.subject, row.detail["by"]) == ("incomplete", "local")
    assert Store.verify(service.store.path).faults == ()
    assert client.delete("/api/v1/axes/bench/runs/incomplete/exclusion").status_code == 200
    assert counting(client) == {"incomplete", "complete"}  # nothing is lost


@pytest.mark.parametrize("order", list(permutations(("incomplete", "complete", "more"))))
@pytest.mark.parametrize("bad", ["", "more"])
def test_the_order_of_arrival_does_not_matter(client: TestClient, order: tuple[str, ...], bad: str) -> None:
    trips = {"incomplete": "12", "complete": "123", "more": "1234"}
    for name in order:
        changes = {"quality": BAD} if name == bad else {}
        send_trips(client, name, trips[name], **changes)
    assert counting(client) == ({"complete"} if bad == "more" else {"more"})


@pytest.mark.parametrize(
    ("trips", "changes"), [("23", {}), ("34", {}), ("12", {}), ("123", {"mass_kg": 1.0})]
)
def test_runs_of_which_neither_is_more_complete_are_left_to_a_person(
    client: TestClient, trips: str, changes: dict[str, Any]
) -> None:
    send_trips(client, "incomplete", "12")
    send_trips(client, "complete", trips, **changes)
    assert counting(client) == {"incomplete", "complete"}
    assert client.get("/api/v1/axes/bench").json()["exclusions"] == []
