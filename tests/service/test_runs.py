"""Runs that are completed: one run for one content, whatever the order and the number of sendings."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import (
    CHANNELS,
    FILES,
    RUN,
    RUN_TOML,
    SETUP,
    NewService,
    body,
    client_of,
    put,
    send,
    send_result,
    sha256,
    work_off,
)
from tests.simulated_bench import AXIS
from tests.store.stored import RUNS, count

from ballscrew.base.jsonfile import write_json
from ballscrew.service import runs
from ballscrew.service.serving import Service
from ballscrew.store.adding import add_run
from ballscrew.store.service_tables import JobRow, Upload
from ballscrew.store.store import Store
from ballscrew.store.tables import Conflict, ResultRow, RunRow


def result(number: int = 0) -> Any:
    return lambda _: ("done", (RUNS[number].to_json(), []))


def test_a_run_is_queued_analysed_and_shown(client: TestClient, service: Service) -> None:
    answer = send(client)
    document = answer.json()
    assert answer.status_code == 202
    assert (document["run"], document["status"]) == ("r1", "queued")
    assert service.changes > 0
    work_off(service, result())
    found = client.get(f"/api/v1/runs/{document['id']}").json()
    assert (found["sent"][0]["status"], found["sent"][0]["verdict"]) == ("done", "good")
    assert found["run"]["id"] == found["sent"][0]["result"] == RUNS[0].id
    assert client.get(f"/api/v1/runs/{RUNS[0].id}").json() == found
    assert Store.verify(service.store.path).faults == ()


def test_the_same_content_is_one_run_under_any_number_of_keys(client: TestClient, service: Service) -> None:
    first = send(client)
    other = "/api/v1/axes/bench/runs/r2"
    again, twin = send(client), send(client, other)
    assert (again.status_code, twin.status_code) == (200, 200)
    assert again.json()["id"] == twin.json()["id"] == first.json()["id"]
    assert count(service.store, JobRow) == 1
    work_off(service, result())
    assert [send(client, key).json()["status"] for key in (RUN, other)] == ["done", "done"]
    assert (count(service.store, RunRow), count(service.store, ResultRow)) == (1, 1)


def test_a_key_with_other_content_is_409_and_set_aside(client: TestClient, service: Service) -> None:
    send(client)
    files = {"a.h5": b"other", "b.h5": FILES["b.h5"]}
    answers = [send(client, files=files) for _ in range(2)]
    assert [answer.status_code for answer in answers] == [409, 409]
    assert "other content" in answers[0].json()["detail"]
    assert send(client).status_code == 200
    sent = client.get("/api/v1/axes/bench/runs").json()["sent"]
    assert [each["status"] for each in sent] == ["queued", "conflict"]
    assert count(service.store, JobRow) == 1


def test_a_run_that_was_analysed_at_the_machine_needs_no_job(client: TestClient, service: Service) -> None:
    answers = [send_result(client, 0), send_result(client, 0), send_result(client, 0, "other-key")]
    assert [answer.status_code for answer in answers] == [202, 200, 200]
    assert {answer.json()["status"] for answer in answers} == {"done"}
    assert send_result(client, 1, "analysed-0").status_code == 409
    assert (count(service.store, RunRow), count(service.store, Conflict)) == (1, 0)


def test_documents_that_are_sent_with_the_run_count(client: TestClient, service: Service) -> None:
    plain = send(client).json()["id"]
    same = send(client, "/api/v1/axes/bench/runs/r3", files=FILES | {"c.toml": CHANNELS.encode()})
    assert (same.status_code, same.json()["id"]) == (200, plain)
    files = FILES | {"c.toml": CHANNELS.replace("N m", "mN m").encode()}
    answer = send(client, "/api/v1/axes/bench/runs/r2", files=files)
    assert answer.status_code == 202
    assert answer.json()["id"] != plain
    work_off(service, result())


def toml(**changes: str) -> str:
    """RUN.toml with other lines."""
    lines = dict(line.split(" = ", 1) for line in RUN_TOML.splitlines())
    return "".join(f"{name} = {text}\n" for name, text in (lines | changes).items())


NO_RUNS: list[tuple[dict[str, Any], str]] = [
    ({"run_toml": "x = ["}, "is not TOML"),
    ({"run_toml": "x = 1"}, "x is not a known field"),
    ({"run_toml": toml(files='["a.h5", "c.h5"]')}, "names the file 'c.h5', which was not sent"),
    ({"run_toml": toml(files='["../../a.h5"]', load='"-1 kg"')}, "load"),
    ({"run_toml": toml(measured_at='"yesterday"')}, "ISO 8601"),
    ({"run_toml": toml(measured_at='"0001-01-01T00:00Z"')}, "year"),
    ({"run_toml": "\ud800"}, "unicode"),
    ({"run_toml": None, "measured_at": "soon"}, "measured_at"),
    ({"run_toml": "a = " + "[" * 5000}, "TOML"),
    ({"run_toml": 'x = "' + "y" * (1 << 20)}, "at most"),
    ({"files": []}, "no file"),
    ({"files": [{"name": "a.h5", "sha256": "0" * 64}]}, "is missing: send it first"),
    ({"files": [{"name": "../a.h5", "sha256": sha256(FILES["a.h5"])}]}, "pattern"),
    ({"files": [{"name": "..", "sha256": sha256(FILES["a.h5"])}]}, "pattern"),
    ({"files": [{"name": ".", "sha256": sha256(FILES["a.h5"])}]}, "pattern"),
    ({"files": [{"name": "a\x00", "sha256": sha256(FILES["a.h5"])}]}, "pattern"),
    ({"files": [{"name": "a.h5", "sha256": sha256(FILES["a.h5"])}] * 2}, "the same name"),
    ({"files": 3}, "list"),
    ({"run_json": sha256(FILES["a.h5"])}, "RUN.json: is not JSON"),
    ({"more": 1}, "more"),
]


def test_what_is_no_run_is_refused_with_a_sentence(client: TestClient, service: Service) -> None:
    for content in FILES.values():
        put(client, content)
    for changes, message in NO_RUNS:
        text = json.dumps(body() | changes)  # httpx would refuse what is not Unicode
        answer = client.post(f"{RUN}/complete", content=text, headers={"Content-Type": "application/json"})
        assert answer.status_code == 422, message
        assert message in answer.json()["detail"]
        assert "ballscrew-" not in answer.json()["detail"]
    assert count(service.store, Upload) == count(service.store, JobRow) == 0


def test_a_result_that_is_too_large_is_not_read(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "_RUN_JSON_BYTES", 100)
    answer = send_result(client, 0)
    assert (answer.status_code, "at most" in answer.json()["detail"]) == (422, True)


def test_a_job_of_any_number_is_looked_for(client: TestClient) -> None:
    for number in (-(10**30), -1, 0, 10**30):
        assert client.post(f"/api/v1/jobs/{number}/retry").status_code == 404


def test_a_result_or_a_data_sheet_of_another_axis_is_422(client: TestClient) -> None:
    other = AXIS.replace('"bench"', '"Y axis"')
    client.put("/api/v1/axes/Y axis", json=SETUP | {"sheet": other})
    answer = client.put("/api/v1/axes/bench", json=SETUP | {"sheet": other})
    assert (answer.status_code, "'Y axis', not of 'bench'" in answer.json()["detail"]) == (422, True)
    send_result(client, 0)
    content = write_json(RUNS[0].to_json()).encode()
    answer = client.post(
        "/api/v1/axes/Y axis/runs/r/complete", json={"files": [], "run_json": sha256(content)}
    )
    assert (answer.status_code, "not of 'Y axis'" in answer.json()["detail"]) == (422, True)
    files = FILES | {"sheet.toml": other.encode()}
    answer = send(client, files=files, run_toml=toml(axis='"sheet.toml"'))
    assert (answer.status_code, "'Y axis', not of 'bench'" in answer.json()["detail"]) == (422, True)


def test_a_data_sheet_may_have_the_name_of_another_axis_as_its_file_name(client: TestClient) -> None:
    sheet = AXIS.replace('"bench"', '"axis"')
    assert client.put("/api/v1/axes/axis", json=SETUP | {"sheet": sheet}).status_code == 200
    plain = send(client, run_toml=toml(axis='"axis.toml"'))
    assert plain.status_code == 202
    files = FILES | {"axis.toml": AXIS.encode()}
    again = send(client, "/api/v1/axes/bench/runs/r2", files=files, run_toml=toml(axis='"axis.toml"'))
    assert (again.status_code, again.json()["id"]) == (200, plain.json()["id"])


def test_the_name_of_a_file_may_contain_dots(client: TestClient) -> None:
    names = [".a", "..b", "a..h5", "...trip 1.", "Fräse.h5"]
    files = {name: name.encode() for name in names}
    assert send(client, files=files, run_toml=toml(files=str(names))).status_code == 202


def test_a_queue_that_is_too_long_is_429(new_service: NewService) -> None:
    service = new_service(max_queue=1)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        assert send(client).status_code == 202
        answer = send(client, "/api/v1/axes/bench/runs/r2", files={"a.h5": b"1", "b.h5": b"2"})
        assert answer.status_code == 429
        assert int(answer.headers["Retry-After"]) > 0
        assert send(client).status_code == 200
        assert count(service.store, Upload) == 1


def test_a_run_that_was_refused_is_analysed_again_after_another_set_up(
    client: TestClient, service: Service
) -> None:
    send(client)
    work_off(service, lambda _: ("refused", "a.h5: has no channel 'a'."))
    assert send(client).json()["error"] == "a.h5: has no channel 'a'."
    client.put("/api/v1/axes/bench", json=SETUP | {"channels": CHANNELS.replace('"a"', '"b"')})
    assert send(client).status_code == 202
    work_off(service, result())
    assert send(client).json()["status"] == "done"


def test_a_late_or_other_result_of_the_same_run_is_no_result(client: TestClient, service: Service) -> None:
    """Two contents, such as another channel map, may be one run to the store: the first result stays."""
    send_result(client, 0)
    send(client)
    other = replace(RUNS[0], cells=RUNS[0].cells[1:])
    work_off(service, lambda _: ("done", (other.to_json(), [])))
    sent = client.get("/api/v1/axes/bench/runs").json()["sent"]
    assert [each["status"] for each in sent] == ["done", "conflict"]
    assert count(service.store, ResultRow) == 1


def test_a_run_of_an_axis_that_is_not_set_up_says_what_is_missing(new_service: NewService) -> None:
    service = new_service()
    add_run(service.store, RUNS[0])
    with client_of(service) as client:
        text = f'{RUN_TOML}axis = "axis.toml"\n'
        for files, missing in ((FILES, "data sheet"), (FILES | {"axis.toml": AXIS.encode()}, "channel map")):
            answer = send(client, files=files, run_toml=text)
            assert answer.status_code == 404  # the sender keeps the run
            assert f"the axis has no {missing}: PUT it with the axis" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\xff\xfe", "c.toml: is not a text file in UTF-8."),
        (b"#" * 101, "c.toml: has 101 bytes; a document has 100 at most."),
    ],
)
def test_a_document_that_is_no_short_text_is_refused(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch, content: bytes, sentence: str
) -> None:
    monkeypatch.setattr(runs, "_DOCUMENT_BYTES", 100)
    answer = send(client, files=FILES | {"c.toml": content})
    assert (answer.status_code, answer.json()["detail"]) == (422, sentence)
    assert count(service.store, Upload) == 0
