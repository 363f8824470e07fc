"""What is read over HTTP: runs by the beginning of their ids, their documents and cells; names of axes."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import SETUP, NewService, client_of, put, send, send_result, sha256, work_off
from tests.store.stored import EVENTS, MODEL, RUNS

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.modelfile import model_json
from ballscrew.modal.run import Run
from ballscrew.service import reading
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token
from ballscrew.store.adding import add_events, add_run
from ballscrew.store.tables import Audit, Axis

ID = "0123456789abcdef"


def send_two(client: TestClient) -> None:
    """Two runs whose ids have ten characters in common."""
    for number, identity in enumerate((ID, ID[:10] + "x" * 6)):
        assert send_result(client, number, id=identity).status_code == 202


@pytest.mark.parametrize(
    ("text", "status"), [(ID, 200), (ID[:11], 200), (ID[:10], 409), (ID[:7], 404), ("%" * 8, 404)]
)
def test_a_run_is_found_by_the_beginning_of_its_id(client: TestClient, text: str, status: int) -> None:
    send_two(client)
    for part in ("", "/document", "/cells"):
        answer = client.get(f"/api/v1/runs/{text}{part}")
        assert answer.status_code == status
    assert status != 409 or "give more of it" in answer.json()["detail"]
    body = {"reason": "loose sensor"}
    assert client.post(f"/api/v1/axes/bench/runs/{text}/exclusion", json=body).status_code == status
    excluded = client.get("/api/v1/axes/bench").json()["exclusions"]
    assert [each["run"] for each in excluded] == ([ID] if status == 200 else [])


def test_an_id_that_begins_another_is_found(client: TestClient) -> None:
    for number, identity in enumerate((ID + "0", ID, ID + "1")):
        send_result(client, number, id=identity)
    assert client.get(f"/api/v1/runs/{ID}").json()["run"]["id"] == ID


def test_what_send_prints_finds_a_run_before_and_after_its_analysis(
    client: TestClient, service: Service
) -> None:
    identity = send(client).json()["id"][:12]
    assert client.get(f"/api/v1/runs/{identity}").json()["run"] is None
    answer = client.get(f"/api/v1/runs/{identity}/cells")
    assert (answer.status_code, answer.json()["detail"]) == (404, "the run has no result.")
    work_off(service, lambda _: ("done", (RUNS[0].to_json(), [])))
    assert client.get(f"/api/v1/runs/{identity}").json()["run"]["id"] == RUNS[0].id


def test_a_machine_finds_only_its_runs(new_service: NewService) -> None:
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    local = Service(service.store, service.settings.model_copy(update={"host": "127.0.0.1"}))
    with client_of(local) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        other = SETUP | {"machine": "mill 5", "sheet": SETUP["sheet"].replace('"bench"', '"Y axis"')}
        client.put("/api/v1/axes/Y axis", json=other)
        send_two(client)
    for machine, status in (("mill 4", 200), ("mill 5", 403)):
        _, text = create_token(service.store, machine)
        with client_of(service, headers={"Authorization": f"Bearer {text}"}) as client:
            for part in ("", "/document"):
                assert client.get(f"/api/v1/runs/{ID}{part}").status_code == status
            assert (
                client.get("/api/v1/runs/none-such").status_code == 403
            )  # whether there is one is not shown


def test_a_machine_that_sends_the_id_of_a_run_of_another_does_not_find_that_run(
    new_service: NewService,
) -> None:
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    local = Service(service.store, service.settings.model_copy(update={"host": "127.0.0.1"}))
    with client_of(local) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        other = SETUP | {"machine": "mill 5", "sheet": SETUP["sheet"].replace('"bench"', '"Y axis"')}
        client.put("/api/v1/axes/Y axis", json=other)
        send_result(client, 0, id=ID)
    content = write_json(replace(RUNS[1], id=ID, axis="Y axis").to_json()).encode()
    _, text = create_token(service.store, "mill 5")
    with client_of(service, headers={"Authorization": f"Bearer {text}"}) as client:
        path = "/api/v1/axes/Y axis/runs/copied"
        assert put(client, content, path).status_code == 201
        sent = client.post(f"{path}/complete", json={"files": [], "run_json": sha256(content)})
        assert sent.status_code == 409
        assert client.get(f"/api/v1/runs/{ID}").status_code == 403
        found = client.get(f"/api/v1/runs/{sent.json()['id']}").json()
        assert (found["axis"], found["run"]) == ("Y axis", None)
        assert [each["status"] for each in found["sent"]] == ["conflict"]
        assert client.get(f"/api/v1/runs/{sent.json()['id']}/document").status_code == 404
    _, text = create_token(service.store, "mill 4")
    with client_of(service, headers={"Authorization": f"Bearer {text}"}) as client:
        (own,) = client.get(f"/api/v1/runs/{ID}").json()["sent"]
        assert own["run"] == "analysed-0"


def test_the_document_and_the_cells_are_those_of_the_run(client: TestClient) -> None:
    reasons = replace(RUNS[0].cells[1], reasons=("=HYPERLINK(1)",), reason_kinds=("",), verdict="suspect")
    run = replace(RUNS[0], cells=(RUNS[0].cells[0], reasons, *RUNS[0].cells[2:]))
    send_result(client, 0, cells=run.cells)
    document = client.get(f"/api/v1/runs/{run.id}/document").json()
    assert document == run.to_json()
    assert Run.from_json(document).to_json() == document
    cells = client.get(f"/api/v1/runs/{run.id}/cells").json()
    assert [cell["frequency_Hz"] for cell in cells["cells"]] == [cell.frequency_Hz for cell in run.cells]
    answer = client.get(f"/api/v1/runs/{run.id}/cells?format=csv")
    assert answer.headers["Content-Type"] == "text/csv; charset=utf-8"
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert [float(row["frequency_Hz"]) for row in rows] == [cell.frequency_Hz for cell in run.cells]
    assert rows[1]["reasons"] == "'=HYPERLINK(1)"  # which no spreadsheet executes
    assert client.get(f"/api/v1/runs/{run.id}/cells?format=xlsx").status_code == 422


def test_no_cell_of_the_history_is_executed_by_a_spreadsheet(client: TestClient) -> None:
    formula = '=HYPERLINK("http://192.0.2.1")'
    send_result(client, 0, id=formula)
    path = "/api/v1/axes/bench/history"
    (row,) = csv.DictReader(io.StringIO(client.get(f"{path}?format=csv").text))
    assert (row["run"], row["counts"]) == (f"'{formula}", "True")
    assert client.get(path).json()["history"][0]["run"] == formula


def test_the_fleet_as_csv_has_numbers_and_iso_times_and_no_cell_is_executed(
    client: TestClient, service: Service
) -> None:
    for run in RUNS[:-1]:
        add_run(service.store, run)
    assert client.put("/api/v1/axes/bench/model", json=model_json(MODEL)).status_code == 200
    work_off(service, lambda _: pytest.fail("no analysis"))
    formulas = {"machine": "=1+1", "site": "@SUM(A1)", "sheet": SETUP["sheet"].replace('"bench"', '"-2+3"')}
    assert client.put("/api/v1/axes/-2+3", json=SETUP | formulas).status_code == 200
    answer = client.get("/api/v1/axes?format=csv")
    assert answer.headers["Content-Type"] == "text/csv; charset=utf-8"
    rows = {row["axis"]: row for row in csv.DictReader(io.StringIO(answer.text))}
    assert set(rows) == {"bench", "'-2+3"}
    assert (rows["'-2+3"]["machine"], rows["'-2+3"]["site"]) == ("'=1+1", "'@SUM(A1)")
    assert rows["'-2+3"]["stiffness_ratio"] == ""
    documents = {row["axis"]: row for row in client.get("/api/v1/axes").json()["axes"]}
    document, row = documents["bench"], rows["bench"]
    names = ("stiffness_ratio", "stiffness_ratio_low", "stiffness_ratio_high")
    assert [float(row[name]) for name in names] == document["stiffness"]
    for quantile in ("05", "50", "95"):
        days = document["rul_days"][f"0.{quantile}".rstrip("0")]
        assert row[f"remaining_life_p{quantile}_days"] == ("" if days is None else str(days))
    assert row["newest_run_at"] == document["newest_at"] == RUNS[-2].measured_at
    assert (row["state"], row["last_assessed_state"]) == (document["lamp"]["state"], "alarm")


@pytest.mark.parametrize("name", ["X/Y", "/", ".."])
def test_a_name_that_cannot_be_a_part_of_a_url_is_refused_when_an_axis_is_added(
    service: Service, name: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="any characters but '/' and control characters, and not dots alone"):
        add_run(service.store, replace(RUNS[0], axis=name))
    with pytest.raises(InputError, match="any characters but '/'"):
        add_events(service.store, EVENTS, name)
    assert tmp_path.exists()


def test_an_axis_of_an_older_store_whose_name_has_a_slash_can_be_read(new_service: NewService) -> None:
    service = new_service()
    with service.store.write("test") as session:
        session.add(Axis(name="X/Y", runs=0))
    assert add_run(service.store, replace(RUNS[0], axis="X/Y")).is_new
    with client_of(service) as client:
        assert [axis["axis"] for axis in client.get("/api/v1/axes").json()["axes"]] == ["X/Y"]
        assert client.get(f"/api/v1/runs/{RUNS[0].id}/cells").status_code == 200


@pytest.mark.parametrize("given", ["9" * 5000, "x" * 99, "-1", ""])
def test_changes_after_what_is_no_number_are_those_from_now_on(service: Service, given: str) -> None:
    service.stopping.set()
    with client_of(service) as client:
        answer = client.get("/api/v1/events", headers={"Last-Event-ID": given})
    assert (answer.status_code, answer.text) == (200, ": connected\n\n")


def test_the_history_is_a_table_in_parquet_too(client: TestClient) -> None:
    for number in range(3):
        send_result(client, number)
    answer = client.get("/api/v1/axes/bench/history?format=parquet")
    assert answer.headers["Content-Type"] == "application/vnd.apache.parquet"
    found = pd.read_parquet(io.BytesIO(answer.content))
    expected = pd.read_csv(io.StringIO(client.get("/api/v1/axes/bench/history?format=csv").text))
    assert found["run"].tolist() == [run.id for run in RUNS[:3]]
    assert list(found.columns) == list(expected.columns)


def test_without_pyarrow_a_history_in_parquet_is_refused_with_what_to_install(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "find_spec", lambda _: None)
    answer = client.get("/api/v1/axes/bench/history?format=parquet")
    assert (answer.status_code, "python -m pip install" in answer.json()["detail"]) == (422, True)


def test_more_changes_than_are_read_at_once_are_sent_without_a_gap(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At once, and not with the next change."""
    monkeypatch.setattr(reading, "_MOST_EVENTS", 2)
    for number in range(3):
        send_result(client, number)
    service.stopping.set()
    text = client.get("/api/v1/events", headers={"Last-Event-ID": "0"}).text
    with service.store.read() as session:
        rows = session.scalars(select(Audit.id).order_by(Audit.id)).all()
    assert [int(number) for number in re.findall(r"^id: (\d+)$", text, re.MULTILINE)] == list(rows)
    assert len(rows) > 4
