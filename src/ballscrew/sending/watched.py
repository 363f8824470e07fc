"""A folder that is watched: which runs are complete."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.base.files import WINDOWS, open_regular
from ballscrew.sending.outgoing import (
    OutgoingRun,
    RunGroup,
    RunRule,
    existing_group,
    group_names,
    is_run_file,
    listed_files,
    run_of,
    visible_files,
)

_ACCESS_DENIED = 5


@dataclass
class WatchedFolder:
    """Runs of a folder, each as soon as its files are complete.

    Parameters
    ----------
    folder : Path
        Searched at any depth. Links and files outside of it are refused: whoever adds a file may have
        fewer rights to read than this program.
    rule : RunRule
        What makes files a run.
    settle : float
        A file is complete when size and time have not changed for this long, s.
    timeout : float
        A run without a change for this long is incomplete, or complete where its number of files is not
        known, s.
    """

    folder: Path
    rule: RunRule
    settle: float
    timeout: float
    _changes: dict[Path, tuple[tuple[int, int], float]] = field(default_factory=dict)
    _done: dict[Path, tuple[object, ...]] = field(default_factory=dict)
    _run_files: dict[Path, tuple[tuple[int, int], tuple[Path, ...] | None]] = field(default_factory=dict)

    def scan(self, now: float) -> Iterator[tuple[RunGroup, OutgoingRun | InputError]]:
        """Runs that are complete, or whose time is over, and that :meth:`done` does not know.

        Parameters
        ----------
        now : float
            Monotonic time, s.

        Yields
        ------
        (RunGroup, OutgoingRun or InputError)
            A run, or why there is none.
        """
        writing: set[str] | None = None
        for group in self._groups(now):
            quiet = now - max(self._changed_at(path, now) for path in group.members)
            if quiet < self.settle or self._done.get(group.source) == self._state(group):
                continue
            if self._is_due(group, quiet):
                if writing is None:
                    writing = _open_for_writing()
                yield group, self._run(group, writing)
            elif quiet >= self.timeout:
                yield group, InputError(f"{group.shortage} Incomplete runs are sent with --send-incomplete.")

    def _is_due(self, group: RunGroup, quiet: float) -> bool:
        if group.complete and group.expected is not None:
            return True
        return quiet >= self.timeout and (group.complete or self.rule.incomplete)

    def done(self, group: RunGroup) -> None:
        """Yield a run again only after one of its files has changed."""
        self._done[group.source] = self._state(group)

    def _state(self, group: RunGroup) -> tuple[object, ...]:
        return tuple((path, self._changes[path][0]) for path in group.members)

    def _run(self, group: RunGroup, writing: Collection[str]) -> OutgoingRun | InputError:
        try:
            self._check(group.source)
            run = run_of(group, self.rule)
            for path in run.paths:
                self._check(path)
                if str(path.resolve()) in writing:
                    raise InputError(f"{path}: is in use (a program is writing to it).")
            return run
        except InputError as error:
            return error

    def _check(self, path: Path) -> None:
        """Check that a file is in the folder and not a link, and that no program is writing it."""
        open_regular(path, links=False).close()
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise InputError(f"{path}: is outside of {self.folder} and is not sent.")
        if WINDOWS:  # a file that is open for writing can often be opened, but not renamed
            try:
                path.rename(path)
            except OSError as error:
                if getattr(error, "winerror", None) == _ACCESS_DENIED:  # no right to rename: a shared folder
                    return
                raise InputError(f"{path}: is in use ({error.strerror or error}).") from None

    def _groups(self, now: float) -> list[RunGroup]:
        paths = list(visible_files(self.folder))
        if self.rule.pattern is not None:
            return group_names(paths, self.rule)
        groups = []
        for path in paths:
            if path.suffix.lower() == ".toml" and now - self._changed_at(path, now) >= self.settle:
                listed = self._listed(path)
                if listed is not None:
                    groups.append(existing_group(path, listed))
        return groups

    def _listed(self, path: Path) -> tuple[Path, ...] | None:
        """Files that a RUN.toml names; None for another TOML file. Only read again after a change."""
        state = self._changes[path][0]
        known = self._run_files.get(path)
        if known is None or known[0] != state:
            listed: tuple[Path, ...] | None = None
            try:
                if is_run_file(path):
                    listed = listed_files(path)
            except InputError:
                listed = ()  # reported as a run that cannot be read
            known = (state, listed)
            self._run_files[path] = known
        return known[1]

    def _changed_at(self, path: Path, now: float) -> float:
        """Time at which the present state of a file was first found."""
        try:
            found = path.stat()
            state = (found.st_size, found.st_mtime_ns)
        except (OSError, ValueError):  # removed meanwhile, a link that leads nowhere, a NUL in the name
            state = (-1, -1)
        known = self._changes.get(path)
        if known is None or known[0] != state:
            known = (state, now)
            self._changes[path] = known
        return known[1]


def _open_for_writing() -> set[str]:
    """Files to which programs of the same user are writing, as Linux shows them in /proc; else none."""
    found = set()
    for process in _entries(Path("/proc")):
        if not process.name.isdecimal():
            continue
        for descriptor in _entries(process / "fd"):
            with suppress(OSError, ValueError, KeyError):  # closed meanwhile
                path = str(descriptor.readlink())
                if path.startswith("/") and _is_for_writing(process / "fdinfo" / descriptor.name):
                    found.add(path)
    return found


def _entries(folder: Path) -> list[Path]:
    with suppress(OSError):  # of another user, or its process has ended
        return list(folder.iterdir())
    return []


def _is_for_writing(information: Path) -> bool:
    text = information.read_text(encoding="ascii")
    flags = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)["flags"]
    return int(flags, 8) & (os.O_WRONLY | os.O_RDWR) != 0
