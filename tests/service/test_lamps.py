"""Lamps: without recent data the state of an axis is unknown, and never that of its newest run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.monitoring.histories import at, history
from tests.service.conftest import SETUP, NewService, client_of, put, send, sha256, work_off
from tests.store.stored import MODEL, RUNS

from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.modelfile import model_json
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.recording.quality.finding import Quality
from ballscrew.service.alarms import watch_for_silence
from ballscrew.service.serving import Service
from ballscrew.store.adding import add_run
from ballscrew.store.calendars import EVERY_DAY, RunCalendar
from ballscrew.store.changing import exclude
from ballscrew.store.lamps import URGENCY, add_lamps
from ballscrew.store.reporting import report
from ballscrew.store.service_tables import Setup

NEWEST = moment(at(21.0), "a run")
SCHEDULE = {"period_s": 3 * 86400.0, "grace_s": 86400.0}
GREEN = ("normal", "learning")

Lamp = Callable[..., dict[str, Any]]


@pytest.fixture
def lamp(client: TestClient, service: Service) -> Lamp:  # noqa: ARG001  it sets the axis up
    """Lamp of an axis of a state, a number of days after its newest run."""

    def show(days: float, state: str = "normal", calendar: RunCalendar = EVERY_DAY) -> dict[str, Any]:
        document: dict[str, Any] = {"axis": "bench", "state": state, "last_state": state}
        document |= dict.fromkeys(("newest_at", "assessed_until"), NEWEST.isoformat())
        document |= dict.fromkeys(("newest_run", "changed_at", "assessed_at"))
        with service.store.read() as session:
            add_lamps(session, [document], NEWEST + timedelta(days=days), calendar)
        return document

    return show


def assess(service: Service, runs: Sequence[Run]) -> None:
    """Add runs and a model, and assess the axis."""
    for run in runs:
        add_run(service.store, Run.from_json(run.to_json()))
    with client_of(service) as client:
        assert client.put("/api/v1/axes/bench/model", json=model_json(MODEL)).status_code == 200
    work_off(service, lambda _: pytest.fail("no analysis"))


def set_schedule(service: Service, schedule: dict[str, float] | None) -> None:
    """Give the axis a schedule that began before its runs."""
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP | {"schedule": schedule})
    with service.store.write("test") as session:
        session.scalars(select(Setup)).one().set_up_at = at(0.0)


@pytest.mark.parametrize("state", URGENCY)
def test_a_recent_run_shows_its_state(lamp: Lamp, service: Service, state: str) -> None:
    set_schedule(service, SCHEDULE)
    assert lamp(1.0, state)["lamp"] == {"state": state, "because": None}


def test_a_clock_a_week_ahead_makes_an_axis_with_a_schedule_unknown(lamp: Lamp, service: Service) -> None:
    set_schedule(service, SCHEDULE)
    assert lamp(7.0)["lamp"] == {"state": "unknown", "because": "overdue"}


@pytest.mark.parametrize("beyond_s", [-1.0, 1.0])
def test_the_lamp_changes_after_period_and_grace(lamp: Lamp, service: Service, beyond_s: float) -> None:
    set_schedule(service, SCHEDULE)
    days = (SCHEDULE["period_s"] + SCHEDULE["grace_s"] + beyond_s) / 86400
    assert (lamp(days)["lamp"]["state"] == "unknown") == (beyond_s > 0)


@pytest.mark.parametrize(("days", "is_unknown"), [(30.9, False), (31.1, True), (3650.0, True)])
def test_an_axis_without_a_schedule_is_unknown_once_its_newest_run_is_old(
    lamp: Lamp, days: float, is_unknown: bool
) -> None:
    found = lamp(days)["lamp"]
    assert (found["state"] == "unknown") == is_unknown
    assert found["because"] == ("old" if is_unknown else None)


@pytest.mark.parametrize("state", ["normal", "alarm"])
def test_no_lamp_is_overdue_because_of_a_weekend(lamp: Lamp, service: Service, state: str) -> None:
    """The newest run is of a Thursday."""
    set_schedule(service, {"period_s": 2 * 86400.0, "grace_s": 3600.0})
    week = RunCalendar(weekdays=tuple(range(5)))
    assert lamp(3.0, state)["measurement"]["recent"] is False
    found = lamp(3.0, state, week)
    assert (found["lamp"]["state"], found["measurement"]["recent"]) == (state, True)
    assert found["due_at"] == (NEWEST + timedelta(days=4)).isoformat()  # Monday
    assert lamp(4.1, state, week)["measurement"]["because"] == "overdue"


def test_the_lamps_of_the_server_have_its_holidays(new_service: NewService) -> None:
    now = datetime.now(UTC)
    days = tuple((now - timedelta(days=day)).date() for day in range(-1, 9))
    for holidays, because in (((), "overdue"), (days, None)):
        service = new_service(holidays=holidays)
        with client_of(service) as client:
            client.put("/api/v1/axes/bench", json=SETUP)
            assess(service, RUNS[:4])
            set_schedule(service, SCHEDULE)
            with service.store.write("test") as session:
                session.scalars(select(Setup)).one().set_up_at = (now - timedelta(days=8)).isoformat()
            (axis,) = client.get("/api/v1/axes").json()["axes"]
            for found in (axis, client.get("/api/v1/axes/bench").json()):
                assert found["measurement"]["because"] == because
            assert ("its run is overdue" in client.get("/axes/bench/report.html").text) == bool(because)


def test_an_alarm_and_a_watch_stay_visible_without_data(lamp: Lamp, service: Service) -> None:
    set_schedule(service, SCHEDULE)
    for state in ("alarm", "watch", "unloaded", "suspect"):
        assert lamp(365.0, state)["lamp"]["state"] == state


def test_a_repair_after_the_newest_run_leaves_the_state_unknown(lamp: Lamp, client: TestClient) -> None:
    event = {"at": (NEWEST + timedelta(days=1)).isoformat(), "kind": "greased"}
    assert client.post("/api/v1/axes/bench/events", json=[event]).status_code == 200
    assert lamp(2.0, "alarm")["lamp"]["state"] == "alarm"
    event["kind"] = "nut replaced"
    assert client.post("/api/v1/axes/bench/events", json=[event]).status_code == 200
    for state in ("alarm", "normal"):
        assert lamp(2.0, state)["lamp"] == {"state": "unknown", "because": "reset"}
        assert lamp(0.5, state)["lamp"]["state"] == state


def test_the_measurement_is_good_only_with_a_recent_run(lamp: Lamp, service: Service) -> None:
    for schedule, because in ((None, "old"), (SCHEDULE, "overdue")):
        set_schedule(service, schedule)
        for state in URGENCY:
            assert lamp(1.0, state)["measurement"] == {"troubles": [], "recent": True, "because": None}
            found = lamp(270.0, state)["measurement"]
            assert found == {"troubles": [], "recent": False, "because": because}


@pytest.mark.parametrize("schedule", [None, SCHEDULE])
@pytest.mark.parametrize("ahead_s", [240.0, 360.0, 9 * 365 * 86400.0])
def test_a_newest_run_in_the_future_does_not_make_a_lamp_green(
    lamp: Lamp, service: Service, schedule: dict[str, float] | None, ahead_s: float
) -> None:
    set_schedule(service, schedule)
    found = lamp(-ahead_s / 86400)
    if ahead_s < 300:
        assert (found["lamp"]["state"], found["measurement"]["recent"]) == ("normal", True)
        return
    assert found["lamp"] == {"state": "unknown", "because": "future"}
    assert found["measurement"] == {"troubles": [], "recent": False, "because": "future"}
    assert found["due_at"] is None
    assert lamp(-ahead_s / 86400, "alarm")["lamp"]["state"] == "alarm"


def test_an_axis_without_a_run_has_no_good_measurement(client: TestClient, service: Service) -> None:
    for runs, words, because in (((), "no run yet", "no run"), (RUNS[:1], "no recent run", "old")):
        for run in runs:
            add_run(service.store, run)
        (axis,) = client.get("/api/v1/axes").json()["axes"]
        for found in (axis, client.get("/api/v1/axes/bench").json()):
            assert found["measurement"] == {"troubles": [], "recent": False, "because": because}
        for page in (client.get("/").text, client.get("/axes/bench").text):
            assert 'class="lamp sound"' not in page
            assert f"○</span> {words}</span>" in page


def test_an_alarm_whose_newest_run_is_old_has_no_good_measurement(
    client: TestClient, service: Service
) -> None:
    assess(service, RUNS)
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert (axis["lamp"]["state"], axis["measurement"]["because"]) == ("alarm", "old")
    for page in (client.get("/").text, client.get("/axes/bench").text):
        assert 'class="lamp alarm' in page
        assert 'class="lamp sound"' not in page
        assert "○</span> no recent run</span>" in page
    assert "Run the test: the newest run is too old" in page


def test_no_state_is_green_without_data(lamp: Lamp, service: Service) -> None:
    for schedule in (SCHEDULE, None):
        set_schedule(service, schedule)
        for state in (*GREEN, "not assessed", "unknown"):
            assert lamp(400.0, state)["lamp"]["state"] not in GREEN


def test_the_lamp_is_unknown_where_the_newest_runs_were_set_aside(
    lamp: Lamp, service: Service, client: TestClient
) -> None:
    runs = history([3.0 * day for day in range(7)])
    bad = Quality("bad", ("clipped",))
    assess(service, runs[:4])
    assert lamp(0.5)["lamp"]["state"] == "normal"
    assess(service, [replace(run, quality=bad) for run in runs[4:]])
    assert lamp(0.5)["lamp"] == {"state": "unknown", "because": "set aside"}
    text = client.get("/").text
    assert 'class="lamp unknown"' in text
    assert 'class="lamp normal"' not in text


def test_a_sender_that_has_stopped_is_a_trouble_and_no_green_lamp(
    client: TestClient, service: Service
) -> None:
    assess(service, history([3.0 * day for day in range(8)]))
    set_schedule(service, SCHEDULE)
    watch_for_silence(service, datetime.now(UTC) + timedelta(days=7))
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert axis["state"] in GREEN
    assert axis["lamp"] == {"state": "unknown", "because": "overdue"}
    assert [trouble["kind"] for trouble in axis["measurement"]["troubles"]] == ["silence"]
    assert client.get("/api/v1/axes/bench").json()["lamp"] == axis["lamp"]
    page = client.get("/").text
    assert 'class="lamp unknown"' in page
    assert 'class="lamp normal"' not in page
    assert 'class="lamp sound"' not in page


def test_runs_that_wait_or_were_refused_do_not_make_a_lamp_green(
    client: TestClient, service: Service
) -> None:
    send(client)
    for outcome in ("failed", "refused"):
        (axis,) = client.get("/api/v1/axes").json()["axes"]
        assert axis["lamp"]["state"] == "not assessed"
        work_off(service, lambda _, outcome=outcome: (outcome, "a reason"))
    assert 'class="lamp normal"' not in client.get("/").text


RECENT = [
    replace(run, measured_at=(datetime.now(UTC) - timedelta(days=30 - 3 * number)).isoformat())
    for number, run in enumerate(history([3.0 * day for day in range(8)]))
]


def test_while_runs_wait_the_lamp_is_that_of_the_newest_assessment(
    client: TestClient, service: Service
) -> None:
    assess(service, RECENT[:6])
    for waiting in (1, 2):
        content = write_json(Run.to_json(RECENT[5 + waiting])).encode()
        url = f"/api/v1/axes/bench/runs/r{waiting}"
        put(client, content, url)
        body = {"files": [], "run_json": sha256(content)}
        assert client.post(f"{url}/complete", json=body).status_code == 202
        (axis,) = client.get("/api/v1/axes").json()["axes"]
        assert (axis["state"], axis["waiting"]) == ("unknown", waiting)
        assert axis["newest_at"] == RECENT[5 + waiting].measured_at
        assert axis["assessed_until"] == RECENT[5].measured_at
        for found in (axis, client.get("/api/v1/axes/bench").json()):
            assert found["lamp"] == {"state": "normal", "because": None}
        words = "1 run waits" if waiting == 1 else "2 runs wait"
        for page in (client.get("/").text, client.get("/axes/bench").text):
            assert words in page
            assert 'class="lamp unknown' not in page.split("Runs (")[0]
    text = client.get("/axes/bench/report.html").text
    assert "normal, 2 runs waiting" in text
    assert send(client, "/api/v1/axes/bench/runs/r3").status_code == 202  # for its analysis
    assert client.get("/api/v1/axes/bench").json()["waiting"] == 3
    work_off(service, lambda _: ("refused", "a.h5: is no recording."))
    axis = client.get("/api/v1/axes/bench").json()
    assert (axis["state"], axis["waiting"], axis["assessed_until"]) == ("normal", None, axis["newest_at"])


def test_an_old_assessment_is_no_green_lamp_while_a_recent_run_waits(
    client: TestClient, service: Service
) -> None:
    assess(service, history([3.0 * day for day in range(6)]))
    assert send(client).status_code == 202
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert (axis["lamp"], axis["waiting"]) == ({"state": "unknown", "because": "old"}, 1)


@pytest.mark.parametrize("excluded", [False, True])
def test_an_axis_without_an_assessment_has_its_newest_run_and_is_counted_alike(
    client: TestClient, service: Service, tmp_path: Path, excluded: bool
) -> None:
    """On the page of the fleet, over HTTP and in the report."""
    client.put("/api/v1/axes/bench", json=SETUP | {"schedule": SCHEDULE})
    for run in RECENT[:3]:
        add_run(service.store, run)
    counting = RECENT[:3]
    if excluded:
        exclude(service.store, RECENT[2].id, reason="another axis")
        counting = RECENT[:2]
    with service.store.write("test") as session:
        session.scalars(select(Setup)).one().set_up_at = at(0.0)
    (axis,) = client.get("/api/v1/axes").json()["axes"]
    assert axis["newest_at"] == counting[-1].measured_at
    due = moment(counting[-1].measured_at, "a run") + timedelta(seconds=SCHEDULE["period_s"])
    assert moment(axis["due_at"], "due") == due
    assert axis["lamp"]["state"] == "not assessed"
    document = report(service.store, out=tmp_path / "report.html")
    assert [each["shown"] for each in document["axes"]] == ["not assessed"]
    assert "1 axis: 1 not assessed" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_measurement_of_a_bad_newest_run_that_was_never_assessed_is_bad(
    client: TestClient, service: Service
) -> None:
    add_run(service.store, RECENT[0])
    add_run(service.store, replace(RECENT[7], quality=Quality("bad", ("clipped",))))
    assert client.get("/api/v1/axes/bench").json()["measurement"]["because"] == "bad"
    assert 'class="lamp sound"' not in client.get("/").text
