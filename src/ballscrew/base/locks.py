"""Lock of a file between processes, which ends with the process that holds it."""

from __future__ import annotations

import os
from typing import IO

_LOCKED_BYTE = 1 << 30  # behind the text, which must stay readable on Windows


def try_lock(stream: IO[str]) -> bool:
    """Lock an open file; False where another process has locked it.

    Parameters
    ----------
    stream : file
        Open for writing. Closing it unlocks it.

    Returns
    -------
    bool
        Whether it is locked by this process now.
    """
    try:
        if os.name == "nt":
            import msvcrt

            stream.seek(_LOCKED_BYTE)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def unlock(stream: IO[str]) -> None:
    """Unlock a file before it is closed, which Windows needs."""
    if os.name == "nt":
        import msvcrt

        stream.seek(_LOCKED_BYTE)
        msvcrt.locking(stream.fileno(), msvcrt.LK_UNLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    # Elsewhere the lock ends with the file.
