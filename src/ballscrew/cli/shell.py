"""The command line as a process: exit status of every kind of error."""

from __future__ import annotations

import io
import sys
from typing import Any

import typer

from ballscrew.base.errors import REFUSED, WRONG_INPUT, BallscrewError
from ballscrew.cli.app import app

INTERRUPTED = 130


def run(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments : list of str, optional
        Without the program's name; by default those of the process.

    Returns
    -------
    int
        0 done, 1 refused, 2 the command or a file is wrong, 130 interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # The code page of a console may lack a character: print a replacement and go on.
            stream.reconfigure(errors="replace")
    try:
        given = sys.argv[1:] if arguments is None else arguments
        if not given:
            arguments = ["--help"]
        # With None instead of the arguments of the process, wildcards are expanded on Windows.
        result: Any = app(args=arguments, standalone_mode=False)
    except BallscrewError as error:
        _complain(str(error))
        return error.exit_status
    except typer.Abort:
        _complain("interrupted.")
        return INTERRUPTED
    except typer.TyperException as error:  # a command, option or value that does not exist
        _complain(f"{_words(error)} Try: ballscrew --help")
        return WRONG_INPUT
    except typer.Exit as leave:
        return int(leave.exit_code)
    except BrokenPipeError:  # the reader of a pipe has closed it
        sys.stderr.close()
        return REFUSED
    return int(result or 0)


def _words(error: typer.TyperException) -> str:
    """Message of typer as one sentence."""
    message = error.format_message() if hasattr(error, "format_message") else error
    return " ".join(str(message).split()).rstrip(".") + "."


def _complain(message: str) -> None:
    sys.stderr.write(f"ballscrew: {message}\n")
