"""Pages in Chromium: accessible, without a horizontal bar, by the keyboard, and while data arrive."""

from __future__ import annotations

import csv
import pkgutil
import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from html import unescape
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, Route
from playwright.sync_api import Error as BrowserError
from starlette.routing import compile_path
from tests.service import raw_runs
from tests.service.conftest import client_of, send_result, wait_for, work_off
from tests.service.pages.browser import CHARTS_ARE_DRAWN, HOSTILE, Window, make_plant, serving
from tests.store.stored import RUNS

from ballscrew.base.result import not_executed
from ballscrew.service import pages, reading
from ballscrew.service.pages.help_topics import TOPICS
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.migrating import create_store

HOSTILE_URL = quote(HOSTILE, safe="")
RUN_URL = quote(RUNS[3].id)
PAGES = {
    "/": ["/"],
    "/alarms": ["/alarms"],
    "/audit": ["/audit", "/audit?axis=bench&action=add"],
    "/axes/{axis:path}": ["/axes/bench", f"/axes/{HOSTILE_URL}", "/axes/Y%20axis"],
    "/axes/{axis}/actions": ["/axes/bench/actions", f"/axes/{HOSTILE_URL}/actions"],
    "/axes/{axis}/calibration": ["/axes/bench/calibration"],
    "/axes/{axis}/setup": ["/axes/bench/setup", f"/axes/{HOSTILE_URL}/setup"],
    "/compare": [
        "/compare",
        f"/compare?a={RUN_URL}&b={quote(RUNS[9].id)}",
        f"/compare?a=bench&b={HOSTILE_URL}",
    ],
    "/findings": ["/findings"],
    "/help": ["/help"],
    "/help/{topic}": [f"/help/{topic}" for topic in TOPICS],
    "/messages": ["/messages"],
    "/runs/{run}": [f"/runs/{RUN_URL}", "/runs/hostile"],
    "/runs/{run}/signals": [f"/runs/{RUN_URL}/signals"],
    "/settings": ["/settings"],
    "/setup": ["/setup"],
    "/sign-in": ["/sign-in"],
    "/status": ["/status"],
    "/users": ["/users"],
}
"""Addresses of each route that is a page; those of an axis also with hostile names."""

DOWNLOADS = {
    "/axes/{axis}/gcode",
    "/axes/{axis}/calibration/model",
    "/axes/{axis:path}/report.{kind}",
}
OF_USERS = {"/account", "/link/{link}"}
"""In test_browser_users.py: there is no user here."""

ADDRESSES = [address for addresses in PAGES.values() for address in addresses]
"""Of each route the first is opened by every run of the tests, the others by those that are slow."""

MARKED = [
    pytest.param(address, marks=[pytest.mark.slow] if number else [], id=address)
    for addresses in PAGES.values()
    for number, address in enumerate(addresses)
]
SIZES = {"desk": (1280, 900), "panel": (1024, 600), "phone": (390, 844)}
FOCUSABLE = """() => [...document.querySelectorAll(
  "a[href], button, input, select, textarea, summary, [tabindex]")]
  .filter((each) => each.tabIndex >= 0 && !each.disabled && each.checkVisibility())
  .filter((each) => each.type !== "radio" || each.checked)"""


WIDER = """() => [...document.querySelectorAll(".wide")]
  .filter((each) => each.checkVisibility() && each.scrollWidth > each.clientWidth)
  .map((each) => each.innerText.slice(0, 60))"""
FOCUSED = """(all) => [all.indexOf(document.activeElement),
  getComputedStyle(document.activeElement).outlineStyle]"""


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Service:
    return make_plant(tmp_path_factory.mktemp("plant"))


@pytest.fixture(scope="module")
def address(plant: Service) -> Iterator[str]:
    with serving(plant) as found:
        yield found


@pytest.fixture
def new_window(browser: Browser, address: str) -> Iterator[Any]:
    """Opens windows, which must have no problem at the end of the test."""
    windows: list[Window] = []

    def make(**options: Any) -> Window:
        windows.append(Window(browser, address, **options))
        return windows[-1]

    yield make
    for window in windows:
        window.close()
    assert [problem for window in windows for problem in window.problems] == []


@pytest.fixture
def window(new_window: Any) -> Window:
    found: Window = new_window()
    return found


def faults(page: Page) -> list[str]:
    """What axe finds."""
    found = []
    for violation in Axe().run(page).response["violations"]:
        places = ", ".join(str(node["target"]) for node in violation["nodes"][:5])
        found.append(f"{violation['id']}: {violation['help']}: {places}")
    return found


def overflow(page: Page) -> float:
    """Pixels that the page is wider than the window, once its charts have their new sizes."""
    width = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    with suppress(BrowserError):
        page.wait_for_function(f"() => {width} <= 0", timeout=30_000)
    return float(page.evaluate(width))


def resize(page: Page, size: str, scheme: Any) -> None:
    page.set_viewport_size(dict(zip(("width", "height"), SIZES[size], strict=True)))  # type: ignore[arg-type]
    page.emulate_media(color_scheme=scheme)


def test_the_table_has_every_page() -> None:
    found = set()
    for module in pkgutil.iter_modules(pages.__path__):
        router = getattr(import_module(f"{pages.__name__}.{module.name}"), "router", None)
        for route in getattr(router, "routes", ()):
            if "GET" in route.methods and not route.path.startswith(("/static/", "/api/")):
                found.add(route.path)
    assert found == set(PAGES) | DOWNLOADS | OF_USERS
    for path, addresses in PAGES.items():
        assert addresses
        for each in addresses:
            assert compile_path(path)[0].match(each.split("?")[0]), each


@pytest.mark.parametrize("path", MARKED)
def test_a_page_is_used_by_the_keyboard_is_accessible_and_fits(path: str, window: Window) -> None:
    """In one window: to open another takes longer than to look."""
    page = window.open(path)
    assert page.locator("h1").count() == 1
    check_keyboard(page)
    for size in SIZES:
        resize(page, size, "light")
        assert overflow(page) <= 0, size
    resize(page, "phone", "dark")
    assert faults(page) == []
    resize(page, "desk", "light")
    assert faults(page) == []


def test_fleet_and_axis_are_read_without_scrolling_sideways(new_window: Any) -> None:
    window = new_window(locale="de")
    for path, size in (("/", "panel"), ("/", "phone"), ("/axes/bench", "phone")):
        page = window.open(path)
        resize(page, size, "light")
        page.wait_for_function(f"() => !({WIDER})().length")


def check_keyboard(page: Page) -> None:
    """Tab reaches each control in the order of the page, with a visible focus."""
    count = page.evaluate(f"({FOCUSABLE})().length")
    fields = page.locator("input[type=date], input[type=datetime-local]").count()
    reached = []
    for _ in range(count + 8 * fields):  # a time has several fields
        page.keyboard.press("Tab")
        reached.append(page.evaluate(f"({FOCUSED})(({FOCUSABLE})())"))
        if reached[-1][0] < 0:  # the end of the page
            break
    stops = [next(group) for _, group in groupby(reached, key=lambda stop: stop[0])]
    assert [place for place, _ in stops if place >= 0] == list(range(count))
    assert {outline for place, outline in stops if place >= 0} <= {"solid", "auto"}


@pytest.mark.slow
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("path", MARKED)
def test_a_page_is_accessible_in_every_size_scheme_and_language(
    path: str, size: str, scheme: str, language: str, new_window: Any
) -> None:
    window = new_window(locale=language, color_scheme=scheme)
    resize(window.page, size, scheme)
    page = window.open(path)
    assert page.locator("html").get_attribute("lang") == language
    assert faults(page) == []
    assert overflow(page) <= 0


def test_the_skip_link_leads_to_the_content_and_enter_follows_a_link(window: Window) -> None:
    page = window.open("/")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
    page.locator("nav a[href='/status']").focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/status")


@pytest.mark.parametrize("path", MARKED)
def test_a_page_is_read_without_scripts(path: str, new_window: Any) -> None:
    page = new_window(java_script_enabled=False).page
    page.goto(path)
    assert page.locator("h1").inner_text()
    assert len(page.locator("main").inner_text()) > 100


def test_names_are_text_and_never_markup(window: Window) -> None:
    page = window.open("/")
    row = page.locator("tr", has_text="alert(2)")
    assert row.locator("th a").inner_text() == HOSTILE
    assert row.locator("th a").get_attribute("href") == f"/axes/{HOSTILE_URL}"
    for path in ("/status", "/alarms", "/runs/hostile", *(each for each in ADDRESSES if HOSTILE_URL in each)):
        page = window.open(path)
        assert HOSTILE in page.locator("main").inner_text() or page.locator("main input").count(), path
        assert page.locator("main img, main script").count() == 0, path


def test_every_link_leads_to_a_page_or_a_file(plant: Service) -> None:
    waiting, known, wrong = ["/"], {"/"}, []
    with client_of(plant, follow_redirects=True) as client:
        while waiting:
            path = waiting.pop()
            answer = client.get(path, headers={"Accept": "text/html"})
            if answer.status_code != 200:
                wrong.append((answer.status_code, path))
            if not answer.headers["content-type"].startswith("text/html"):
                continue
            for target in re.findall(r'(?:href|data-source)="(/[^"#]*)', answer.text):
                link = unescape(target)
                shape = re.sub(
                    r"(cell|run|against|a|b)=[^&]*", r"\1", re.sub(r"/runs/[^/?]*", "/runs/", link)
                )
                if shape not in known and not link.startswith("/api/v1/events"):
                    known.add(shape)
                    waiting.append(link)
    assert wrong == []
    assert len(known) >= 50


def test_a_filter_is_in_the_address_and_survives_back_forward_and_reload(window: Window) -> None:
    page = window.open("/")
    rows = page.locator("tbody tr:visible")
    assert rows.count() == 3
    page.get_by_label("Search").fill("mill 5")
    assert rows.count() == 1
    assert page.url.endswith("?search=mill+5")
    page.get_by_role("link", name="Server").click()
    page.wait_for_url("**/status")
    page.go_back()
    assert page.get_by_label("Search").input_value() == "mill 5"
    assert rows.count() == 1
    page.reload()
    assert rows.count() == 1
    page.go_forward()
    assert page.locator("h1").inner_text() == "Server"


def test_a_table_is_sorted_by_its_heads_and_exported(window: Window, tmp_path: Path) -> None:
    page = window.open("/")
    head = page.locator("th", has=page.get_by_role("button", name="Axis", exact=True))
    for order in ("ascending", "descending"):
        head.get_by_role("button").press("Enter")
        assert head.get_attribute("aria-sort") == order
        names = page.locator("tbody tr th").all_inner_texts()
        assert (names[0] == "Y axis") == (order == "descending")
    with page.expect_download() as download:
        page.get_by_role("link", name="All axes as CSV").click()
    download.value.save_as(tmp_path / "fleet.csv")
    rows = list(csv.DictReader((tmp_path / "fleet.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["axis"] for row in rows} == {"bench", "Y axis", HOSTILE}
    page = window.open("/axes/bench")
    text = 'loose;=HYPERLINK(1);"  +2'
    page.locator("#axis-events ~ .wide tbody td").last.evaluate(
        "(cell, text) => (cell.textContent = text)", text
    )
    with page.expect_download() as download:
        page.locator("#axis-events ~ .tools button").click()
    download.value.save_as(tmp_path / "events.csv")
    rows = list(csv.DictReader((tmp_path / "events.csv").read_text(encoding="utf-8-sig").splitlines()))
    assert [datetime.fromisoformat(row["Time"]).tzinfo for row in rows] == [UTC]
    assert list(rows[0].values())[-1] == not_executed(" ".join(text.split()))


def test_empty_cells_are_last_in_both_directions(window: Window) -> None:
    page = window.open("/")
    head = page.locator("th", has=page.get_by_role("button", name="Last run"))
    column = head.evaluate("(head) => head.cellIndex")
    for _ in range(2):
        head.get_by_role("button").click()
        cells = page.locator(f"tbody tr > :nth-child({column + 1})")
        values = cells.evaluate_all("(all) => all.map((each) => each.dataset.value)")
        assert [value == "" for value in values] == [False, False, True]


def test_a_time_without_a_zone_is_in_utc(new_window: Any) -> None:
    page = new_window(locale="en-GB", timezone_id="Asia/Tokyo").open(f"/compare?a=bench&b={HOSTILE_URL}")
    times = ["2026-01-31T08:00", "2026-01-31 08:00:00.5", "2026-01-31T08:00Z", "2026-01-31T09:00+01:00"]
    read = "(all) => all.map((each) => ballscrew.instant(each).toISOString().slice(0, 16))"
    assert set(page.evaluate(read, times)) == {"2026-01-31T08:00"}
    shown = page.evaluate(
        """async (time) => {
          const place = document.querySelector("[data-chart=trends]");
          const shown = document.createElement("time");
          shown.dateTime = time;
          place.before(shown);
          document.body.dispatchEvent(new CustomEvent("htmx:afterSwap"));
          const { join } = uPlot;
          const tables = [];
          uPlot.join = (given) => (tables.push(...given), join(given));
          const row = { measured_at: time, stiffness: 1, stiffness_low: 1, stiffness_high: 1 };
          await ballscrew.charts.trends(place, { axis: "a", history: [row] });
          return [shown.textContent, tables[0][0][0]];
        }""",
        times[0],
    )
    assert shown == ["31 Jan 2026, 17:00", datetime(2026, 1, 31, 8, tzinfo=UTC).timestamp()]


def test_the_second_axis_of_a_comparison_is_waited_for_and_its_error_is_shown(new_window: Any) -> None:
    window = new_window()
    window.expected |= {404, 503}
    requests: list[Route] = []

    def answer(route: Route) -> None:
        requests.append(route)
        if len(requests) == 1:
            busy = {"detail": "the store is busy."}
            route.fulfill(status=503, json=busy, headers={"Retry-After": "0.1"})

    page = window.page
    page.route(re.compile(re.escape(f"/api/v1/axes/{HOSTILE_URL}/history")), answer)
    page.goto(f"/compare?a=bench&b={HOSTILE_URL}")
    place = page.locator("[data-chart=trends]")
    page.get_by_text("the store is busy.").wait_for()
    while len(requests) < 2:
        page.wait_for_timeout(50)
    assert place.get_attribute("data-drawn") == "yes"
    requests[1].fulfill(status=404, json={"detail": "there is no such axis."})
    page.wait_for_function(CHARTS_ARE_DRAWN)
    assert place.inner_text() == "there is no such axis."


def test_the_language_is_changed_with_the_filter_and_remembered(new_window: Any) -> None:
    window = new_window(locale="en-GB")
    page = window.open("/")
    page.get_by_label("Search").fill("mill")
    page.get_by_role("link", name="Deutsch").click()
    page.wait_for_selector("html[lang=de]")
    assert "search=mill" in page.url
    assert window.open("/status").locator("html").get_attribute("lang") == "de"


def test_a_run_that_arrives_appears_in_two_windows_without_a_reload(
    new_window: Any, plant: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    streams: list[int] = []
    newest = reading._newest

    def newest_of_a_stream(service: Service) -> int:
        streams.append(newest(service))
        return streams[-1]

    monkeypatch.setattr(reading, "_newest", newest_of_a_stream)
    windows = [new_window(), new_window()]
    for window in windows:
        window.open("/").evaluate("window.same = true")
    wait_for(lambda: len(streams) >= 2)
    last = "//tr[.//a[text()='bench']]/td[7]"  # of the last run
    before = windows[0].page.locator(last).get_attribute("data-value")
    with client_of(plant) as client:
        assert send_result(client, len(RUNS) - 1).status_code == 202
    work_off(plant, lambda _: pytest.fail("no analysis"))
    plant.announce()  # as a worker does
    for window in windows:
        page = window.page
        page.wait_for_function(
            """([path, before]) =>
              document.evaluate(path, document, null, 9).singleNodeValue.dataset.value > before""",
            arg=[last, before],
        )
        assert page.evaluate("window.same")
        assert page.locator("thead button").count() == 9  # of the new table too


def test_a_page_is_reloaded_while_data_arrive(window: Window, plant: Service) -> None:
    page = window.open("/")
    for _ in range(5):
        plant.announce()
        page.reload()
    assert page.locator("tbody tr").count() == 3


def test_the_map_of_frf_is_computed_when_it_is_opened_and_says_which_runs_are_blank(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw_runs.compute_here(monkeypatch)
    raw_runs.analyse_at_once(monkeypatch)
    service = Service(ServedStore(create_store(tmp_path / "store").path), ServerSettings(min_free_bytes=0))
    service.partial.mkdir()
    service.scratch.mkdir()
    with client_of(service) as client:
        run = raw_runs.send_raw(client)
        raw_runs.analyse(service, run)
        send_result(client, 3)
    with serving(service) as address:
        window = Window(browser, address)
        page = window.page
        requests: list[str] = []
        page.on("request", lambda request: requests.append(request.url))
        held: list[Route] = []
        page.route("**/trend", lambda route: held.append(route))
        page.goto("/axes/bench")
        page.locator("[data-responses] summary").press("Enter")  # before the trend has arrived
        held[0].continue_()
        page.unroute("**/trend")
        page.wait_for_selector("[data-plot=responses] canvas")
        about = "Runs: 1 computed from their raw files; 1 blank, since their raw files are not stored"
        assert page.locator("[data-about]").inner_text() == about
        select = page.locator("[data-responses] select")
        assert select.locator("option").count() == len(RUNS[0].cells)
        with page.expect_response("**/responses?cell=5"):
            select.select_option("5")
        page.wait_for_load_state("networkidle")
        assert [url.partition("?")[2] for url in requests if "/responses" in url] == ["cell=0", "cell=5"]
        later = [503, 202, 202]

        def answer(route: Route) -> None:
            if "/magnitude" in route.request.url and later:
                return route.fulfill(status=later.pop(), json={"detail": "later."})
            if "/magnitude" in route.request.url:
                return route.continue_()
            found = route.fetch().json()
            place = next(number for number, each in enumerate(found["magnitude_dB"]) if each)
            found["magnitude_dB"][place], found["waiting"] = None, [found["run"][place]]
            return route.fulfill(json=found)

        window.expected = {503}
        page.route(re.compile("/responses|/magnitude"), answer)
        requests.clear()
        with page.expect_response(lambda found: "/magnitude" in found.url and found.status == 200):
            select.select_option("3")
        page.wait_for_function(
            "(text) => document.querySelector('[data-about]').textContent === text", arg=about
        )
        asked = [url.split("?")[0].rpartition("/")[2] for url in requests]
        assert asked == ["responses", *4 * ["magnitude"]]
        assert faults(page) == []
        assert overflow(page) <= 0
        window.close()
    assert window.problems == []


def test_signals_that_are_not_there_yet_are_asked_for_again(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a file is read, and when the server refuses for a while."""
    raw_runs.compute_here(monkeypatch)
    service = Service(ServedStore(create_store(tmp_path / "store").path), ServerSettings(min_free_bytes=0))
    service.partial.mkdir()
    service.scratch.mkdir()
    with client_of(service) as client:
        run = raw_runs.send_raw(client)
    raw_runs.analyse(service, run)
    later = {
        "file": [(503, "the process that computes it ended."), (202, "the file is being read.")],
        "channel": [(202, "the file is being read."), (429, "too many results are being computed.")],
    }

    def answer(route: Route) -> None:
        waiting = later["channel" if "channel=" in route.request.url else "file"]
        if not waiting:
            return route.continue_()
        status, detail = waiting.pop()
        headers = {"Retry-After": "0.1"}
        return route.fulfill(status=status, json={"detail": detail}, headers=headers)

    with serving(service) as address:
        window = Window(browser, address)
        window.expected = {429, 503}
        window.page.route("**/api/v1/runs/*/signals?*", answer)
        window.page.goto(f"/runs/{quote(run)}/signals")
        window.page.wait_for_selector(".signals .u-legend")
        window.page.wait_for_load_state("networkidle")
        assert later == {"file": [], "channel": []}
        assert window.page.locator(".message").all_inner_texts() == []
        assert window.page.locator("[data-shown]").inner_text() == "0.0 s … 40.0 s"
        window.close()
    assert window.problems == []


@pytest.mark.parametrize("path", MARKED)
def test_a_page_is_printed_without_controls(path: str, window: Window) -> None:
    """On A4, whose margins leave 703 CSS pixels, every chart and table is whole."""
    page = window.open(path)
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.set_viewport_size({"width": 703, "height": 1000})
    assert page.locator("header nav:visible, .tools:visible, .filters:visible, footer:visible").count() == 0
    assert overflow(page) <= 0
    cut = """each => each.checkVisibility() && each.getBoundingClientRect().right > 704"""
    boxes = "[...document.querySelectorAll('.wide')].map((each) => each.scrollHeight - each.clientHeight)"
    assert max(page.evaluate(boxes), default=0) <= 0
    assert (
        page.evaluate(f"[...document.querySelectorAll('main *')].filter({cut}).map((e) => e.outerHTML)") == []
    )


def test_charts_are_redrawn_in_the_width_of_a_printed_page(window: Window) -> None:
    page = window.open("/axes/bench")
    for plot in ("evidence", "frequencies"):
        page.wait_for_selector(f"[data-plot={plot}] canvas")
    widths = "[...document.querySelectorAll('.uplot .u-wrap')].map((each) => each.clientWidth)"
    before = page.evaluate(widths)
    assert min(before) > 1000
    page.evaluate(f"addEventListener('beforeprint', () => queueMicrotask(() => (window.printed = {widths})))")
    page.pdf(format="A4")
    assert set(page.evaluate("printed")) == {700}
    assert set(page.evaluate(widths)) == set(before)
