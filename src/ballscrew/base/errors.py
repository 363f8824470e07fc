"""The tree of errors, and the exit status that each one ends a command with.

A message is one sentence that says what is wrong, where, what was given and what is allowed.
"""

from __future__ import annotations

import re
from typing import Any

DONE = 0
REFUSED = 1
WRONG_INPUT = 2
WATCH = 3
ALARM = 4
UNASSESSED = 5
SPOOLED = 75

_LONGEST = 80
# Controls of terminals, ends of lines, directions of writing: a name in a file may contain any.
_CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


class BallscrewError(Exception):
    """Any error that this package raises on purpose.

    Attributes
    ----------
    exit_status : int
        What a command that ends with this error returns to the shell.
    """

    exit_status: int = WRONG_INPUT

    def __init__(self, message: str = "") -> None:
        super().__init__(printable(message))


class InputError(BallscrewError):
    """The command, a setting or a file is wrong; exit status 2."""

    exit_status = WRONG_INPUT


class InterruptedReadError(InputError):
    """The process that reads a file was ended from outside: the file may be as it should, try again."""


class MeasurementError(BallscrewError):
    """The measurement is bad and was refused; exit status 1."""

    exit_status = REFUSED


def printable(text: str) -> str:
    """Escape what a terminal would obey: control characters, ends of lines, directions of writing.

    Parameters
    ----------
    text : str
        Text that may contain names from a file.

    Returns
    -------
    str
        The same on one line, with the escapes of a Python string.
    """
    return _CONTROLS.sub(_escape, text)


def _escape(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode("ascii")


def shown(given: object) -> str:
    """Show what was given in a message, cut short: a file may hold a megabyte where a number belongs.

    Parameters
    ----------
    given : object
        The value that was found.

    Returns
    -------
    str
        Its text, 80 characters at most.
    """
    try:
        text = repr(given)
    except ValueError:  # a whole number of more digits than Python will print
        return f"a whole number of {given.__sizeof__()} bytes"
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def field_error(source: object, field: str, given: Any, allowed: str) -> InputError:
    """Say which field of which file holds an impossible value.

    Parameters
    ----------
    source : object
        The file (or what stands in its place) that was read.
    field : str
        The field, with its table: ``"screw.lead"``.
    given : object
        The value that was found; ``None`` where the field is missing.
    allowed : str
        What would have been right, in words.

    Returns
    -------
    InputError
        To be raised by the caller.
    """
    found = "is missing" if given is None else f"is {shown(given)}"
    return InputError(f"{source}: {field} {found}; it must be {allowed}.")
