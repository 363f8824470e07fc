"""Fixtures of the readers' tests."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for


@pytest.fixture
def survives() -> Callable[[Path], bool]:
    """Reads all of a file; whether it could be read, an InputError of one line being the only other end."""

    def survive(path: Path) -> bool:
        try:
            reader = reader_for(path)
            header = reader.read_header(path)
            values = reader.read(path, [channel.name for channel in header.channels])
        except InputError as error:
            message = str(error)
        else:
            message = ""
        if message:
            assert message.startswith(str(path))
            assert "\n" not in message
            return False
        assert set(values) == {channel.name for channel in header.channels}
        assert all(array.ndim == 1 and array.dtype.kind == "f" for array in values.values())
        return True

    return survive


@pytest.fixture(autouse=True)
def _no_unraisable() -> Iterator[None]:
    # Half-built objects of a failing library may complain when they are collected; that is not our test.
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    yield
    sys.unraisablehook = hook
