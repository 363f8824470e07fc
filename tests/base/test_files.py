from __future__ import annotations

import io
import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from ballscrew.base import files
from ballscrew.base.errors import InputError, printable
from ballscrew.base.files import (
    check_folder,
    move_file,
    open_regular,
    read_whole,
    sweep,
    sync_folder,
    write_text,
    write_texts,
)
from ballscrew.base.jsonfile import SCHEMA, read_json
from ballscrew.base.provenance import hash_file
from ballscrew.base.tomlfile import read_toml


def test_files_are_written_and_replaced(tmp_path):
    (tmp_path / "a").write_text("old", encoding="ascii")
    write_texts([(tmp_path / "a", ["1\n", "2\n"]), (tmp_path / "b", iter(["3"]))])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"1\n2\n", "b": b"3"}


def breaking(error):
    yield "half"
    raise error


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError(28, "No space left on device"), InputError),
        (InputError("no"), InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (ZeroDivisionError(), ZeroDivisionError),
    ],
)
def test_all_or_none(tmp_path, error, raised):
    (tmp_path / "a").write_text("old", encoding="ascii")
    with pytest.raises(raised):
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


@pytest.mark.parametrize("read", [open_regular, read_whole, read_json, read_toml, hash_file])
def test_pipes_devices_and_folders_are_refused_at_once(tmp_path, read):
    with pytest.raises(InputError, match="is a folder"):
        read(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "a\0")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(InputError, match="is a pipe"):
            read(tmp_path / "pipe")
        with pytest.raises(InputError, match="is a device"):
            read("/dev/zero")


def test_links_are_followed_where_they_may_be(tmp_path):
    (tmp_path / "secret").write_bytes(b"1")
    try:
        (tmp_path / "link").symlink_to("secret")
    except OSError:
        pytest.skip("links cannot be made here")
    assert read_whole(tmp_path / "link") == b"1"
    with pytest.raises(InputError, match="is a link"):
        read_whole(tmp_path / "link", links=False)


def test_sizes_are_limited_and_counted(tmp_path):
    (tmp_path / "a").write_bytes(bytes(10))
    assert read_whole(tmp_path / "a", 10) == bytes(10)
    with pytest.raises(InputError, match="has 10 bytes; a file of this kind has at most 9"):
        read_whole(tmp_path / "a", 9)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs a file whose size is not stated")
def test_more_bytes_than_stated_are_refused():
    with pytest.raises(InputError, match="changed while it was read"):
        read_whole("/proc/self/status")


def test_what_killed_processes_left_is_swept(tmp_path):
    for name in ("recordings-old", "recordings-new"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "trip.h5").touch()
    (tmp_path / ".model-12345678.json").touch()
    for name in ("recordings-old", ".model-12345678.json"):
        os.utime(tmp_path / name, (0, 0))
    sweep(tmp_path, "recordings-*")
    write_texts([(tmp_path / "model.json", ["{}"])])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.json", "recordings-new"]


def test_the_reason_is_that_of_the_system(tmp_path):
    with pytest.raises(InputError, match=r"a: cannot be written \(No space left on device\)\."):
        write_texts([(tmp_path / "a", breaking(OSError(28, "Can't write data\n(file write failed: …)")))])


def test_controls_of_a_terminal_are_escaped():
    assert printable("µ → °\x1b[31m\n\u202e\x9b") == "µ → °\\x1b[31m\\n\\u202e\\x9b"
    assert str(InputError("a\x1bb")) == "a\\x1bb"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_a_pipe_that_comes_in_the_place_of_a_file_is_not_read(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "a")
    monkeypatch.setattr(Path, "is_file", lambda _: True)  # it was one
    with pytest.raises(InputError, match="a: is no regular file"):
        open_regular(tmp_path / "a")


def test_an_error_of_the_disk_while_a_file_is_read_is_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"x")

    class Broken(io.FileIO):
        def read(self, _size=-1):
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(files, "open_regular", lambda path, **_: Broken(path))
    with pytest.raises(InputError, match=r"a: cannot be read \(Input/output error\)\.$"):
        read_whole(tmp_path / "a")


def test_an_error_of_the_disk_while_a_file_is_hashed_is_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"x")

    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("hashlib.file_digest", fail)
    with pytest.raises(InputError, match=r"a: cannot be read \(Input/output error\)\.$"):
        hash_file(tmp_path / "a")


def test_a_folder_is_made_durable_except_on_windows(tmp_path, monkeypatch):
    sync_folder(tmp_path)
    with pytest.raises(FileNotFoundError):
        sync_folder(tmp_path / "none")
    monkeypatch.setattr(files, "os", SimpleNamespace(name="nt"))  # which can open none
    sync_folder(tmp_path / "none")


def test_a_device_or_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for write in (lambda path: write_text(path, "x"), check_folder):
        with pytest.raises(InputError, match="a pipe"):
            write(tmp_path / "pipe")
        with pytest.raises(InputError, match="a device"):
            write(Path(os.devnull))
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]
    assert not Path(os.devnull).is_file()


def test_a_link_leads_to_the_file_that_is_written(tmp_path):
    (tmp_path / "target").write_text("old", encoding="ascii")
    (tmp_path / "link").symlink_to("target")
    (tmp_path / "circle").symlink_to("circle")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text(encoding="ascii") == "new"
    with pytest.raises(InputError, match=r"circle"):
        write_text(tmp_path / "circle", "x")


def test_a_name_that_is_too_long_is_refused(tmp_path):
    path = tmp_path / ("a" * 300)
    for write in (lambda path: write_text(path, "x"), check_folder):
        with pytest.raises(InputError, match="cannot be written \\(File name too long\\)"):
            write(path)


@pytest.mark.parametrize(("held", "moved"), [(3, True), (9, False)])
def test_a_file_that_a_scanner_holds_is_moved_again_on_windows(tmp_path, monkeypatch, held, moved):
    tried, pauses = [], []
    replace = Path.replace

    def hold(path, target):
        tried.append(path)
        if len(tried) <= held:
            raise PermissionError(13, "Permission denied")
        return replace(path, target)

    (tmp_path / "a").write_text("x", encoding="ascii")
    monkeypatch.setattr(Path, "replace", hold)
    monkeypatch.setattr(files.time, "sleep", pauses.append)
    with pytest.raises(PermissionError):
        move_file(tmp_path / "a", tmp_path / "b")
    tried.clear()
    monkeypatch.setattr(files, "WINDOWS", True)
    if moved:
        move_file(tmp_path / "a", tmp_path / "b")
        assert pauses == [0.05, 0.1, 0.2]
    else:
        with pytest.raises(PermissionError):
            move_file(tmp_path / "a", tmp_path / "b")
        assert sum(pauses) < 2
    assert (tmp_path / "b").exists() == moved


def test_text_as_powershell_redirects_it_is_read(tmp_path):
    for encoding in ("utf-16", "utf-8-sig"):
        (tmp_path / "a.json").write_bytes(f'{{"schema": {SCHEMA}, "name": "ü"}}'.encode(encoding))
        assert read_json(tmp_path / "a.json")["name"] == "ü"
