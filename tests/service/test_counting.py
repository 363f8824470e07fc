"""Runs that do not count by themselves: parts of more complete runs, and runs with doubtful times."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import permutations
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import (
    CHANNELS,
    FILES,
    RUN_TOML,
    SETUP,
    send,
    send_result,
    sha256,
    work_off,
)
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS

from ballscrew.base.provenance import FileRef
from ballscrew.calibration.modelfile import model_json
from ballscrew.service.alarms import watch_for_silence
from ballscrew.service.jobs import lease_job
from ballscrew.service.serving import Service
from ballscrew.service.working import finish
from ballscrew.store.service_tables import Setup, Upload
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit, RunRow

TRIPS = tuple(FileRef(f"trip{number}.h5", f"{number:02d}" * 32) for number in range(1, 5))
BAD = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))


def send_trips(client: TestClient, name: str, trips: str, **changes: Any) -> None:
    """Send a run that was analysed at the machine from the trips of these numbers."""
    files = tuple(TRIPS[int(number) - 1] for number in trips)
    number = {"incomplete": 5, "complete": 6, "more": 7}[name]
    given = {"key": name, "id": name, "files": files} | changes
    assert send_result(client, number, **given).status_code == 202


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


def test_parts_of_a_bad_run_that_does_not_count_stay(client: TestClient) -> None:
    send_trips(client, "incomplete", "1")
    send_trips(client, "complete", "2", quality=BAD)
    send_trips(client, "more", "12", quality=BAD)
    assert counting(client) == {"incomplete", "complete"}


def act(client: TestClient, action: str, run: str) -> str:
    """Exclude, include or correct a run as a person; the id of the result."""
    url = f"/api/v1/axes/bench/runs/{run}"
    if action == "exclude":
        answer = client.post(f"{url}/exclusion", json={"reason": "a test"})
    elif action == "include":
        answer = client.delete(f"{url}/exclusion")
    else:
        answer = client.post(f"{url}/correct", json={"measured_at": RUNS[4].measured_at, "reason": "a test"})
    assert answer.status_code == 200
    return str(answer.json()["id"])


@pytest.mark.parametrize("doubtful", ["incomplete", "complete"])
def test_a_part_whose_time_is_corrected_does_not_count_beside_the_whole(
    client: TestClient, doubtful: str
) -> None:
    for name, trips in (("incomplete", "12"), ("complete", "123")):
        send_trips(client, name, trips, **({"measured_at": FUTURE} if name == doubtful else {}))
    assert counting(client) == {"incomplete", "complete"} - {doubtful}
    corrected = act(client, "correct", doubtful)
    assert counting(client) == {corrected if doubtful == "complete" else "complete"}
    assert client.get("/api/v1/axes/bench").json()["shared_recordings"] == []


def test_a_part_that_a_person_includes_again_does_not_count_beside_the_whole(client: TestClient) -> None:
    send_trips(client, "incomplete", "12")
    act(client, "exclude", "incomplete")
    send_trips(client, "complete", "123")
    act(client, "include", "incomplete")
    assert counting(client) == {"complete"}


@pytest.mark.parametrize("order", list(permutations(("incomplete", "complete", "more"))))
def test_the_most_complete_part_counts_while_the_whole_is_excluded(
    client: TestClient, order: tuple[str, ...]
) -> None:
    trips = {"incomplete": "12", "complete": "123", "more": "1234"}
    for name in order:
        send_trips(client, name, trips[name])
    act(client, "exclude", "more")
    assert counting(client) == {"complete"}
    act(client, "exclude", "complete")
    assert counting(client) == {"incomplete"}
    act(client, "include", "more")
    assert counting(client) == {"more"}
    corrected = act(client, "correct", "more")
    act(client, "exclude", corrected)
    assert counting(client) == {"incomplete"}  # the other one is excluded by a person


def test_a_store_without_its_server_lets_the_part_count_too(client: TestClient, service: Service) -> None:
    for name, trips in (("incomplete", "12"), ("complete", "123")):
        send_trips(client, name, trips)
    store = Store(service.store.path)
    store.exclude("complete", reason="a test")
    assert counting(client) == {"incomplete"}
    store.exclude("complete", undo=True)
    assert counting(client) == {"complete"}
    store.exclude("incomplete", undo=True)
    assert counting(client) == {"incomplete", "complete"}


def test_a_part_counts_if_the_whole_is_bad_in_the_history(client: TestClient) -> None:
    send_trips(client, "incomplete", "12")
    send_trips(client, "complete", "123", quality=BAD)
    assert counting(client) == {"incomplete"}
    made = replace(RUNS[6].made, settings={**RUNS[6].made.settings, "another": 1})
    send_trips(client, "complete", "123", made=made, key="another")  # not of the history
    assert counting(client) == {"incomplete"}
    act(client, "exclude", "incomplete")
    assert counting(client) == {"complete"}


@pytest.mark.parametrize(("trips", "changes"), [("23", {}), ("12", {}), ("123", {"mass_kg": 1.0})])
def test_a_run_that_shares_trips_with_another_without_being_more_complete_is_refused(
    client: TestClient, trips: str, changes: dict[str, Any]
) -> None:
    send_trips(client, "incomplete", "12")
    files = tuple(TRIPS[int(number) - 1] for number in trips)
    answer = send_result(client, 6, key="complete", id="complete", files=files, **changes)
    assert answer.status_code == 409
    assert "belongs to the run 'incomplete' of 2026" in answer.json()["detail"]
    assert counting(client) == {"incomplete"}
    send_trips(client, "more", "34")
    assert counting(client) == {"incomplete", "more"}
    assert client.get("/api/v1/axes/bench").json()["exclusions"] == []


OTHER_TIME = RUN_TOML.replace("01-01T08:00:00Z", "01-02T08:00:00Z")
R2 = "/api/v1/axes/bench/runs/r2"


@pytest.mark.parametrize("analysed", [False, True])
def test_the_same_files_with_another_time_are_refused_until_the_first_run_does_not_count(
    client: TestClient, service: Service, analysed: bool
) -> None:
    send(client)
    files = tuple(FileRef(name, sha256(content)) for name, content in FILES.items())
    first = replace(RUNS[0], files=files)
    if analysed:
        work_off(service, lambda _: ("done", (first.to_json(), [])))
    answer = send(client, R2, run_toml=OTHER_TIME)
    assert answer.status_code == 409
    name = first.id[:12] if analysed else "r1"
    assert f"the recording 'a.h5' belongs to the run '{name}' of " in answer.json()["detail"]
    assert len(client.get("/api/v1/axes/bench/runs").json()["sent"]) == 1
    if analysed:
        assert client.post(f"/api/v1/axes/bench/runs/{first.id}/exclusion", json={"reason": "x"}).is_success
        assert send(client, R2, run_toml=OTHER_TIME).status_code == 202


def test_the_same_files_are_refused_after_their_analysis_where_no_time_was_stated(
    client: TestClient, service: Service
) -> None:
    files = tuple(FileRef(name, sha256(content)) for name, content in FILES.items())
    runs = {"r1": replace(RUNS[0], files=files), "r2": replace(RUNS[1], files=files)}
    untimed = "".join(line for line in RUN_TOML.splitlines(True) if "measured_at" not in line)
    send(client)
    assert send(client, R2, run_toml=untimed).status_code == 202
    for name in runs:
        work_off_first(service, runs[name])
    sent = client.get("/api/v1/axes/bench/runs").json()["sent"]
    assert [each["status"] for each in sent] == ["done", "refused"]
    assert "belongs to the run" in sent[1]["error"]
    assert client.get("/api/v1/alarms").json()["alarms"] == []  # nothing is wrong with the measurement
    exclusion = f"/api/v1/axes/bench/runs/{RUNS[0].id}/exclusion"
    assert client.post(exclusion, json={"reason": "the other one is right"}).is_success
    assert send(client, R2, run_toml=untimed).status_code == 202
    work_off_first(service, runs["r2"])
    assert counting_all(client) == {RUNS[1].id}


def work_off_first(service: Service, run: Any) -> None:
    """Analyse the run that waits longest."""
    lease = lease_job(service)
    assert lease is not None
    finish(service, lease, "done", (run.to_json(), []))


def counting_all(client: TestClient) -> set[str]:
    runs = client.get("/api/v1/axes/bench/runs").json()["runs"]
    return {each["run"] for each in runs if each["counts"]}


def test_the_files_of_another_axis_are_refused(client: TestClient) -> None:
    sheet = AXIS.replace('"bench"', '"Y axis"')
    client.put("/api/v1/axes/Y axis", json=SETUP | {"sheet": sheet})
    send(client)
    other = "/api/v1/axes/Y axis/runs/r1"
    answer = send(client, other)
    assert answer.status_code == 409
    assert "of the axis 'bench' already: send the recordings of the axis 'Y axis'" in answer.json()["detail"]
    client.put(
        "/api/v1/axes/Y axis", json=SETUP | {"sheet": sheet, "channels": CHANNELS.replace('"a"', '"y"')}
    )
    assert send(client, other).status_code == 202  # two axes in one file


FUTURE = (datetime.now(UTC) + timedelta(days=400)).isoformat()
"""Of a clock that is wrong."""


def standing(client: TestClient) -> list[tuple[str, str]]:
    """Actor and reason of each exclusion that has not ended."""
    found = client.get("/api/v1/axes/bench").json()["exclusions"]
    return [(each["actor"], each["reason"]) for each in found if each["ended_at"] is None]


def test_a_run_from_the_future_does_not_count_until_its_time_is_corrected(
    client: TestClient, service: Service
) -> None:
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    for number in range(4):
        assert send_result(client, number).json()["doubt"] is None
    answer = send_result(client, 4, measured_at=FUTURE)
    doubt = f"measured_at, {FUTURE}, is in the future."
    assert (answer.status_code, answer.json()["doubt"]) == (202, doubt)
    work_off(service, lambda _: pytest.fail("no analysis"))
    assert standing(client) == [("server", doubt)]
    state = client.get("/api/v1/axes/bench/state").json()
    assert (state["newest_at"], state["refusal"]) == (RUNS[3].measured_at, None)
    assert client.get(f"/api/v1/runs/{RUNS[4].id}").json()["sent"][0]["doubt"] == doubt
    assert send_result(client, 4, measured_at=FUTURE).json()["doubt"] == doubt
    correction = {"measured_at": RUNS[4].measured_at, "reason": "the clock was wrong"}
    corrected = client.post(f"/api/v1/axes/bench/runs/{RUNS[4].id}/correct", json=correction)
    assert corrected.status_code == 200
    assert standing(client) == []
    work_off(service, lambda _: pytest.fail("no analysis"))
    assert client.get("/api/v1/axes/bench/state").json()["newest_at"] == RUNS[4].measured_at
    assert client.get(f"/api/v1/runs/{RUNS[4].id}").json()["sent"][0]["doubt"] is None
    assert Store.verify(service.store.path).faults == ()


def test_a_clock_may_be_ahead_by_five_minutes(client: TestClient) -> None:
    for number, seconds in ((0, 240), (1, 360)):
        time = (datetime.now(UTC) + timedelta(seconds=seconds)).isoformat()
        assert (send_result(client, number, measured_at=time).json()["doubt"] is None) == (seconds < 300)


@pytest.mark.parametrize("first", [True, False])
def test_a_time_far_from_all_others_is_doubtful(client: TestClient, first: bool) -> None:
    """Of a clock that lost its battery; the first run of an axis has no others."""
    if not first:
        send_result(client, 1)
    found = send_result(client, 0, measured_at="2000-01-01T00:01:00+00:00").json()["doubt"]
    if first:
        assert found is None
        return
    assert "2000-01-01T00:01:00+00:00, is more than a year from every other run" in found
    assert [actor for actor, _ in standing(client)] == ["server"]
    assert client.delete(f"/api/v1/axes/bench/runs/{RUNS[0].id}/exclusion").status_code == 200
    assert standing(client) == []  # a person has decided


@pytest.mark.parametrize("done", ["corrected", "excluded"])
def test_a_run_that_no_longer_counts_makes_no_clock_right(client: TestClient, done: str) -> None:
    """Of a clock without a battery, the first run of the axis is not doubtful, and a person has to act."""
    first = send_result(client, 0, measured_at="2000-01-01T00:01:00+00:00").json()
    assert first["doubt"] is None
    url = f"/api/v1/axes/bench/runs/{RUNS[0].id}"
    if done == "corrected":
        client.post(f"{url}/correct", json={"measured_at": RUNS[0].measured_at, "reason": "battery"})
    else:
        client.post(f"{url}/exclusion", json={"reason": "battery"})
    assert send_result(client, 1).json()["doubt"] is None
    assert (
        "from every other run"
        in send_result(client, 2, measured_at="2000-01-01T00:02:00+00:00").json()["doubt"]
    )
    text = RUN_TOML.replace("2026-01-01T08:00:00Z", '"2000-01-01T00:03:00+00:00"')
    assert "from every other run" in send(client, run_toml=text).json()["doubt"]  # before its analysis


def test_a_run_after_a_long_pause_is_not_doubtful(client: TestClient) -> None:
    send_result(client, 0, measured_at="2020-01-01T00:00:00+00:00")
    assert send_result(client, 1, measured_at=datetime.now(UTC).isoformat()).json()["doubt"] is None


def test_a_run_whose_time_is_doubtful_neither_hides_silence_nor_ends_a_trouble(
    client: TestClient, service: Service
) -> None:
    client.put("/api/v1/axes/bench", json=SETUP | {"schedule": {"period_s": 3600}})
    send_result(client, 0, quality=BAD)
    before = (datetime.now(UTC) - timedelta(hours=2)).isoformat(timespec="milliseconds")
    with service.store.write("test") as session:
        session.scalars(select(Setup)).one().set_up_at = before
        for row in (*session.scalars(select(RunRow)), *session.scalars(select(Upload))):
            row.received_at = before
    watch_for_silence(service)
    for doubtful in (True, False):
        time = FUTURE if doubtful else RUNS[2].measured_at
        text = RUN_TOML.replace("2026-01-01T08:00:00Z", f'"{time}"')
        run = f"/api/v1/axes/bench/runs/{doubtful}"
        send_result(client, 1 if doubtful else 2, measured_at=time)
        watch_for_silence(service)
        files = {name: f"{time} {name}".encode() for name in FILES}
        answer = send(client, run, files, run_toml=text).json()  # which waits for its analysis
        assert (answer["doubt"] is not None) == doubtful
        watch_for_silence(service)
        troubles = client.get("/api/v1/alarms").json()["alarms"]
        states = {each["kind"]: each["state"] for each in troubles}
        assert set(states.values()) == ({"raised"} if doubtful else {"ended"})


def test_a_refused_run_with_a_doubtful_time_is_a_trouble_from_its_receipt(
    client: TestClient, service: Service
) -> None:
    answer = send(client, run_toml=RUN_TOML.replace("2026-01-01T08:00:00Z", f'"{FUTURE}"')).json()
    work_off(service, lambda _: ("refused", "a.h5: has no channel 'a'."))
    (trouble,) = client.get("/api/v1/alarms").json()["alarms"]
    assert trouble["began_at"] == answer["received_at"]


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({}, 422),
        ({"measured_at": "soon"}, 422),
        ({"measured_at": FUTURE}, 422),
        ({"mass_kg": -1}, 422),
        ({"measured_at": RUNS[1].measured_at, "reason": "x\x00"}, 422),
        ({"measured_at": RUNS[1].measured_at, "more": 1}, 422),
    ],
)
def test_what_cannot_be_corrected_is_refused(client: TestClient, body: dict[str, Any], status: int) -> None:
    send_result(client, 0)
    answer = client.post(f"/api/v1/axes/bench/runs/{RUNS[0].id}/correct", json=body)
    assert (answer.status_code, type(answer.json()["detail"])) == (status, str)
    assert client.get("/api/v1/axes/bench").json()["corrections"] == []


def test_a_correction_states_by_whom_it_was_made(client: TestClient, service: Service) -> None:
    send_result(client, 0)
    body = {"measured_at": RUNS[1].measured_at, "reason": "the clock was wrong"}
    answer = client.post(f"/api/v1/axes/bench/runs/{RUNS[0].id}/correct", json=body).json()
    assert answer["supersedes"] == RUNS[0].id
    (correction,) = client.get("/api/v1/axes/bench").json()["corrections"]
    assert (correction["run"], correction["actor"]) == (answer["id"], "local")
    with service.store.read() as session:
        rows = session.scalars(select(Audit).where(Audit.action == "correct")).all()
    assert [row.detail["by"] for row in rows] == ["local"]
    again = client.post(f"/api/v1/axes/bench/runs/{RUNS[0].id}/correct", json=body)
    assert again.json()["id"] == answer["id"]
    body["measured_at"] = RUNS[2].measured_at
    again = client.post(f"/api/v1/axes/bench/runs/{RUNS[0].id}/correct", json=body)
    assert (again.status_code, "was corrected already" in again.json()["detail"]) == (422, True)


@pytest.mark.parametrize("measured_at", [FUTURE, RUNS[4].measured_at], ids=["future", "past"])
def test_a_bad_run_of_a_doubtful_time_is_a_trouble_of_the_time_at_which_it_came(
    client: TestClient, measured_at: str
) -> None:
    """Else the trouble would begin in the future, and no good run could end it."""
    for number in range(4):
        send_result(client, number)
    send_result(client, 4, quality=BAD, measured_at=measured_at)
    (trouble,) = client.get("/api/v1/alarms").json()["alarms"]
    received = client.get(f"/api/v1/runs/{RUNS[4].id}").json()["sent"][0]["received_at"]
    assert trouble["kind"] == "measurement"
    assert trouble["began_at"] == (received if measured_at == FUTURE else measured_at)
