"""Alarms: raised and retracted by assessments, each with one message, and what people do about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import history
from tests.service.conftest import (
    RUN_TOML,
    SETUP,
    NewService,
    client_of,
    events_of,
    put,
    send,
    send_result,
    sha256,
    work_off,
)
from tests.store.stored import MODEL, RUNS

from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.calibration.modelfile import model_json
from ballscrew.modal.run import Run
from ballscrew.report.monitor_words import NOTHING
from ballscrew.report.what_to_do import OLD
from ballscrew.service.alarms import watch_for_silence
from ballscrew.service.jobs import lease_job
from ballscrew.service.pages.rendering import page_sentence
from ballscrew.service.planning import planned_messages, unclosed_alarms
from ballscrew.service.serving import Service
from ballscrew.service.working import finish
from ballscrew.store.adding import add_run
from ballscrew.store.assessing import monitor_axis
from ballscrew.store.changing import exclude
from ballscrew.store.folder import at_time
from ballscrew.store.service_tables import Message, Setup, Trouble
from ballscrew.store.tables import Audit, Axis


def assess(service: Service) -> None:
    """Do what waits; no run waits for an analysis."""
    work_off(service, lambda _: pytest.fail("no analysis"))


def alarms(client: TestClient) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.get("/api/v1/alarms").json()["alarms"]
    return found


def messages(service: Service) -> list[tuple[str, str]]:
    with service.store.read() as session:
        return [(row.key, row.kind) for row in session.scalars(select(Message).order_by(Message.id))]


def act(client: TestClient, alarm: str, action: str, **others: str) -> Any:
    return client.post(f"/api/v1/alarms/{alarm}", json={"action": action, **others})


def test_an_alarm_is_raised_handled_and_retracted(client: TestClient, service: Service) -> None:
    for number in range(len(RUNS)):
        assert send_result(client, number).status_code == 202
    state = client.get("/api/v1/axes/bench/state").json()
    assert (state["state"], state["missing"]) == ("not assessed", ["model"])
    assess(service)
    assert client.get("/api/v1/jobs").json()["jobs"] == []
    assert client.put("/api/v1/axes/bench/model", json=model_json(MODEL)).status_code == 200
    assess(service)
    state = client.get("/api/v1/axes/bench/state").json()
    assert (state["state"], state["missing"]) == ("alarm", [])
    assert client.get("/api/v1/axes/bench/forecast").json()["rul_days"]["quantiles"]
    (alarm,) = alarms(client)
    assert (alarm["state"], alarm["kind"], alarm["axis"]) == ("raised", "axis", "bench")
    assert messages(service) == [("alarm-1/1", "raised")]
    tomorrow = (datetime.now(UTC) + timedelta(days=1)).isoformat()
    assert act(client, alarm["id"], "acknowledge").json()["state"] == "acknowledged"
    assert act(client, alarm["id"], "shelve", until=tomorrow).json()["state"] == "shelved"
    assert act(client, alarm["id"], "close", text="nut was worn").json()["state"] == "closed"
    assert act(client, alarm["id"], "acknowledge").status_code == 409  # of a window that is not up to date
    for run in RUNS[7:]:
        exclude(service.store, run.id, reason="loose sensor")
    note = [{"at": RUNS[0].measured_at, "kind": "note"}]
    assert client.post("/api/v1/axes/bench/events", json=note).json()["new"]
    assess(service)
    (alarm,) = alarms(client)
    assert alarm["state"] == "closed"
    assert alarm["ended_at"] is not None
    assert messages(service) == [("alarm-1/1", "raised"), ("alarm-1/2", "retracted")]
    assert len(alarms(client)[0]["actions"]) == 3


def test_pages_and_actions_load_no_trouble_that_has_ended(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    monkeypatch.setattr("ballscrew.store.alarms.coded_reason", made.append)
    with service.store.write("test") as session:
        bench = session.scalars(select(Axis.id)).one()
        for number in range(30):
            ended = "2026-02-01T08:00Z" if number else None
            trouble = {"kind": "silence", "began_at": f"2026-01-{number + 1:02}T08:00Z", "text": f"{number}"}
            session.add(Trouble(axis_id=bench, raised_at=trouble["began_at"], ended_at=ended, **trouble))
    for path in ("/", "/status"):
        assert client.get(path).status_code == 200
    assert set(made) == {"0"}
    made.clear()
    assert act(client, "trouble-7", "close", text="no sensor").json()["actions"][0]["text"] == "no sensor"
    assert set(made) == {"6"}
    assert len(alarms(client)) == 30


def test_an_axis_that_cannot_be_assessed_says_why(client: TestClient, service: Service) -> None:
    send_result(client, 0)
    for model in (MODEL, calibrated(runs=("another",))):
        assert client.put("/api/v1/axes/bench/model", json=model_json(model)).json()["new"]
    assess(service)
    state = client.get("/api/v1/axes/bench/state").json()
    assert (state["state"], "2 models of the axis" in state["reasons"][0]) == ("not assessed", True)
    (job,) = client.get("/api/v1/jobs").json()["jobs"]
    assert (job["kind"], job["status"]) == ("assess", "set aside")


def test_a_refused_assessment_is_a_trouble_until_the_axis_is_assessed(
    client: TestClient, service: Service
) -> None:
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    assert client.get("/api/v1/jobs").json()["jobs"] == []  # that a run is missing is no trouble
    files = (replace(RUNS[0].files[0], name="a.h5", sha256="ab" * 32),)
    for number, name in enumerate(("one", "copy")):
        add_run(service.store, replace(RUNS[number], id=name, files=files))
        exclude(service.store, name, reason="not yet")
    for name in ("one", "copy"):
        exclude(service.store, name, undo=True)
    for number in (2, 3):
        send_result(client, number)  # a good run does not end the trouble
        assess(service)
        (alarm,) = alarms(client)
        assert (alarm["kind"], alarm["state"]) == ("assessment", "raised")
        (axis,) = client.get("/api/v1/axes").json()["axes"]
        assert "the same recording, 'a.h5'" in axis["refusal"]
        assert alarm["text"] == f"the axis cannot be assessed: {axis['refusal']}"
        assert alarm["code"] == "axis-not-assessed"
        assert axis["reasons"] == [axis["refusal"]]
        assert "cannot be assessed" in client.get("/").text
    exclusion = "/api/v1/axes/bench/runs/copy/exclusion"
    assert client.post(exclusion, json={"reason": "copied"}).json()["excluded"]
    assess(service)
    assert alarms(client)[0]["state"] == "ended"
    assert client.get("/api/v1/axes").json()["axes"][0]["refusal"] is None
    assert client.delete(exclusion).json() == {
        "schema": SCHEMA, "axis": "bench", "id": "copy", "excluded": False,
    }  # fmt: skip
    assess(service)
    assert [alarm["state"] for alarm in alarms(client)] == ["raised", "ended"]


def test_an_assessment_that_always_fails_is_a_trouble(new_service: NewService) -> None:
    service = new_service(back_off_s=0.0, attempts=2)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
        send_result(client, 0)
        while (lease := lease_job(service)) is not None:
            assert alarms(client) == []
            finish(service, lease, "failed", "x")
        assert [each["text"] for each in alarms(client)] == ["the axis cannot be assessed: x"]


@pytest.mark.parametrize(
    ("axis", "run", "body", "status"),
    [
        ("bench", "none", {"reason": "x"}, 404),
        ("none", RUNS[0].id, {"reason": "x"}, 404),
        ("Y axis", RUNS[0].id, {"reason": "x"}, 404),
        ("bench", RUNS[0].id[:5], {"reason": "x"}, 404),
        ("bench", RUNS[0].id, {"reason": " "}, 422),
        ("bench", RUNS[0].id, {}, 422),
        ("bench", RUNS[0].id, {"reason": "x\x00"}, 422),
    ],
)
def test_what_cannot_be_excluded_is_refused(
    client: TestClient, axis: str, run: str, body: dict[str, str], status: int
) -> None:
    sheet = SETUP["sheet"].replace('"bench"', '"Y axis"')
    client.put("/api/v1/axes/Y axis", json=SETUP | {"sheet": sheet})
    send_result(client, 0)
    assert client.post(f"/api/v1/axes/{axis}/runs/{run}/exclusion", json=body).status_code == status
    assert client.get("/api/v1/axes/bench").json()["exclusions"] == []


@pytest.mark.parametrize(
    ("alarm", "action", "status"),
    [
        ("alarm-9", {"action": "acknowledge"}, 404),
        ("alarm-9999999999999999999", {"action": "acknowledge"}, 404),
        ("alarm-²", {"action": "acknowledge"}, 404),
        ("1", {"action": "acknowledge"}, 404),
        ("alarm-1", {"action": "close"}, 422),
        ("alarm-1", {"action": "shelve"}, 422),
        ("alarm-1", {"action": "shelve", "until": "2001-01-01"}, 422),
        ("alarm-1", {"action": "shelve", "until": "later"}, 422),
        ("alarm-1", {"action": "silence"}, 422),
    ],
)
def test_what_cannot_be_done_is_refused(
    client: TestClient, alarm: str, action: dict[str, str], status: int
) -> None:
    answer = client.post(f"/api/v1/alarms/{alarm}", json=action)
    assert answer.status_code == status
    assert isinstance(answer.json()["detail"], str)


def test_silence_is_raised_once_and_ends_with_the_next_run(client: TestClient, service: Service) -> None:
    client.put("/api/v1/axes/bench", json=SETUP | {"schedule": {"period_s": 3600, "grace_s": 60}})
    later = datetime.now(UTC) + timedelta(hours=2)
    watch_for_silence(service)
    assert alarms(client) == []
    for _ in range(2):
        watch_for_silence(service, later)
    (alarm,) = alarms(client)
    assert (alarm["kind"], alarm["state"]) == ("silence", "raised")
    assert act(client, alarm["id"], "acknowledge").json()["state"] == "acknowledged"
    send(client)
    watch_for_silence(service)
    assert alarms(client)[0]["state"] == "ended"
    assert messages(service) == [("trouble-1/1", "raised"), ("trouble-1/2", "ended")]


def test_silence_begins_when_the_run_was_overdue_and_a_late_analysis_does_not_end_it(
    client: TestClient, service: Service
) -> None:
    client.put("/api/v1/axes/bench", json=SETUP | {"schedule": {"period_s": 3600, "grace_s": 60}})
    begin = datetime.now(UTC)
    send(client)
    later = begin + timedelta(hours=2)
    watch_for_silence(service, later)
    (alarm,) = alarms(client)
    overdue = datetime.fromisoformat(alarm["began_at"]) - begin
    assert timedelta(seconds=3660) <= overdue < timedelta(seconds=3720)
    with at_time(later):
        work_off(service, lambda _: ("done", (RUNS[0].to_json(), [])))
    watch_for_silence(service, later + timedelta(minutes=1))
    assert [each["state"] for each in alarms(client) if each["kind"] == "silence"] == ["raised"]


def test_a_schedule_that_is_removed_ends_its_alarm(client: TestClient, service: Service) -> None:
    client.put("/api/v1/axes/bench", json=SETUP | {"schedule": {"period_s": 1}})
    watch_for_silence(service, datetime.now(UTC) + timedelta(hours=2))
    client.put("/api/v1/axes/bench", json=SETUP)
    watch_for_silence(service, datetime.now(UTC) + timedelta(hours=2))
    assert alarms(client)[0]["state"] == "ended"


def test_a_run_that_cannot_be_analysed_is_trouble_with_the_measurement(
    client: TestClient, service: Service
) -> None:
    send(client)
    work_off(service, lambda _: ("refused", "a.h5: has no channel 'a'."))
    (alarm,) = alarms(client)
    assert (alarm["kind"], alarm["text"]) == ("measurement", "a.h5: has no channel 'a'.")
    assert client.get("/api/v1/axes/bench/state").json()["state"] == "not assessed"
    files = {"a.h5": b"better", "b.h5": b"run"}
    send(client, "/api/v1/axes/bench/runs/r2", files)
    work_off(service, lambda _: ("done", (RUNS[0].to_json(), [])))
    assert alarms(client)[0]["state"] == "ended"


def test_a_bad_run_that_was_analysed_at_the_machine_is_trouble_too(client: TestClient) -> None:
    bad = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))
    assert send_result(client, 0, quality=bad).json()["verdict"] == "bad"
    (alarm,) = alarms(client)
    assert (alarm["kind"], alarm["text"]) == ("measurement", "the sensor is loose.")
    assert alarm["began_at"] == RUNS[0].measured_at
    send_result(client, 1)
    assert alarms(client)[0]["state"] == "ended"


CLIPPED = "torque is clipped at 1.20 N m: 12 samples lie there, 3.1 % of all above half that limit"


@pytest.mark.parametrize(
    ("reasons", "beginning"), [((CLIPPED,) * 1200, f"{CLIPPED}; {CLIPPED}; "), (("x" * 9000,), "xxx")]
)
def test_very_many_reasons_are_a_trouble_with_the_first_ones(
    client: TestClient, reasons: tuple[str, ...], beginning: str
) -> None:
    send_result(client, 0, quality=replace(RUNS[0].quality, verdict="bad", reasons=reasons))
    (alarm,) = alarms(client)
    assert alarm["text"].startswith(beginning)
    assert alarm["text"].endswith("; …")
    assert len(alarm["text"]) < 4010
    for path in ("/alarms", "/axes/bench"):
        assert client.get(path, headers={"Accept-Language": "de"}).status_code == 200


BAD = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))


def test_a_late_older_run_does_not_end_the_trouble_of_a_newer_one(client: TestClient) -> None:
    send_result(client, 3, quality=BAD)
    send_result(client, 1)
    send_result(client, 2, quality=replace(BAD, reasons=("the axis is cold.",)))
    (alarm,) = alarms(client)
    assert (alarm["state"], alarm["began_at"]) == ("raised", RUNS[3].measured_at)
    assert alarm["text"] == "the sensor is loose."
    send_result(client, 4)
    assert alarms(client)[0]["state"] == "ended"
    send_result(client, 0, quality=BAD)  # older than a good one
    assert [alarm["state"] for alarm in alarms(client)] == ["ended"]


def test_a_refused_run_is_a_trouble_from_the_time_that_it_states(
    client: TestClient, service: Service
) -> None:
    send_result(client, 3)
    send(client)  # measured before
    work_off(service, lambda _: ("refused", "a.h5: has no channel 'a'."))
    assert alarms(client) == []


CHANGED = history([3.0 * day for day in range(16)], lambda day: 0.7 if 15 <= day < 21 else 1.0)
"""Runs of an axis of which two alone are soft: the monitor's state is normal again after calm ones."""


def send_runs(client: TestClient, service: Service, runs: Sequence[Run]) -> None:
    for run in runs:
        content = write_json(run.to_json()).encode()
        url = f"/api/v1/axes/bench/runs/{run.id}"
        put(client, content, url)
        answer = client.post(f"{url}/complete", json={"files": [], "run_json": sha256(content)})
        assert answer.status_code == 202
    assess(service)


def test_an_alarm_is_over_once_a_later_run_of_its_epoch_is_normal(
    client: TestClient, service: Service
) -> None:
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    send_runs(client, service, CHANGED[:10])
    assert [(each["state"], each["ended_at"]) for each in alarms(client)] == [("raised", None)]
    with service.store.read() as session:
        assert [name for _, name in unclosed_alarms(session)] == [alarms(client)[0]["id"]]
    send_runs(client, service, CHANGED[10:])
    (alarm,) = alarms(client)
    state = client.get("/api/v1/axes/bench").json()
    normal = [run["measured_at"] for run in state["runs"][8:] if run["state"] == "normal"]
    assert (state["state"], alarm["state"], alarm["ended_at"]) == ("normal", "ended", normal[0])
    with service.store.read() as session:
        assert list(unclosed_alarms(session)) == []
    assert [each["text"] for each in state["to_do"]] == [OLD]
    assert state["alarms"][0]["over_at"] == normal[0]
    assert client.get("/api/v1/axes/bench/trend").json()["alarms"][0]["ended_at"] == normal[0]
    assert messages(service) == [("alarm-1/1", "raised"), ("alarm-1/2", "ended")]
    with service.store.write("test") as session:
        session.get_one(Message, 1).sent_at = session.get_one(Message, 1).at
    with service.store.read() as session:
        assert planned_messages(session, service, datetime.now(UTC)).waiting == {2: "hold time"}
    assert "standing alarm" not in client.get("/").text


def test_an_alarm_of_old_runs_that_come_late_does_not_stand_and_needs_no_message(
    client: TestClient, service: Service
) -> None:
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    send_runs(client, service, [*CHANGED[:5], *CHANGED[7:]])
    assert alarms(client) == []
    send_runs(client, service, CHANGED[5:7])
    assert [each["state"] for each in alarms(client)] == ["ended"]
    assert messages(service) == []


def test_an_alarm_of_an_epoch_before_is_to_be_closed(client: TestClient, service: Service) -> None:
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    send_runs(client, service, CHANGED[:8])
    event = [{"at": CHANGED[7].measured_at, "kind": "nut replaced"}]
    assert client.post("/api/v1/axes/bench/events", json=event).status_code == 200
    send_runs(client, service, CHANGED[8:13])
    (alarm,) = alarms(client)
    sentence = f"Close the alarm of {alarm['began_at'][:10]} with what was found: it still stands."
    found = client.get("/api/v1/axes/bench").json()
    assert (alarm["state"], found["state"]) == ("raised", "normal")
    assert [each["text"] for each in found["to_do"]] == [OLD, sentence]
    for address, shown in (("", page_sentence(sentence, "en")), ("/report.html", sentence)):
        text = client.get(f"/axes/bench{address}").text
        assert shown in text
        assert NOTHING not in text
    assert sentence in monitor_axis(service.store, "bench").notes
    act(client, alarm["id"], "close", text="the nut was worn")
    closed = client.get("/api/v1/axes/bench").json()
    assert [each["text"] for each in closed["to_do"]] == [OLD]


def send_no_recording(client: TestClient, service: Service, key: str = "r1") -> None:
    """Send files that are no recordings and state no time."""
    untimed = "".join(line for line in RUN_TOML.splitlines(keepends=True) if "measured_at" not in line)
    files = {"a.h5": f"{key}, a letter".encode(), "b.h5": f"{key}, another".encode()}
    send(client, f"/api/v1/axes/bench/runs/{key}", files, run_toml=untimed)
    work_off(service, lambda _: ("refused", "a.h5: is no recording."))


def test_files_that_are_no_recording_are_a_trouble_until_the_next_newest_good_run(
    client: TestClient, service: Service
) -> None:
    """They were measured before their receipt, as every run that comes later was too."""
    send_result(client, 2)
    send_no_recording(client, service)
    assert [alarm["state"] for alarm in alarms(client)] == ["raised"]
    send_result(client, 1)  # older than the newest one
    send_result(client, 3, quality=BAD)
    assert [alarm["state"] for alarm in alarms(client)] == ["raised"]
    send_result(client, 4)
    assert [alarm["state"] for alarm in alarms(client)] == ["ended"]
    assert act(client, alarms(client)[0]["id"], "close", text="a letter").status_code == 200


def test_a_closed_trouble_is_no_longer_on_the_lamp_and_the_next_bad_run_raises_another(
    client: TestClient, service: Service
) -> None:
    now = datetime.now(UTC)
    times = [(now - timedelta(days=10 - day)).isoformat(timespec="seconds") for day in range(10)]
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    for number in range(5):
        send_result(client, number, measured_at=times[number])
    assess(service)
    send_no_recording(client, service)
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert [each["kind"] for each in axis["measurement"]["troubles"]] == ["measurement"]
    act(client, alarms(client)[0]["id"], "close", text="a letter")
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert axis["measurement"] == {"troubles": [], "recent": True, "because": None}
    assert 'class="lamp sound"' in client.get("/").text
    send_result(client, 5, measured_at=times[5], quality=BAD)  # before the letter
    assert [alarm["state"] for alarm in alarms(client)] == ["closed"]
    send_no_recording(client, service, "r2")
    assert sorted(alarm["state"] for alarm in alarms(client)) == ["closed", "raised"]


def test_the_measurement_of_a_bad_newest_run_is_bad_also_after_its_trouble_was_closed(
    client: TestClient, service: Service
) -> None:
    now = datetime.now(UTC)
    times = [(now - timedelta(days=10 - day)).isoformat(timespec="seconds") for day in range(10)]
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    for number in range(5):
        send_result(client, number, measured_at=times[number], **({"quality": BAD} if number == 4 else {}))
    assess(service)
    act(client, alarms(client)[0]["id"], "close", text="the sensor was loose")
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert axis["measurement"] == {"troubles": [], "recent": True, "because": "bad"}
    for page in (client.get("/").text, client.get("/axes/bench").text):
        assert 'class="lamp sound"' not in page
        assert "▲</span> bad measurement" in page
    send_result(client, 5, measured_at=times[5], quality=BAD)
    assert sorted(alarm["state"] for alarm in alarms(client)) == ["closed", "raised"]


def test_files_that_are_no_recording_do_not_hide_silence(client: TestClient, service: Service) -> None:
    client.put("/api/v1/axes/bench", json=SETUP | {"schedule": {"period_s": 3600}})
    before = (datetime.now(UTC) - timedelta(hours=2)).isoformat()
    with service.store.write("test") as session:
        session.scalars(select(Setup)).one().set_up_at = before
    send_no_recording(client, service)
    watch_for_silence(service)
    assert {alarm["kind"] for alarm in alarms(client)} == {"measurement", "silence"}


def test_a_preview_of_a_reset_stores_nothing(client: TestClient) -> None:
    for number in range(8):
        send_result(client, number)
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    event = [{"at": RUNS[5].measured_at, "kind": "nut replaced"}]
    found = client.post("/api/v1/axes/bench/events?preview=true", json=event).json()
    assert (len(found["before"]["epochs"]), len(found["after"]["epochs"])) == (1, 2)
    assert client.get("/api/v1/axes/bench").json()["events"] == []
    assert client.post("/api/v1/axes/bench/events", json=event).json()["new"]
    assert len(client.get("/api/v1/axes/bench").json()["events"]) == 1


def test_one_preview_is_computed_at_a_time(client: TestClient, service: Service) -> None:
    send_result(client, 0)
    client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
    url, event = "/api/v1/axes/bench/events?preview=true", [{"at": RUNS[5].measured_at, "kind": "note"}]
    with service.computing("this test"):
        answer = client.post(url, json=event)
    assert (answer.status_code, answer.headers["Retry-After"]) == (503, "10")
    assert client.post(url, json=[{"at": "soon", "kind": "note"}]).status_code == 422
    assert [client.post(url, json=event).status_code for _ in range(2)] == [200, 200]


def test_the_same_action_of_the_same_person_counts_once(client: TestClient, service: Service) -> None:
    send_result(client, 0, quality=BAD)
    (alarm,) = alarms(client)
    tomorrow = (datetime.now(UTC) + timedelta(days=1)).isoformat()
    given: list[tuple[str, dict[str, str]]] = [
        ("reopen", {}), ("acknowledge", {}), ("acknowledge", {}), ("acknowledge", {"text": "on Monday"}),
        ("shelve", {"until": tomorrow}), ("shelve", {"until": tomorrow}), ("close", {"text": "loose"}),
        ("close", {"text": "loose"}), ("reopen", {}), ("reopen", {}), ("acknowledge", {}),
    ]  # fmt: skip
    answers = [act(client, alarm["id"], action, **others).json() for action, others in given]
    assert answers[1] == answers[2]
    assert [len(answer["actions"]) for answer in answers] == [0, 1, 1, 2, 3, 3, 4, 4, 5, 5, 6]
    with service.store.read() as session:
        written = session.scalars(select(Audit).where(Audit.subject == alarm["id"])).all()
    assert len(written) == 6


def test_a_weekend_is_no_silence(new_service: NewService) -> None:
    service = new_service(working_days=("Mon", "Tue", "Wed", "Thu", "Fri"), time_zone="Europe/Berlin")
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP | {"schedule": {"period_s": 24 * 3600}})
        now = datetime.now(UTC)
        sunday = now + timedelta(days=6 - now.weekday(), weeks=1)
        with service.store.write("test") as session:
            for setup in session.scalars(select(Setup)):
                setup.set_up_at = (sunday - timedelta(days=2)).isoformat()  # Friday at this time of day
        watch_for_silence(service, sunday)
        assert alarms(client) == []
        watch_for_silence(service, sunday + timedelta(days=2))
        assert [alarm["kind"] for alarm in alarms(client)] == ["silence"]


def test_what_changes_is_streamed_without_a_gap(client: TestClient, service: Service) -> None:
    send_result(client, 0)
    service.stopping.set()  # the stream ends
    everything = client.get("/api/v1/events", headers={"Last-Event-ID": "0"}).text
    subjects = [event["subject"] for event in events_of(everything)]
    assert subjects[0] == "store"  # its creation
    assert f"run {RUNS[0].id}" in subjects
    last = everything.rsplit("id: ", 1)[1].split("\n")[0]
    assert events_of(client.get("/api/v1/events", headers={"Last-Event-ID": last}).text) == []
    assert client.get("/api/v1/events", headers={"Last-Event-ID": "x" * 99}).status_code == 200


def test_a_trouble_is_closed_with_a_text_and_without_a_finding(client: TestClient) -> None:
    quality = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))
    send_result(client, 0, quality=quality)
    (trouble,) = alarms(client)
    answer = act(client, trouble["id"], "close", text="fixed", finding="preload loss")
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith("a finding is that of an alarm of an axis")
    assert alarms(client) == [trouble]
    assert act(client, trouble["id"], "close", text="fixed").status_code == 200
