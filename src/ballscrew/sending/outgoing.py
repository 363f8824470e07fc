"""What is a run: a RUN.toml, a RUN.json, a folder, files, or a pattern of names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import read_whole
from ballscrew.base.jsonfile import read_json
from ballscrew.base.tomlfile import read_toml
from ballscrew.base.words import plural
from ballscrew.modal.job import read_run

_FIELDS = ("axis", "run", "trip")
_LARGEST = 1 << 20  # bytes of a RUN.toml
_DOCUMENTS = (".toml", ".json")
_BY_WINDOWS = ("thumbs.db", "desktop.ini")  # files that Windows puts into folders


@dataclass(frozen=True)
class OutgoingRun:
    """A run before it is copied into the spool.

    Parameters
    ----------
    name : str
        For messages: path of its RUN.toml, folder, or first file.
    axis : str
        Name of the axis.
    files : tuple of Path
        Recordings, and documents that are sent with them.
    run_toml : str or None
        Text of its RUN.toml.
    run_json : Path or None
        Result of an analysis at the machine.
    measured_at : str or None
        ISO 8601.
    """

    name: str
    axis: str
    files: tuple[Path, ...]
    run_toml: str | None = None
    run_json: Path | None = None
    measured_at: str | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """All files to send."""
        if self.run_json is None:
            return self.files
        return (*self.files, self.run_json)


@dataclass(frozen=True)
class RunRule:
    """What makes files a run.

    Parameters
    ----------
    axis : str or None
        Name of the axis; None where RUN.toml or the pattern states it.
    pattern : str or None
        Names of the recordings, such as ``"{axis}_{run}_trip{trip}.h5"``: files with the same axis and run in
        the same folder are a run. With slashes, names of folders too.
    trips : int or None
        Files of a complete run.
    incomplete : bool
        Whether incomplete runs are sent.
    documents : bool
        Whether data sheet, plan and channel map of a RUN.toml are sent with it, in place of those at the
        server.
    """

    axis: str | None = None
    pattern: str | None = None
    trips: int | None = None
    incomplete: bool = False
    documents: bool = False


@dataclass(frozen=True)
class RunGroup:
    """Files that are a run, complete or not.

    Parameters
    ----------
    source : Path
        RUN.toml, or the first file.
    files : tuple of Path
        Those that exist, in the order of the trips.
    expected : int or None
        Number of files of the complete run, if known.
    axis : str or None
        From the pattern.
    """

    source: Path
    files: tuple[Path, ...]
    expected: int | None
    axis: str | None = None

    @property
    def complete(self) -> bool:
        """Whether no file is missing, as far as is known."""
        return self.expected is None or len(self.files) >= self.expected

    @property
    def shortage(self) -> str:
        """Sentence about the missing files."""
        return f"{self.source}: {len(self.files)} of {plural(self.expected or 0, 'trip')}."

    @property
    def members(self) -> tuple[Path, ...]:
        """All files that exist."""
        return tuple(dict.fromkeys((self.source, *self.files)))


def find_runs(given: Sequence[Path], rule: RunRule) -> Iterator[OutgoingRun | InputError]:
    """Runs of the files that a user gives; where there is none, the error in its place.

    Parameters
    ----------
    given : sequence of Path
        RUN.toml and RUN.json files, folders, and recordings; the latter are one run together.
    rule : RunRule
        What makes files a run.

    Yields
    ------
    OutgoingRun or InputError
        In the order given.
    """
    if rule.pattern is not None:
        groups = group_names(_files_below(given), rule)
        if not groups:
            yield InputError(f"no file has a name of the pattern {rule.pattern!r}.")
        yield from (_run_or_error(group, rule) for group in groups)
        return
    recordings = [path for path in given if path.suffix.lower() not in _DOCUMENTS and not path.is_dir()]
    for path in given:
        if path not in recordings:
            yield _given_run(path, rule)
    if recordings:
        yield _run_or_error(RunGroup(recordings[0], tuple(recordings), rule.trips), rule)


def _files_below(given: Sequence[Path]) -> Iterator[Path]:
    for path in given:
        if path.is_dir():
            yield from visible_files(path)
        else:
            yield path


def visible_files(folder: Path) -> Iterator[Path]:
    """Files at any depth, without hidden ones."""
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if not hidden and not path.is_dir():
            yield path


def _given_run(path: Path, rule: RunRule) -> OutgoingRun | InputError:
    try:
        if path.is_dir():
            return _run_or_error(_folder_group(path, rule), rule)
        if path.suffix.lower() == ".toml":
            return _run_or_error(existing_group(path, listed_files(path)), rule)
    except InputError as error:
        return error
    return _run_or_error(RunGroup(path, (path,), None), rule)


def _folder_group(folder: Path, rule: RunRule) -> RunGroup:
    """The RUN.toml of a folder, or its recordings."""
    names = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    run_files = [path for path in names if path.suffix.lower() == ".toml" and is_run_file(path)]
    if len(run_files) > 1:
        raise InputError(f"{folder}: contains {len(run_files)} RUN.toml files; give them instead.")
    if run_files:
        return existing_group(run_files[0], listed_files(run_files[0]))
    recordings = list(filter(_is_recording, names))
    if not recordings:
        raise InputError(f"{folder}: contains no recordings.")
    return RunGroup(recordings[0], tuple(recordings), rule.trips)


def _is_recording(path: Path) -> bool:
    is_other = path.suffix.lower() in _DOCUMENTS or path.name.lower() in _BY_WINDOWS
    return not is_other and path.is_file()


def is_run_file(path: Path) -> bool:
    """Whether a TOML file is a RUN.toml: it names recordings and a channel map."""
    fields = read_toml(path)
    return "files" in fields and "channels" in fields


def listed_files(path: Path) -> tuple[Path, ...]:
    """Recordings that a RUN.toml names."""
    return tuple(file for file in read_run(path).files if isinstance(file, Path))


def existing_group(path: Path, listed: Sequence[Path]) -> RunGroup:
    """Group of the files that a RUN.toml names."""
    there = [file for file in listed if file.exists() or file.is_symlink()]
    return RunGroup(path, tuple(there), len(listed))


def group_names(paths: Iterable[Path], rule: RunRule) -> list[RunGroup]:
    """Groups of the files whose names have the pattern.

    Parameters
    ----------
    paths : iterable of Path
        Any files.
    rule : RunRule
        With a pattern.

    Returns
    -------
    list of RunGroup
        By folder, axis and run.
    """
    pattern = rule.pattern or ""
    expression = _expression(pattern)
    depth = pattern.count("/") + 1
    groups: dict[tuple[str, ...], list[tuple[tuple[int, str], Path, str | None]]] = {}
    for path in sorted(paths):
        match = expression.fullmatch("/".join(path.parts[-depth:]))
        if match is None:
            continue
        found = match.groupdict()
        folder = path.parents[depth - 1]
        key = (str(folder), str(found.get("axis")), str(found.get("run")))
        trip = found.get("trip") or ""
        groups.setdefault(key, []).append(((len(trip), trip), path, found.get("axis")))
    return [_named_group(sorted(rows, key=_order), rule) for rows in groups.values()]


def _order(row: tuple[tuple[int, str], Path, str | None]) -> tuple[tuple[int, str], Path]:
    return row[:2]


def _named_group(rows: Sequence[tuple[tuple[int, str], Path, str | None]], rule: RunRule) -> RunGroup:
    files = tuple(path for _, path, _ in rows)
    expected = rule.trips
    if expected is None and not re.search(r"\{trip\}|\*", rule.pattern or ""):
        expected = 1
    return RunGroup(files[0], files, expected, rows[0][2])


def _expression(pattern: str) -> re.Pattern[str]:
    """Regular expression of a pattern; a field that is repeated has the same value."""
    text, named = "", set()
    for part in re.split(r"(\{[^{}]*\}|\*)", pattern):
        name = part[1:-1] if part.startswith("{") else ""
        if part == "*":
            text += "[^/]*"
        elif name in named:
            text += f"(?P={name})"
        elif name in _FIELDS:
            named.add(name)
            text += f"(?P<{name}>[^/]+?)"
        elif name or part == "{}":
            raise InputError(
                f"the pattern has the field {{{name}}}; known are {{axis}}, {{run}} and {{trip}}."
            )
        else:
            text += re.escape(part)
    return re.compile(text, re.IGNORECASE)


def _run_or_error(group: RunGroup, rule: RunRule) -> OutgoingRun | InputError:
    if not group.complete and not rule.incomplete:
        return InputError(f"{group.shortage} Incomplete runs are sent with --send-incomplete.")
    try:
        return run_of(group, rule)
    except InputError as error:
        return error


def run_of(group: RunGroup, rule: RunRule) -> OutgoingRun:
    """Run of a group of files.

    Parameters
    ----------
    group : RunGroup
        Its files.
    rule : RunRule
        With the axis that is given, which replaces that of a data sheet or a name.

    Returns
    -------
    OutgoingRun
        With what RUN.toml or RUN.json states.

    Raises
    ------
    InputError
        If a file cannot be read or the axis is not stated.
    """
    source, name = group.source, str(group.source)
    if source.suffix.lower() == ".toml":
        return _stated_run(group, rule)
    if len(group.files) == 1 and source.suffix.lower() == ".json":
        return _analysed_run(source, rule.axis or group.axis)
    return OutgoingRun(name, _axis(rule.axis or group.axis, name), group.files)


def _stated_run(group: RunGroup, rule: RunRule) -> OutgoingRun:
    """Run of a RUN.toml."""
    source, name, files = group.source, str(group.source), group.files
    stated = read_run(source)
    if not files:
        raise InputError(f"{name}: none of its recordings exists.")
    axis = rule.axis
    if axis is None and stated.axis is not None:
        axis = read_toml(stated.axis).text("name")
    if rule.documents:
        files += tuple(path for path in (stated.axis, stated.plan, stated.channels) if path is not None)
    text = read_whole(source, _LARGEST).decode("utf-8-sig")
    return OutgoingRun(name, _axis(axis, name), files, text, None, stated.measured_at)


def _analysed_run(path: Path, given: str | None) -> OutgoingRun:
    """Run of a RUN.json, which the server accepts for the axis that it states alone."""
    document = read_json(path)
    run = document.get("run")
    if not isinstance(run, dict) or "cells" not in document:
        raise InputError(f"{path}: is no RUN.json, which 'ballscrew analyze --json' prints.")
    axis, measured_at = run.get("axis"), run.get("measured_at")
    if not isinstance(axis, str | None) or not isinstance(measured_at, str | None):
        raise InputError(f"{path}: axis and measured_at must be texts.")
    if axis is None:
        raise InputError(f"{path}: states no axis; analyze the run again with its data sheet (--axis).")
    if given is not None and given != axis:
        raise InputError(f"{path}: is of the axis {shown(axis)}, not of {shown(given)}.")
    return OutgoingRun(str(path), _axis(axis, str(path)), (), None, path, measured_at)


def _axis(name: str | None, source: str) -> str:
    if name is None:
        raise InputError(f"{source}: the axis is not stated; give its name (--axis).")
    if "/" in name or not name.strip(". "):
        raise InputError(f"{source}: the axis is {name!r}; it must have a letter or a digit, and no '/'.")
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:  # bytes of a file's name that are no text
        raise InputError(f"{source}: the axis is no text in UTF-8; give its name (--axis).") from None
    return name
