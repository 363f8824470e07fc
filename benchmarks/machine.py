"""What a table was measured on, and the lines that go above it."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime

__all__ = ["heading"]


def heading(command: str) -> str:
    """Command, date and the machine's size, as every table of the docs has them.

    Parameters
    ----------
    command : str
        What makes the table.

    Returns
    -------
    str
        One line.
    """
    cores = os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count()
    day = datetime.now(tz=UTC).date().isoformat()
    return f"`{command}`, {day}, {platform.machine()}, {cores} cores, Python {platform.python_version()}"
