"""The command line as a process: exit status of every kind of error."""

from __future__ import annotations

import errno
import io
import os
import platform
import signal
import sys
import tempfile
import threading
import traceback
from contextlib import suppress
from typing import Any

import typer

from ballscrew._version import __version__
from ballscrew.base.errors import WRONG_INPUT, BallscrewError
from ballscrew.cli.app import app

UNEXPECTED = 70
INTERRUPTED = 130
BROKEN_PIPE = 141

_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_COMPLETION = "_BALLSCREW_COMPLETE"


def run(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments : list of str, optional
        Without the program's name; by default those of the process.

    Returns
    -------
    int
        0 done, 1 refused, 2 the command or a file is wrong, 70 unexpected error, 75 not sent yet, 130
        interrupted, 141 the reader of the output has closed it; 3 to 5 with ``--exit-code``.
    """
    _prepare_streams()
    interrupts = _record_interrupts() if arguments is None else []
    try:
        status = _status(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        interrupts.append(signal.SIGINT)
        status = INTERRUPTED
    except OSError as error:
        status = _output_status(error)
    except Exception as error:  # noqa: BLE001  whatever it is, the user reads a sentence
        _complain(_report(error))
        status = UNEXPECTED
    if interrupts or status == INTERRUPTED:  # a callback of a compiled library may swallow an interrupt
        _complain("interrupted.")
        return INTERRUPTED
    return status


def _status(arguments: list[str] | None) -> int:
    """Exit status of a command; raises only what is no error of its own."""
    given = sys.argv[1:] if arguments is None else arguments
    if not given:
        arguments = ["--help"]
    stdout, stderr = sys.stdout, sys.stderr
    try:
        # With None instead of the arguments of the process, wildcards are expanded on Windows.
        result: Any = app(args=arguments, prog_name="ballscrew", standalone_mode=False)
    except BallscrewError as error:
        _complain(str(error))
        return error.exit_status
    except typer.Abort:
        return INTERRUPTED
    except typer.TyperException as error:  # a command, option or value that does not exist
        _complain(f"{_words(error)} Try: {_command(error)} --help")
        return WRONG_INPUT
    except typer.Exit as leave:
        return int(leave.exit_code)
    except SystemExit as leave:
        sys.stdout, sys.stderr = stdout, stderr  # typer has replaced them
        if _COMPLETION in os.environ:
            return int(leave.code or 0)
        raise BrokenPipeError from None  # for which typer and rich leave
    return int(result or 0)


def _prepare_streams() -> None:
    """Make the output printable: a process may have no stream, or one whose code page lacks a character."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, io.StringIO())
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _record_interrupts() -> list[int]:
    """List to which every interrupt of the process is added, besides raising KeyboardInterrupt."""
    interrupts: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    is_main = threading.current_thread() is threading.main_thread()
    if is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    return interrupts


def _output_status(error: OSError) -> int:
    """Status of an error of the standard output; any other is unexpected."""
    windows_pipe = os.name == "nt" and error.errno == errno.EINVAL and error.filename is None
    if isinstance(error, BrokenPipeError) or windows_pipe:
        _discard_output()
        return BROKEN_PIPE
    if error.errno in _FULL:
        _discard_output()
        where = error.filename or "the output"
        _complain(f"{where} cannot be written ({error.strerror}).")
        return WRONG_INPUT
    if error.errno == errno.ENAMETOOLONG:
        _complain(f"{error.filename}: the name is too long for a file.")
        return WRONG_INPUT
    _complain(_report(error))
    return UNEXPECTED


def _discard_output() -> None:
    """Send what is still to be printed nowhere, or Python would fail to print it when it ends."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _report(error: Exception) -> str:
    """Write a report of an unexpected error, and return the sentence about it."""
    cause = f"{type(error).__name__}: {error}".splitlines()[0][:200].rstrip(": .")
    system = f"ballscrew {__version__}, Python {platform.python_version()}, {platform.platform()}"
    text = f"{system}\n{' '.join(sys.argv[1:])}\n\n{''.join(traceback.format_exception(error))}"
    try:
        handle, name = tempfile.mkstemp(prefix="ballscrew-report-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="replace") as stream:
            stream.write(text)
    except OSError:
        return f"unexpected error ({cause}), and no report could be written."
    return f"unexpected error ({cause}): this is a bug; please report it with the file {name}."


def _words(error: typer.TyperException) -> str:
    """Message of typer as one sentence."""
    message = error.format_message() if hasattr(error, "format_message") else error
    text = " ".join(str(message).split())
    return text if text.endswith((".", "?")) else f"{text}."


def _command(error: typer.TyperException) -> str:
    """Words that call the command whose options are wrong."""
    context = getattr(error, "ctx", None)
    if context is None:
        return "ballscrew"
    return str(context.command_path)


def _complain(message: str) -> None:
    with suppress(OSError):
        sys.stderr.write(f"ballscrew: {message}\n")
