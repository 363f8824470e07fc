"""The same number on a page, from the API, in the report, and from the command line: nine digits of it."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from playwright.sync_api import Browser
from tests.service.conftest import client_of
from tests.service.pages.browser import serving

from ballscrew.base.jsonfile import plain
from ballscrew.base.words import interval_words, life_words
from ballscrew.cli.shell import run
from ballscrew.service.pages.rendering import format_number, format_percent
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.fleet import simulate_fleet
from ballscrew.store.migrating import create_store

NUMBERS = st.floats(-1e9, 1e9, allow_nan=False) | st.integers(-4000, 4000).map(lambda each: each / 8)
AXES = 50
ROW = r'<th scope="row"><a href="[^"]*">([^<]*)</a></th>(.*?)</tr>'


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Service:
    """Fifty axes with random states: 200 numbers and more."""
    store = create_store(tmp_path_factory.mktemp("numbers") / "store")
    simulate_fleet(store, axes=AXES, years=0.3, cells=2, seed=5)
    return Service(ServedStore(store.path), ServerSettings(min_free_bytes=0))


def unmarked(text: str, language: str) -> str:
    """A number without the marks of its language and of the pages."""
    text = text.replace("−", "-")
    if language == "de":
        return text.replace(".", "").replace(",", ".")
    return text.replace(",", "")


@given(value=NUMBERS, decimals=st.integers(0, 6), language=st.sampled_from(["en", "de"]))
def test_a_page_rounds_as_the_command_line(value: float, decimals: int, language: str) -> None:
    assert unmarked(format_number(value, decimals, language), language) == f"{value:.{decimals}f}"


def random_numbers() -> Iterator[tuple[float, int]]:
    """Of many sizes, and the halves of steps, which functions round differently."""
    generator = random.Random(27)  # noqa: S311
    for _ in range(150):
        yield generator.uniform(-1, 1) * 10 ** generator.randint(-3, 6), generator.randint(0, 4)
    for _ in range(50):
        yield (2 * generator.randint(-500, 500) + 1) / 16, generator.randint(0, 3)
    yield from ((0.125, 2), (2.675, 2), (0.5, 0), (1.5, 0), (-2.5, 0), (0.0, 2), (1005e-3, 2))


def test_scripts_of_pages_round_as_the_command_line(browser: Browser, plant: Service) -> None:
    values = list(random_numbers())
    with serving(plant) as address:
        context = browser.new_context(base_url=address)
        page = context.new_page()
        for language in ("en", "de"):
            page.goto(f"/status?lang={language}")
            shown = page.evaluate("(values) => values.map((each) => ballscrew.number(...each))", values)
            expected = [format_number(value, decimals, language) for value, decimals in values]
            assert shown == expected
        context.close()


def test_page_api_and_command_line_have_the_same_numbers(
    plant: Service, capsys: pytest.CaptureFixture[str]
) -> None:
    with client_of(plant) as client:
        answer = client.get("/api/v1/axes").json()["axes"]
        page = {}
        for language in ("en", "de"):
            text = client.get(f"/?part=rows&lang={language}").text
            page[language] = {unescape(name): row for name, row in re.findall(ROW, text, re.DOTALL)}
        single = {axis["axis"]: client.get(f"/api/v1/axes/{axis['axis']}").json() for axis in answer}
    capsys.readouterr()
    assert run(["store", "list", "--store", str(plant.store.path), "--json"]) == 0
    listed = {axis["axis"]: axis for axis in json.loads(capsys.readouterr().out)["axes"]}
    count = 0
    for axis in answer:
        name, stiffness, life = axis["axis"], axis["stiffness"], axis["rul_days"]
        assert single[name]["stiffness"] == stiffness
        assert single[name]["rul_days"] == life
        assert listed[name]["stiffness"] == plain(stiffness)
        assert listed[name]["rul_days"] == plain(life)
        for language in ("en", "de"):
            row = page[language][name]
            assert f'data-value="{stiffness[0]}"' in row
            assert format_percent(stiffness, language) in row
            if axis["state"] in ("alarm", "watch"):
                assert re.search(rf"\b{re.escape(format_number(life['0.05'], 0, language))}\b", row)
        count += len(stiffness) + len(life)
    assert count >= 200


@pytest.mark.slow
def test_the_report_of_the_fleet_has_the_numbers_of_the_api(plant: Service, tmp_path: Path) -> None:
    with client_of(plant) as client:
        answer = client.get("/api/v1/axes").json()["axes"]
    out = tmp_path / "fleet.html"
    assert run(["report", "--data", str(plant.store.path), "--out", str(out)]) == 0
    text = out.read_text(encoding="utf-8")
    rows = dict(re.findall(r'<td><a href="#axis-\d+">([^<]*)</a></td>(.*?)</tr>', text, re.DOTALL))
    assert set(rows) == {axis["axis"] for axis in answer}
    count = 0
    for axis in answer:
        assert f">{interval_words(axis['stiffness'])}<" in rows[axis["axis"]]
        count += 3
        if axis["rul_days"]:
            assert f">{life_words(axis['rul_days']).removesuffix(' days')}<" in rows[axis["axis"]]
            count += 3
    assert count >= 200


def test_a_stored_run_has_the_same_numbers_on_pages_from_the_api_the_command_line_and_in_the_report(
    plant: Service, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with client_of(plant) as client:
        name = client.get("/api/v1/axes").json()["axes"][0]["axis"]
        answer = client.get(f"/api/v1/axes/{name}").json()
        trend = client.get(f"/api/v1/axes/{name}/trend").json()["runs"]["stiffness"]
        history = client.get(f"/api/v1/axes/{name}/history?format=csv").text.splitlines()
        axis_page = client.get(f"/axes/{name}?runs=all&lang=en").text
        last = answer["runs"][-1]["run"]
        result = client.get(f"/api/v1/runs/{last}").json()["run"]
        run_page = client.get(f"/runs/{last}?lang=en").text
    store = str(plant.store.path)
    capsys.readouterr()
    assert run(["store", "show", name, "--store", store, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["runs"] == plain(answer["runs"])
    assert run(["report", name, "--data", store, "--out", str(tmp_path / "axis.html")]) == 0
    report = (tmp_path / "axis.html").read_text(encoding="utf-8")
    column = history[0].split(",").index("stiffness")
    for line, each, ratio in zip(history[1:], answer["runs"], trend, strict=True):
        stiffness = each["stiffness"]
        assert (float(line.split(",")[column]) if stiffness else None) == (stiffness or [None])[0]
        assert ratio == stiffness
        assert format_percent(stiffness, "en") in axis_page
        assert format_percent(stiffness, "en") == interval_words(stiffness)
        assert f">{interval_words(stiffness)}<" in report
    assert life_words(answer["rul_days"]) in report
    for cell in result["cells"]:
        assert format_number(cell["frequency_Hz"], 2, "en") in run_page
