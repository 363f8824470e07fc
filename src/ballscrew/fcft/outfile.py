"""Text files that are written whole or not at all: half a program must never lie on a machine."""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from pathlib import Path

from ballscrew.base.errors import InputError

__all__ = ["dry_run_path", "write_whole"]


def write_whole(files: Iterable[tuple[Path, Iterable[str]]]) -> None:
    """Write text files; no name is taken before all are complete, and a file of that name is replaced.

    Parameters
    ----------
    files : iterable of (path, texts)
        What to write where; the texts are written one after the other as they come, in ASCII.

    Raises
    ------
    InputError
        If a file cannot be written; then none is left behind half done.
    """
    complete: list[tuple[Path, Path]] = []
    path = Path()
    try:
        for path, texts in files:
            if path.is_dir():
                raise InputError(f"{path}: is a folder; it must be the name of a file.")
            temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
            with temporary.open("x", encoding="ascii", newline="\n") as stream:
                complete.append((temporary, path))
                stream.writelines(texts)
        for temporary, path in complete:
            temporary.replace(path)
    except OSError as error:
        reason = error.strerror or "there is no such folder, or it is read-only"
        raise InputError(f"{path}: cannot be written ({reason}).") from None
    except ValueError as error:  # a NUL in the path, or no name in it
        raise InputError(f"{str(path)!r}: cannot be written ({error}).") from None
    finally:
        for temporary, _ in complete:
            temporary.unlink(missing_ok=True)


def dry_run_path(path: Path) -> Path:
    """Where the dry run of a program is written: NAME-dry-run.SUFFIX beside it."""
    return path.with_name(f"{path.stem}-dry-run{path.suffix}")
