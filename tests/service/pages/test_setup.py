"""Pages of the set-up of an axis, the check of its plan, and its G-code."""

from __future__ import annotations

import re
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import CHANNELS, SETUP
from tests.service.pages.forms import HOSTILE, get, post, problem
from tests.simulated_bench import AXIS, PLAN

from ballscrew.service.serving import Service

LOADS = ["80 kg", "90 kg", "100 kg"]
ADDRESS = "/axes/bench/setup"
FORM = {"machine": "mill 4", "site": "", "sheet": AXIS, "plan": PLAN, "channels": CHANNELS, "do": "save"}


def test_the_set_up_is_saved_as_it_is_shown(client: TestClient) -> None:
    page = get(client, ADDRESS)
    assert 'value="mill 4"' in page
    assert "<b>model</b>" in page
    sheet = AXIS.replace("\n", "\r\n").replace("32 kg", "33 kg") + f"# {HOSTILE}"
    answer = post(client, ADDRESS, **FORM | {"sheet": sheet, "period": "1,5", "grace": "0.25"})
    assert (answer.status_code, answer.headers["location"]) == (303, f"{ADDRESS}?done=setup")
    page = get(client, answer.headers["location"])
    assert "The set-up is saved." in page
    assert "# &lt;script&gt;alert" in page
    assert 'name="period" size="6" value="1.5"' in page
    assert 'name="grace" size="6" value="0.25"' in page


def test_the_calendar_is_saved_as_it_is_shown_and_stays_with_the_next_change(client: TestClient) -> None:
    page = get(client, ADDRESS)
    assert 'placeholder="Mon, Tue, Wed, Thu, Fri, Sat, Sun" value=""' in page
    assert 'placeholder="UTC" value=""' in page
    calendar = {
        "working_days": "Mon,Tue Wed",
        "shifts": "06:00-14:00, 22:00-06:00",
        "time_zone": "Asia/Tokyo",
        "holidays": "none",
    }
    assert post(client, ADDRESS, **FORM | {"period": "1"} | calendar).status_code == 303
    page = get(client, ADDRESS)
    fields = dict(re.findall(r'name="(\w+)" size="28"[^>]* value="([^"]*)"', page))
    assert fields == calendar | {"working_days": "Mon, Tue, Wed"}
    assert "<details open><summary>Shifts and holidays" in page
    assert post(client, ADDRESS, **FORM | {"period": "2"} | fields).status_code == 303
    document = client.get("/api/v1/axes/bench").json()
    assert document["schedule"] == {
        "period_s": 2 * 86400.0,
        "grace_s": 0.0,
        "working_days": ["Mon", "Tue", "Wed"],
        "holidays": [],
        "time_zone": "Asia/Tokyo",
        "shifts": ["06:00-14:00", "22:00-06:00"],
    }


def test_a_change_of_comments_alone_is_not_stored_and_the_page_says_so(client: TestClient) -> None:
    answer = post(client, ADDRESS, **FORM | {"plan": PLAN + "# slower"})
    assert answer.headers["location"] == f"{ADDRESS}?done=comments"
    page = get(client, answer.headers["location"])
    assert "a change of comments alone is not stored" in page
    assert "# slower" not in page


def test_a_new_axis_is_set_up_by_the_name_in_its_data_sheet(client: TestClient) -> None:
    assert "Set up a new axis" in get(client, "/setup")
    assert "there is an axis 'bench' already" in problem(post(client, "/setup", **FORM))
    answer = post(client, "/setup", **FORM | {"sheet": AXIS.replace('"bench"', '"Y <axis>"')})
    assert answer.headers["location"] == "/axes/Y%20%3Caxis%3E/setup?done=setup"
    page = get(client, answer.headers["location"])
    assert "Y &lt;axis&gt;</a></h1>" in page


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"machine": "  "}, "The machine must not be empty."),
        ({"machine": "x" * 201}, "The machine must have 200 characters or fewer."),
        ({"sheet": "\n"}, "The data sheet must not be empty."),
        ({"sheet": HOSTILE}, "axis.toml"),
        ({"sheet": "a\0b"}, "axis.toml"),
        ({"sheet": AXIS.replace('"bench"', '"other"')}, "the axis 'other', not of 'bench'"),
        ({"plan": "repetitions = -1"}, "plan.toml"),
        ({"channels": "x = 1"}, "channels.toml"),
        ({"period": "soon"}, "The period is 'soon'; it must be a number of days from 0 to 3650."),
        ({"period": "0"}, "The period must be greater than 0 days."),
        ({"period": "1", "grace": "-1"}, "The grace time is '-1'"),
        ({"period": "1e400"}, "The period is '1e400'"),
        ({"shifts": "06:00-14:00"}, "Working days and shifts need a period."),
        ({"period": "1", "shifts": HOSTILE}, "it must be such as 06:00-14:00."),
        ({"period": "1", "working_days": "Montag"}, "'Montag'; they must be of Mon, Tue, "),
        ({"period": "1", "working_days": "none"}, "Working days must not be empty."),
        ({"period": "1", "holidays": "Christmas"}, "Holidays must be dates such as 2026-12-25."),
        ({"period": "1", "time_zone": HOSTILE}, "is no known time zone; give one such as Europe/Berlin."),
        ({"plan": "", "do": "check"}, "a check needs a data sheet and a plan."),
        ({"plan": "positions = 1", "do": "check"}, "plan.toml"),
        (
            {"plan": PLAN.replace('"45 mm"', '"0.5 mm"').replace('["100 kg"]', str(LOADS)), "do": "check"},
            "2703",
        ),
    ],
)
def test_a_wrong_set_up_is_one_sentence_and_the_input_stays(
    client: TestClient, changes: dict[str, str], sentence: str
) -> None:
    answer = post(client, ADDRESS, **FORM | {"machine": "changed"} | changes)
    assert answer.status_code == 422
    assert sentence in problem(answer)
    assert "/tmp" not in problem(answer)  # noqa: S108
    assert "<script>alert" not in answer.text
    if "machine" not in changes:
        assert 'value="changed"' in answer.text
    assert 'value="mill 4"' in get(client, ADDRESS)


def test_a_plan_is_checked_before_it_is_saved(client: TestClient) -> None:
    answer = post(client, ADDRESS, **FORM | {"do": "check"})
    assert answer.status_code == 200
    assert "No problems found." in answer.text
    assert "<dt>Cells</dt><dd>40</dd>" in answer.text
    assert "/tmp" not in answer.text  # noqa: S108
    limited = AXIS.replace("[screw]", '[limits]\nspeed = "1 mm/s"\n[screw]')
    answer = post(client, "/setup", **FORM | {"sheet": limited, "do": "check"})
    assert "must not be run" in answer.text


def test_a_check_while_another_request_computes_is_refused(client: TestClient, service: Service) -> None:
    with service.computing("this test"):
        answer = post(client, ADDRESS, **FORM | {"do": "check"})
        assert (answer.status_code, "while another request computes" in problem(answer)) == (503, True)
        assert client.get("/axes/bench/gcode").status_code == 503


@pytest.mark.parametrize(("dialect", "word", "begin"), [("iso", "X", "%"), ("siemens", "X1", ";")])
def test_the_program_of_the_plan_is_downloaded(
    client: TestClient, dialect: str, word: str, begin: str
) -> None:
    query = {"dialect": dialect, "word": word}
    answer = client.get("/axes/bench/gcode", params=query)
    assert answer.headers["Content-Disposition"] == 'attachment; filename="bench.nc"'
    assert answer.text.startswith(begin)
    assert "/tmp" not in answer.text  # noqa: S108
    dry = client.get("/axes/bench/gcode", params=query | {"part": "dry-run"})
    assert dry.headers["Content-Disposition"] == 'attachment; filename="bench-dry-run.nc"'
    assert "DRY RUN" in dry.text


@pytest.mark.parametrize(
    ("query", "status"), [({"dialect": HOSTILE}, 422), ({"word": "M30"}, 422), ({"word": ""}, 422)]
)
def test_a_wrong_dialect_or_axis_word_is_a_sentence(
    client: TestClient, query: dict[str, Any], status: int
) -> None:
    answer = client.get("/axes/bench/gcode", params=query, headers={"Accept": "text/html"})
    assert answer.status_code == status
    assert "must be one of" in problem(answer)


def test_an_axis_without_a_plan_has_no_program(client: TestClient) -> None:
    client.put("/api/v1/axes/bench", json=SETUP | {"plan": None})
    assert client.get("/axes/bench/gcode").status_code == 404
    assert "The axis has no plan yet." in get(client, ADDRESS)
