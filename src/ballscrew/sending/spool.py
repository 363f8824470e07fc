"""Spool on the disk: runs that wait for the server, each whole or absent, and a log of what was sent.

``queue/ID`` is a run with its files, named by their hashes, and a manifest; it is renamed into place whole.
``rejected/ID`` is a run that the server refused, with its answer. ``sent.jsonl`` has a line for each run that
the server acknowledged.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.base.files import move_file, open_regular, sweep, sync_folder, write_text
from ballscrew.base.locks import try_lock, unlock
from ballscrew.sending.outgoing import OutgoingRun
from ballscrew.sending.spooled import SpooledRun, Version, copy_run, identify, now, read_manifest, version_of

_BLOCK = 1 << 20
_MANIFEST = "manifest.json"
_INCOMING = ".incoming-"
_ID_LENGTH = 32
_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))


class FullSpoolError(InputError):
    """A run does not fit into the spool now; it stays where it is."""


class Spool:
    """Spool of the runs for one server.

    Parameters
    ----------
    folder : Path
        Created where it does not exist.
    limit : float
        Largest size, bytes.

    Raises
    ------
    InputError
        If the folder cannot be created or read.
    """

    def __init__(self, folder: Path, limit: float) -> None:
        self.folder = folder
        self.limit = limit
        self.queue = folder / "queue"
        self.rejected = folder / "rejected"
        self._log = folder / "sent.jsonl"
        self._lock = folder / "spool.lock"
        try:
            for each in (self.queue, self.rejected):
                each.mkdir(mode=0o700, parents=True, exist_ok=True)
            sweep(self.queue, f"{_INCOMING}*")
            self._sent, self._hashes = self._read_log()
        except OSError as error:
            raise InputError(f"{folder}: cannot be the spool ({error.strerror or error}).") from None
        for place in (self.queue, self.rejected):
            for folder_of_run in _folders(place):
                with suppress(InputError):
                    self._learn(read_manifest(folder_of_run))

    def _read_log(self) -> tuple[set[str], dict[Version, str]]:
        """Ids of runs that were sent, and hashes of versions of files."""
        ids: set[str] = set()
        hashes: dict[Version, str] = {}
        if not self._log.exists():
            return ids, hashes
        for line in self._log.read_text(encoding="utf-8", errors="replace").splitlines():
            with suppress(ValueError, KeyError, TypeError):  # a line that a power loss has cut
                row = json.loads(line)
                hashes |= {(path, size, time): sha for path, size, time, sha in row["files"]}
                ids.add(row["id"])
        return ids, hashes

    def _learn(self, run: SpooledRun) -> None:
        for version, file in zip(run.versions, run.uploads, strict=True):
            self._hashes[version] = file.sha256

    def state(self, identity: str) -> str:
        """``"queued"``, ``"rejected"``, ``"sent"``, or an empty text where the content is not known."""
        if (self.queue / identity).exists():
            return "queued"
        if (self.rejected / identity).exists():
            return "rejected"
        return "sent" if identity in self._sent else ""

    def known_state(self, run: OutgoingRun, key: str | None = None) -> str:
        """State of a run whose files have not changed since they were read; they are not read again."""
        try:
            hashes = [self._hashes.get(version_of(path)) for path in run.paths]
        except OSError:
            return ""
        known = [each for each in hashes if each is not None]
        if len(known) < len(hashes):
            return ""
        return self.state(identify(run, known, key)[1])

    def size(self) -> int:
        """Bytes of all files in the spool."""
        total = 0
        for path in self.folder.rglob("*"):
            with suppress(OSError):  # another process may remove it
                if path.is_file():
                    total += path.stat().st_size
        return total

    def put(
        self, run: OutgoingRun, *, key: str | None = None, links: bool = True, again: bool = True
    ) -> SpooledRun | None:
        """Copy a run into the spool: whole, or not at all.

        Parameters
        ----------
        run : OutgoingRun
            The user's files, which stay as they are.
        key : str, optional
            Of the run at the server; by default a hash of the content.
        links : bool
            Whether symbolic links are followed.
        again : bool
            Whether a run that was sent or rejected before is sent again.

        Returns
        -------
        SpooledRun or None
            None where it was sent or rejected before and is not sent again.

        Raises
        ------
        FullSpoolError
            If it does not fit now.
        InputError
            If a file cannot be read or changes meanwhile, or the spool cannot be written.
        """
        try:
            self._check_size(run, links=links)
            incoming = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=self.queue))
            try:
                spooled = copy_run(run, incoming, key, links=links)
                self._learn(spooled)
                if not again and self.state(spooled.id):
                    return None
                self._move_into_queue(incoming, spooled)
            finally:
                shutil.rmtree(incoming, ignore_errors=True)
        except OSError as error:
            if error.errno in _FULL:
                raise FullSpoolError(f"{run.name}: the disk of the spool is full; it stays there.") from None
            raise InputError(f"{run.name}: cannot be spooled ({error.strerror or error}).") from None
        return spooled

    def _check_size(self, run: OutgoingRun, *, links: bool) -> None:
        size = 0
        for path in run.paths:
            with open_regular(path, links=links) as stream:
                size += os.fstat(stream.fileno()).st_size
        limit = f"the limit of the spool, {self.limit / 1e9:g} GB"
        if size > self.limit:
            raise InputError(f"{run.name}: has {size / 1e9:.3g} GB, more than {limit} (--spool-limit).")
        if self.size() + size > self.limit:
            where = ""
            if _folders(self.rejected):
                where = f" {self.rejected} contains runs that the server refused."
            raise FullSpoolError(f"{run.name}: stays there, since {limit}, is reached.{where}")

    def _move_into_queue(self, incoming: Path, run: SpooledRun) -> None:
        try:
            move_file(incoming, run.folder)
        except OSError:
            if not run.folder.exists():
                raise  # else another process has spooled the same
        sync_folder(self.queue)

    def _discard(self, folder: Path) -> None:
        """Remove a folder in one step: it is never there in part."""
        if folder.exists():
            trash = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=self.queue))
            move_file(folder, trash / folder.name)
            shutil.rmtree(trash, ignore_errors=True)

    @contextmanager
    def sending(self) -> Iterator[bool]:
        """Hold the lock of the spool while its runs are sent; False where another process sends them."""
        with self._lock.open("a+", encoding="utf-8") as stream:
            locked = try_lock(stream)
            try:
                yield locked
            finally:
                if locked:
                    unlock(stream)

    def runs(self, complain: Callable[[str], None]) -> list[SpooledRun]:
        """Runs in the order in which they were spooled; damaged ones are rejected. Needs the lock."""
        found = []
        for folder in _folders(self.queue):
            try:
                found.append(read_manifest(folder))
            except InputError as error:
                place = self.reject(folder, str(error))
                complain(f"{error} (its copy is in {place})")
        return sorted(found, key=_spooled_at)

    def waiting(self) -> int:
        """Number of runs that were not sent."""
        return len(_folders(self.queue))

    def names(self) -> list[str]:
        """Names of the runs that were not sent; of a damaged one its id."""
        found = []
        for folder in _folders(self.queue):
            found.append(folder.name)
            with suppress(InputError):
                found[-1] = read_manifest(folder).name
        return found

    def finish(self, run: SpooledRun) -> None:
        """Remember that a run was sent, then remove it from the spool."""
        rows = []
        for version, file in zip(run.versions, run.uploads, strict=True):
            rows.append([*version, file.sha256])
        entry = {"id": run.id, "axis": run.axis, "run": run.key, "at": now(), "files": rows}
        with self._log.open("ab") as stream:
            stream.write(f"\n{json.dumps(entry)}\n".encode())  # an earlier line may have been cut
            stream.flush()
            os.fsync(stream.fileno())
        self._sent.add(run.id)
        self._discard(run.folder)
        self._discard(self.rejected / run.id)

    def reject(self, folder: Path, answer: str) -> Path:
        """Move a run out of the queue, with the answer of the server as a text file.

        Parameters
        ----------
        folder : Path
            Of the run.
        answer : str
            Why.

        Returns
        -------
        Path
            Its folder now.
        """
        target = self.rejected / folder.name
        write_text(folder / "answer.txt", answer + "\n")
        self._discard(target)
        move_file(folder, target)
        sync_folder(self.rejected)
        sync_folder(self.queue)
        return target


def _spooled_at(run: SpooledRun) -> tuple[str, str]:
    return run.spooled_at, run.id


def _folders(place: Path) -> list[Path]:
    return [path for path in sorted(place.iterdir()) if not path.name.startswith(".") and path.is_dir()]
