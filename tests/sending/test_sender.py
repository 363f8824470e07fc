"""What is sent arrives once, whatever fails on the way."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import shutil
import socket
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.sending.conftest import Scene, StopError, write_run
from tests.sending.fake_server import FakeServer, Fault, fake_server

from ballscrew import InputError
from ballscrew.base.files import move_file
from ballscrew.sending import server as server_module
from ballscrew.sending import spool
from ballscrew.sending.outgoing import RunRule, existing_group, listed_files, run_of
from ballscrew.sending.sender import SendHooks, SendResult, send, send_new
from ballscrew.sending.settings import SendSettings, check_address, spool_folder
from ballscrew.sending.spool import Spool
from ballscrew.sending.watched import WatchedFolder

Send = Callable[..., SendResult]


def queue_of(settings: SendSettings) -> list[Path]:
    assert settings.spool is not None
    return sorted(settings.spool.glob("queue/*"))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_a_run_arrives_with_its_files_and_the_spool_is_empty(
    send_files: Send, server: FakeServer, run_toml: Path, settings: SendSettings, scene: Scene
) -> None:
    before = contents(run_toml.parent)
    result = send_files(run_toml)
    assert (result.waiting, result.reason, result.failures, result.rejected) == (0, "", (), ())
    ((axis, key),) = server.runs
    document = server.runs[axis, key]
    assert axis == "X axis"
    assert [file["name"] for file in document["files"]] == ["trip1.h5", "trip2.h5"]
    assert [server.files[file["sha256"]] for file in document["files"]] == [b"one" * 1000, b"two" * 1000]
    assert document["run_toml"] == run_toml.read_text()
    assert document["run_json"] is None
    assert document["measured_at"] == "2026-01-31T08:00:00+00:00"
    assert queue_of(settings) == []
    assert contents(run_toml.parent) == before
    (answer,) = scene.answers
    assert (answer.run, answer.status, answer.new) == (key, "queued", True)


def test_the_key_is_the_same_in_every_repetition(
    send_files: Send, server: FakeServer, run_toml: Path
) -> None:
    send_files(run_toml)
    received = server.received
    (answer,) = send_files(run_toml).sent
    assert not answer.new
    assert len(server.runs) == 1
    assert server.received == received  # the server has the files


def test_a_key_can_be_given(send_files: Send, server: FakeServer, run_toml: Path) -> None:
    send_files(run_toml, run="night-7")
    assert list(server.runs) == [("X axis", "night-7")]


@pytest.mark.parametrize("key", ["", "a/b", "..", "ä", "x" * 101])
def test_a_key_that_is_no_part_of_a_url_is_refused(send_files: Send, run_toml: Path, key: str) -> None:
    with pytest.raises(InputError, match="--run is"):
        send_files(run_toml, run=key)


def test_a_key_is_of_a_single_run(send_files: Send, run_toml: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are 2"):
        send_files(run_toml, write_run(tmp_path / "other"), run="a")


def test_an_analysed_run_is_sent_as_its_document(
    send_files: Send, server: FakeServer, tmp_path: Path
) -> None:
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"schema": 2, "run": {"axis": "X axis", "measured_at": None}, "cells": []}))
    send_files(path)
    (document,) = server.runs.values()
    assert document["files"] == []
    assert server.files[document["run_json"]] == path.read_bytes()


def test_files_of_one_name_get_numbers(send_files: Send, server: FakeServer, tmp_path: Path) -> None:
    for number in (1, 2):
        (tmp_path / f"trip{number}").mkdir()
        (tmp_path / f"trip{number}" / "data.h5").write_bytes(bytes([number]))
    send_files(tmp_path, rule=RunRule(axis="X axis", pattern="trip{trip}/data.h5"))
    (document,) = server.runs.values()
    assert [file["name"] for file in document["files"]] == ["01-data.h5", "02-data.h5"]


def test_a_run_file_in_a_watched_folder_sends_no_documents_from_elsewhere(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, tmp_path: Path
) -> None:
    (tmp_path / "secret.toml").write_text('name = "X axis"\n')
    path = write_run(folder / "1")
    path.write_text(path.read_text().replace("channels.toml", "../../secret.toml"))
    watch(folder, server, settings, scene, documents=True)
    assert server.log == []
    assert "is outside of" in scene.sentences[0]


def test_an_empty_file_arrives(send_files: Send, server: FakeServer, tmp_path: Path) -> None:
    send_files(write_run(tmp_path / "run", [b""]))
    assert list(server.files.values()) == [b""]
    assert len(server.runs) == 1


HOSTILE_NAMES = [
    "Straße 7 ünï.h5",
    "a b  c.h5",
    "..h5",
    "-rf.h5",
    "%2e%2e.h5",
    "x;\nrm.h5",
    "'\"$(x)`.h5",
    "\u202e5h.h5",
]


def test_hostile_names_are_names_only(send_files: Send, server: FakeServer, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for name in HOSTILE_NAMES:
        (folder / name).write_bytes(name.encode())
    server.axes.add("..a\\b?#%2f ü")
    send_files(*sorted(folder.iterdir()), rule=RunRule(axis="..a\\b?#%2f ü"))
    ((axis, _),) = server.runs
    (document,) = server.runs.values()
    assert axis == "..a\\b?#%2f ü"
    assert sorted(file["name"] for file in document["files"]) == sorted(HOSTILE_NAMES)


@pytest.mark.skipif(os.name == "nt" or sys.platform == "darwin", reason="names are text there")
def test_a_name_that_is_no_text_is_sent_with_marks_in_its_place(
    send_files: Send, server: FakeServer, tmp_path: Path
) -> None:
    path = tmp_path / os.fsdecode(b"trip\xff.h5")
    path.write_bytes(b"1")
    assert send_files(path, rule=RunRule(axis="X axis")).waiting == 0
    (document,) = server.runs.values()
    assert document["files"][0]["name"] == "trip?.h5"


@pytest.mark.parametrize("axis", ["..", ".", " ", ""])
def test_an_axis_that_is_a_path_is_refused(send_files: Send, run_toml: Path, axis: str) -> None:
    (sentence,) = send_files(run_toml, rule=RunRule(axis=axis)).failures
    assert "the axis is" in sentence


# Failures of the network and the server

PASSING = [
    Fault("PUT", "cut"),
    Fault("PUT", "lost"),
    Fault("PUT", 500),
    Fault("PUT", 507),
    Fault("PUT", 408),
    Fault("HEAD", "cut"),
    Fault("HEAD", 503),
    Fault("HEAD", 405),
    Fault("HEAD", 501, of_proxy=True),
    Fault("HEAD", 405, of_proxy=True),
    Fault("POST", 429, of_proxy=True),
    Fault("HEAD", "offset", {"Upload-Offset": "17"}),
    Fault("HEAD", "offset", {"Upload-Offset": "99999999"}),
    Fault("HEAD", "offset", {"Upload-Offset": "3000"}),
    Fault("HEAD", "offset", {"Upload-Offset": "-1"}),
    Fault("HEAD", "offset", {"Upload-Offset": "x"}),
    Fault("HEAD", "offset"),
    Fault("PUT", 409),
    Fault("POST", "lost"),
    Fault("POST", "cut"),
    Fault("POST", 502),
    Fault("POST", 429),
    Fault("POST", 425),
    Fault("*", "away", times=3),
    Fault("*", 503, times=4),
]


@pytest.mark.parametrize("fault", PASSING, ids=lambda fault: f"{fault.method}-{fault.kind}-{fault.headers}")
def test_a_run_arrives_once_after_a_passing_failure(
    send_files: Send, server: FakeServer, run_toml: Path, settings: SendSettings, fault: Fault
) -> None:
    server.faults.append(replace(fault))
    result = send_files(run_toml)
    assert (result.waiting, result.rejected, result.failures) == (0, (), ())
    assert sorted(server.files.values()) == [b"one" * 1000, b"two" * 1000]
    assert len(server.runs) == 1
    assert queue_of(settings) == []


def test_a_cut_upload_continues_where_it_was_cut(
    send_files: Send, server: FakeServer, tmp_path: Path
) -> None:
    content = bytes(range(256)) * 20_000
    server.faults.append(Fault("PUT", "cut", times=3))
    send_files(write_run(tmp_path / "run", [content]))
    assert list(server.files.values()) == [content]
    assert server.received == len(content)


def test_a_part_of_another_content_at_the_server_is_sent_anew(
    send_files: Send, server: FakeServer, run_toml: Path
) -> None:
    for content in (b"one" * 1000, b"two" * 1000):
        server.parts[hashlib.sha256(content).hexdigest()] = b"something else"
    assert send_files(run_toml).rejected == ()
    assert sorted(server.files.values()) == [b"one" * 1000, b"two" * 1000]


def test_a_slow_server_is_no_end(
    server: FakeServer, run_toml: Path, settings: SendSettings, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module.Server.__init__, "__defaults__", (0.1,))
    server.faults.append(Fault("PUT", "slow"))
    result = send([run_toml], server.address, settings=settings, hooks=scene.hooks)
    assert (result.waiting, len(server.runs)) == (0, 1)
    assert len(scene.waits) == 1


def closed_address() -> str:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return f"http://127.0.0.1:{found.getsockname()[1]}"


def test_a_server_that_is_away_leaves_the_run_in_the_spool(
    run_toml: Path, settings: SendSettings, scene: Scene
) -> None:
    result = send([run_toml], closed_address(), settings=settings, hooks=scene.hooks)
    assert result.waiting == 1
    assert "no connection" in result.reason
    assert scene.waits == [1, 2, 4, 8, 16]
    assert len(scene.sentences) == 1  # the same sentence once
    shutil.rmtree(run_toml.parent)  # the spool has all that is needed
    with fake_server() as server:
        result = send([], server.address, settings=settings, hooks=scene.hooks)
        assert len(server.runs) == 1
    assert (result.waiting, len(result.sent)) == (0, 1)


def test_waits_differ_between_senders_and_have_an_upper_limit(
    run_toml: Path, settings: SendSettings, scene: Scene
) -> None:
    hooks = replace(scene.hooks, random=lambda: 0.0)
    send([run_toml], closed_address(), settings=replace(settings, tries=3), hooks=hooks)
    assert scene.waits == [0.5, 1]
    scene.most = 25
    with pytest.raises(StopError):
        send_new(run_toml.parent, closed_address(), settings=replace(settings, settle=0), hooks=scene.hooks)


def test_the_time_that_the_server_asks_for_is_waited(
    send_files: Send, server: FakeServer, run_toml: Path, scene: Scene
) -> None:
    server.faults.append(Fault("POST", 429, {"Retry-After": "37"}))
    assert send_files(run_toml).waiting == 0
    assert scene.waits == [37]


@pytest.mark.parametrize(
    "text", ["Wed, 21 Oct 2015 07:28:00 GMT", "Wed, 21 Oct 2015 07:28:00", "soon", "-5", "1e9", ""]
)
def test_a_time_to_wait_that_is_past_or_none_is_the_usual_one(
    send_files: Send, server: FakeServer, run_toml: Path, scene: Scene, text: str
) -> None:
    server.faults.append(Fault("POST", 429, {"Retry-After": text}))
    assert send_files(run_toml).waiting == 0
    assert scene.waits == [1]


def test_a_command_does_not_wait_for_an_hour(
    send_files: Send, server: FakeServer, run_toml: Path, scene: Scene
) -> None:
    server.faults.append(Fault("POST", 503, {"Retry-After": "3600"}))
    result = send_files(run_toml)
    assert (result.waiting, scene.waits) == (1, [])
    assert "503 as asked" in result.reason


def test_a_run_that_makes_the_server_fail_does_not_stop_the_others(
    send_files: Send, server: FakeServer, run_toml: Path, tmp_path: Path, scene: Scene
) -> None:
    server.faults.append(Fault("POST", 500, times=1))
    server.faults.append(Fault("POST", "pass", times=1))
    server.faults.append(Fault("POST", 500, times=100))
    sent: list[int] = []
    scene.actions[1] = lambda: sent.append(len(scene.answers))
    result = send_files(run_toml, write_run(tmp_path / "other", [b"3"]))
    assert (result.waiting, len(result.sent), len(server.runs)) == (1, 1, 1)
    assert sent == [1]  # in the first pass


@pytest.mark.parametrize("status", [400, 409, 413, 415, 422])
def test_what_the_server_refuses_is_set_aside_with_its_answer(
    send_files: Send, server: FakeServer, run_toml: Path, settings: SendSettings, status: int
) -> None:
    assert settings.spool
    server.faults.append(Fault("POST", status, detail="the axis of RUN.toml is another one"))
    result = send_files(run_toml)
    (sentence,) = result.rejected
    assert f"{status} the axis of RUN.toml is another one" in sentence
    assert result.waiting == 0
    (place,) = (settings.spool / "rejected").iterdir()
    assert (place / "answer.txt").read_text() == f"{status} the axis of RUN.toml is another one\n"
    assert b"one" * 1000 in contents(place).values()
    assert send_files(run_toml).rejected == ()  # sent again on demand
    assert list((settings.spool / "rejected").iterdir()) == []


def test_a_run_that_is_refused_again_replaces_its_answer(
    send_files: Send, server: FakeServer, run_toml: Path, settings: SendSettings
) -> None:
    assert settings.spool
    for detail in ("wrong", "still wrong"):
        server.faults.append(Fault("POST", 422, detail=detail))
        assert f"422 {detail}" in send_files(run_toml).rejected[0]
    assert len(list((settings.spool / "rejected").iterdir())) == 1


def test_a_run_of_an_axis_that_is_not_set_up_waits_while_others_are_sent(
    send_files: Send, server: FakeServer, run_toml: Path, tmp_path: Path, scene: Scene
) -> None:
    result = send_files(run_toml, rule=RunRule(axis="Y axis"))
    assert (result.waiting, result.rejected, scene.waits) == (1, (), [])
    assert "no run of the axis 'Y axis' can be received yet (404 " in result.reason
    assert server.received == 0
    server.faults.append(Fault("POST", 500))  # it is repeated, though the other would have to wait for long
    result = send_files(write_run(tmp_path / "other", [b"three"]))
    assert (result.waiting, result.rejected, len(result.sent), len(scene.waits)) == (1, (), 1, 1)
    server.axes.add("Y axis")
    assert len(send_files().sent) == 1


@pytest.mark.parametrize("method", ["HEAD", "PUT", "POST"])
@pytest.mark.parametrize("status", [400, 401, 403, 404, 405, 409, 413, 422])
def test_what_a_proxy_or_another_server_refuses_stays_in_the_spool(
    send_files: Send, server: FakeServer, run_toml: Path, scene: Scene, method: str, status: int
) -> None:
    if (method, status) == ("HEAD", 405):
        method = "PUT"  # a proxy may pass on everything but HEAD
    server.faults.append(Fault(method, status, of_proxy=True))
    result = send_files(run_toml)
    assert (result.waiting, result.rejected, scene.waits) == (1, (), [])
    assert f"answers {status} but not as a ballscrew server does; check --to" in result.reason
    assert len(send_files().sent) == 1


def test_a_file_that_a_proxy_does_not_pass_on_holds_up_no_other(
    send_files: Send, server: FakeServer, run_toml: Path, tmp_path: Path
) -> None:
    server.faults.append(Fault("PUT", 413, of_proxy=True))
    result = send_files(run_toml, write_run(tmp_path / "other", [b"three"]))
    assert (result.waiting, len(result.sent)) == (1, 1)


def test_a_file_that_is_too_large_for_the_server_is_refused(
    send_files: Send, server: FakeServer, run_toml: Path
) -> None:
    server.faults.append(Fault("PUT", 413, detail="too large"))
    assert "413 too large" in send_files(run_toml).rejected[0]


def test_a_damaged_copy_in_the_spool_is_refused_and_not_sent(
    run_toml: Path, settings: SendSettings, scene: Scene, server: FakeServer
) -> None:
    send([run_toml], closed_address(), settings=replace(settings, tries=1))
    (folder,) = queue_of(settings)
    name = hashlib.sha256(b"one" * 1000).hexdigest()
    (folder / name).write_bytes(b"One" * 1000)
    result = send([], server.address, settings=settings, hooks=scene.hooks)
    assert "its copy in the spool is damaged" in result.rejected[0]
    assert server.runs == {}


@pytest.mark.parametrize("damage", ["{", "[]", "{}", '{"files": 3}', "\xff", None])
def test_a_damaged_manifest_does_not_stop_the_others(
    run_toml: Path, settings: SendSettings, server: FakeServer, tmp_path: Path, damage: str | None
) -> None:
    send([run_toml], closed_address(), settings=replace(settings, tries=1))
    (folder,) = queue_of(settings)
    if damage is None:
        (folder / "manifest.json").unlink()
    else:
        (folder / "manifest.json").write_text(damage, encoding="latin-1")
    result = send([write_run(tmp_path / "other", [b"3"])], server.address, settings=settings)
    assert (result.waiting, len(server.runs)) == (0, 1)
    assert settings.spool
    rejected = settings.spool / "rejected" / folder.name
    assert (rejected / "answer.txt").exists()
    (sentence,) = result.rejected
    assert "manifest.json" in sentence
    assert sentence.endswith(f"(its copy is in {rejected})")


@pytest.mark.parametrize(
    ("status", "token", "words"),
    [
        (401, "bs_old", "the token is refused (401"),
        (401, None, "no token was given (401"),
        (403, "bs_other", "the token is not allowed to send for this axis (403"),
    ],
)
def test_a_wrong_token_stops_loses_nothing_and_is_named(
    send_files: Send,
    server: FakeServer,
    run_toml: Path,
    scene: Scene,
    monkeypatch: pytest.MonkeyPatch,
    status: int,
    token: str | None,
    words: str,
) -> None:
    """The server's own reason is lost: the answer to HEAD has no body."""
    if token is not None:
        monkeypatch.setenv("BALLSCREW_TOKEN", token)
    server.faults.append(Fault("HEAD", status, times=100))
    result = send_files(run_toml)
    assert (result.waiting, result.rejected, scene.waits) == (1, (), [])
    assert words in result.reason
    assert result.reason.endswith("BALLSCREW_TOKEN), and 'ballscrew token list' at the server.")


def test_the_token_is_of_a_file_or_the_environment(
    send_files: Send,
    server: FakeServer,
    run_toml: Path,
    settings: SendSettings,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    server.token = "bs_secret"  # noqa: S105
    assert send_files(run_toml).waiting == 1
    path = tmp_path / "token.txt"
    path.write_bytes(b"\xef\xbb\xbfbs_secret\r\n")
    assert send_files(settings=replace(settings, token_file=path)).waiting == 0
    monkeypatch.setenv("BALLSCREW_TOKEN", "bs_secret")
    assert send_files(run_toml).waiting == 0


@pytest.mark.parametrize(
    "content", [b"", b" \n", b"two words", b"bs_\xff\xfe", b"a\r\nHost: evil", b"x" * 5000]
)
def test_a_file_that_is_no_token_is_refused_without_showing_it(
    run_toml: Path, settings: SendSettings, tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "token.txt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"token\.txt") as caught:
        send([run_toml], "http://localhost", settings=replace(settings, token_file=path))
    assert "evil" not in str(caught.value)


@pytest.mark.parametrize("page", ["<html>Welcome to the factory</html>", "{}", "[]", '{"run": "other"}', "{"])
def test_a_page_of_a_proxy_is_no_acknowledgement(
    send_files: Send, server: FakeServer, run_toml: Path, page: str
) -> None:
    server.faults.append(Fault("*", "proxy", detail=page, times=100))
    result = send_files(run_toml)
    assert (result.waiting, result.sent) == (1, ())
    assert "not as a ballscrew server does" in result.reason


def test_a_redirection_is_not_followed(send_files: Send, server: FakeServer, run_toml: Path) -> None:
    server.faults.append(Fault("*", 307, {"Location": "http://elsewhere.invalid/"}, times=100))
    result = send_files(run_toml)
    assert result.waiting == 1
    assert "answers 307" in result.reason


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("plant", "must be a URL"),
        ("ftp://plant", "must be a URL"),
        ("http://", "must be a URL"),
        ("http://[::1", "must be a URL"),
        ("https://plant:99999", "must be a URL"),
        ("https://plant/a b", "must be a URL"),
        ("https://me:pw@plant", "a name or a password"),
        ("https://plant?x=1", "no '\\?'"),
        ("http://plant:8000", "plain HTTP"),
        ("http://127.0.0.1.evil.example", "plain HTTP"),
        ("http://localhost.evil.example", "plain HTTP"),
    ],
)
def test_a_wrong_address_is_refused(run_toml: Path, settings: SendSettings, address: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        send([run_toml], address, settings=settings)
    assert "pw" not in str(caught.value)


@pytest.mark.parametrize(
    "address", ["http://localhost:1", "http://127.3.2.1:1", "http://[::1]:1", "https://plant"]
)
def test_this_host_and_encryption_need_no_permission(address: str) -> None:
    assert check_address(address + "/", plain=False) == address


def test_plain_http_can_be_allowed() -> None:
    assert check_address("http://plant", plain=True) == "http://plant"


def test_without_httpx_the_extra_is_named(
    run_toml: Path, settings: SendSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "httpx", None)
    with pytest.raises(InputError, match=r"ballscrew\[send\]"):
        send([run_toml], "http://localhost", settings=settings)


# The spool


def test_runs_that_do_not_fit_stay_and_are_sent_when_there_is_room(
    server: FakeServer, settings: SendSettings, scene: Scene, tmp_path: Path
) -> None:
    runs = [write_run(tmp_path / str(number), [bytes([number]) * 40_000]) for number in range(4)]
    small = replace(settings, spool_limit=100_000)
    result = send(runs, closed_address(), settings=replace(small, tries=1), hooks=scene.hooks)
    assert result.waiting == 4
    assert len(queue_of(settings)) == 2
    result = send(runs, server.address, settings=small, hooks=scene.hooks)
    assert (result.waiting, len(server.runs)) == (0, 4)


def test_a_run_that_never_fits_is_named(send_files: Send, settings: SendSettings, run_toml: Path) -> None:
    result = send_files(run_toml, settings=replace(settings, spool_limit=10))
    assert "more than the limit of the spool" in result.failures[0]


def test_a_spool_full_of_refused_runs_is_named(
    send_files: Send, server: FakeServer, settings: SendSettings, run_toml: Path, tmp_path: Path
) -> None:
    small = replace(settings, spool_limit=12_000)
    server.faults.append(Fault("POST", 422))
    send_files(run_toml, settings=small)
    result = send_files(write_run(tmp_path / "b", [b"x" * 6000]), settings=small)
    assert result.waiting == 1
    assert "contains runs that the server refused" in result.reason


def test_a_full_disk_leaves_the_run_and_no_half_of_it(
    run_toml: Path, settings: SendSettings, server: FakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        result = send([run_toml], server.address, settings=settings)
    assert result.waiting == 1
    assert "is full" in result.reason
    assert settings.spool
    assert list((settings.spool / "queue").iterdir()) == []


def test_a_folder_that_cannot_be_the_spool_is_named(run_toml: Path, settings: SendSettings) -> None:
    with pytest.raises(InputError, match="cannot be the spool"):
        send([run_toml], "http://localhost", settings=replace(settings, spool=run_toml))


@pytest.mark.parametrize(
    ("system", "variables", "place"),
    [
        ("Linux", {"HOME": "/h", "XDG_DATA_HOME": ""}, "/h/.local/share"),
        ("Linux", {"XDG_DATA_HOME": "/data"}, "/data"),
        ("Darwin", {"HOME": "/h", "XDG_DATA_HOME": ""}, "/h/Library/Application Support"),
        ("Windows", {"LOCALAPPDATA": "/u/AppData/Local"}, "/u/AppData/Local"),
    ],
)
def test_the_spool_is_in_the_users_data_folder_by_server(
    monkeypatch: pytest.MonkeyPatch, system: str, variables: dict[str, str], place: str
) -> None:
    monkeypatch.setattr(platform, "system", lambda: system)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    found = spool_folder(SendSettings(), "https://plant:8443/a/../b")
    assert found == Path(place) / "ballscrew" / "spool" / "plant-3A8443-2Fa-2F..-2Fb"


def test_without_a_home_folder_the_option_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    for name in ("XDG_DATA_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match="--spool"):
        spool_folder(SendSettings(), "https://plant")


def test_two_senders_with_one_file_are_one_run(server: FakeServer, run_toml: Path, tmp_path: Path) -> None:
    threads = []
    for number in range(4):
        settings = SendSettings(spool=tmp_path / f"spool{number}")
        hooks = Scene().hooks
        thread = threading.Thread(
            target=send, args=([run_toml], server.address), kwargs={"settings": settings, "hooks": hooks}
        )
        threads.append(thread)
        thread.start()
    for thread in threads:
        thread.join()
    assert len(server.runs) == 1
    assert all(queue_of(SendSettings(spool=tmp_path / f"spool{number}")) == [] for number in range(4))


def test_a_spool_is_sent_by_a_single_process(
    send_files: Send, run_toml: Path, settings: SendSettings
) -> None:
    assert settings.spool
    with Spool(settings.spool, 1e9).sending() as locked:
        assert locked
        result = send_files(run_toml)
    assert result.waiting == 1
    assert "another process sends" in result.reason
    assert send_files().waiting == 0


def test_a_file_that_changes_while_it_is_read_is_not_sent(
    send_files: Send, run_toml: Path, server: FakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    fsync = os.fsync

    def grow(handle: int) -> None:
        with (run_toml.parent / "trip1.h5").open("ab") as stream:
            stream.write(b"more")
        fsync(handle)

    monkeypatch.setattr(os, "fsync", grow)
    result = send_files(run_toml)
    assert "changed while it was read" in result.failures[0]
    assert server.log == []


class KilledError(BaseException):
    """The process ends here."""


class Kill:
    """Ends the process, as far as its files are concerned, at the n-th change of a file or request.

    From then on every change fails, so that what Python does to clean up has no effect.
    """

    steps = -1
    thread = 0
    killed = False
    events = ("os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.chmod", "open")

    def step(self, *_: object) -> None:
        if self.steps < 0:
            return
        if self.steps == 0:
            self.killed = True
            raise KilledError
        self.steps -= 1

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.steps < 0 or threading.get_ident() != self.thread or event not in self.events:
            return
        reads = event == "open" and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR)
        if not reads:
            self.step()


KILL = Kill()
sys.addaudithook(KILL.audit)  # cannot be removed; does nothing unless armed


def check_spool(settings: SendSettings) -> None:
    """Each run in the spool is whole."""
    assert settings.spool
    for folder in settings.spool.glob("queue/[!.]*"):
        document = json.loads((folder / "manifest.json").read_text())
        for file in document["files"]:
            assert hashlib.sha256((folder / file["sha256"]).read_bytes()).hexdigest() == file["sha256"]


@pytest.mark.parametrize("refused", [False, True])
def test_a_kill_at_any_step_loses_and_doubles_nothing(
    server: FakeServer, run_toml: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: bool
) -> None:
    request = server_module.Server._request

    def step_and_request(*arguments: Any, **options: Any) -> Any:
        KILL.step()
        return request(*arguments, **options)

    monkeypatch.setattr(server_module.Server, "_request", step_and_request)
    before = contents(run_toml.parent)
    KILL.thread = threading.get_ident()
    steps = 0
    while True:
        settings = SendSettings(spool=tmp_path / f"spool-{steps}")
        server.files.clear()
        server.runs.clear()
        server.faults[:] = [Fault("POST", 422, times=2 if refused else 0)]  # before the kill, and after it
        KILL.steps, KILL.killed = steps, False
        hooks = SendHooks(KILL.step, lambda _: None, progress=KILL.step, sleep=lambda _: None)
        try:
            send([run_toml], server.address, settings=settings, hooks=hooks)
        except KilledError:
            pass
        finally:
            KILL.steps = -1
        check_spool(settings)
        assert settings.spool
        rejected = list(settings.spool.glob("rejected/*"))
        waits = len(list(settings.spool.glob("queue/[!.]*")))
        assert len(rejected) + waits <= 1
        if KILL.killed and (waits or rejected):  # all that is needed is in the spool
            result = send([], server.address, settings=settings)
            assert result.waiting == 0
        elif KILL.killed:
            send([run_toml], server.address, settings=settings)
        assert len(server.runs) == (0 if refused else 1)
        assert len(list(settings.spool.glob("rejected/*"))) == refused
        assert list(settings.spool.glob("queue/[!.]*")) == []
        assert contents(run_toml.parent) == before
        if not KILL.killed:
            break
        steps += 1
    assert steps > 20


def test_what_a_kill_has_left_is_removed_after_a_day(settings: SendSettings) -> None:
    assert settings.spool
    remains = settings.spool / "queue" / ".incoming-abc"
    remains.mkdir(parents=True)
    Spool(settings.spool, 1)
    assert remains.exists()
    os.utime(remains, (0, 0))
    Spool(settings.spool, 1)
    assert not remains.exists()


# A folder that is watched


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "X1"
    path.mkdir()
    return path


def watch(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, pauses: int = 10, **rule: Any
) -> None:
    scene.most = len(scene.waits) + pauses
    with pytest.raises(StopError):
        send_new(folder, server.address, rule=RunRule(**rule), settings=settings, hooks=scene.hooks)


def test_a_run_is_sent_when_its_files_have_settled(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    path = write_run(folder / "2026-01-31")
    trip = path.parent / "trip2.h5"

    def grow() -> None:
        assert server.runs == {}
        trip.write_bytes(trip.read_bytes() + b"more")

    scene.actions = dict.fromkeys(range(1, 6), grow)
    watch(folder, server, settings, scene)
    (document,) = server.runs.values()
    assert server.files[document["files"][1]["sha256"]] == b"two" * 1000 + b"more" * 5
    assert scene.sentences == []


def test_a_restart_sends_nothing_again_and_reads_nothing_again(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_run(folder / "1")
    watch(folder, server, settings, scene)
    requests = len(server.log)
    monkeypatch.setattr(Spool, "put", lambda *_, **__: pytest.fail("read again"))
    watch(folder, server, settings, scene)
    assert len(server.log) == requests


def test_a_run_that_was_moved_is_not_sent_again(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    write_run(folder / "1")
    watch(folder, server, settings, scene)
    requests = len(server.log)
    (folder / "1").rename(folder / "2")
    scene.actions[len(scene.waits) + 10] = lambda: (folder / "2").rename(folder / "3")
    watch(folder, server, settings, scene, pauses=20)
    assert len(server.log) == requests
    write_run(folder / "4", [b"4"])
    scene.actions[len(scene.waits) + 10] = lambda: (folder / "4").rename(folder / "5")
    watch(folder, server, settings, scene, pauses=20)
    assert len(server.runs) == len(scene.answers) == 2


def test_a_log_that_was_cut_costs_one_run_at_most(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    assert settings.spool
    write_run(folder / "1", [b"1"])
    watch(folder, server, settings, scene)
    log = settings.spool / "sent.jsonl"
    log.write_bytes(log.read_bytes()[:-30])
    write_run(folder / "2", [b"2"])
    watch(folder, server, settings, scene)
    assert len(server.runs) == 2
    assert [answer.new for answer in scene.answers] == [True, False, True]
    requests = len(server.log)
    watch(folder, server, settings, scene)
    assert len(server.log) == requests


def test_runs_by_a_pattern_of_names(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    server.axes.add("Y axis")
    for name in ("X axis_7_trip1.h5", "X axis_7_trip2.h5", "X axis_8_trip1.h5", "Y axis_7_trip1.h5"):
        (folder / name).write_bytes(name.encode())
    (folder / "Y axis_7_trip2.h5").write_bytes(b"y")
    (folder / "notes.txt").write_bytes(b"")
    rule = {"pattern": "{axis}_{run}_trip{trip}.h5", "trips": 2}
    watch(folder, server, settings, scene, **rule)
    names = [[file["name"] for file in document["files"]] for document in server.runs.values()]
    assert sorted(names) == [
        ["X axis_7_trip1.h5", "X axis_7_trip2.h5"],
        ["Y axis_7_trip1.h5", "Y axis_7_trip2.h5"],
    ]
    assert scene.sentences == []
    scene.time = 0
    watch(folder, server, settings, scene, pauses=300, **rule)
    (sentence,) = scene.sentences
    assert "1 of 2 trips" in sentence
    assert len(server.runs) == 2


def test_an_incomplete_run_is_sent_if_asked_for(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    path = write_run(folder / "1", [b"1", b"2", b"3"])
    (path.parent / "trip2.h5").unlink()
    quick = replace(settings, timeout=30)
    watch(folder, server, quick, scene)
    assert server.runs == {}
    assert "2 of 3 trips" in scene.sentences[0]
    watch(folder, server, quick, scene, incomplete=True)
    (document,) = server.runs.values()
    assert [file["name"] for file in document["files"]] == ["trip1.h5", "trip3.h5"]


def test_without_a_number_of_trips_a_run_is_complete_after_the_timeout(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    run = folder / "0042"
    run.mkdir()
    (run / "trip1.h5").write_bytes(b"1")
    scene.actions[12] = lambda: (run / "trip2.h5").write_bytes(b"2")
    watch(folder, server, replace(settings, timeout=100), scene, 20, pattern="{run}/{trip}.h5", axis="X axis")
    assert server.runs == {}
    watch(folder, server, replace(settings, timeout=100), scene, 30, pattern="{run}/{trip}.h5", axis="X axis")
    (document,) = server.runs.values()
    assert len(document["files"]) == 2


def test_a_server_that_was_away_gets_all_runs_once(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    for number in range(3):
        write_run(folder / str(number), [bytes([number])])
    server.faults.append(Fault("*", "away", times=12))
    watch(folder, server, settings, scene, pauses=400)
    assert len(server.runs) == 3
    assert len(scene.answers) == 3
    assert [sentence for sentence in scene.sentences if "no connection" not in sentence] == []


def test_a_day_without_the_server_loses_no_run_with_a_full_spool_and_cut_uploads(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    """A run every hour; the spool contains three; from the second day each first upload is cut."""
    hour, outage = 3600.0, Fault("*", "away", times=10**9)
    server.faults.append(outage)
    written = 0

    def pass_time() -> None:
        nonlocal written
        scene.time += 600.0
        if written < 24 and scene.time >= written * hour:
            write_run(folder / str(written), [bytes([written]) * 30_000, bytes([written, 1]) * 5_000])
            written += 1
        if outage.times and scene.time >= 24 * hour:
            assert server.runs == {}
            outage.times = 0
            server.faults.append(Fault("PUT", "cut", times=24))

    scene.actions = dict.fromkeys(range(1, 300), pass_time)
    watch(folder, server, replace(settings, spool_limit=130_000), scene, pauses=300)
    assert outage.times == 0
    assert [fault.times for fault in server.faults] == [0, 0]
    assert any("stays there" in sentence for sentence in scene.sentences)
    sent = {
        tuple(server.files[file["sha256"]] for file in document["files"]) for document in server.runs.values()
    }
    assert sent == {(bytes([each]) * 30_000, bytes([each, 1]) * 5_000) for each in range(24)}
    assert len(server.runs) == len(scene.answers) == 24
    assert queue_of(settings) == []


def test_a_full_spool_loses_nothing(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    for number in range(5):
        write_run(folder / str(number), [bytes([number]) * 40_000])
    server.faults.append(Fault("*", "away", times=8))
    watch(folder, server, replace(settings, spool_limit=100_000), scene, pauses=400)
    assert len(server.runs) == 5
    assert sum("stays there" in sentence for sentence in scene.sentences) <= 2


def test_a_new_token_is_used_without_a_restart(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, tmp_path: Path
) -> None:
    server.token = "new"  # noqa: S105
    token = tmp_path / "token.txt"
    token.write_text("old")
    write_run(folder / "1")
    scene.actions[20] = lambda: token.write_text("new")
    watch(folder, server, replace(settings, token_file=token), scene, pauses=100)
    assert len(server.runs) == 1
    assert sum("token" in sentence for sentence in scene.sentences) == 1


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_links_and_files_elsewhere_are_not_sent(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, tmp_path: Path
) -> None:
    secret = tmp_path / "secret.h5"
    secret.write_bytes(b"secret")
    first = write_run(folder / "1", [b"1"])
    (first.parent / "trip1.h5").unlink()
    (first.parent / "trip1.h5").symlink_to(secret)
    second = write_run(folder / "2", [b"2"])
    second.write_text(second.read_text().replace('"trip1.h5"', '"../../secret.h5"'))
    watch(folder, server, settings, scene)
    assert server.log == []
    assert any("is a link" in sentence for sentence in scene.sentences)
    assert any("is outside of" in sentence for sentence in scene.sentences)
    assert len(scene.sentences) == 2


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_a_link_that_the_user_gives_is_followed(send_files: Send, server: FakeServer, tmp_path: Path) -> None:
    (tmp_path / "data.h5").write_bytes(b"1")
    link = tmp_path / "newest.h5"
    link.symlink_to("data.h5")
    send_files(link, rule=RunRule(axis="X axis"))
    assert list(server.files.values()) == [b"1"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_a_pipe_is_not_waited_for(send_files: Send, folder: Path) -> None:
    os.mkfifo(folder / "a.h5")
    assert "it is a pipe" in send_files(folder / "a.h5", rule=RunRule(axis="X axis")).failures[0]


def test_a_run_that_cannot_be_read_is_named_once_and_does_not_stop_the_others(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    write_run(folder / "2")
    write_run(folder / "1").write_text("files = [")
    (folder / "0.toml").write_bytes(b"\xff")
    watch(folder, server, settings, scene)
    assert len(server.runs) == 1
    assert len(scene.sentences) == 2


def test_a_folder_that_is_away_for_a_while_is_watched_again(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    rglob = Path.rglob

    def away(path: Path, pattern: str) -> Any:
        if path == folder and 3 < len(scene.waits) < 8:
            raise FileNotFoundError(2, "No such file or directory")
        return rglob(path, pattern)

    monkeypatch.setattr(Path, "rglob", away)
    write_run(folder / "1")
    scene.actions[5] = lambda: write_run(folder / "2", [b"2"]) and None
    watch(folder, server, settings, scene, 20)
    assert len(server.runs) == 2
    assert sum("cannot be read" in sentence for sentence in scene.sentences) == 1


def test_a_refused_run_of_a_watched_folder_is_not_sent_again(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    server.faults.append(Fault("POST", 422))
    write_run(folder / "1")
    watch(folder, server, settings, scene)
    assert len(scene.sentences) == 1
    requests = len(server.log)
    watch(folder, server, settings, scene)
    assert len(server.log) == requests
    assert "was refused before" in scene.sentences[1]


def test_the_spool_is_not_in_the_watched_folder(folder: Path, settings: SendSettings) -> None:
    with pytest.raises(InputError, match="must be outside"):
        send_new(folder, "http://localhost", settings=replace(settings, spool=folder / "spool"))


def test_a_run_that_never_fits_is_named_once_and_the_others_of_the_folder_are_sent(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene
) -> None:
    write_run(folder / "1", [b"x" * 5000])
    write_run(folder / "2", [b"y"])
    watch(folder, server, replace(settings, spool_limit=4000), scene)
    assert list(server.files.values()) == [b"y"]
    (sentence,) = scene.sentences
    assert "more than the limit of the spool" in sentence


def test_a_spool_that_cannot_be_locked_for_a_while_is_named_and_sent_later(
    folder: Path, server: FakeServer, settings: SendSettings, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    sending = Spool.sending

    def fail(spool: Spool) -> Any:
        if len(scene.waits) < 8:
            raise OSError(errno.EIO, "Input/output error")
        return sending(spool)

    monkeypatch.setattr(Spool, "sending", fail)
    write_run(folder / "1")
    watch(folder, server, settings, scene, 60)
    assert len(server.runs) == 1
    (sentence,) = scene.sentences
    assert sentence.startswith(f"{settings.spool}: ")
    assert "Input/output error." in sentence


def test_a_file_that_goes_and_comes_begins_to_settle_when_it_comes(folder: Path) -> None:
    watched = WatchedFolder(folder, RunRule(), settle=10.0, timeout=100.0)
    path = folder / "a.h5"
    assert [watched._changed_at(path, now) for now in (1.0, 2.0)] == [1.0, 1.0]
    path.write_bytes(b"x")
    assert [watched._changed_at(path, now) for now in (3.0, 4.0)] == [3.0, 3.0]
    path.unlink()
    assert [watched._changed_at(path, now) for now in (5.0, 6.0)] == [5.0, 5.0]
    assert watched._changed_at(folder / "a\0b", 7.0) == 7.0


def test_a_proxy_that_is_no_address_is_a_sentence(
    run_toml: Path, settings: SendSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", "gopher://proxy:70")
    with pytest.raises(InputError, match=r"http://192\.0\.2\.1: no connection can be made .*gopher"):
        send([run_toml], "http://192.0.2.1", settings=replace(settings, plain_http=True))


@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_bytes(b"one" * 999)])
def test_a_copy_in_the_spool_that_is_missing_or_short_is_refused_and_not_sent(
    run_toml: Path,
    settings: SendSettings,
    scene: Scene,
    server: FakeServer,
    damage: Callable[[Path], object],
) -> None:
    send([run_toml], closed_address(), settings=replace(settings, tries=1))
    (folder,) = queue_of(settings)
    damage(folder / hashlib.sha256(b"one" * 1000).hexdigest())
    result = send([], server.address, settings=settings, hooks=scene.hooks)
    assert "trip1.h5: its copy in the spool is damaged; send the run again" in result.rejected[0]
    assert "PUT" not in server.log


def test_a_whole_file_that_the_server_refuses_is_refused_with_its_reason(
    send_files: Send, server: FakeServer, run_toml: Path
) -> None:
    """Its copy is right, and the server had nothing of it."""
    server.faults.append(Fault("PUT", 422, detail="the disk is no disk"))
    result = send_files(run_toml)
    assert "trip1.h5" in result.rejected[0]
    assert "the disk is no disk" in result.rejected[0]
    assert server.log.count("PUT") == 1


def test_a_run_whose_files_are_gone_has_no_known_state(
    send_files: Send, run_toml: Path, settings: SendSettings
) -> None:
    send_files(run_toml)
    assert settings.spool is not None
    spool, run = (
        Spool(settings.spool, 1e9),
        run_of(existing_group(run_toml, listed_files(run_toml)), RunRule()),
    )
    assert spool.known_state(run) == "sent"
    run.paths[0].unlink()
    assert spool.known_state(run) == ""


@pytest.mark.parametrize("function", ["fsync", "move_file"])
def test_an_error_of_the_disk_leaves_no_half_of_a_run_in_the_spool(
    run_toml: Path, settings: SendSettings, server: FakeServer, monkeypatch: pytest.MonkeyPatch, function: str
) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr({"fsync": os, "move_file": spool}[function], function, fail)
        result = send([run_toml], server.address, settings=settings)
    assert result.failures[0].endswith("cannot be spooled (Input/output error).")
    assert settings.spool
    assert list((settings.spool / "queue").iterdir()) == []
    assert server.runs == {}


def test_a_run_that_another_process_spools_at_the_same_time_is_sent_once(
    send_files: Send, run_toml: Path, server: FakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def come_second(path: Path, target: Path) -> None:
        if target.parent.name == "queue" and not target.exists():
            shutil.copytree(path, target)
        move_file(path, target)

    monkeypatch.setattr(spool, "move_file", come_second)
    result = send_files(run_toml)
    assert (len(result.sent), result.failures, len(server.runs)) == (1, (), 1)
