"""Page of a run: numbers as the API has them, runs without raw files or result, hostile names."""

from __future__ import annotations

import html
import re
import shlex
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from tests.service import raw_runs
from tests.service.conftest import SETUP, other_files, send, send_result, work_off
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS

from ballscrew.cli.shell import run as command
from ballscrew.service.pages import run as run_page
from ballscrew.service.pages.rendering import format_number
from ballscrew.service.serving import Service
from ballscrew.store.adding import add_model
from ballscrew.store.changing import correct_run

ID = [quote(run.id) for run in RUNS]


@pytest.fixture
def filled(client: TestClient, service: Service) -> TestClient:
    """Client of an axis with four runs that were assessed."""
    add_model(service.store, MODEL)
    for number in range(4):
        send_result(client, number)
    work_off(service, lambda _: ("failed", "no analysis"))
    return client


def page(client: TestClient, path: str, status: int = 200) -> str:
    answer = client.get(path, headers={"Accept-Language": "en"})
    assert answer.status_code == status, answer.text[:2000]
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert " style=" not in answer.text
    assert "<script>" not in answer.text
    return re.sub(r"\s+", " ", answer.text)


def test_a_run_shows_its_verdict_its_state_and_its_cells(filled: TestClient) -> None:
    text = page(filled, f"/runs/{RUNS[2].id}")
    assert "State of the axis by this run:" in text
    assert "cell that moved most since the baseline" in text
    found = filled.get(f"/api/v1/runs/{RUNS[2].id}/cells").json()
    for cell in found["cells"]:
        value = format_number(cell["frequency_Hz"], 2, "en")
        assert f">{value} ± {format_number(cell['standard_uncertainty_Hz'], 2, 'en')}</td>" in text
        assert f"{format_number(cell['change_Hz'], 2, 'en')} ± " in text
    percents = re.findall(r'data-value="([^"]*)">([^<]*)</td> <td><span class="verdict', text)
    for cell, (part, shown) in zip(found["cells"], percents, strict=True):
        assert float(part) == pytest.approx(100 * (cell["frequency_Hz"] / cell["other_frequency_Hz"] - 1))
        assert shown == format_number(float(part), 2, "en")
    assert "cells of one position are drawn beside each other" in text
    assert f'href="/runs/{ID[1]}" rel="prev"' in text
    assert f'href="/runs/{ID[3]}" rel="next"' in text
    assert f"/compare?a={ID[2]}&amp;b={ID[0]}" in text


def test_changes_are_since_the_run_that_is_asked_for(filled: TestClient) -> None:
    text = page(filled, f"/runs/{RUNS[2].id}?against=previous")
    assert "cell that moved most since the previous run" in text
    assert f"/cells?against={ID[3]}" in page(filled, f"/runs/{RUNS[2].id}?against={RUNS[3].id}")
    page(filled, f"/runs/{RUNS[2].id}?against=none", 404)


def test_a_run_without_raw_files_says_so_and_shows_no_frf(filled: TestClient) -> None:
    text = page(filled, f"/runs/{RUNS[2].id}")
    assert text.count("Raw data not kept") == 3
    assert "signals?cell" not in text
    assert "data-later" not in text
    assert f"ballscrew store show &#39;{RUNS[2].id}&#39;" in text
    assert "Raw data not kept" in page(filled, f"/runs/{RUNS[2].id}/signals")


def test_the_commands_compute_the_run_again(
    client: TestClient, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = raw_runs.send_raw(client)
    raw_runs.analyse(service, sent)
    text = page(client, f"/runs/{sent}")
    block = re.search('id="commands"[^>]*>(.*?)</pre>', text)
    assert block is not None
    found = [shlex.split("ballscrew" + each) for each in html.unescape(block[1]).split("ballscrew")[1:3]]
    monkeypatch.chdir(tmp_path)
    assert found[0][0] == "ballscrew"
    assert command(found[0][1:]) == 0
    assert found[1][:2] == ["ballscrew", "analyze"]
    assert Path(found[1][2]).is_file()


def test_hostile_names_are_escaped(client: TestClient, service: Service) -> None:
    sent = raw_runs.send_raw(client)
    hostile = page(client, f"/runs/{sent}") + page(client, f"/runs/{sent}/signals?file=1")
    raw_runs.analyse(service, sent)
    hostile += page(client, f"/runs/{sent}") + page(client, f"/runs/{sent}/signals?file=1")
    assert "<img" not in hostile
    assert hostile.count("&lt;img src=x") >= 4
    name = "<b>'\"&; $(x) `y`"
    sheet = AXIS.replace('"bench"', f"'''{name}'''")
    client.put("/api/v1/axes/" + "%3Cb%3E'%22%26%3B%20%24(x)%20%60y%60", json=SETUP | {"sheet": sheet})
    assert "<b>'" not in page(client, "/compare")


def test_a_run_that_was_refused_says_why(client: TestClient, service: Service) -> None:
    sent = send(client).json()["id"]
    assert "waits for its analysis" in page(client, f"/runs/{sent}")
    work_off(service, lambda _: ("refused", "a.h5: is <b>no</b> recording."))
    text = page(client, f"/runs/{sent[:20]}")
    assert "The run was refused" in text
    assert "is &lt;b&gt;no&lt;/b&gt; recording." in text
    assert f"/runs/{sent}/signals?file=1" in text


def test_signals_of_a_cell_begin_before_its_first_transient(client: TestClient, service: Service) -> None:
    sent = raw_runs.send_raw(client)
    raw_runs.analyse(service, sent)
    text = page(client, f"/runs/{sent}/signals?cell=0")
    span = re.search(r"data-span='\[([\d.]+), ([\d.]+)\]'", text)
    assert span is not None
    assert [float(each) for each in span.groups()] == pytest.approx([2.85, 3.35])
    assert "signals?file=1" in text  # the transient in the first file is not used
    assert "1 transient in this file" in text
    assert "no such file" in page(client, f"/runs/{sent}/signals?file=7")


def test_the_frf_of_another_cell_is_a_part_of_the_page(client: TestClient, service: Service) -> None:
    sent = raw_runs.send_raw(client)
    raw_runs.analyse(service, sent)
    text = page(client, f"/runs/{sent}?part=frf&cell=0")
    assert "<html" not in text
    assert "/response?cell=0" in text
    assert "no: cut by the end of the record" in text
    assert 'value="5" selected' in page(client, f"/runs/{sent}?cell=5")


def test_corrections_and_exclusions_are_listed(filled: TestClient, service: Service) -> None:
    new = correct_run(service.store, RUNS[2].id, measured_at="2026-01-08T08:00Z", reason="typing <error>")
    filled.post(f"/api/v1/axes/bench/runs/{RUNS[3].id}/exclusion", json={"reason": "sensor <loose>"})
    text = page(filled, f"/runs/{new}")
    assert "typing &lt;error&gt;" in text
    assert f'correction of <a href="/runs/{ID[2]}">' in text
    assert "was corrected as" in page(filled, f"/runs/{RUNS[2].id}")
    text = page(filled, f"/runs/{RUNS[3].id}")
    assert "sensor &lt;loose&gt;" in text
    assert "does not count" in text


def test_a_run_that_is_not_there_and_one_of_several_are_pages(filled: TestClient) -> None:
    assert "no run &#39;&lt;b&gt;&#39;" in page(filled, "/runs/%3Cb%3E", 404)
    for letter in "ab":
        send_result(filled, 5, f"twin {letter}", id="01234567" + 56 * letter, files=other_files(letter))
    text = page(filled, "/runs/01234567", 409)
    assert f'href="/runs/01234567{56 * "b"}"' in text
    assert "No such run" in page(filled, "/runs/none/signals", 404)


def test_commands_are_quoted_for_the_shell_of_the_computer(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("store", "show", "my plant")
    assert run_page._command(*words) == "ballscrew store show 'my plant'"
    monkeypatch.setattr(run_page, "os", SimpleNamespace(name="nt"))
    assert run_page._command(*words) == 'ballscrew store show "my plant"'
