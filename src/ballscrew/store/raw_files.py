"""Raw files by the hash of their content: written once, whole or not at all, never changed."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import zstandard

from ballscrew.base.errors import InputError
from ballscrew.base.files import move_file, open_regular, sync_folder

_BLOCK = 1 << 20
_SAMPLE = 1 << 16  # bytes of a file that are compressed to see whether it pays
_LEAST_GAIN = 0.9  # compressed over plain size of the sample, from which on a file is stored as it is
_LEVEL = 3  # of zstd: 300 MB/s
INCOMING = ".incoming-"
"""Beginning of the names of files that are being written."""


class ChangedFileError(InputError):
    """A file has another content than its hash states."""


@dataclass(frozen=True, slots=True)
class StoredFile:
    """A raw file as it was stored.

    Parameters
    ----------
    sha256 : str
        Of its content.
    size, stored_size : int
        Bytes of the content, and on the disk.
    compression : str
        ``zstd`` or ``none``.
    """

    sha256: str
    size: int
    stored_size: int
    compression: str


def path_of(folder: Path, sha256: str, compression: str) -> Path:
    """Path of a raw file in the folder of raw files."""
    suffix = ".zst" if compression == "zstd" else ""
    return folder / sha256[:2] / f"{sha256}{suffix}"


def put_file(folder: Path, source: Path, sha256: str) -> StoredFile:
    """Copy a file into the folder of raw files, durably, under the hash of its content.

    Hash while reading, temporary file in the same file system, fsync, rename, fsync of the folder. After an
    error there is no file of that name.

    Parameters
    ----------
    folder : Path
        Folder of raw files.
    source : Path
        The file.
    sha256 : str
        Hash that its content must have.

    Returns
    -------
    StoredFile
        Its sizes.

    Raises
    ------
    ChangedFileError
        If it has another content.
    InputError
        If it cannot be read or written; its cause is the error of the system.
    """
    handle, name = -1, ""
    try:
        with open_regular(source) as stream:
            handle, name = tempfile.mkstemp(prefix=INCOMING, dir=folder)
            with os.fdopen(handle, "wb") as target:
                found, size, compression = _copy(stream, target)
                target.flush()
                Path(name).chmod(0o644)  # who may read the folder may read its files
                os.fsync(target.fileno())  # an error is final: the kernel has dropped the data
        if found != sha256:
            raise ChangedFileError(f"{source}: has changed since it was analysed; nothing was added.")
        final = path_of(folder, found, compression)
        if not final.parent.is_dir():
            final.parent.mkdir(exist_ok=True)
            sync_folder(folder)
        stored_size = Path(name).stat().st_size
        move_file(Path(name), final)
        sync_folder(final.parent)
    except OSError as error:
        raise InputError(f"{source}: cannot be stored ({error.strerror or error}).") from error
    finally:
        if name:
            Path(name).unlink(missing_ok=True)
    return StoredFile(found, size, stored_size, compression)


def _copy(stream: BinaryIO, target: BinaryIO) -> tuple[str, int, str]:
    """Copy, compressed where it pays; hash of the content, its size, and the compression."""
    digest, size = hashlib.sha256(), 0
    block = stream.read(_BLOCK)
    compressor = zstandard.ZstdCompressor(level=_LEVEL, write_checksum=True)
    compression = "none"
    writer = None
    middle = len(block) // 2  # a recording begins with a header and a standstill
    sample = block[middle : middle + _SAMPLE]
    if len(compressor.compress(sample)) < _LEAST_GAIN * len(sample):
        compression = "zstd"
        writer = compressor.stream_writer(target, closefd=False)
    while block:
        digest.update(block)
        size += len(block)
        (writer or target).write(block)
        block = stream.read(_BLOCK)
    if writer is not None:
        writer.close()  # type: ignore[no-untyped-call]
    return digest.hexdigest(), size, compression


def clone_file(source: Path, folder: Path, sha256: str, compression: str) -> None:
    """Copy a stored file as it is into another folder of raw files, durably, and verify its content.

    Parameters
    ----------
    source : Path
        The stored file.
    folder : Path
        The other folder.
    sha256, compression : str
        As it was stored.

    Raises
    ------
    InputError
        If its content is not that of its hash, or it cannot be copied.
    """
    final = path_of(folder, sha256, compression)
    handle, name = -1, ""
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        with open_regular(source) as stream:
            handle, name = tempfile.mkstemp(prefix=INCOMING, dir=folder)
            with os.fdopen(handle, "wb") as target:
                shutil.copyfileobj(stream, target, _BLOCK)
                target.flush()
                Path(name).chmod(0o644)
                os.fsync(target.fileno())
        if hash_of(Path(name), compression) != sha256:
            raise InputError(f"{source}: the content is not that of its hash: it is damaged.")
        move_file(Path(name), final)
        sync_folder(final.parent)
        sync_folder(folder)
    except OSError as error:
        raise InputError(f"{source}: cannot be copied ({error.strerror or error}).") from None
    finally:
        if name:
            Path(name).unlink(missing_ok=True)


def read_blocks(path: Path, compression: str) -> Iterator[bytes]:
    """Content of a raw file.

    Parameters
    ----------
    path : Path
        Of the stored file.
    compression : str
        ``zstd`` or ``none``.

    Yields
    ------
    bytes
        A block.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with open_regular(path) as stream:
            reader: BinaryIO = stream
            if compression == "zstd":
                reader = zstandard.ZstdDecompressor().stream_reader(stream, read_across_frames=True)
            while block := reader.read(_BLOCK):
                yield block
    except (OSError, zstandard.ZstdError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from None


def copy_out(path: Path, compression: str, target: Path, sha256: str) -> None:
    """Write the content of a raw file to a path, and check its hash.

    Raises
    ------
    InputError
        If its content has another hash.
    """
    digest = hashlib.sha256()
    with target.open("wb") as stream:
        for block in read_blocks(path, compression):
            digest.update(block)
            stream.write(block)
    if digest.hexdigest() != sha256:
        raise InputError(f"{path}: the content of the file is not that of its hash: it is damaged.")


def hash_of(path: Path, compression: str) -> str:
    """Hash of the content of a raw file."""
    digest = hashlib.sha256()
    for block in read_blocks(path, compression):
        digest.update(block)
    return digest.hexdigest()


def make_folder(path: Path) -> None:
    """Create a folder and those above it, durably."""
    missing = [each for each in (path, *path.parents) if not each.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for each in missing:
        sync_folder(each.parent)


@contextmanager
def materialised(
    folder: Path, files: list[tuple[str, str, str]], into: Path | None = None
) -> Iterator[list[Path]]:
    """Raw files under their names, each in a folder of its own, as long as the block lasts.

    Parameters
    ----------
    folder : Path
        Folder of raw files.
    files : list of (name, sha256, compression)
        Which.
    into : Path, optional
        Folder for the temporary ones.

    Yields
    ------
    list of Path
        As many.
    """
    with tempfile.TemporaryDirectory(prefix="ballscrew-", dir=into) as temporary:
        paths = []
        for number, (name, sha256, compression) in enumerate(files):
            place = Path(temporary) / f"{number:03d}"
            place.mkdir()
            target = place / (Path(name).name or "recording")  # a name from a file may lead elsewhere
            copy_out(path_of(folder, sha256, compression), compression, target, sha256)
            paths.append(target)
        yield paths


@contextmanager
def text_files(texts: Mapping[str, str | None]) -> Iterator[dict[str, Path]]:
    """Texts as files ``KIND.toml``, as long as the block lasts; messages contain their names without folder.

    Parameters
    ----------
    texts : mapping of str to str or None
        Text by kind; None is left out.

    Yields
    ------
    dict of str to Path
        Path by kind.

    Raises
    ------
    InputError
        If a text is not valid Unicode.
    """
    with tempfile.TemporaryDirectory(prefix="ballscrew-") as folder:
        paths = {}
        try:
            for kind, text in texts.items():
                if text is not None:
                    paths[kind] = Path(folder) / f"{kind}.toml"
                    paths[kind].write_text(text, encoding="utf-8", newline="")
            yield paths
        except UnicodeEncodeError:
            raise InputError("a text is not valid Unicode.") from None
        except InputError as error:
            raise type(error)(str(error).replace(f"{folder}/", "").replace(f"{folder}\\", "")) from None
