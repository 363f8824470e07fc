"""Users in Chromium: the first link, sign-in and sign-out by the keyboard, what each role shows."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page
from tests.service.conftest import SETUP, client_of
from tests.service.pages.browser import MARKUP, Window, serving
from tests.service.pages.test_browser import faults, overflow, resize
from tests.service.people import PASSWORD, new_user

from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.users import end_sessions_of, first_link
from ballscrew.store.migrating import create_store


def make_service(folder: Path) -> Service:
    """A service where people must sign in, with an axis of a machine with a hostile name."""
    settings = ServerSettings(min_free_bytes=0)
    service = Service(ServedStore(create_store(folder / "store").path), settings)
    service.partial.mkdir()
    with client_of(service) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP | {"machine": MARKUP}).status_code == 200
    service.settings = settings.model_copy(update={"require_login": True})
    return service


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Service:
    """With a user of each role."""
    service = make_service(tmp_path_factory.mktemp("plant"))
    for name, role in {"anna": "admin", "max": "maintainer", "vera": "viewer"}.items():
        new_user(service, name, role)
    return service


@pytest.fixture(scope="module")
def address(plant: Service) -> Iterator[str]:
    with serving(plant) as found:
        yield found


@pytest.fixture
def window(browser: Browser, address: str) -> Iterator[Window]:
    """A window without a session, which must have no problem at the end of the test."""
    found = Window(browser, address)
    yield found
    found.close()
    assert found.problems == []


def sign_in(page: Page, name: str, path: str = "/") -> None:
    page.goto(path)
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url(f"**{path}")


def check(page: Page) -> None:
    """A page is accessible and fits."""
    for size in ("desk", "phone"):
        resize(page, size, "light")
        assert overflow(page) <= 0, size
        assert faults(page) == []
    resize(page, "desk", "dark")
    assert faults(page) == []


def test_the_first_link_makes_an_administrator_by_the_keyboard_alone(
    browser: Browser, tmp_path: Path
) -> None:
    service = make_service(tmp_path)
    with serving(service) as address:
        window = Window(browser, address)
        page = window.page
        page.goto("/")
        assert page.url == f"{address}/sign-in?next=%2F"
        page.goto(f"/link/{first_link(service.store)}")
        check(page)
        page.get_by_label("Name").focus()
        for text in ("Änne", PASSWORD, PASSWORD):
            page.keyboard.type(text)
            page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == "Save and sign in"
        page.keyboard.press("Enter")
        page.wait_for_url(f"{address}/")
        assert page.get_by_role("link", name="Änne").is_visible()
        window.close()
    assert window.problems == []


def test_sign_in_and_sign_out_by_the_keyboard_alone(window: Window) -> None:
    page = window.page
    page.goto("/alarms?show=ended")
    assert "/sign-in?next=" in page.url
    check(page)
    page.get_by_label("Name").focus()
    page.keyboard.type("vera")
    page.keyboard.press("Tab")
    page.keyboard.type("wrong")
    window.expected = {401}
    page.keyboard.press("Enter")
    page.wait_for_selector("[role=alert]")
    assert page.get_by_role("alert").inner_text() == "The name or the password is wrong."
    check(page)
    page.get_by_label("Password").focus()
    page.keyboard.type(PASSWORD)
    page.keyboard.press("Enter")
    page.wait_for_url("**/alarms?show=ended")
    page.get_by_role("button", name="Sign out").focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/sign-in")
    page.go_back()
    assert "/sign-in" in page.url  # nothing of the page is stored
    page.goto("/")
    assert "/sign-in" in page.url


def test_a_viewer_sees_no_buttons_and_a_maintainer_does(browser: Browser, window: Window) -> None:
    page = window.page
    sign_in(page, "vera", "/alarms")
    assert page.locator("main form[method=post]").count() == 0
    assert page.get_by_text("Act", exact=True).count() == 0
    window.open("/axes/bench/actions")
    assert page.locator("main form").count() == 0
    check(page)
    window.open("/axes/bench/setup")
    assert page.get_by_label("Machine").is_disabled()
    assert page.get_by_role("button", name="Save").count() == 0
    check(page)
    window.expected = {403}
    page.goto("/users")
    assert page.get_by_role("alert").inner_text() == "this needs the role admin; 'vera' has viewer."
    other = Window(browser, window.address)
    sign_in(other.page, "max", "/axes/bench/actions")
    assert other.page.get_by_role("button", name="Add the event").is_visible()
    other.close()
    assert other.problems == []


def test_forms_that_htmx_sends_contain_the_token(window: Window) -> None:
    page = window.page
    sign_in(page, "max", "/axes/bench/actions")
    section = page.locator("#event")
    section.get_by_label("Kind").select_option("note")
    section.get_by_label("Text").fill("by max")
    with page.expect_response("**/actions/events") as answer:
        section.get_by_role("button", name="Add the event").click()
    assert answer.value.status == 303
    assert answer.value.request.headers["x-csrf-token"]
    page.locator("#event .message.done").wait_for()


def test_a_page_whose_session_ended_leads_to_the_sign_in(window: Window, plant: Service) -> None:
    page = window.page
    sign_in(page, "vera")
    page.wait_for_timeout(300)  # until the stream is open
    window.expected = {401}
    end_sessions_of(plant.store, "vera", by="test")
    page.evaluate("htmx.trigger(document.body, 'changes')")
    page.wait_for_url("**/sign-in?next=%2F")


def test_an_administrator_invites_a_user_who_changes_the_password(browser: Browser, window: Window) -> None:
    page = window.page
    sign_in(page, "anna", "/users")
    page.locator("#users").get_by_label("Name", exact=True).fill("<img src=x onerror=alert(1)>")
    page.get_by_role("button", name="Invite").click()
    page.wait_for_selector("pre")
    check(page)
    link = page.locator("pre").inner_text()
    page.locator("#tokens").get_by_label("Name").fill("dashboard")
    page.get_by_role("button", name="Create", exact=True).click()
    page.wait_for_selector("#tokens pre")
    assert re.fullmatch(r"bs_[\w-]{43}", page.locator("pre").inner_text())
    other = Window(browser, window.address)
    other.page.goto(link)
    other.page.get_by_label("Password").fill(PASSWORD)
    other.page.get_by_label("The same again").fill(PASSWORD)
    other.page.get_by_role("button", name="Save").click()
    other.page.get_by_role("link", name="<img").click()
    other.page.wait_for_url("**/account")
    check(other.page)
    other.page.get_by_label("Present password").fill(PASSWORD)
    for label in ("New password", "The same again"):
        other.page.get_by_label(label).fill("another good password")
    other.page.get_by_role("button", name="Change the password").click()
    assert other.page.get_by_role("status").inner_text().startswith("The password is changed")
    other.close()
    assert other.problems == []
