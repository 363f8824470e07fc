from __future__ import annotations

from pathlib import Path

import pytest

from ballscrew.base.errors import InputError
from ballscrew.base.files import write_texts


def test_files_are_written_and_replaced(tmp_path):
    (tmp_path / "a").write_text("old", encoding="ascii")
    write_texts([(tmp_path / "a", ["1\n", "2\n"]), (tmp_path / "b", iter(["3"]))])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"1\n2\n", "b": b"3"}


def breaking(error):
    yield "half"
    raise error


@pytest.mark.parametrize(
    ("error", "seen"),
    [
        (OSError(28, "No space left on device"), InputError),
        (InputError("no"), InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (ZeroDivisionError(), ZeroDivisionError),
    ],
)
def test_all_or_none(tmp_path, error, seen):
    (tmp_path / "a").write_text("old", encoding="ascii")
    with pytest.raises(seen):
        write_texts([(tmp_path / "a", ["new"]), (tmp_path / "b", breaking(error))])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"old"}


def test_what_is_not_ascii_is_not_written(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_texts([(tmp_path / "a", ["µ"])])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["", ".", "..", "none/a", "a\0"])
def test_a_place_that_cannot_be_written(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"cannot be written|is a folder") as error:
        write_texts([(Path(name), ["x"])])
    assert str(error.value).endswith(".")
    assert list(tmp_path.iterdir()) == []
