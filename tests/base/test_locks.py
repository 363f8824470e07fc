"""Locks of files, as Windows has them: of a byte behind the text."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ballscrew.base import locks
from ballscrew.base.locks import try_lock, unlock


def test_a_file_is_locked_by_one_opener_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    with path.open("a+") as first, path.open("a+") as second:
        assert try_lock(first)
        assert not try_lock(second)
    with path.open("a+") as third:
        assert try_lock(third)


def test_windows_locks_and_unlocks_a_byte_behind_the_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []
    refused: list[bool] = []

    def locking(_: int, mode: str, size: int) -> None:
        if refused:
            raise PermissionError(13, "Permission denied")
        calls.append((mode, stream.tell(), size))

    fake = SimpleNamespace(locking=locking, LK_NBLCK="lock", LK_UNLCK="unlock")
    monkeypatch.setitem(sys.modules, "msvcrt", fake)
    monkeypatch.setattr(locks, "os", SimpleNamespace(name="nt"))
    with (tmp_path / "a.lock").open("w+") as stream:
        stream.write("text")
        assert try_lock(stream)
        unlock(stream)
        refused.append(True)
        assert not try_lock(stream)
    (lock, released) = calls
    assert (lock, released) == (("lock", lock[1], 1), ("unlock", lock[1], 1))
    assert lock[1] > 1_000_000
    assert (tmp_path / "a.lock").read_text() == "text"
