"""Opening of regular files only, and writing of a file whole or not at all."""

from __future__ import annotations

import glob
import os
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedReader
from pathlib import Path

from ballscrew.base.errors import InputError

Progress = Callable[[int, int, str], None]
"""Called with the number of parts that are done, the number of all parts, and the name of the last one."""


def ignore_progress(done: int, total: int, name: str) -> None:
    """Report no progress."""


WINDOWS = os.name == "nt"
# Pauses in s before a file is moved again that another program holds, as a virus scanner does on Windows.
_PAUSES = (0.05, 0.1, 0.2, 0.4, 0.8)
_ABANDONED = 24 * 3600.0  # s; the longest command takes minutes


def open_regular(path: str | Path, *, links: bool = True) -> BufferedReader:
    """Open a file to read it; a pipe, device or folder is refused without waiting for it.

    Parameters
    ----------
    path : path-like
        The file.
    links : bool
        Whether a symbolic link is followed.

    Returns
    -------
    BufferedReader
        The open file.

    Raises
    ------
    InputError
        If it cannot be read or is no regular file.
    """
    path = Path(path)
    try:
        if not links and path.is_symlink():
            raise InputError(f"{path}: is a link; give the file that it leads to.")
        flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
        if not links:
            flags |= getattr(os, "O_NOFOLLOW", 0)
        if not path.is_file() and path.exists():  # opening a device may already act on it
            raise InputError(f"{path}: cannot be read (it is {_kind(path.stat().st_mode)}).")
        stream = os.fdopen(os.open(path, flags), "rb")
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            stream.close()
            raise InputError(f"{path}: is no regular file.")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from None
    except ValueError as error:  # a NUL in the path
        raise InputError(f"{path}: cannot be read ({error}).") from None
    return stream


def regular_target(path: str | Path) -> Path:
    """Path of a regular file, or of the one that a symbolic link leads to.

    Parameters
    ----------
    path : path-like
        The file or link.

    Returns
    -------
    Path
        The same path where it is no link.

    Raises
    ------
    InputError
        If it cannot be read, is no regular file, or leads in a circle.
    """
    path = Path(path)
    try:
        if path.is_symlink():
            path = path.resolve(strict=True)
    except (OSError, RuntimeError, ValueError):  # a circle is a RuntimeError up to Python 3.12
        raise InputError(f"{path}: is a link that leads to no file.") from None
    open_regular(path, links=False).close()
    return path


def read_whole(path: str | Path, most: int | None = None, *, links: bool = True) -> bytes:
    """Read a regular file whole.

    Parameters
    ----------
    path : path-like
        The file.
    most : int, optional
        Largest size, bytes.
    links : bool
        Whether a symbolic link is followed.

    Returns
    -------
    bytes
        Its content.

    Raises
    ------
    InputError
        If it cannot be read, is no regular file, is larger, or grows while it is read.
    """
    with open_regular(path, links=links) as stream:
        size = os.fstat(stream.fileno()).st_size
        if most is not None and size > most:
            raise InputError(f"{path}: has {size} bytes; a file of this kind has at most {most}.")
        try:
            content = stream.read(size + 1)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from None
    if len(content) != size:
        raise InputError(f"{path}: changed while it was read.")
    return content


def decode(content: bytes) -> str:
    """Text of a file in UTF-8, or in UTF-16 with a mark, as PowerShell writes what is redirected to a file.

    Raises
    ------
    UnicodeDecodeError
        If it is neither.
    """
    is_utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    return content.decode("utf-16" if is_utf_16 else "utf-8-sig")


def sweep(folder: Path, pattern: str) -> None:
    """Remove temporary files and folders that a killed process left a day ago or more.

    Parameters
    ----------
    folder : Path
        Where they lie.
    pattern : str
        Their names, for :meth:`pathlib.Path.glob`.
    """
    latest = time.time() - _ABANDONED
    for path in folder.glob(pattern):
        with suppress(OSError):  # another process may remove it at the same time
            if path.is_symlink() or path.stat().st_mtime > latest:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device or socket"


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Path of a temporary file that replaces ``path`` when the block ends without an error.

    The temporary file lies in the same folder and has the same suffix; it is flushed to the disk before it
    takes the place of ``path``. After an error ``path`` is as it was.

    Parameters
    ----------
    path : path-like
        The file to write; replaced if it exists. Of a symbolic link, the file that it leads to.

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
        if path.is_symlink():
            path = path.resolve()
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is {_kind(path.stat().st_mode)}; give the name of a file.")
        sweep(path.parent, f".{glob.escape(path.stem[:40])}-????????{glob.escape(path.suffix)}")
        temporary = _new_file(path)
        yield temporary
        _flush(temporary)
        _copy_mode(path, temporary)
        move_file(temporary, path)
        sync_folder(path.parent)
    except OSError as error:
        reason = "there is no such folder, or it is read-only"
        if error.errno:  # HDF5 puts several lines into strerror
            reason = os.strerror(error.errno)
        raise InputError(f"{path}: cannot be written ({reason}).") from None
    except ValueError as error:  # a NUL in the path, or a character that the encoding lacks
        raise InputError(f"{str(path)!r}: cannot be written ({error}).") from None
    except RuntimeError:  # of Python before 3.13
        if not path.is_symlink():
            raise
        raise InputError(f"{path}: is a link that leads in a circle.") from None
    finally:
        if temporary is not None:
            with suppress(OSError):  # an earlier error is the one to report
                temporary.unlink(missing_ok=True)


def check_folder(path: Path) -> None:
    """Check before the work that a file can be written after it.

    Raises
    ------
    InputError
        If it is a folder, or its folder does not exist.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path}: cannot be written: it is a folder; name a file in it.")
        if not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written: make the folder {path.parent} first.")
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: cannot be written: it is {_kind(path.stat().st_mode)}.")
    except OSError as error:  # of a name that is too long
        raise InputError(f"{path}: cannot be written ({error.strerror or error}).") from None


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


def move_file(source: Path, target: Path) -> None:
    """Move a file or folder to a place on the same disk, where it replaces a file.

    On Windows it is moved again for 1.5 s if another program holds either of them.

    Raises
    ------
    OSError
        If it cannot be moved.
    """
    for pause in _PAUSES if WINDOWS else ():
        try:
            source.replace(target)
        except PermissionError:
            time.sleep(pause)
        else:
            return
    source.replace(target)


def _new_file(path: Path) -> Path:
    """Empty file beside ``path``; tempfile would try without end in a folder that Windows protects."""
    while True:
        new = path.with_name(f".{path.stem[:40]}-{secrets.token_hex(4)}{path.suffix}")
        with suppress(FileExistsError):
            os.close(os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))
            return new


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable where it can be opened; Windows has no such call."""
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
