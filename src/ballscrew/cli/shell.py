"""The command line as a process: what each error means to the shell."""

from __future__ import annotations

import io
import sys
from typing import Any

import typer

from ballscrew.base.errors import REFUSED, WRONG_INPUT, BallscrewError
from ballscrew.cli.app import app

__all__ = ["run"]

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
        if isinstance(
            stream, io.TextIOWrapper
        ):  # a console's code page may lack a sign; that is no reason to stop
            stream.reconfigure(errors="replace")
    try:
        # None, and not the process's own arguments: only then does Windows get trip*.h5 expanded.
        nothing = not (sys.argv[1:] if arguments is None else arguments)
        result: Any = app(args=["--help"] if nothing else arguments, standalone_mode=False)
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
    except BrokenPipeError:  # the reader of a pipe has gone: its affair
        sys.stderr.close()
        return REFUSED
    return int(result or 0)


def _words(error: typer.TyperException) -> str:
    """What typer says, as one sentence."""
    say = getattr(error, "format_message", lambda: str(error))
    return " ".join(str(say()).split()).rstrip(".") + "."


def _complain(message: str) -> None:
    sys.stderr.write(f"ballscrew: {message}\n")
