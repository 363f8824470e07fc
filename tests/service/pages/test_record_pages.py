"""Pages of the findings and of the audit, and alarms that are closed with a finding on their page."""

from __future__ import annotations

import re

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.pages.forms import HOSTILE, get, post, problem

from ballscrew.service.serving import Service
from ballscrew.store.folder import now
from ballscrew.store.opened import record
from ballscrew.store.tables import AlarmRow, EventRow, RawFile, RecordingRow, RunRow

CLOSE = {"action": "close", "text": "nut", "finding": "preload loss"}


def cells(page: str, heading: str) -> list[str]:
    """Texts of the first row of a table."""
    table = page[page.index(f">{heading}<") :]
    row = re.findall(r"<tr>(.*?)</tr>", table[table.index("<tbody>") :], re.DOTALL)[0]
    return [
        re.sub("<[^>]+>", "", cell).strip()
        for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL)
    ]


def test_without_findings_the_page_gives_no_number(worn: TestClient) -> None:
    page = get(worn, "/findings")
    assert "too few for a precision" in page
    assert cells(page, "By axis")[:4] == ["bench", "1", "0", "0"]
    assert cells(page, "By axis")[-2:] == ["too few", "too few"]


def test_the_page_has_the_numbers_of_the_api(worn: TestClient) -> None:
    assert post(worn, "/alarms/alarm-1", **CLOSE).status_code == 303
    page, document = get(worn, "/findings"), worn.get("/api/v1/findings").json()
    assert "1 of 1 inspected alarms were a loss of preload." in page
    low = document["axes"][0]["precision"][1]
    assert cells(page, "By axis")[-2] == f"100 ({100 * low:.0f} to 100) %"
    assert cells(page, "By axis")[-1] == "0.0 (0.0 to 0.0)"
    assert "preload loss confirmed" in get(worn, "/alarms?show=closed")


def test_a_finding_with_maintenance_and_hostile_texts(worn: TestClient, worn_service: Service) -> None:
    form = CLOSE | {"finding": "another cause", "cause": HOSTILE, "text": HOSTILE}
    done = {"kind": "bearing replaced", "at": "2026-06-01T08:00", "offset": "+02:00", "done": HOSTILE}
    assert post(worn, "/alarms/alarm-1", **form, **done).status_code == 303
    with worn_service.store.read() as session:
        event = session.scalars(select(EventRow)).one()
    assert (event.at, event.kind, event.text) == ("2026-06-01T08:00+02:00", "bearing replaced", HOSTILE)
    for path in ("/findings", "/alarms?show=closed", "/audit"):
        assert "<script>alert" not in get(worn, path)


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        ({"finding": ""}, "What was found must be chosen."),
        ({"finding": "another cause"}, "which other cause"),
        ({"kind": "greased", "at": ""}, "must be a time"),
        ({"finding": "gremlins"}, "What was found is not valid."),
    ],
)
def test_a_finding_that_does_not_fit_is_one_sentence(
    worn: TestClient, form: dict[str, str], sentence: str
) -> None:
    answer = post(worn, "/alarms/alarm-1", **(CLOSE | form))
    assert (answer.status_code, sentence in problem(answer)) == (422, True)
    assert worn.get("/api/v1/alarms").json()["alarms"][0]["state"] == "raised"


def test_the_audit_shows_who_and_what_and_pages_on(worn: TestClient, worn_service: Service) -> None:
    post(worn, "/alarms/alarm-1", action="acknowledge")
    page = get(worn, "/audit")
    assert "state: raised → acknowledged" in page
    assert "<small>testclient</small>" in page
    with worn_service.store.write("test") as session:
        for number in range(101):
            record(session, "tidy", f"{number} {HOSTILE}")
    page = get(worn, "/audit?action=tidy")
    (before,) = re.findall(r"before=(\d+)", page)
    assert "<script>alert" not in page
    assert f"0 {HOSTILE[:5]}".replace("<", "&lt;") in get(worn, f"/audit?action=tidy&before={before}")
    assert "No row fits." in get(worn, "/audit?by=nobody")
    assert 'href="/api/v1/audit?format=csv&amp;action=tidy"' in page


def test_a_run_whose_raw_files_were_deleted_says_so(worn: TestClient, worn_service: Service) -> None:
    with worn_service.store.write("test") as session:
        run = session.scalars(select(RunRow)).first()
        assert run is not None
        sha256 = session.scalars(select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)).all()[0]
        row = {"size": 1, "stored_size": 1, "compression": "none", "added_at": now(), "deleted_at": now()}
        session.merge(RawFile(sha256=sha256, **row))
        name = run.run
    page = get(worn, f"/runs/{name}")
    assert "The raw data of this run were deleted by policy at" in page
    assert "deleted by policy at" in page[page.index("How every number was made") :]


def test_an_alarm_of_an_unknown_rule_is_listed(worn: TestClient, worn_service: Service) -> None:
    with worn_service.store.write("test") as session:
        alarm = session.scalars(select(AlarmRow)).one()
        alarm.began_at = "2020-01-01T00:00Z"
    assert cells(get(worn, "/findings"), "By rule")[0] == "not known"


def test_settings_have_a_page_and_secrets_are_not_on_it(service: Service, client: TestClient) -> None:
    service.settings = service.settings.model_validate({"heartbeat_url": "https://x.example/s3cret"})
    page = get(client, "/settings")
    assert "s3cret" not in page
    assert re.search(r"<code>heartbeat_url</code></th><td>\s*set</td>", page)
    assert "s3cret" not in get(client, "/status")
