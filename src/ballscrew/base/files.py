"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ballscrew.base.errors import InputError

Progress = Callable[[int, int, str], None]
"""Called with the number of parts that are done, the number of all parts, and the name of the last one."""


def ignore_progress(done: int, total: int, name: str) -> None:
    """Report no progress."""


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Path of a temporary file that replaces ``path`` when the block ends without an error.

    The temporary file lies in the same folder and has the same suffix; it is flushed to the disk before it
    takes the place of ``path``. After an error ``path`` is as it was.

    Parameters
    ----------
    path : path-like
        The file to write; replaced if it exists.

    Yields
    ------
    Path
        The temporary file, empty.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    path = Path(path)
    temporary = None
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder; give the name of a file.")
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        _flush(temporary)
        _copy_mode(path, temporary)
        temporary.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        reason = error.strerror or "there is no such folder, or it is read-only"
        raise InputError(f"{path}: cannot be written ({reason}).") from None
    except ValueError as error:  # a NUL in the path, or a character that the encoding lacks
        raise InputError(f"{str(path)!r}: cannot be written ({error}).") from None
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file with Unix line ends, whole or not at all.

    Parameters
    ----------
    path : path-like
        The file; replaced if it exists.
    text : str
        Its content.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_texts(files: Iterable[tuple[Path, Iterable[str]]]) -> None:
    """Write several ASCII text files: either all of them replace the files of their names, or none does.

    Parameters
    ----------
    files : iterable of (path, texts)
        What to write where; the texts are written one after the other as they come.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    with ExitStack() as complete:
        for path, texts in files:
            temporary = complete.enter_context(replacing(path))
            with temporary.open("w", encoding="ascii", newline="\n") as stream:
                stream.writelines(texts)


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Make the new name durable where a folder can be opened; Windows has no such call."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _copy_mode(path: Path, temporary: Path) -> None:
    """Permissions of the file that is replaced, else those of any new file."""
    if path.exists():
        temporary.chmod(path.stat().st_mode & 0o777)
        return
    mask = os.umask(0)
    os.umask(mask)
    temporary.chmod(0o666 & ~mask)
