"""Forms in Chromium: an upload, a form that is sent without htmx, and one that is refused with it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect
from tests.service.conftest import FILES, SETUP, NewService, client_of, work_off
from tests.service.pages.browser import HOSTILE, Window, serving

from ballscrew.service.serving import Service
from ballscrew.store.service_tables import Upload


@pytest.fixture
def plant(new_service: NewService) -> Service:
    """A service with an axis that is set up."""
    service = new_service()
    with client_of(service) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
    return service


@pytest.fixture
def window(browser: Browser, plant: Service) -> Iterator[Window]:
    """A window of that service, which must have no problem at the end of the test."""
    with serving(plant) as address:
        found = Window(browser, address, timezone_id="Europe/Berlin")
        yield found
        found.close()
    assert found.problems == []


@pytest.mark.parametrize(
    ("load", "mass", "temperature", "celsius"),
    [
        ("110 lb", 110 * 0.45359237, "77 °F", 25.0),
        pytest.param("100,5", 100.5, "25 °C", 25.0, marks=pytest.mark.slow),
        pytest.param(".05 T", 50.0, "20", 20.0, marks=pytest.mark.slow),
    ],
)
def test_a_run_is_uploaded_and_its_verdict_appears(
    window: Window, plant: Service, load: str, mass: float, temperature: str, celsius: float
) -> None:
    page = window.open("/axes/bench/actions")
    send_button = page.get_by_role("button", name="Send")
    problem = page.locator("[data-problem]")
    send_button.click()
    expect(problem).to_have_text("Choose one file or more.")
    files = [
        {"name": name, "mimeType": "application/octet-stream", "buffer": content}
        for name, content in FILES.items()
    ]
    page.set_input_files("input[name=files]", files)  # type: ignore[arg-type]  as its documentation states
    for wrong in ("", "50 m", "-5 kg", "1,000", "1.000 kg", "5 constructor", "5 kg 6", 'a" # '):
        page.fill("input[name=load]", wrong)
        send_button.click()
        expect(problem).to_contain_text("Load must be a mass, such as 50 kg, 110 lb or 0.05 t")
        page.fill("input[name=load]", "1")
        page.evaluate("document.querySelector('[data-problem]').textContent = ''")
    page.fill("input[name=load]", load)
    page.fill("input[name=measured_at]", "2026-01-20T10:00:00")
    page.fill("input[name=temperature]", "25 m")
    send_button.click()
    expect(problem).to_contain_text("Temperature must be a number of °C")
    page.fill("input[name=temperature]", temperature)
    send_button.click()
    expect(page.locator("[data-result]")).to_contain_text("waits for its analysis", timeout=30_000)
    with plant.store.read() as session:
        (row,) = session.query(Upload).all()
        assert row.stated["measured_at"] == "2026-01-20T09:00:00+00:00"
        assert row.stated["mass_kg"] == pytest.approx(mass)
        assert row.stated["temperature_C"] == pytest.approx(celsius)
    work_off(plant, lambda _: ("refused", f"a.h5: {HOSTILE}."))
    expect(problem).to_have_text(f"The run cannot be analysed: a.h5: {HOSTILE}.")
    send_button.click()
    expect(page.locator("[data-files]")).to_contain_text("already stored")


def test_a_form_is_sent_without_htmx(window: Window) -> None:
    page = window.open("/axes/bench/setup")
    page.fill("input[name=site]", HOSTILE)
    page.get_by_role("button", name="Save").click()
    expect(page.locator(".message.done")).to_be_visible()
    expect(page.locator("input[name=site]")).to_have_value(HOSTILE)


def test_a_form_that_is_refused_shows_its_sentence_and_what_was_entered(window: Window) -> None:
    window.expected = {422}
    page = window.open("/axes/bench/actions")
    page.locator("#event input[name=at]").fill("2026-01-20T10:00")
    page.locator("#event input[name=text]").fill(HOSTILE)
    page.locator("#event").get_by_role("button", name="Preview").click()
    expect(page.locator("#event .message")).to_contain_text("no model")
    expect(page.locator("#event .message")).to_be_focused()
    expect(page.locator("#event input[name=text]")).to_have_value(HOSTILE)
    expect(page.locator("#event input[name=offset]")).to_have_value("+01:00")
    page.locator("#event").get_by_role("button", name="Add the event").click()
    expect(page.locator("#event .message.done")).to_be_visible()
    expect(page.locator("#event input[name=text]")).to_have_value("")


def test_long_names_and_texts_do_not_widen_a_page_and_are_whole_on_demand(
    window: Window, plant: Service
) -> None:
    name, text = "M" * 200, "word" * 2500
    with client_of(plant) as client:
        sheet = SETUP["sheet"].replace('"bench"', f'"{"X" * 200}"')
        setup = SETUP | {"machine": name, "site": name, "sheet": sheet}
        assert client.put(f"/api/v1/axes/{'X' * 200}", json=setup).status_code == 200
        event = [{"at": "2026-01-20T10:00:00Z", "kind": "note", "text": text}]
        assert client.post(f"/api/v1/axes/{'X' * 200}/events", json=event).status_code == 200
        for names in ({"machine": name + "M"}, {"site": name + "M"}):
            answer = client.put("/api/v1/axes/bench", json=SETUP | names)
            assert answer.status_code == 422
            assert "at most 200 characters" in answer.json()["detail"]
        long_axis = SETUP | {"sheet": sheet.replace("XX", "XXX")}
        answer = client.put(f"/api/v1/axes/{'X' * 300}", json=long_axis)
        assert (answer.status_code, "it must have 200 at most" in answer.json()["detail"]) == (422, True)
    for path in (
        "/",
        f"/axes/{'X' * 200}",
        f"/axes/{'X' * 200}/actions",
        f"/axes/{'X' * 200}/setup",
        "/compare",
    ):
        page = window.open(path)
        for width in (1280, 1024, 390):
            page.set_viewport_size({"width": width, "height": 800})
            wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            assert page.evaluate(wide) <= 0, (path, width)
            boxes = (
                "[...document.querySelectorAll('.wide')].map((each) => each.scrollWidth - each.clientWidth)"
            )
            assert max(page.evaluate(boxes), default=0) <= (0 if width > 1024 else 200), (path, width)
            rows = "[...document.querySelectorAll('tbody tr')].map((each) => each.clientHeight)"
            assert max(page.evaluate(rows), default=0) < 700, (path, width)
    page = window.open(f"/axes/{'X' * 200}/actions")
    assert text not in page.locator("#events").inner_text()
    page.locator("#events .more summary").press("Enter")
    assert page.locator("#events .more").inner_text().replace("\n", "") == text
