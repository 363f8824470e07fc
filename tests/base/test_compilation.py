"""Compiled functions without a folder for them."""

from __future__ import annotations

import pytest
from numba.core.caching import FunctionCache

from ballscrew.base.compilation import compiled


def double(value: float) -> float:
    return 2 * value


def test_without_a_folder_nothing_is_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_folder(*_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(FunctionCache, "__init__", no_folder)
    assert compiled()(double)(2.0) == 4.0


def test_on_a_full_disk_nothing_is_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_space(*_: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(FunctionCache, "save_overload", no_space)
    assert compiled()(double)(3) == 6
