"""Page of an axis, and the curves that its charts show."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import SETUP, client_of
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS, fill

from ballscrew.cli.shell import run as run_command
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.service.curves import _over
from ballscrew.service.pages.rendering import format_percent, page_sentence
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.adding import add_sheet
from ballscrew.store.assessing import monitor_axis
from ballscrew.store.fleet import simulate_fleet
from ballscrew.store.migrating import create_store
from ballscrew.store.rows import pack, unpack
from ballscrew.store.tables import CellRow, Explanation, ResultRow, StateRow

HOSTILE = """<script>alert("x") <img src=x onerror=y> 'ä' ?a=b#c% &amp; {{ 7 * 7 }}"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Service:
    """A service with an axis that wears, one that was only set up, and two without explanation."""
    store = create_store(tmp_path_factory.mktemp("axis") / "store")
    fill(store)
    monitor_axis(store, "bench")
    simulate_fleet(store, axes=2, years=2.5, cells=8)
    served = ServedStore(store.path)
    service = Service(served, ServerSettings(min_free_bytes=0))
    sheet = store.path / "sheet.toml"
    sheet.write_text(AXIS.replace('"bench"', json.dumps(HOSTILE, ensure_ascii=False)), encoding="utf-8")
    add_sheet(served, sheet, machine="<b>mill</b>", site="hall & yard")
    return service


@pytest.fixture(scope="module")
def client(service: Service) -> Iterator[TestClient]:
    with client_of(service) as client:
        yield client


def page_of(client: TestClient, axis: str = "bench", query: str = "") -> str:
    answer = client.get(f"/axes/{quote(axis, safe='')}{query}")
    assert answer.status_code == 200
    return answer.text


def curves(client: TestClient, name: str, axis: str = "bench") -> dict[str, Any]:
    answer = client.get(f"/api/v1/axes/{quote(axis, safe='')}/{name}")
    assert answer.status_code == 200
    found: dict[str, Any] = answer.json()
    return found


def test_what_to_do_stands_before_why_and_before_the_charts(client: TestClient) -> None:
    document = client.get("/api/v1/axes/bench").json()
    text = unescape(page_of(client))
    explanation = document["explanation"]
    parts = [page_sentence(each["text"], "en", part=True) for each in explanation["headline_parts"]]
    order = ["".join(parts), "What to do<", *(page_sentence(each, "en") for each in explanation["actions"])]
    order += ["Run the test: the newest run is too old", "Reasons and doubts<"]
    order += [
        explanation["state"]["nut_reasons"][0].split(". ")[0],
        "History<",
        "Possible causes<",
        "Alarms</h2>",
    ]
    places = [text.index(each) for each in (*order, "Events</h2>", "Runs (14)<")]
    assert places == sorted(places)
    assert "Loss of stiffness." in text
    assert text.count('class="lamp alarm large"') == 1


def test_the_page_states_the_numbers_of_the_api_and_links_every_run(client: TestClient) -> None:
    text = page_of(client)
    runs = client.get("/api/v1/axes/bench/runs").json()["runs"]
    assert len(runs) == len(RUNS)
    for run in runs:
        row = text[text.index(f'href="/runs/{quote(run["run"], safe="")}"') :].split("</tr>")[0]
        assert format_percent(run["stiffness"], "en") in row
        assert format_percent(run["nut"], "en") in row
        assert run["measured_at"] in row
    for cause in client.get("/api/v1/axes/bench").json()["explanation"]["state"]["causes"]:
        assert f'data-value="{cause["probability"]}"' in text


def test_a_german_page_has_no_english_headline_action_cause_or_evidence(client: TestClient) -> None:
    explanation = client.get("/api/v1/axes/bench").json()["explanation"]
    text = unescape(page_of(client, query="?lang=de"))
    assert 'id="axis-headline">ALARM seit ' in text
    assert "dafür: " in text
    assert "dagegen: " in text
    causes = explanation["state"]["causes"]
    english = [*explanation["actions"], *(part["text"] for part in explanation["headline_parts"][1:])]
    english += [finding for cause in causes for finding in cause["evidence"].split("; ")]
    assert [sentence for sentence in english if sentence in text] == []
    assert 'lang="en">' not in text.split("<main")[1]
    for part in explanation["headline_parts"]:
        assert part["code"].startswith("headline-")
    assert page_of(client, query="?lang=en")


def test_an_explanation_of_an_earlier_version_is_shown_in_english(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store")
    fill(store)
    monitor_axis(store, "bench")
    with store.write("test") as session:
        row = session.scalars(select(Explanation)).one()
        document = unpack(row.document)
        del document["headline_parts"]
        for cause in document["state"]["causes"]:
            cause["evidence"] = "an oil film causes a step that does not last; by sentences of long ago"
        row.document = pack(document)
    with client_of(Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))) as client:
        text = unescape(page_of(client, query="?lang=de"))
    assert f'lang="en">{document["headline"]}</p>' in text
    assert "ein Ölfilm bewirkt einen Sprung, der nicht andauert; by sentences of long ago" in text


def test_the_end_of_life_is_stated_beside_the_remaining_life(client: TestClient) -> None:
    text = page_of(client)
    life = text[text.index("<dt>Remaining life") :].split("</div>")[0]
    assert "until the preload falls below 50 % of what it was" in life
    assert 'href="/help/axis#life"' in life
    assert 'id="life"' in client.get("/help/axis").text
    assert 'href="/help/axis#life"' in client.get("/").text


def test_page_fleet_api_report_and_command_line_say_the_same_to_do(
    service: Service, client: TestClient, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actions = [each["text"] for each in client.get("/api/v1/axes/bench").json()["to_do"]]
    assert len(actions) == 3
    assert not any(text.startswith("Nothing") for text in actions)
    (axis,) = (each for each in client.get("/api/v1/axes").json()["axes"] if each["axis"] == "bench")
    assert [each["text"] for each in axis["to_do"]] == actions
    fleet = unescape(client.get("/").text)
    first = actions[0].split(": ")[0]
    assert f'<td class="do">{first} <a href="/axes/bench#axis-do">and 2 more steps</a></td>' in fleet
    assert 'href="/setup">Set up an axis</a>' in fleet
    store, out = str(service.store.path), tmp_path / "axis.html"
    capsys.readouterr()
    assert run_command(["store", "show", "bench", "--store", store]) == 0
    printed = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert run_command(["report", "bench", "--data", store, "--out", str(out)]) == 0
    texts = (unescape(page_of(client)), unescape(out.read_text(encoding="utf-8")), printed)
    for text in texts:
        places = [text.index(action) for action in actions]
        assert places == sorted(places)


def test_the_page_says_how_its_numbers_were_made(client: TestClient) -> None:
    text = page_of(client).split('id="axis-made"')[1]
    assert "joint, revision 1" in text
    assert "from 14 runs" in text
    assert text.count("<code>") == 1


def test_an_axis_that_was_only_set_up_says_what_is_missing(client: TestClient) -> None:
    text = page_of(client, HOSTILE)
    assert "This axis was never assessed." in text
    assert "Add what is missing: data sheet, plan, channel map, model, run with a time." in text
    assert "No run was sent yet." in text
    assert "data-chart" not in text


def test_hostile_names_are_text(client: TestClient) -> None:
    for text in (page_of(client, HOSTILE), page_of(client)):
        assert "<script>alert" not in text
        assert "<b>mill" not in text
        assert " style=" not in text
    assert "{{ 7 * 7 }}" in unescape(page_of(client, HOSTILE))
    for name in ("trend", "frequencies", "mechanics"):
        assert curves(client, name, HOSTILE)["axis"] == HOSTILE


@pytest.mark.parametrize("axis", ["none", "<i>none</i>", "a/b", "bench/", "x" * 3000, "%00"])
def test_an_unknown_axis_is_a_page_with_links_to_the_fleet_and_the_set_up(
    client: TestClient, axis: str
) -> None:
    for page in ("", "/actions", "/setup", "/calibration", "/report.html"):
        answer = client.get(f"/axes/{quote(axis, safe='')}{page}", headers={"accept": "text/html"})
        assert answer.status_code == 404
        assert "<i>none" not in answer.text
        assert "There is no axis “" in unescape(answer.text)
        assert 'href="/">All axes</a>' in answer.text
        assert 'href="/setup">Set up an axis</a>' in answer.text
    for name in ("trend", "frequencies", "mechanics"):
        assert client.get(f"/api/v1/axes/{quote(axis, safe='')}/{name}").status_code == 404


def test_the_live_part_is_sent_only_after_a_change(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store")
    fill(store, RUNS[:4])
    monitor_axis(store, "bench")
    service = Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))
    with client_of(service) as client:
        text = page_of(client, query="?part=live")
        stamp = text.split('name="known" value="')[1].split('"')[0]
        assert "<html" not in text
        again = client.get("/axes/bench", params={"part": "live", "known": stamp})
        assert (again.status_code, again.text) == (204, "")
        event = {"at": "2026-01-05T08:00:00Z", "kind": "note", "text": "<u>oil</u>"}
        assert client.post("/api/v1/axes/bench/events", json=[event]).status_code == 200
        changed = client.get("/axes/bench", params={"part": "live", "known": stamp})
        assert changed.status_code == 200
        assert "The axis will be assessed again." in changed.text
        assert "&lt;u&gt;oil&lt;/u&gt;" in changed.text


@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_axis_with_few_runs_and_no_model_has_a_page(tmp_path: Path, number: int) -> None:
    store = create_store(tmp_path / "store")
    fill(store, RUNS[:number]) if number else None
    service = Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        text = page_of(client)
        assert f"Runs ({number})" in text
        assert ("data-chart" in text) == (number > 0)
        assert len(curves(client, "trend")["runs"]["time"]) == number
        assert len(curves(client, "mechanics")["time"]) == number


def test_many_runs_are_listed_when_asked_for(client: TestClient) -> None:
    axis = "simulated 0-00000"
    text = page_of(client, axis)
    assert text.count('href="/runs/') == 100
    assert "All 130 runs" in text
    assert page_of(client, axis, "?runs=all").count('href="/runs/') == 130


def test_the_trend_has_a_column_for_each_quantity_of_the_runs(client: TestClient) -> None:
    document = curves(client, "trend")
    runs = client.get("/api/v1/axes/bench/runs").json()["runs"]
    for name in ("run", "state", "quality", "stiffness", "nut", "temperature_C"):
        assert document["runs"][name] == [run[name] for run in runs]
    assert {len(column) for column in document["runs"].values()} == {len(RUNS)}
    above = [value is not None and value > 1 for value in document["runs"]["ramp"]]
    assert above.index(True) == document["runs"]["state"].index("alarm")
    assert [each["kind"] for each in document["events"]] == ["note", "greased"]
    assert document["alarms"][0]["began_at"] == document["epochs"][0]["alarm_at"]
    assert len(document["ahead"]["ratio"]) == len(document["ahead"]["days"])


def test_frequencies_are_means_of_stops_relative_to_the_runs_that_were_learned(
    client: TestClient, service: Service
) -> None:
    axis = "simulated 0-00001"
    document = curves(client, "frequencies", axis)
    assert document["position_m"] == [0.0, 0.045]
    with service.store.read() as session:
        values = session.scalars(
            select(CellRow.frequency_Hz).order_by(CellRow.result_id, CellRow.place)
        ).all()
    values = values[-130 * 8 :]
    rows = [values[8 * number : 8 * number + 8] for number in range(130)]
    baseline = [median(row[cell] for row in rows[:3]) for cell in range(8)]
    for found, relative, row in zip(document["frequency_Hz"], document["relative"], rows, strict=True):
        assert found == pytest.approx([sum(row[:4]) / 4, sum(row[4:]) / 4], rel=1e-6)
        over = [value / base for value, base in zip(row, baseline, strict=True)]
        assert relative == pytest.approx([sum(over[:4]) / 4, sum(over[4:]) / 4], rel=1e-6)


def test_a_cell_without_a_frequency_is_left_out_of_its_stop(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store")
    simulate_fleet(store, axes=1, years=0.1, cells=5)
    with store.write("test") as session:
        for cell in session.scalars(select(CellRow).where(CellRow.result_id == 4)):
            cell.frequency_Hz = None if cell.place in (0, 4) else 100.0 + cell.place
    with client_of(Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))) as client:
        document = curves(client, "frequencies", "simulated 0-00000")
    assert document["frequency_Hz"][3] == [102.0, None]
    assert document["relative"][3][1] is None
    assert None not in document["frequency_Hz"][0]


def test_runs_that_are_not_yet_assessed_are_relative_to_the_epoch_before_them(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store")
    simulate_fleet(store, axes=1, years=0.2, cells=5)
    with client_of(Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))) as client:
        before = curves(client, "frequencies", "simulated 0-00000")["relative"]
        with store.write("test") as session:
            states = session.scalars(select(StateRow).order_by(StateRow.time)).all()
            numbers = [state.run_id for state in states]
            for state in (states[0], *states[-2:]):
                session.delete(state)
            for cell in session.scalars(
                select(CellRow)
                .join(ResultRow, ResultRow.id == CellRow.result_id)
                .where(ResultRow.run_id == numbers[-1])
            ):
                cell.frequency_Hz = 0.9 * (cell.frequency_Hz or 0.0)
        after = curves(client, "frequencies", "simulated 0-00000")["relative"]
    assert after[0] == [None, None]
    for value, whole in zip(after[-1], before[-1], strict=True):
        assert value == pytest.approx(0.9 * whole, abs=0.01)


def test_mechanics_states_friction_and_lost_motion_of_the_results(client: TestClient) -> None:
    document = curves(client, "mechanics")
    for run, value in zip(RUNS, document["coulomb_N"], strict=True):
        expected = run.rigid_body.coulomb_N
        assert value == [expected, run.rigid_body.standard_uncertainty["coulomb_N"]]
    assert document["lost_motion_m"] == [None] * len(RUNS)


def test_a_run_that_is_excluded_is_in_the_table_and_not_in_the_curves(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store")
    fill(store, RUNS[:4])
    with client_of(Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))) as client:
        run = quote(RUNS[1].id, safe="")
        body = {"reason": "<em>wrong</em> load"}
        assert client.post(f"/api/v1/axes/bench/runs/{run}/exclusion", json=body).status_code == 200
        assert 'excluded: <span class="more">&lt;em&gt;wrong&lt;/em&gt; load</span>' in page_of(client)
        for name in ("frequencies", "mechanics"):
            assert RUNS[1].id not in curves(client, name)["run"]
        assert len(curves(client, "trend")["runs"]["run"]) == 3


def test_the_model_of_the_page_is_that_of_the_assessment(client: TestClient) -> None:
    assert MODEL.axis == "bench"
    digest = page_of(client).split("<code>")[1].split("</code>")[0]
    assert len(digest) == 64


def test_the_report_of_an_axis_is_a_file_with_its_headline(client: TestClient) -> None:
    answer = client.get("/axes/bench/report.html")
    assert answer.headers["Content-Disposition"] == "attachment; filename*=UTF-8''bench.html"
    assert "ALARM since 2026-01-22" in unescape(answer.text)
    hostile = client.get(f"/axes/{quote(HOSTILE, safe='')}/report.html")
    assert hostile.status_code == 200
    assert "<script>alert" not in hostile.text
    assert '"' not in hostile.headers["Content-Disposition"]


def test_a_report_does_not_wait_for_its_turn(client: TestClient, service: Service) -> None:
    with service.computing("this test"):
        answer = client.get("/axes/bench/report.pdf")
    assert (answer.status_code, answer.headers["Retry-After"]) == (503, "10")


@pytest.mark.parametrize(("path", "status"), [("none/report.html", 404), ("bench/report.exe", 422)])
def test_a_report_that_cannot_be_made_is_refused(client: TestClient, path: str, status: int) -> None:
    assert client.get(f"/axes/{path}").status_code == status


def test_only_the_first_rows_of_a_long_table_are_printed_and_a_line_says_so(client: TestClient) -> None:
    names = [row["axis"] for row in client.get("/api/v1/axes").json()["axes"]]
    name = next(each for each in names if each.startswith("simulated"))
    count = len(client.get(f"/api/v1/axes/{name}/runs").json()["runs"])
    assert count > 20
    assert f"Printed: the first 20 of {count} rows." in page_of(client, name)
    assert "Printed:" not in page_of(client)


@pytest.mark.parametrize(
    ("statistic", "limit", "expected"),
    [(None, 2.0, None), (3.0, None, None), (3.0, 0.0, None), (3.0, 2.0, 1.5), (-1.0, 2.0, 0.0)],
)
def test_evidence_is_relative_to_its_limit_where_there_is_one(
    statistic: float | None, limit: float | None, expected: float | None
) -> None:
    assert _over(statistic, limit) == expected


def test_friction_and_lost_motion_are_shown_where_a_run_states_them(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store")
    lost = tuple(LostMotion(0.1 * n, value, 1e-7, 2) for n, value in enumerate((3e-6, 1e-6, 8e-6)))
    first = replace(RUNS[0], lost_motion=lost)
    fill(store, [first, replace(RUNS[1], rigid_body=replace(RUNS[1].rigid_body, coulomb_N=None))])
    service = Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))
    with client_of(service) as client:
        found = curves(client, "mechanics")
    assert found["coulomb_N"] == [[RUNS[0].rigid_body.coulomb_N, 1.0], None]
    assert found["lost_motion_m"] == [[3e-6, 1e-6, 8e-6], None]
