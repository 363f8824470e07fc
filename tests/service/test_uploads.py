"""Files that are sent: verified, resumed, refused, and never half there."""

from __future__ import annotations

import asyncio
import errno
import gzip
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.types import Message
from tests.service.conftest import (
    RUN,
    SETUP,
    NewService,
    client_of,
    put,
    send,
    send_result,
    sha256,
    work_off,
)
from tests.store.stored import count, imitate_analysis, write_recordings

from ballscrew.service import uploads
from ballscrew.service.serving import ServedStore, Service
from ballscrew.store.adding import add
from ballscrew.store.raw_files import StoredFile, path_of, put_file, read_blocks
from ballscrew.store.store import Store
from ballscrew.store.tables import RawFile

CONTENT = os.urandom(1000) * 3000  # three blocks
QUOTA = getattr(errno, "EDQUOT", errno.ENOSPC)  # Windows may lack it
URL = f"{RUN}/files/{sha256(CONTENT)}"


def stored(service: Service, content: bytes) -> bytes:
    with service.store.read() as session:
        row = session.get_one(RawFile, sha256(content))
    path = path_of(service.store.folder.files, row.sha256, row.compression)
    return b"".join(read_blocks(path, row.compression))


def partials(service: Service) -> list[Path]:
    return list(service.partial.iterdir())


def test_a_file_is_stored_once(client: TestClient, service: Service) -> None:
    head = client.head(URL)
    assert (head.status_code, head.headers["Upload-Offset"]) == (204, "0")
    assert [put(client, CONTENT).status_code for _ in range(2)] == [201, 200]
    head = client.head(URL)
    assert (head.status_code, head.headers["Upload-Complete"]) == (200, "?1")
    assert stored(service, CONTENT) == CONTENT
    assert count(service.store, RawFile) == 1
    assert partials(service) == []
    assert Store.verify(service.store.path).faults == ()


def test_a_compressed_body_is_stored_as_it_is(client: TestClient, service: Service) -> None:
    content = gzip.compress(bytes(10_000_000))
    assert put(client, content, **{"Content-Encoding": "gzip"}).status_code == 201
    with service.store.read() as session:
        assert session.scalars(select(RawFile.size)).all() == [len(content)]


def test_a_file_is_resumed_where_it_ended(client: TestClient, service: Service) -> None:
    total, first = len(CONTENT), len(CONTENT) // 2 + 7

    def part(start: int, stop: int) -> dict[str, str]:
        return {"Content-Range": f"bytes {start}-{stop - 1}/{total}"}

    answer = client.put(URL, content=CONTENT[:first], headers=part(0, first))
    assert (answer.status_code, answer.headers["Upload-Offset"]) == (202, str(first))
    assert client.head(URL).headers["Upload-Offset"] == str(first)
    answer = client.put(URL, content=CONTENT[:10], headers=part(0, 10))
    assert (answer.status_code, answer.headers["Upload-Offset"]) == (409, str(first))
    assert client.put(URL, content=CONTENT[first:], headers=part(first, total)).status_code == 201
    assert stored(service, CONTENT) == CONTENT


def test_another_digest_leaves_nothing(client: TestClient, service: Service) -> None:
    answer = client.put(URL, content=CONTENT[:-1])
    assert answer.status_code == 422
    assert "another SHA-256" in answer.json()["detail"]
    assert partials(service) == []
    assert count(service.store, RawFile) == 0
    assert client.head(URL).headers["Upload-Offset"] == "0"


@pytest.mark.parametrize(
    "given",
    [
        "bytes 0-99/10",
        "bytes 5-2/10",
        "bytes 0-9/10",
        "bytes */10",
        "lines 0-1/2",
        "bytes 0-9999999999999999999/1",
        "bytes -1-3/4",
    ],
)
def test_a_range_that_does_not_fit_is_refused(client: TestClient, given: str) -> None:
    answer = client.put(URL, content=b"abc", headers={"Content-Range": given})
    assert answer.status_code == 422
    assert "Content-Range" in answer.json()["detail"]


@pytest.mark.parametrize("digest", ["", "abc", "A" * 64, "..%2f..%2fetc", "g" * 64, "0" * 65, "%00" * 64])
def test_hostile_digests_are_refused(client: TestClient, service: Service, digest: str) -> None:
    assert client.put(f"{RUN}/files/{digest}", content=b"x").status_code in (404, 405, 422)
    assert partials(service) == []


def test_the_largest_file_is_limited_also_where_its_length_is_not_stated(new_service: NewService) -> None:
    service = new_service(max_file_bytes=1000)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        assert client.put(URL, content=CONTENT).status_code == 413
        assert client.put(URL, content=(CONTENT[:600] for _ in range(9))).status_code == 413


def test_an_unknown_axis_is_404(client: TestClient) -> None:
    answer = client.put(f"/api/v1/axes/none/runs/r/files/{sha256(b'')}", content=b"")
    assert (answer.status_code, "no axis 'none'" in answer.json()["detail"]) == (404, True)


@pytest.mark.parametrize("part", ["copy", "stream"])
@pytest.mark.parametrize(
    ("number", "status"),
    [
        (errno.ENOSPC, 507),
        (QUOTA, 507),
        (errno.EIO, 503),
        (errno.EACCES, 503),
    ],
)
def test_a_full_disk_is_507_another_error_503_and_neither_leaves_a_file(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch, part: str, number: int, status: int
) -> None:
    """By the number of the error: its words differ between languages."""

    def fail(*_: object) -> None:
        raise OSError(number, "Kein Platz")

    with monkeypatch.context() as patched:
        if part == "copy":
            patched.setattr(os, "fsync", fail)
        else:
            patched.setattr(Path, "open", fail)
        answer = put(client, CONTENT)
    assert (answer.status_code, "Kein Platz" in answer.json()["detail"]) == (status, True)
    assert answer.headers["Retry-After"]
    assert count(service.store, RawFile) == 0


def test_a_disk_with_too_little_space_is_507(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Service, "free_bytes", lambda _: -1)
    assert put(client, CONTENT).status_code == 507
    assert count(service.store, RawFile) == 0


def test_two_senders_of_one_file_do_not_mix(client: TestClient, service: Service) -> None:
    client.app.state.receiving.add(sha256(CONTENT))  # type: ignore[attr-defined]
    assert put(client, CONTENT).status_code == 409
    assert partials(service) == []


def test_a_damaged_store_receives_nothing(client: TestClient, service: Service) -> None:
    service.store.folder.mark_damaged(["a fault"])
    answer = put(client, CONTENT)
    assert (answer.status_code, "damaged" in answer.json()["detail"]) == (503, True)
    assert answer.headers["Retry-After"] == "60"
    answer = client.get("/readyz")
    assert (answer.status_code, "damaged" in answer.json()["reason"]) == (503, True)


def test_an_archived_file_is_received_again(client: TestClient, service: Service) -> None:
    put(client, CONTENT)
    with service.store.write("test") as session:
        row = session.get_one(RawFile, sha256(CONTENT))
        path_of(service.store.folder.files, row.sha256, row.compression).unlink()
        row.archived_to = "elsewhere"
    assert client.head(URL).status_code == 204
    assert put(client, CONTENT).status_code == 201
    assert uploads.stored_size(service, sha256(CONTENT)) == len(CONTENT)


def test_a_file_without_a_row_is_removed_at_the_next_start(client: TestClient, service: Service) -> None:
    """Of a server that was killed between the file and its row, or before it removed the partial file."""
    put(client, CONTENT)
    (service.partial / sha256(CONTENT)).write_bytes(CONTENT)
    files = service.store.folder.files
    put_file(files, service.partial / sha256(CONTENT), sha256(CONTENT))
    (service.partial / sha256(b"x")).write_bytes(b"x")
    put_file(files, service.partial / sha256(b"x"), sha256(b"x"))
    (files / ".incoming-abc").write_bytes(b"half")
    uploads.recover_uploads(service)
    assert Store.verify(service.store.path).orphans == ()
    assert [path.name for path in service.partial.iterdir()] == [sha256(b"x")]
    assert stored(service, CONTENT) == CONTENT
    assert put(client, b"x").status_code == 201


def make_old(path: Path) -> None:
    os.utime(path, (time.time() - 8 * 86400,) * 2)


def make_all_old(service: Service) -> None:
    for path in service.store.folder.files.rglob("*"):
        make_old(path)


def test_old_incomplete_uploads_are_removed(service: Service) -> None:
    for name in ("old", "new"):
        (service.partial / name).touch()
    make_old(service.partial / "old")
    uploads.remove_unused(service)
    assert [path.name for path in service.partial.iterdir()] == ["new"]


def test_an_old_file_that_no_run_refers_to_is_removed_and_can_be_sent_again(
    client: TestClient, service: Service
) -> None:
    put(client, CONTENT)
    uploads.remove_unused(service)
    assert client.head(URL).status_code == 200
    make_all_old(service)
    uploads.remove_unused(service)
    assert (client.head(URL).status_code, count(service.store, RawFile)) == (204, 0)
    verification = Store.verify(service.store.path)
    assert (verification.faults, verification.orphans) == ((), ())
    assert put(client, CONTENT).status_code == 201


def test_a_file_that_a_sender_has_just_asked_for_stays(client: TestClient, service: Service) -> None:
    put(client, CONTENT)
    make_all_old(service)
    assert client.head(URL).status_code == 200  # so that the sender does not send it again
    uploads.remove_unused(service)
    assert stored(service, CONTENT) == CONTENT


def test_files_of_runs_stay_of_whatever_status(
    client: TestClient, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    (path.parent / "axis.toml").write_text(SETUP["sheet"])
    path.write_text(path.read_text() + 'axis = "axis.toml"\n')
    add(service.store, path)
    send(client)
    assert send(client, files={"a.h5": b"other", "b.h5": b"content"}).status_code == 409
    send(client, RUN + "-refused", {"a.h5": b"1", "b.h5": b"2"})
    work_off(service, lambda _: ("refused", "it cannot be analysed."))
    send_result(client, 0)
    before = count(service.store, RawFile)
    make_all_old(service)
    uploads.remove_unused(service)
    assert count(service.store, RawFile) == before == 9
    assert Store.verify(service.store.path).faults == ()


def test_a_file_that_is_sent_while_its_old_copy_is_removed_is_not_lost(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its content arrives between the removal of the old row and of the old file."""
    put(client, CONTENT)
    make_all_old(service)
    answers = []
    write = ServedStore.write
    put_file = uploads.put_file

    def put_and_lose(*arguments: Any) -> StoredFile:
        found = put_file(*arguments)
        path_of(*arguments[::2], found.compression).unlink()
        return found

    @contextmanager
    def send_between(store: ServedStore, purpose: str, **options: bool) -> Iterator[Session]:
        with write(store, purpose, **options) as session:
            yield session
        if purpose == "remove unused files" and not answers:
            answers.append(put(client, CONTENT).status_code)

    with monkeypatch.context() as patched:
        patched.setattr(ServedStore, "write", send_between)
        uploads.remove_unused(service)
    assert answers == [201]
    assert stored(service, CONTENT) == CONTENT
    other = b"another"
    with monkeypatch.context() as patched:
        patched.setattr(uploads, "put_file", put_and_lose)
        assert put(client, other).status_code == 503
    assert put(client, other).status_code == 201
    assert Store.verify(service.store.path).faults == ()


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        (90, "the part ends at 90; Content-Range states 100."),
        (110, "the part is longer than Content-Range states, which ends at 100."),
    ],
)
def test_a_part_of_another_size_than_its_range_is_refused_and_the_file_can_be_resumed(
    client: TestClient, end: int, expected: str
) -> None:
    """Of a body without Content-Length."""
    total = len(CONTENT)
    first = client.put(URL, content=CONTENT[:50], headers={"Content-Range": f"bytes 0-49/{total}"})
    assert first.status_code == 202
    part = iter([CONTENT[50:end]])
    answer = client.put(URL, content=part, headers={"Content-Range": f"bytes 50-99/{total}"})
    assert answer.status_code == 422
    assert answer.json()["detail"] == expected
    offset = int(client.head(URL).headers["Upload-Offset"])
    assert offset <= 100
    rest = {"Content-Range": f"bytes {offset}-{total - 1}/{total}"}
    assert client.put(URL, content=CONTENT[offset:], headers=rest).status_code == 201


def test_an_upload_from_which_nothing_comes_is_ended(new_service: NewService) -> None:
    """What has come stays, and can be resumed."""
    service = new_service(upload_idle_s=0.05)
    statuses: list[int | None] = []

    async def receive() -> Message:
        if not statuses:
            statuses.append(None)
            return {"type": "http.request", "body": b"x" * 10, "more_body": True}
        await asyncio.Event().wait()
        raise AssertionError("it is ended before")

    async def answer(message: Message) -> None:
        statuses.append(message.get("status"))

    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        headers = [(b"host", b"localhost"), (b"content-range", b"bytes 0-99/100")]
        scope = {"type": "http", "method": "PUT", "path": URL, "query_string": b"", "headers": headers}
        asyncio.run(client.app(scope, receive, answer))
    assert statuses[1] == 408


def test_a_file_that_is_missing_is_not_removed_as_unused(client: TestClient, service: Service) -> None:
    """That it is missing is a fault, which stays visible."""
    old = time.time() - 30 * 86400
    for content in (CONTENT, CONTENT[:100]):
        put(client, content)
        with service.store.read() as session:
            row = session.get_one(RawFile, sha256(content))
        path = path_of(service.store.folder.files, row.sha256, row.compression)
        os.utime(path, (old, old))
    path.unlink()
    uploads.remove_unused(service)
    with service.store.read() as session:
        assert session.scalars(select(RawFile.sha256)).all() == [sha256(CONTENT[:100])]
    assert len(Store.verify(service.store.path).faults) == 1
