"""Values as bytes and back, and bytes that are cut, too long, or of something else."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from ballscrew.base import exactfile
from ballscrew.base.errors import InputError
from ballscrew.base.exactfile import from_bytes, to_bytes


@dataclass(frozen=True)
class Part:
    name: str
    value: Any


READERS = {"Part": Part}


def back(value: Any) -> Any:
    return from_bytes(to_bytes(value, {}), READERS, "a.bin")


def test_a_number_of_numpy_comes_back_as_a_plain_one() -> None:
    part = back(Part("a", np.float64(0.1)))
    assert (part.value, type(part.value)) == (0.1, float)
    assert back(np.int64(3)) == 3
    assert back(np.bool_(True)) is True


def test_an_array_comes_back_to_the_bit() -> None:
    values = np.array([[0.1, np.nan], [np.inf, -0.0]])
    found = back({"a": values})["a"]
    assert found.dtype == values.dtype
    assert found.tobytes() == values.tobytes()


def test_an_array_of_a_type_that_is_not_read_is_refused() -> None:
    content = to_bytes(Part("a", np.array([1j])), {})
    with pytest.raises(InputError, match=r"^a\.bin: is damaged, .*an array of '<c16'"):
        from_bytes(content, READERS, "a.bin")


def test_bytes_that_are_cut_are_refused() -> None:
    content = to_bytes(Part("a", "x" * 1000), {})
    for size in (0, 1, len(content) - 1):
        with pytest.raises(InputError, match=r"a\.bin: is damaged"):
            from_bytes(content[:size], READERS, "a.bin")
    with pytest.raises(InputError, match="too long or cut off"):
        from_bytes(content[:-4], READERS, "a.bin")


def test_bytes_that_would_fill_the_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exactfile, "_LARGEST", 1000)
    assert len(from_bytes(zlib.compress(json.dumps("x" * 900).encode()), READERS, "a.bin")) == 900
    with pytest.raises(InputError, match="too long or cut off"):
        from_bytes(zlib.compress(json.dumps("x" * 1100).encode()), READERS, "a.bin")
