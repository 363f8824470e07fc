"""Findings by which alarms are closed, and the audit: who, from where, before and after."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import SETUP, NewService, client_of
from tests.service.pages.forms import HOSTILE
from tests.service.test_alarms import act, assess
from tests.store.stored import RUNS

from ballscrew.service.serving import Service
from ballscrew.store.checking import verify
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.service_tables import AlarmAction
from ballscrew.store.tables import Audit, EventRow

NUT = {"at": "2026-03-01T08:00Z", "kind": "nut replaced", "text": "by the night shift"}


ALARM = "alarm-1"


def close(client: TestClient, alarm: str, finding: str | None, **others: Any) -> Any:
    body = {"action": "close", "text": "nut was worn", "finding": finding} | others
    return client.post(f"/api/v1/alarms/{alarm}", json=body)


def findings(client: TestClient) -> dict[str, Any]:
    found: dict[str, Any] = client.get("/api/v1/findings").json()
    return found


def audit(client: TestClient, **query: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.get("/api/v1/audit", params=query).json()["audit"]
    return found


def test_a_confirmed_loss_counts_for_rule_machine_and_axis(worn: TestClient) -> None:
    before = findings(worn)
    assert (before["all"]["alarms"], before["all"]["precision"], before["all"]["lead_days"]) == (
        1,
        None,
        None,
    )
    assert before["alarms"][0]["rule"] in ("ramp", "odds", "ramp and odds")
    answer = close(worn, ALARM, "preload loss")
    assert answer.status_code == 200
    assert answer.json()["actions"][-1]["finding"] == "preload loss"
    found = findings(worn)
    for rows, name in (
        ("rules", before["alarms"][0]["rule"]),
        ("machines", "hall 2: mill 4"),
        ("axes", "bench"),
    ):
        (row,) = found[rows]
        assert name in row.values()
        assert (row["inspected"], row["confirmed"], row["precision"][0]) == (1, 1, 1.0)
        assert 0.0 < row["precision"][1] < 0.3
        assert 0.0 <= row["lead_days"][0] < 0.01
    assert act(worn, ALARM, "reopen").json()["state"] == "raised"
    assert findings(worn)["all"]["inspected"] == 0


def test_another_cause_and_an_alarm_without_an_inspection(worn: TestClient) -> None:
    assert close(worn, ALARM, "another cause", cause=HOSTILE).status_code == 200
    found = findings(worn)
    assert (found["all"]["another_cause"], found["all"]["precision"][0]) == (1, 0.0)
    assert (found["alarms"][0]["cause"], found["alarms"][0]["lead_days"]) == (HOSTILE, None)
    for finding in ("not inspected", None):
        assert close(worn, ALARM, finding).status_code == 200
        assert findings(worn)["all"]["precision"] is None


def test_maintenance_is_one_transaction_with_the_finding_and_begins_an_epoch(
    worn: TestClient, worn_service: Service
) -> None:
    answer = close(worn, ALARM, "preload loss", maintenance=NUT | {"kind": "explosion"})
    assert answer.status_code == 422
    assert worn.get("/api/v1/alarms").json()["alarms"][0]["state"] == "raised"
    at = RUNS[-1].measured_at
    assert close(worn, ALARM, "preload loss", maintenance=NUT | {"at": at}).status_code == 200
    with worn_service.store.read() as session:
        event = session.scalars(select(EventRow)).one()
        taken = session.scalars(select(AlarmAction)).one()
    assert (event.kind, taken.event, taken.finding) == ("nut replaced", event.digest, "preload loss")
    assess(worn_service)
    assert worn.get("/api/v1/axes/bench").json()["runs"][-1]["epoch"] == 1
    assert findings(worn)["all"]["confirmed"] == 1
    assert verify(worn_service.store.path).faults == ()


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ({"action": "close", "text": "x", "finding": "another cause"}, "which other cause"),
        ({"action": "close", "text": "x", "cause": "bearing"}, "cause needs a finding"),
        ({"action": "close", "text": "x", "finding": "nothing found", "cause": "y"}, "which other cause"),
        ({"action": "acknowledge", "finding": "nothing found"}, "belong to close"),
        ({"action": "reopen", "maintenance": NUT}, "belong to close"),
        ({"action": "close", "text": "x", "finding": "gremlins"}, "preload loss"),
        ({"action": "close", "text": "", "finding": "nothing found"}, "with a finding"),
    ],
)
def test_a_finding_that_does_not_fit_is_one_sentence(
    worn: TestClient, body: dict[str, Any], sentence: str
) -> None:
    answer = worn.post(f"/api/v1/alarms/{ALARM}", json=body)
    assert (answer.status_code, sentence in answer.json()["detail"]) == (422, True)


def test_a_change_states_by_whom_from_where_before_and_after(worn: TestClient) -> None:
    act(worn, ALARM, "acknowledge")
    row = audit(worn, action="acknowledge")[0]
    assert (row["by"], row["from"], row["subject"]) == ("local", "testclient", ALARM)
    assert row["changed"] == {"state": ["raised", "acknowledged"]}
    assert row["detail"]["axis"] == "bench"
    schedule = SETUP | {"schedule": {"period_s": 86400}}
    assert worn.put("/api/v1/axes/bench", json=schedule).status_code == 200
    assert audit(worn, action="set up")[0]["changed"]["period_s"] == [None, 86400.0]
    run = RUNS[3].id
    assert worn.post(f"/api/v1/axes/bench/runs/{run}/correct", json={"mass_kg": 101.0}).status_code in (
        200,
        422,
    )
    worn.post(f"/api/v1/axes/bench/runs/{run}/exclusion", json={"reason": "loose"})
    assert audit(worn, action="exclude")[0]["changed"] == {"counts": [True, False]}


def test_an_addition_is_one_row(client: TestClient) -> None:
    number = len(audit(client))
    client.post("/api/v1/axes/bench/events", json=[{"at": NUT["at"], "kind": "note"}])
    (row,) = audit(client)[: len(audit(client)) - number]
    assert (row["action"], row["by"], row["from"]) == ("add", "local", "testclient")


def test_what_the_server_and_the_command_line_do_is_named(service: Service, client: TestClient) -> None:
    with service.store.write("test") as session:
        record(session, "tidy", "store")
    assert (audit(client)[0]["by"], audit(client)[0]["from"]) == ("server", "server")
    with OpenStore(service.store.path).write("test") as session:
        record(session, "tidy", "store")
    row = audit(client)[0]
    assert ("@" in row["by"], row["from"]) == (True, "command line")


def test_rows_are_selected_by_axis_person_and_action(worn: TestClient) -> None:
    client = worn
    other = SETUP | {"machine": "mill 5", "sheet": SETUP["sheet"].replace('"bench"', '"Y axis"')}
    client.put("/api/v1/axes/Y axis", json=other)
    for row in audit(client, axis="Y axis"):
        assert "Y axis" in json.dumps(row)
    actions = Counter(row["action"] for row in audit(client, axis="bench"))
    assert actions["raise"] == 1
    assert actions["assess"] >= 1
    assert audit(client, by="nobody") == []
    assert {row["by"] for row in audit(client, by="local")} == {"local"}
    whole = audit(client)
    assert audit(client, before=whole[3]["id"]) == whole[4:]
    assert client.get("/api/v1/audit?before=0").status_code == 422


def test_exports_are_whole_and_no_cell_is_a_formula(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ballscrew.service.records.MOST_ROWS", 20)
    monkeypatch.setattr("ballscrew.service.records._PART", 20)
    with service.store.write("test") as session:
        for number in range(53):
            record(session, "=cmd|' /C calc'!A0", f"@SUM({number})", by="+1", text=HOSTILE)
    answer = client.get("/api/v1/audit?format=csv")
    assert answer.headers["Content-Disposition"] == 'attachment; filename="audit.csv"'
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    with service.store.read() as session:
        numbers = session.scalars(select(Audit.id).order_by(Audit.id.desc())).all()
    assert [int(row["id"]) for row in rows] == list(numbers)
    for row in rows:
        assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for cell in row.values())
    with service.store.write("test") as session:
        record(session, "receive", 'run 1; =1+1;"@SUM(2)', by="a\n-3")
    text = client.get("/api/v1/audit?format=csv").text
    for line in text.splitlines():  # as a spreadsheet in German divides it
        for cell in line.split(";"):
            assert not cell.lstrip(' "').startswith(("=", "+", "-", "@"))
    lines = client.get("/api/v1/audit?format=jsonl").text.splitlines()
    assert [json.loads(line)["id"] for line in lines][1:] == list(numbers)
    answer = client.get("/api/v1/audit").json()
    assert (len(answer["audit"]), answer["before"]) == (20, answer["audit"][-1]["id"])


def test_findings_and_audit_need_a_token_elsewhere(new_service: NewService) -> None:
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    with client_of(service) as client:
        assert {client.get(f"/api/v1/{name}").status_code for name in ("findings", "audit")} == {401}
