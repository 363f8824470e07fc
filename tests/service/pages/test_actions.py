"""Page of what people do on an axis: events, a new baseline, exclusions, uploads."""

from __future__ import annotations

import re

import pytest
from fastapi.testclient import TestClient
from tests.service.pages.forms import HOSTILE, fill_axis, get, post, problem
from tests.simulated_bench import AXIS

from ballscrew.service.serving import Service

ACTIONS = "/axes/bench/actions"
EVENTS, EXCLUSIONS = f"{ACTIONS}/events", f"{ACTIONS}/exclusions"
AT = "2026-01-20T10:00"


def test_an_event_is_previewed_and_then_stored(client: TestClient, service: Service) -> None:
    fill_axis(client, service)
    form = {"section": "baseline", "kind": "maintenance", "at": AT, "offset": "+02:00", "text": "new <nut>"}
    answer = post(client, EVENTS, do="preview", **form)
    assert answer.status_code == 200
    assert "Preview: nothing is stored yet" in answer.text
    assert "20 Jan 2026, 08:00 UTC</time>, maintenance" in answer.text
    assert 'value="new &lt;nut&gt;"' in answer.text
    assert client.get("/api/v1/axes/bench").json()["events"] == []
    answer = post(client, EVENTS, do="store", **form)
    assert (answer.status_code, answer.headers["location"]) == (303, f"{ACTIONS}?done=baseline")
    (event,) = client.get("/api/v1/axes/bench").json()["events"]
    assert (event["at"], event["kind"], event["text"]) == (f"{AT}+02:00", "maintenance", "new <nut>")
    assert "The event is stored" in get(client, answer.headers["location"])


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("nut replaced", "the next run begins a new baseline"),
        pytest.param("greased", "From the next run on, a step of the values", marks=pytest.mark.slow),
        pytest.param("note", "A note changes nothing after it either.", marks=pytest.mark.slow),
    ],
)
def test_a_preview_of_an_event_after_the_newest_run_says_what_comes_with_the_next(
    client: TestClient, service: Service, kind: str, sentence: str
) -> None:
    fill_axis(client, service)
    later = post(client, EVENTS, kind=kind, at="2026-03-20T10:00", do="preview").text
    assert "The event is later than the newest run" in later
    assert sentence in later
    assert "stay as they are" not in later
    assert "The event is later" not in post(client, EVENTS, kind=kind, at=AT, do="preview").text


def test_a_mistaken_event_can_be_left_out_and_counted_again(client: TestClient) -> None:
    post(client, EVENTS, kind="note", at=AT, text=HOSTILE, do="store")
    page = get(client, ACTIONS)
    assert "<script>alert" not in page
    (event,) = re.findall(r'name="subject" value="([0-9a-f]{64})"', page)
    assert problem(post(client, EXCLUSIONS, of="event", subject=event, do="exclude")) == (
        "The reason must not be empty."
    )
    answer = post(client, EXCLUSIONS, of="event", subject=event, reason="mistake", do="exclude")
    assert answer.headers["location"] == f"{ACTIONS}?done=exclude"
    assert 'no: <span class="more">mistake</span>' in get(client, ACTIONS)
    assert post(client, EXCLUSIONS, of="event", subject=event, do="include").status_code == 303
    (stated,) = client.get("/api/v1/axes/bench").json()["exclusions"]
    assert (stated["event"], stated["ended_at"] is not None) == (event, True)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"at": ""}, "an event: at is ''"),
        ({"at": "tomorrow"}, "an event: at is 'tomorrow'"),
        ({"at": "1812-01-01T00:00"}, "look at the clock"),
        ({"at": "x" * 100}, "The time must have 64 characters or fewer."),
        ({"at": AT, "offset": "+99:99"}, "an event: at is"),
        ({"kind": ""}, "an event's kind is ''"),
        ({"kind": HOSTILE[:60]}, "an event's kind is"),
        ({"text": "x" * 10_001}, "The text must have 10000 characters or fewer."),
        ({"text": "a\0b"}, "valid Unicode without NUL"),
        ({"do": "preview"}, "no model"),
    ],
)
def test_a_wrong_event_is_one_sentence_and_the_input_stays(
    client: TestClient, changes: dict[str, str], sentence: str
) -> None:
    form = {"section": "event", "kind": "note", "at": AT, "text": 'my "text"', "do": "store"} | changes
    answer = post(client, EVENTS, **form)
    assert answer.status_code == 422
    assert sentence in problem(answer)
    assert "<script>alert" not in answer.text
    if "text" not in changes:
        assert 'value="my &#34;text&#34;"' in answer.text
    assert client.get("/api/v1/axes/bench").json()["events"] == []


def test_a_second_computation_at_a_time_is_refused(client: TestClient, service: Service) -> None:
    fill_axis(client, service, 4)
    with service.computing("this test"):
        answer = post(client, EVENTS, kind="note", at=AT, do="preview")
    assert answer.status_code == 503
    assert "while another request computes" in problem(answer)
    assert post(client, EVENTS, kind="note", at=AT, do="preview").status_code == 200


def test_a_run_is_excluded_with_a_reason_and_included_again(client: TestClient, service: Service) -> None:
    runs = fill_axis(client, service, 4)
    assert problem(post(client, EXCLUSIONS, subject=runs[2], reason=" ", do="exclude")) == (
        "The reason must not be empty."
    )
    assert "there is no run 'x'" in problem(post(client, EXCLUSIONS, subject="x", reason="r", do="exclude"))
    answer = post(client, EXCLUSIONS, subject=runs[2], reason=HOSTILE, do="exclude")
    assert answer.headers["location"] == f"{ACTIONS}?done=exclude"
    page = get(client, answer.headers["location"])
    assert "Excluded runs</h3>" in page.replace(" (1)", "")
    assert "&lt;script&gt;alert" in page
    assert post(client, EXCLUSIONS, subject=runs[2], do="include").status_code == 303
    assert "Excluded runs" not in get(client, ACTIONS)
    assert re.search(f'value="{runs[1]}" data-time="[^"]+" selected', get(client, f"{ACTIONS}?run={runs[1]}"))


def test_the_form_of_an_upload_says_what_is_missing(client: TestClient) -> None:
    page = get(client, ACTIONS)
    assert 'class="upload" data-axis="bench"' in page
    assert "Set it up first" not in page
    assert client.put("/api/v1/axes/bench", json={"machine": "m", "sheet": AXIS}).status_code == 200
    assert "Set it up first" in get(client, ACTIONS)


def test_a_form_with_too_many_fields_is_refused(client: TestClient) -> None:
    answer = post(client, EVENTS, x=["1"] * 2001)
    assert answer.status_code == 422
    assert "too many fields" in answer.text
