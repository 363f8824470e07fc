"""Schedules of axes: working days, holidays, time zone and shifts of each, by default those of the server."""

from __future__ import annotations

from datetime import date, datetime, timedelta
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import SETUP, NewService, client_of
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL

from ballscrew.calibration.modelfile import model_json
from ballscrew.service.alarms import watch_for_silence
from ballscrew.store.calendars import DAYS
from ballscrew.store.service_tables import Setup

HOUR = 3600.0
CALENDAR = {
    "working_days": ["Mon", "Tue", "Wed", "Thu", "Fri"],
    "holidays": ["2026-12-25"],
    "time_zone": "Asia/Tokyo",
    "shifts": ["06:00-14:00", "22:00-06:00"],
}
SERVER = {"working_days": list(DAYS), "holidays": [], "time_zone": "UTC", "shifts": []}
URL = "/api/v1/axes/bench"


def set_up(client: TestClient, schedule: dict[str, Any] | None) -> Any:
    return client.put(URL, json=SETUP | {"schedule": schedule})


def shown(client: TestClient) -> tuple[Any, Any]:
    document = client.get(URL).json()
    return document["schedule"], document["calendar"]


def test_a_calendar_is_set_shown_changed_and_removed(client: TestClient) -> None:
    assert shown(client) == (None, SERVER)
    numbers = {"period_s": HOUR, "grace_s": 0.0}
    for calendar in (CALENDAR, {"shifts": []}, {"holidays": [], "time_zone": "Europe/Berlin"}, {}):
        assert set_up(client, numbers | calendar).status_code == 200
        assert shown(client) == (numbers | dict.fromkeys(CALENDAR) | calendar, SERVER | calendar)
        assert set_up(client, shown(client)[0]).status_code == 200  # what is shown can be sent
    assert set_up(client, None).status_code == 200
    assert shown(client) == (None, SERVER)


def test_the_audit_names_the_values_of_the_calendar_that_changed(client: TestClient) -> None:
    set_up(client, {"period_s": HOUR, "time_zone": "Asia/Tokyo"})
    set_up(client, {"period_s": HOUR, "time_zone": "Europe/Berlin", "shifts": ["06:00-14:00"]})
    row = client.get("/api/v1/audit?action=set up").json()["audit"][0]
    assert row["changed"] == {
        "time_zone": ["Asia/Tokyo", "Europe/Berlin"],
        "shifts": [None, ["06:00-14:00"]],
    }


@pytest.mark.parametrize(
    ("calendar", "sentence"),
    [
        ({"time_zone": "Mars/Base"}, "'Mars/Base' is no known time zone; give one such as Europe/Berlin."),
        ({"time_zone": "../x"}, "no known time zone"),
        ({"time_zone": "\x00"}, "no known time zone"),
        ({"time_zone": "x" * 65}, "at most 64 characters"),
        ({"shifts": ["6-14"]}, "shifts: a shift is '6-14'; it must be such as 06:00-14:00."),
        (
            {"shifts": ["06:00-06:00"]},
            "shifts: the shift 06:00-06:00 is empty; the whole day is 00:00-24:00.",
        ),
        ({"shifts": ["22:00-06:00", "05:00-13:00"]}, "the shift 22:00-06:00 overlaps with the next."),
        ({"shifts": "06:00-14:00"}, "shifts: "),
        ({"shifts": ["06:00-06:01"] * 25}, "at most 24 items"),
        ({"working_days": []}, "working_days: "),
        ({"working_days": ["Montag"]}, "working_days.0: "),
        ({"holidays": ["Christmas"]}, "holidays.0: "),
        ({"holidays": [1798070400]}, "must be a date such as 2026-12-25"),
        ({"holidays": ["1798070400"]}, "must be a date such as 2026-12-25"),
        ({"holidays": ["2026-12-24T00:00:00Z"]}, "must be a date such as 2026-12-25"),
        ({"holidays": ["2026-12-25"] * 1001}, "at most 1000 items"),
        ({"working_day": ["Mon"]}, "working_day: "),
        (
            {"working_days": ["Mon"], "shifts": ["06:00-06:01"], "period_s": 1e9},
            "schedule: period_s and grace_s are more than the shifts of 100 years.",
        ),
        (
            {
                "working_days": ["Mon"],
                "holidays": [str(date(2027, 1, 4) + timedelta(weeks=week)) for week in range(52)],
            },
            "schedule: holidays: there is no working day for a year from 2027-01-04 on.",
        ),
    ],
)
def test_a_wrong_calendar_is_refused_with_a_sentence_and_nothing_is_stored(
    new_service: NewService, calendar: dict[str, Any], sentence: str
) -> None:
    with client_of(new_service()) as client:
        answer = set_up(client, {"period_s": HOUR} | calendar)
        assert (answer.status_code, sentence in answer.json()["detail"]) == (422, True), answer.text
        assert "Value error" not in answer.text
        assert client.get("/api/v1/axes").json()["axes"] == []


def silent(client: TestClient) -> list[str]:
    alarms = client.get("/api/v1/alarms").json()["alarms"]
    return sorted(alarm["axis"] for alarm in alarms if alarm["state"] == "raised")


def test_silence_is_that_of_the_zone_and_the_shifts_of_each_axis(new_service: NewService) -> None:
    """Two axes with a period of 4 h, in the early shifts of Tokyo and Berlin; a third as the server."""
    service = new_service(working_days=("Sun",), shifts=("00:00-12:00",))
    early = {"period_s": 4 * HOUR, "working_days": CALENDAR["working_days"], "shifts": ["06:00-14:00"]}
    schedules = {
        "bench": early | {"time_zone": "Asia/Tokyo"},
        "berlin": early | {"time_zone": "Europe/Berlin"},
        "server": {"period_s": 4 * HOUR},
    }
    with client_of(service) as client:
        for name, schedule in schedules.items():
            setup = SETUP | {"sheet": AXIS.replace('"bench"', f'"{name}"'), "schedule": schedule}
            assert client.put(f"/api/v1/axes/{name}", json=setup).status_code == 200
        with service.store.write("test") as session:
            for setup in session.scalars(select(Setup)):
                setup.set_up_at = "2026-01-16T20:00Z"  # Friday, after the shifts of both
        for at, expected in (
            ("2026-01-18T03:59Z", []),
            ("2026-01-18T04:01Z", ["server"]),
            ("2026-01-19T00:59Z", ["server"]),  # 9:59 in Tokyo
            ("2026-01-19T01:01Z", ["bench", "server"]),
            ("2026-01-19T08:59Z", ["bench", "server"]),  # 9:59 in Berlin
            ("2026-01-19T09:01Z", ["bench", "berlin", "server"]),
        ):
            watch_for_silence(service, datetime.fromisoformat(at))
            assert silent(client) == expected, at
        due = {axis["axis"]: axis["due_at"] for axis in client.get("/api/v1/axes").json()["axes"]}
        assert due == {
            "bench": "2026-01-19T01:00:00+00:00",
            "berlin": "2026-01-19T09:00:00+00:00",
            "server": "2026-01-18T04:00:00+00:00",
        }


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"kind": "run"}, "the body is no MODEL.json"),
        ({"axis": "Y axis"}, "the model is that of the axis 'Y axis', not of 'bench'."),
    ],
)
def test_a_document_that_is_no_model_of_the_axis_is_refused(
    client: TestClient, changes: dict[str, str], sentence: str
) -> None:
    answer = client.put(f"{URL}/model", json=model_json(MODEL) | changes)
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith(sentence)
    assert client.get("/api/v1/axes/bench/state").json()["missing"][0] == "model"
