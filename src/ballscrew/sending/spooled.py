"""A run in the spool: a folder with copies of its files, by their hashes, and a manifest."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from ballscrew.base.errors import InputError
from ballscrew.base.files import move_file, open_regular, sync_folder
from ballscrew.base.provenance import digest
from ballscrew.sending.outgoing import OutgoingRun

_BLOCK = 1 << 20
_MANIFEST = "manifest.json"
_ID_LENGTH = 32

# Path, size in bytes and time of change in ns of a file: the same version has the same content.
Version = tuple[str, int, int]


@dataclass(frozen=True)
class SpooledFile:
    """A file in the spool.

    Parameters
    ----------
    name : str
        Without folder.
    sha256 : str
        Of its content.
    size : int
        Bytes.
    """

    name: str
    sha256: str
    size: int


@dataclass(frozen=True)
class SpooledRun:
    """A run in the spool.

    Parameters
    ----------
    folder : Path
        Of its files; its name is the id of the content.
    name, axis, run_toml, measured_at
        As in :class:`~ballscrew.sending.outgoing.OutgoingRun`.
    key : str
        Of the run at the server.
    files : tuple of SpooledFile
        Recordings.
    run_json : SpooledFile or None
        Result of an analysis at the machine.
    versions : tuple of (str, int, int)
        Path, size in bytes and time of change in ns of the user's files, in the same order, RUN.json last.
    spooled_at : str
        ISO 8601.
    """

    folder: Path
    name: str
    axis: str
    key: str
    files: tuple[SpooledFile, ...]
    run_toml: str | None
    run_json: SpooledFile | None
    measured_at: str | None
    versions: tuple[Version, ...]
    spooled_at: str

    @property
    def uploads(self) -> tuple[SpooledFile, ...]:
        """All files to send."""
        if self.run_json is None:
            return self.files
        return (*self.files, self.run_json)

    @property
    def id(self) -> str:
        """Id of the content."""
        return self.folder.name


def now() -> str:
    """Time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def version_of(path: Path) -> Version:
    """Version of a file of the user."""
    state = path.stat()
    return _text(str(path.absolute())), state.st_size, state.st_mtime_ns


def _text(name: str) -> str:
    """Name of a file in UTF-8, which the bytes of a name need not be."""
    return name.encode("utf-8", "replace").decode("utf-8")


def identify(run: OutgoingRun, hashes: Sequence[str], key: str | None) -> tuple[str, str]:
    """Key of a run, and id of its content with the key."""
    content = {
        "axis": run.axis,
        "files": hashes,
        "run_toml": run.run_toml,
        "analysed": run.run_json is not None,
        "measured_at": run.measured_at,
    }
    key = key or digest(content)[:_ID_LENGTH]
    return key, digest(content | {"run": key})[:_ID_LENGTH]


def copy_run(run: OutgoingRun, incoming: Path, key: str | None, *, links: bool) -> SpooledRun:
    """Copy the files of a run into a folder, durably, and write their manifest there."""
    files, versions = [], []
    for path, name in zip(run.paths, _names(run), strict=True):
        versions.append(version_of(path))
        files.append(_copy_file(path, name, incoming, links=links))
        if version_of(path) != versions[-1] or files[-1].size != versions[-1][1]:
            raise InputError(f"{path}: changed while it was read; send it when it is complete.")
    key, identity = identify(run, [file.sha256 for file in files], key)
    spooled = SpooledRun(
        folder=incoming.parent / identity,
        name=_text(run.name),
        axis=run.axis,
        key=key,
        files=tuple(files[: len(run.files)]),
        run_toml=run.run_toml,
        run_json=files[-1] if run.run_json else None,
        measured_at=run.measured_at,
        versions=tuple(versions),
        spooled_at=now(),
    )
    document = asdict(spooled)
    del document["folder"]
    with (incoming / _MANIFEST).open("w", encoding="ascii") as stream:
        json.dump(document, stream, indent=1)
        stream.flush()
        os.fsync(stream.fileno())
    sync_folder(incoming)
    return spooled


def _names(run: OutgoingRun) -> list[str]:
    """Names of the files; numbered where two have the same and no RUN.toml refers to them."""
    names = [_text(path.name) for path in run.paths]
    if run.run_toml is None and len(set(names)) < len(names):
        names = [f"{number:02d}-{name}" for number, name in enumerate(names, 1)]
    return names


def _copy_file(path: Path, name: str, folder: Path, *, links: bool) -> SpooledFile:
    """Copy a file durably under the hash of its content."""
    with open_regular(path, links=links) as stream:
        temporary = folder / "incoming"
        with temporary.open("wb") as target:
            sha256, size = _copy_blocks(stream, target)
            target.flush()
            os.fsync(target.fileno())
    move_file(temporary, folder / sha256)
    return SpooledFile(name, sha256, size)


def _copy_blocks(stream: BinaryIO, target: BinaryIO) -> tuple[str, int]:
    found, size = hashlib.sha256(), 0
    while block := stream.read(_BLOCK):
        found.update(block)
        size += len(block)
        target.write(block)
    return found.hexdigest(), size


def read_manifest(folder: Path) -> SpooledRun:
    """Run of a folder in the spool.

    Raises
    ------
    InputError
        If the manifest is damaged.
    """
    try:
        document: dict[str, Any] = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        document["files"] = tuple(SpooledFile(**file) for file in document["files"])
        document["versions"] = tuple((path, size, time) for path, size, time in document["versions"])
        if document["run_json"] is not None:
            document["run_json"] = SpooledFile(**document["run_json"])
        return SpooledRun(folder=folder, **document)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{folder / _MANIFEST}: the manifest is damaged ({error}).") from None
