"""Page of the alarms."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from tests.service.pages.forms import HOSTILE, fill_axis, get, post, problem

from ballscrew.service.alarms import report_bad_measurement
from ballscrew.service.serving import Service
from ballscrew.store.reading import find_axis


@pytest.fixture
def trouble(client: TestClient, service: Service) -> str:
    """A standing trouble with a hostile text."""
    with service.store.write("test") as session:
        report_bad_measurement(session, find_axis(session, "bench"), "2026-01-01T08:00Z", [HOSTILE])
    (found,) = client.get("/api/v1/alarms").json()["alarms"]
    return str(found["id"])


def test_alarms_come_before_troubles_and_are_acted_on(client: TestClient, service: Service) -> None:
    fill_axis(client, service)
    with service.store.write("test") as session:
        report_bad_measurement(session, find_axis(session, "bench"), "2026-03-02T08:00Z", [HOSTILE])
    page = get(client, "/alarms")
    assert "Standing (2)" in page
    assert page.index("loss of stiffness</span>") < page.index("bad measurement</span>")
    assert "<script>alert" not in page
    answer = post(client, "/alarms/alarm-1", action="acknowledge")
    assert (answer.status_code, answer.headers["location"]) == (303, "/alarms?done=acknowledge")
    assert "The alarm is acknowledged." in get(client, "/alarms?done=acknowledge")
    assert post(client, "/alarms/alarm-1", action="shelve", until="2090-01-01").status_code == 303
    assert (
        post(
            client, "/alarms/alarm-1", action="close", text="bearing: <loose>", finding="nothing found"
        ).status_code
        == 303
    )
    page = get(client, "/alarms")
    assert "Standing (1)" in page
    assert '<q><span class="more">bearing: &lt;loose&gt;</span></q>' in page
    assert "Earlier (1)" in get(client, "/alarms?show=closed&axis=bench")
    assert "Earlier (0)" in get(client, "/alarms?show=retracted")
    assert "Standing (0)" in get(client, "/alarms?axis=none")
    assert post(client, "/alarms/alarm-1", action="reopen").status_code == 303
    assert "Standing (2)" in get(client, "/alarms")


def test_a_finding_is_stated_on_an_alarm_that_ended_by_itself(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill_axis(client, service)
    monkeypatch.setattr("ballscrew.store.alarms.alarm_over_at", lambda *_: "2026-03-02T08:00:00+00:00")
    page = get(client, "/alarms?show=ended")
    assert "Standing (0)" in page
    assert "State a finding" in page
    form = {"action": "close", "text": "nothing is loose", "finding": "nothing found"}
    assert post(client, "/alarms/alarm-1", **form).status_code == 303
    assert "State a finding" not in get(client, "/alarms")
    assert client.get("/api/v1/findings").json()["all"]["inspected"] == 1


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        ({"action": "close", "text": " "}, "closed with a finding"),
        ({"action": "close", "text": "x" * 10_001}, "The text must have 10000 characters or fewer."),
        ({"action": "shelve"}, "until is the end of a shelving"),
        ({"action": "shelve", "until": "2020-01-01"}, "must be in the future"),
        ({"action": "shelve", "until": HOSTILE}, "it must be a time"),
        ({"action": "explode"}, "The action is not valid."),
        ({}, "The action is not valid."),
    ],
)
def test_a_wrong_action_is_one_sentence_at_the_alarm(
    client: TestClient, trouble: str, form: dict[str, str], sentence: str
) -> None:
    answer = post(client, f"/alarms/{trouble}", **form)
    assert answer.status_code == 422
    assert sentence in problem(answer)
    assert "<details open>" in answer.text
    assert "<script>alert" not in answer.text
    assert client.get("/api/v1/alarms").json()["alarms"][0]["actions"] == []


def test_an_alarm_that_does_not_exist_is_404(client: TestClient) -> None:
    for name in ("alarm-1", "trouble-9999999999", "x", "alarm-"):
        answer = post(client, f"/alarms/{name}", action="acknowledge")
        assert (answer.status_code, "There is no such page" in answer.text) == (404, True)
