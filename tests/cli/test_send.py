"""``ballscrew send`` as a command: its output and exit statuses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tests.sending.conftest import write_run
from tests.sending.fake_server import FakeServer, Fault, fake_server

from ballscrew.cli.shell import run
from ballscrew.sending import sender
from ballscrew.sending.sender import SendHooks


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeServer]:
    monkeypatch.delenv("BALLSCREW_TOKEN", raising=False)
    with fake_server() as fake:
        yield fake


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return write_run(tmp_path / "X1").relative_to(tmp_path)


def call(server: FakeServer, *arguments: str) -> int:
    return run(["send", *arguments, "--to", server.address, "--spool", "spool"])


def test_a_line_for_each_run(server: FakeServer, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(server, str(path)) == 0
    ((_, key),) = server.runs
    assert capsys.readouterr().out == f"{path}: run {key} of X axis, id ffffffffffff: queued.\n"
    assert call(server, str(path)) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{path}: run {key} of X axis, id ffffffffffff: was there already, queued.\n"
    assert printed.err == ""


def test_the_status_is_75_while_something_is_in_the_spool(
    server: FakeServer, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.token = "bs"  # noqa: S105
    assert call(server, str(path)) == 75
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "1 run not sent yet" in printed.err
    assert "no token was given" in printed.err
    server.token = None
    assert call(server) == 0
    assert len(server.runs) == 1


def test_the_status_is_2_after_a_refusal_or_a_wrong_file(
    server: FakeServer, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.faults.append(Fault("POST", 422, detail="RUN.toml is of\x1b[31m another axis"))
    assert call(server, str(path)) == 2
    printed = capsys.readouterr().err
    assert "422 RUN.toml is of\\x1b[31m another axis" in printed
    assert len(printed.splitlines()) == 1
    assert call(server, str(path), "none.toml") == 2
    assert "none.toml: cannot be read" in capsys.readouterr().err
    assert len(server.runs) == 1


def test_a_dry_run_lists_runs_and_writes_nothing(
    server: FakeServer, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(server, str(path), "--dry-run") == 0
    assert capsys.readouterr().out == f"{path}: 2 files of X axis, 0.0 MB\n"
    assert not Path("spool").exists()
    assert server.log == []
    call(server, str(path))
    capsys.readouterr()
    (path.parent / "notes.toml").write_text("files = [")
    assert call(server, "--watch", "X1", "--dry-run") == 2
    printed = capsys.readouterr()
    assert printed.out == f"{path}: 2 files of X axis, 0.0 MB; sent before\n"
    assert "is not TOML" in printed.err


def test_one_document_of_what_was_sent(
    server: FakeServer, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def documents(*arguments: str) -> dict[str, Any]:
        statuses.append(call(server, *arguments, "--json"))
        found: dict[str, Any] = json.loads(capsys.readouterr().out)
        return found

    statuses: list[int] = []
    server.token = "bs"  # noqa: S105
    found = documents(str(path), "none.toml")
    assert (found["sent"], found["spooled"], found["rejected"]) == ([], [str(path)], [])
    assert "none.toml: cannot be read" in found["failures"][0]
    assert "no token was given" in found["reason"]
    server.token = None
    found = documents()
    ((_, key),) = server.runs
    assert found["sent"] == [
        {
            "name": str(path), "axis": "X axis", "run": key, "id": "f" * 64, "status": "queued", "new": True,
            "doubt": None,
        }
    ]  # fmt: skip
    assert (found["spooled"], found["reason"]) == ([], None)
    found = documents(str(path))
    assert (found["sent"], [each["run"] for each in found["there_already"]]) == ([], [key])
    server.faults.append(Fault("POST", 422, detail="is wrong"))
    found = documents(str(path))
    assert "refused: 422 is wrong (its copy is in " in found["rejected"][0]
    assert statuses == [75, 0, 0, 2]


def test_a_doubtful_time_is_printed(
    server: FakeServer, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.doubt = "measured_at is in the future."
    assert call(server, str(path)) == 0
    sentence = "does not count until its time is corrected: measured_at is in the future."
    assert capsys.readouterr().err == f"ballscrew: {path}: {sentence}\n"


@pytest.mark.usefixtures("path")
def test_trips_are_those_of_a_plan(server: FakeServer, capsys: pytest.CaptureFixture[str]) -> None:
    Path("plan.toml").write_text(
        'positions = ["0 mm", "100 mm"]\nrepetitions = 3\nmasses = ["0 kg"]\n'
        'motion = { speed = "150 mm/s", acceleration = "2.5 m/s^2", jerk = "1500 m/s^3", dwell = "200 ms" }\n'
    )
    pattern = ("--pattern", "trip{trip}.h5", "--axis", "X axis", "--plan", "plan.toml")
    assert call(server, "X1", *pattern) == 2
    assert "2 of 3 trips" in capsys.readouterr().err
    assert call(server, "X1", *pattern, "--send-incomplete") == 0


@pytest.mark.usefixtures("path")
def test_a_watch_ends_with_an_interrupt(
    server: FakeServer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    waits = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(sender, "SendHooks", partial(SendHooks, sleep=wait))
    assert call(server, "--watch", "X1", "--settle", "0") == 130
    printed = capsys.readouterr()
    assert "queued" in printed.out
    assert printed.err == "ballscrew: interrupted.\n"


@pytest.mark.usefixtures("path")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("send", "a.h5"), "--to"),
        (("send", "--to", "http://plant", "a.h5"), "plain HTTP"),
        (("send", "--to", "http://localhost", "--watch", "none"), "is not a folder"),
        (("send", "--to", "http://localhost", "--watch", ".", "a.h5"), "without FILES"),
        (("send", "--to", "http://localhost", "--trips", "0"), "--trips"),
        (("send", "--to", "http://localhost", "--watch", ".", "--json"), "--json reports"),
        (("send", "--to", "http://localhost", "--dry-run", "--json"), "--json reports"),
        (("send", "--to", "http://localhost", "--token-file", "none.txt"), "none.txt"),
    ],
)
def test_a_wrong_call_is_named(
    arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*arguments]) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert len(printed.err.splitlines()) == 1
