"""Settings: options, environment, file and defaults, in this order; the page lists all of them."""

from __future__ import annotations

import json
import re
import sys
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from tests.docs.pages import page

from ballscrew.base.errors import InputError
from ballscrew.cli.shell import run
from ballscrew.service.settings import (
    PREFIX,
    ServerSettings,
    default_folder,
    origins,
    read_settings,
)
from ballscrew.store.retention import RetentionPolicy


def test_an_option_overrides_the_environment_which_overrides_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "server.toml").write_text('port = 1\nworkers = 1\nhost = "::1"\nallowed_hosts = ["a"]\n')
    monkeypatch.setenv("BALLSCREW_SERVER_PORT", "2")
    monkeypatch.setenv("BALLSCREW_SERVER_WORKERS", "2")
    options = {"port": 3}
    found = read_settings(tmp_path, None, options)
    assert (found.port, found.workers, found.host, found.attempts) == (3, 2, "::1", 3)
    assert found.allowed_hosts == ("a",)
    where = origins(tmp_path, None, options)
    assert [where[name] for name in ("port", "workers", "host", "attempts")] == [
        "option",
        "BALLSCREW_SERVER_WORKERS",
        str(tmp_path / "server.toml"),
        "default",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("port = 70000", "port is 70000"),
        ("port = [", "not TOML"),
        ("retention_days = 1000000", "less than or equal to 36500"),
        ("pot = 1", "pot is not a known setting"),
        ('method = "best"', "method is 'best'"),
        ("workers = 0", "workers is 0"),
        ("allowed_hosts = 3", "allowed_hosts is 3"),
        ('working_days = ["Montag"]', "working_days"),
        ("working_days = []", "working_days"),
        ('holidays = ["Christmas"]', "holidays"),
        ('shifts = ["6-14"]', "a shift is '6-14'; it must be such as 06:00-14:00."),
    ],
)
def test_a_wrong_setting_is_a_sentence(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "server.toml").write_text(text)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_settings(tmp_path, None, {})
    assert "server.toml" in str(caught.value)


WORKING = {"working_days": ("Mon", "Tue", "Wed", "Thu", "Fri"), "time_zone": "Europe/Berlin"}


@pytest.mark.parametrize(
    ("begin", "end", "hours", "settings"),
    [
        ("2026-01-02T08:00+01:00", "2026-01-03T08:00+01:00", 24, {}),  # Friday to Saturday
        ("2026-01-02T08:00+01:00", "2026-01-05T08:00+01:00", 24, WORKING),  # to Monday
        ("2026-01-03T08:00+01:00", "2026-01-04T08:00+01:00", 0, WORKING),
        ("2026-01-02T08:00+01:00", "2026-01-06T08:00+01:00", 24, WORKING | {"holidays": ("2026-01-05",)}),
        ("2026-01-02T08:00Z", "2026-01-05T08:00Z", 24, WORKING),  # midnight is that of the zone
        ("2026-01-02T23:30Z", "2026-01-04T22:30Z", 0, WORKING),
        ("2026-01-04T23:30Z", "2026-01-05T23:00Z", 23.5, WORKING),
        ("2026-03-27T00:00+01:00", "2026-03-31T00:00+02:00", 48, WORKING),  # with the change to summer time
        ("2026-03-29T00:00+01:00", "2026-03-30T00:00+02:00", 23, {"time_zone": "Europe/Berlin"}),
        ("2026-01-02T08:00Z", "2026-01-01T08:00Z", 0, {}),
        ("2026-01-02T13:00+01:00", "2026-01-05T07:00+01:00", 2, WORKING | {"shifts": ("06:00-14:00",)}),
    ],
)
def test_silence_is_counted_on_working_days_alone(
    begin: str, end: str, hours: float, settings: dict[str, Any]
) -> None:
    calendar = ServerSettings(**settings).calendar
    start, present = datetime.fromisoformat(begin), datetime.fromisoformat(end)
    assert present <= calendar.after(start, timedelta(hours=hours))
    if hours > 0:
        assert present > calendar.after(start, timedelta(hours=hours, seconds=-1))


_MONDAYS = tuple(date(2027, 1, 4) + timedelta(weeks=week) for week in range(52))


def test_days_are_read_from_the_file_and_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "server.toml"
    path.write_text('working_days = ["Mon", "Tue"]\nholidays = [2026-12-25]\ntime_zone = "Asia/Tokyo"\n')
    found = read_settings(tmp_path, None, {})
    assert (found.working_days, found.holidays) == (("Mon", "Tue"), (date(2026, 12, 25),))
    assert run(["serve", "--data", str(tmp_path), "--check", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)["settings"]
    assert printed["holidays"]["value"] == ["2026-12-25"]
    (problem,) = ServerSettings(working_days=("Mon",), holidays=_MONDAYS).problems()
    assert problem == "holidays: there is no working day for a year from 2027-01-04 on."
    for zone in ("Mars/Base", "", "../x", "\x00", "/etc/passwd"):
        (problem,) = ServerSettings(time_zone=zone).problems()
        assert problem.startswith("time_zone: ")


def test_a_wrong_variable_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BALLSCREW_SERVER_PORT", "many")
    with pytest.raises(InputError, match="BALLSCREW_SERVER_PORT: port is 'many'"):
        read_settings(tmp_path, None, {})
    monkeypatch.delenv("BALLSCREW_SERVER_PORT")
    monkeypatch.setenv("BALLSCREW_SERVER_RETENTION_DAY", "1")
    with pytest.raises(InputError, match="BALLSCREW_SERVER_RETENTION_DAY: is not a known setting"):
        read_settings(tmp_path, None, {})
    monkeypatch.delenv("BALLSCREW_SERVER_RETENTION_DAY")
    monkeypatch.setenv("BALLSCREW_SERVER_ALLOWED_HOSTS", "[")
    with pytest.raises(InputError, match="allowed_hosts"):
        read_settings(tmp_path, None, {})
    with pytest.raises(InputError, match="no such file"):
        read_settings(tmp_path, tmp_path / "none.toml", {})


@pytest.mark.parametrize(
    ("host", "is_loopback"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("127.9.9.9", True), ("::", False),
     ("192.168.1.2", False), ("plant.example", False), ("localhost.example", False)],
)  # fmt: skip
def test_off_loopback_needs_tls_or_an_explicit_setting(host: str, is_loopback: bool) -> None:
    found = ServerSettings(host=host)
    assert (found.problems() == []) == found.on_loopback == is_loopback
    assert ServerSettings(host=host, allow_plain_http=True).problems() == []


def test_check_prints_every_setting_and_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    command = ["serve", "--check", "--data", str(tmp_path), "--host", "0.0.0.0"]  # noqa: S104
    assert run(command) == 2
    printed = capsys.readouterr()
    assert all(name in printed.out for name in ServerSettings.model_fields)
    assert "not a loopback address" in printed.err
    assert run([*command, "--json"]) == 2
    document = json.loads(capsys.readouterr().out)
    assert document["settings"]["host"] == {"value": "0.0.0.0", "from": "option"}  # noqa: S104
    assert run(["serve", "--check", "--data", str(tmp_path)]) == 0
    (tmp_path / "server.toml").write_text('certificate = "none.pem"\n')
    assert run(["serve", "--check", "--data", str(tmp_path)]) == 2
    assert "both certificate and private_key" in capsys.readouterr().err


def test_the_page_lists_every_setting_with_its_default() -> None:
    text = page("docs/howto/server.md")
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*?) \|", text, re.M))
    assert list(rows) == list(ServerSettings.model_fields)
    for name, given in rows.items():
        default = ServerSettings.model_fields[name].default
        if given.startswith("`"):
            assert json.loads(given.strip("`")) == (list(default) if default == () else default), name
    assert PREFIX in text


@pytest.mark.parametrize(
    ("platform", "end"),
    [
        ("win32", Path("local") / "ballscrew"),
        ("darwin", Path("Library") / "Application Support" / "ballscrew"),
        ("linux", Path("share") / "ballscrew"),
    ],
)
def test_the_default_folder_is_the_users(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, platform: str, end: Path
) -> None:
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.delenv("BALLSCREW_STORE", raising=False)
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    assert default_folder().parts[-len(end.parts) :] == end.parts
    monkeypatch.setenv("BALLSCREW_STORE", str(tmp_path / "plant"))
    assert default_folder() == tmp_path / "plant"


def test_a_file_of_settings_that_is_named_is_read_instead_of_that_of_the_data_folder(tmp_path: Path) -> None:
    (tmp_path / "server.toml").write_text("port = 1\n")
    other = tmp_path / "other.toml"
    other.write_text("port = 2\nretention_days = 90\nretention_newest = 5\n")
    found = read_settings(tmp_path, other, {})
    assert (found.port, found.retention) == (2, RetentionPolicy(90.0, 5))
    assert read_settings(tmp_path, None, {}).retention is None
    assert origins(tmp_path, other, {})["port"] == str(other)
    with pytest.raises(InputError, match="there is no such file"):
        read_settings(tmp_path, tmp_path / "none.toml", {})
