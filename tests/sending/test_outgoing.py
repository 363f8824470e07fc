"""What is a run, and which files it has."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from tests.sending.conftest import write_run

from ballscrew import InputError
from ballscrew.sending.outgoing import OutgoingRun, RunRule, _folder_group, find_runs
from ballscrew.sending.watched import WatchedFolder

X = RunRule(axis="X axis")


def only_run(given: list[Path], rule: RunRule = X) -> OutgoingRun:
    (found,) = find_runs(given, rule)
    assert isinstance(found, OutgoingRun), found
    return found


def only_error(given: list[Path], rule: RunRule = X) -> str:
    (found,) = find_runs(given, rule)
    assert isinstance(found, InputError), found
    return str(found)


def touch(folder: Path, *names: str) -> list[Path]:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(name.encode())
    return [folder / name for name in names]


def names_of(run: OutgoingRun) -> list[str]:
    return [path.name for path in run.files]


def test_a_run_file_states_axis_files_and_time(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    run = only_run([path], RunRule())
    assert (run.axis, names_of(run)) == ("X axis", ["trip1.h5", "trip2.h5"])
    assert (run.run_toml, run.measured_at) == (path.read_text(), "2026-01-31T08:00:00+00:00")


def test_documents_are_sent_on_demand(tmp_path: Path) -> None:
    run = only_run([write_run(tmp_path)], RunRule(documents=True))
    assert names_of(run) == ["trip1.h5", "trip2.h5", "axis.toml", "channels.toml"]


def test_an_axis_that_is_given_replaces_that_of_the_data_sheet(tmp_path: Path) -> None:
    assert only_run([write_run(tmp_path)], RunRule(axis="Y")).axis == "Y"


def test_a_folder_is_its_run_file_else_its_recordings(tmp_path: Path) -> None:
    files = touch(tmp_path / "a", "trip1.h5", "trip2.h5", "axis.toml", ".hidden", "run.json")
    (tmp_path / "a" / "axis.toml").write_text('name = "A"\n')
    assert only_run([tmp_path / "a"]).files == tuple(files[:2])
    write_run(tmp_path / "b")
    assert only_run([tmp_path / "b"], RunRule()).run_toml is not None


def test_a_folder_with_two_run_files_or_without_recordings_is_named(tmp_path: Path) -> None:
    path = write_run(tmp_path / "a")
    path.with_name("other.toml").write_text(path.read_text())
    assert "contains 2 RUN.toml files" in only_error([tmp_path / "a"])
    (tmp_path / "b").mkdir()
    assert "contains no recordings" in only_error([tmp_path / "b"])


def test_recordings_that_are_given_are_a_run_in_their_order(tmp_path: Path) -> None:
    files = touch(tmp_path, "b.h5", "a.h5")
    assert only_run(files).files == tuple(files)


def test_run_files_folders_and_recordings_together_are_several_runs(tmp_path: Path) -> None:
    recordings = touch(tmp_path, "a.h5", "b.h5")
    touch(tmp_path / "c", "c.h5")
    found = list(find_runs([write_run(tmp_path / "d"), recordings[0], tmp_path / "c", recordings[1]], X))
    assert [len(run.files) for run in found if isinstance(run, OutgoingRun)] == [2, 1, 2]


def test_a_document_of_an_analysis_states_axis_and_time(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    document = {"schema": 2, "run": {"axis": "Z", "measured_at": "2026-01-31"}, "cells": []}
    path.write_text(json.dumps(document))
    run = only_run([path], RunRule())
    assert (run.axis, run.measured_at, run.run_json, run.files) == ("Z", "2026-01-31", path, ())
    assert only_run([path], RunRule(pattern="{run}.json")).axis == "Z"
    assert only_run([path], RunRule(axis="Z")).axis == "Z"
    assert "is of the axis 'Z', not of 'X axis'" in only_error([path], X)


def test_a_document_of_an_analysis_without_an_axis_is_not_sent_for_one(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_text('{"schema": 2, "run": {"axis": null}, "cells": []}')
    assert "states no axis" in only_error([path], X)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not JSON"),
        ("{}", "schema"),
        ('{"schema": 2}', "is no RUN.json"),
        ('{"schema": 2, "run": [], "cells": []}', "is no RUN.json"),
        ('{"schema": 2, "run": {"axis": 3}, "cells": []}', "must be texts"),
        ('{"schema": 2, "run": {"axis": null}, "cells": []}', "states no axis"),
    ],
)
def test_a_document_of_something_else_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "run.json"
    path.write_text(text)
    assert words in only_error([path], RunRule())


def test_without_an_axis_the_option_is_named(tmp_path: Path) -> None:
    assert "give its name (--axis)" in only_error(touch(tmp_path, "a.h5"), RunRule())


@pytest.mark.parametrize("name", ["X/Y", "..", " "])
def test_an_axis_that_no_server_has_is_not_sent(tmp_path: Path, name: str) -> None:
    sentence = only_error(touch(tmp_path, "a.h5"), RunRule(axis=name))
    assert "it must have a letter or a digit, and no '/'" in sentence


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("files = [", "is not TOML"),
        ("files = []\nchannels = 'c'", "a list of file names"),
        ("files = ['trip1.h5']", "channels is missing"),
        ("files = ['a']\nchannels = 'c'\nlode = 1", "lode is not a known field"),
        ("files = ['a']\nchannels = 'c'", "0 of 1 trip."),
        ("files = ['trip1.h5', 'b', 'c']\nchannels = 'c'", "1 of 3 trips."),
        ("files = ['trip1.h5', 'a\\u0000b']\nchannels = 'c'", ""),
        ("axis = 'none.toml'\nfiles = ['trip1.h5']\nchannels = 'c'", "none.toml: cannot be read"),
    ],
)
def test_a_wrong_run_file_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = write_run(tmp_path)
    path.write_text(text)
    assert words in only_error([path], RunRule())


def test_an_incomplete_run_is_sent_if_asked_for_and_none_without_files(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    (tmp_path / "trip1.h5").unlink()
    rule = RunRule(incomplete=True)
    assert names_of(only_run([path], rule)) == ["trip2.h5"]
    (tmp_path / "trip2.h5").unlink()
    assert "none of its recordings exists" in only_error([path], rule)


@pytest.mark.parametrize(
    ("pattern", "runs"),
    [
        ("{axis}_{run}_trip{trip}.h5", [["X_1_trip1.h5", "X_1_trip2.h5", "X_1_trip10.h5"], ["X_2_trip1.h5"]]),
        ("{axis}_*_trip{trip}.H5", [["X_1_trip1.h5", "X_2_trip1.h5", "X_1_trip2.h5", "X_1_trip10.h5"]]),
        ("{run}/{trip}.h5", [["X_1_trip1.h5", "X_2_trip1.h5", "X_1_trip2.h5", "X_1_trip10.h5"]]),
        ("{run}/{run}_{trip}.h5", []),
        ("X_1_trip1.h5", [["X_1_trip1.h5"]]),
        ("X_1_trip..h5", []),
    ],
)
def test_a_pattern_groups_names(tmp_path: Path, pattern: str, runs: list[list[str]]) -> None:
    touch(tmp_path / "n", "X_1_trip1.h5", "X_2_trip1.h5", "X_1_trip10.h5", "X_1_trip2.h5", "other.csv")
    found = list(find_runs([tmp_path], RunRule(axis="X", pattern=pattern)))
    if not runs:
        (error,) = found
        assert "no file has a name of the pattern" in str(error)
        return
    assert sorted(sorted(names_of(run)) for run in found if isinstance(run, OutgoingRun)) == sorted(
        map(sorted, runs)
    )


def test_trips_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    files = touch(tmp_path, *(f"X_1_trip{number}.h5" for number in (10, 9, 1, 2)))
    run = only_run(files, RunRule(pattern="{axis}_{run}_trip{trip}.h5"))
    assert names_of(run) == ["X_1_trip1.h5", "X_1_trip2.h5", "X_1_trip9.h5", "X_1_trip10.h5"]
    assert run.axis == "X"


def test_the_same_name_in_two_folders_is_two_runs(tmp_path: Path) -> None:
    touch(tmp_path, "a/X_1.h5", "b/X_1.h5")
    assert len(list(find_runs([tmp_path], RunRule(pattern="{axis}_{run}.h5")))) == 2


@pytest.mark.parametrize("pattern", ["{axs}_{run}.h5", "{}.h5", "{run:03d}.h5"])
def test_an_unknown_field_of_a_pattern_is_named(tmp_path: Path, pattern: str) -> None:
    with pytest.raises(InputError, match="known are"):
        list(find_runs([tmp_path], RunRule(pattern=pattern)))


def test_too_few_files_of_a_pattern_are_named(tmp_path: Path) -> None:
    files = touch(tmp_path, "X_1_a.h5", "X_1_b.h5")
    rule = RunRule(pattern="{axis}_{run}_{trip}.h5", trips=3)
    assert "2 of 3 trips" in only_error(files, rule)
    assert "1 of 3 trips" in only_error(files[:1], RunRule(axis="X", trips=3))


def test_a_pattern_without_trips_is_complete_with_a_file(tmp_path: Path) -> None:
    touch(tmp_path, "X_1.h5")
    watched = WatchedFolder(tmp_path, RunRule(pattern="{axis}_{run}.h5"), settle=10, timeout=900)
    assert list(watched.scan(0)) == []
    ((group, run),) = watched.scan(10)
    assert isinstance(run, OutgoingRun)
    watched.done(group)
    assert list(watched.scan(20)) == []
    touch(tmp_path, "X_1.h5")
    os.utime(tmp_path / "X_1.h5", (1, 1))
    assert list(watched.scan(30)) == []
    assert len(list(watched.scan(40))) == 1


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="rights do not apply")
def test_a_file_that_cannot_be_opened_is_not_complete(tmp_path: Path) -> None:
    (path,) = touch(tmp_path, "X_1.h5")
    path.chmod(0)
    watched = WatchedFolder(tmp_path, RunRule(pattern="{axis}_{run}.h5"), settle=0, timeout=0)
    ((_, error),) = watched.scan(0)
    assert isinstance(error, InputError)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are shown on Linux")
def test_a_file_to_which_a_program_writes_is_not_complete(tmp_path: Path) -> None:
    touch(tmp_path, "X_1.h5")
    watched = WatchedFolder(tmp_path, RunRule(pattern="{axis}_{run}.h5"), settle=0, timeout=0)
    with (tmp_path / "X_1.h5").open("ab"):
        ((_, error),) = watched.scan(0)
        assert "X_1.h5: is in use (a program is writing to it)" in str(error)
    with (tmp_path / "X_1.h5").open("rb"):
        ((_, run),) = watched.scan(0)
        assert not isinstance(run, InputError)


def test_a_file_that_is_open_on_windows_is_not_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touch(tmp_path, "X_1.h5")
    watched = WatchedFolder(tmp_path, RunRule(pattern="{axis}_{run}.h5"), settle=0, timeout=0)

    def in_use(path: Path, target: Path) -> None:
        assert path == target
        raise PermissionError(13, "The process cannot access the file")

    monkeypatch.setattr("ballscrew.sending.watched.WINDOWS", True)
    monkeypatch.setattr(Path, "rename", in_use)
    ((_, error),) = watched.scan(0)
    assert "is in use" in str(error)


def test_a_file_that_may_not_be_renamed_on_windows_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a share that is read-only."""
    touch(tmp_path, "X_1.h5")
    watched = WatchedFolder(tmp_path, RunRule(pattern="{axis}_{run}.h5"), settle=0, timeout=0)

    class AccessError(PermissionError):
        winerror = 5

    def refuse(*_: Path) -> None:
        raise AccessError(13, "Access is denied")

    monkeypatch.setattr("ballscrew.sending.watched.WINDOWS", True)
    monkeypatch.setattr(Path, "rename", refuse)
    ((_, run),) = watched.scan(0)
    assert not isinstance(run, InputError)


def test_hidden_files_are_no_recordings(tmp_path: Path) -> None:
    touch(tmp_path, ".X_1.h5", ".git/X_1.h5")
    watched = WatchedFolder(tmp_path, RunRule(pattern="{axis}_{run}.h5"), settle=0, timeout=0)
    assert list(watched.scan(0)) == []


def test_an_axis_that_is_no_text_is_not_sent(tmp_path: Path) -> None:
    sentence = only_error(touch(tmp_path, "a.h5"), RunRule(axis="X\udcff"))
    assert sentence.endswith("the axis is no text in UTF-8; give its name (--axis).")
    sentence.encode()


def test_files_that_windows_puts_into_a_folder_are_no_recordings(tmp_path: Path) -> None:
    touch(tmp_path, "a.h5", "Thumbs.db", "desktop.ini")
    assert [path.name for path in _folder_group(tmp_path, RunRule()).files] == ["a.h5"]
