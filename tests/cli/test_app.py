from __future__ import annotations

import errno
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from ballscrew import __version__
from ballscrew.base.errors import BallscrewError, InputError, MeasurementError
from ballscrew.cli.app import app
from ballscrew.cli.shell import run
from ballscrew.recording.readers.process import IN_PROCESS

COMMANDS = [
    "amend", "analyze", "calibrate", "demo", "frf", "init", "monitor", "plan", "preload", "quality",
    "report", "reprocess", "reproduce", "send", "serve", "simulate multi-level-mass", "simulate run",
    "simulate run-to-failure",
    "store add", "store archive", "store backup", "store correct", "store exclude", "store export",
    "store gc", "store init", "store list", "store migrate", "store restore", "store retain", "store show",
    "store simulate-fleet", "store verify", "token create", "token list", "token revoke",
    "user add", "user disable", "user link", "user list", "user role", "watch",
]  # fmt: skip


def process(*arguments, cwd=None, **environment):
    """The real thing: a process of its own."""
    return subprocess.run(  # noqa: S603
        [sys.executable, "-m", "ballscrew", *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        timeout=600,
        cwd=cwd,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "utf-8", **environment},
    )


def one_sentence(err):
    return err.startswith("ballscrew: ") and err.count("\n") == 1 and "Traceback" not in err


def plain(text):
    """Without colours and line breaks."""
    return re.sub(r"\s+", " ", re.sub(r"\x1b\[[0-9;]*m", "", text))


@pytest.mark.parametrize("flag", ["--version", "-V"])
def test_the_version(ballscrew, flag):
    outcome = ballscrew(flag)
    assert (outcome.status, outcome.out, outcome.err) == (0, f"ballscrew {__version__}\n", "")


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_names_every_command(ballscrew, flag):
    outcome = ballscrew(flag)
    assert outcome.status == 0
    for command in COMMANDS:
        assert command.split()[0] in outcome.out
    assert "Exit status: 0 done; 1 bad measurement, refused; 2" in plain(outcome.out)


def commands():
    """Name to command; those of a group by both names."""
    found = {}
    for name, command in typer.main.get_command(app).commands.items():
        inner = getattr(command, "commands", None)
        found |= {f"{name} {more}": one for more, one in inner.items()} if inner else {name: command}
    return found


def test_the_commands_are_these():
    assert set(commands()) == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_mentions_every_option(ballscrew, command):
    outcome = ballscrew(*command.split(), "--help")
    assert (outcome.status, outcome.err) == (0, "")
    for parameter in commands()[command].params:
        if parameter.param_type_name == "option" and parameter.name != "help":
            assert parameter.help, f"{parameter.name} says nothing of itself"
            for name in parameter.opts:
                assert name in outcome.out
    assert f"Example: ballscrew {command}" in plain(outcome.out)


def test_no_help_names_a_python_type_or_promises_json_in_place_of_a_table_that_is_not_printed(ballscrew):
    for command in ["", *COMMANDS]:
        out = ballscrew(*command.split(), "--help").out
        assert not re.search(r"<\w|\{(?!axis|run|trip)", out)  # fields of the pattern of `send` are no types
        assert "instead of a table" not in plain(out)
        if command == "serve":
            words = re.sub(r"[│\s]+", " ", plain(out))
            assert "With --check, print the settings as JSON" in words


def test_completion(monkeypatch, capsys):
    monkeypatch.setenv("_BALLSCREW_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "ballscrew moni")
    monkeypatch.setenv("COMP_CWORD", "1")
    assert run([]) == 0
    assert capsys.readouterr().out.split() == ["monitor"]


def test_without_arguments_the_help_is_shown(ballscrew):
    outcome = ballscrew()
    assert "analyze" in outcome.out + outcome.err
    assert outcome.status in (0, 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["analyse", "a.h5"], "analyse"),
        (["analyze"], "argument"),
        (["analyze", "a.h5", "--chanels", "c.toml"], "--chanels"),
        (["analyze", "a.h5", "--band", "50"], "--band"),
        (["analyze", "a.h5", "--band", "low", "high"], "--band"),
        (["analyze", "a.h5", "--mass"], "--mass"),
        (["quality"], "argument"),
        (["quality", "a.h5", "--method", "paper"], "--method"),
        (["init"], "argument"),
    ],
)
def test_a_wrong_command_is_one_sentence(ballscrew, arguments, message):
    result = ballscrew(*arguments)
    assert (result.status, result.out) == (2, "")
    assert one_sentence(result.err), result.err
    assert message.lower() in result.err.lower()


def test_interrupted(monkeypatch, capsys):
    for error in (KeyboardInterrupt, typer.Abort):

        def interrupt(*_, error=error, **__):
            raise error

        monkeypatch.setattr("ballscrew.cli.analyze.quality_command", interrupt)
        assert run(["quality", "a.h5"]) == 130
        outcome = capsys.readouterr()
        assert (outcome.out, outcome.err) == ("", "ballscrew: interrupted.\n")


def test_an_interrupt_outside_of_a_command(monkeypatch, capsys):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("ballscrew.cli.shell._status", interrupt)
    assert run(["quality", "a.h5"]) == 130
    outcome = capsys.readouterr()
    assert (outcome.out, outcome.err) == ("", "ballscrew: interrupted.\n")


def test_a_process_without_a_standard_output(rig, monkeypatch, capsys):
    """As one has that a Windows program without a console starts."""
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", None)
        patched.setattr(sys, "stderr", None)
        assert run(["--version"]) == 0
        assert sys.stdout.getvalue() == f"ballscrew {__version__}\n"
        assert run(["quality", str(rig / "none.h5")]) == 2
        assert "none.h5" in sys.stderr.getvalue()
    assert capsys.readouterr() == ("", "")


def test_recordings_are_read_in_this_process_on_request(ballscrew, monkeypatch):
    monkeypatch.setenv(IN_PROCESS, "")
    assert ballscrew("--in-process", "--version").status == 0
    assert os.environ[IN_PROCESS] == "1"


def ending(code, **streams):
    """Process that runs ``ballscrew quality a.h5``, whose module is replaced by one with ``code``."""
    text = f"""
import os, signal, sys, tempfile, types
from ballscrew.__main__ import main
def command(*_, **__):
    {code}
commands = types.ModuleType("ballscrew.cli.analyze")
commands.quality_command = command
sys.modules[commands.__name__] = commands
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a background process may ignore
sys.argv = ["ballscrew", "quality", "a.h5"]
main()
"""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
    return subprocess.run(  # noqa: S603
        [sys.executable, "-c", text], text=True, timeout=600, check=False, **options
    )


def test_an_interrupt_that_a_callback_swallows():
    code = "try: signal.raise_signal(signal.SIGINT)\n    except KeyboardInterrupt: return 0"
    outcome = ending(code)
    assert (outcome.returncode, outcome.stdout) == (130, "")
    assert outcome.stderr == "ballscrew: interrupted.\n"


def test_a_closed_pipe():
    for code in ("print('x' * 9_000_000)", "from ballscrew.cli.output import console; console().print('x')"):
        reading, writing = os.pipe()
        os.close(reading)
        try:
            outcome = ending(code, stdout=writing)
        finally:
            os.close(writing)
        assert (outcome.returncode, outcome.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_the_output():
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        outcome = ending("print('x')", stdout=full)
    assert outcome.returncode == 2
    assert one_sentence(outcome.stderr), outcome.stderr
    assert "No space left" in outcome.stderr


def test_an_unexpected_error_is_a_sentence_and_a_report(monkeypatch, capsys, tmp_path):
    def fail(*_, **__):
        raise ZeroDivisionError("by\nnothing")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("ballscrew.cli.analyze.quality_command", fail)
    assert run(["quality", "a.h5"]) == 70
    outcome = capsys.readouterr()
    (report,) = tmp_path.iterdir()
    assert outcome.out == ""
    assert one_sentence(outcome.err)
    assert f"(ZeroDivisionError: by): this is a bug; please report it with the file {report}." in outcome.err
    assert "Traceback" in report.read_text(encoding="utf-8")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    assert run(["quality", "a.h5"]) == 70
    assert "no report could be written" in capsys.readouterr().err


def test_an_error_of_the_system_that_no_command_expects_is_reported(monkeypatch, capsys, tmp_path):
    def fail(*_, **__):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("ballscrew.cli.analyze.quality_command", fail)
    assert run(["quality", "a.h5"]) == 70
    outcome = capsys.readouterr()
    assert outcome.out == ""
    assert one_sentence(outcome.err)
    assert f"(OSError: [Errno {errno.EIO}] Input/output error): this is a bug" in outcome.err
    assert len(list(tmp_path.iterdir())) == 1


def test_every_error_has_its_status(monkeypatch, capsys):
    for error, status in ((InputError, 2), (MeasurementError, 1), (BallscrewError, 2)):

        def fail(*_, error=error, **__):
            raise error("this is why.")

        monkeypatch.setattr("ballscrew.cli.analyze.quality_command", fail)
        assert run(["quality", "a.h5"]) == status
        assert capsys.readouterr().err == "ballscrew: this is why.\n"


def test_a_process_of_its_own(rig):
    version = process("--version")
    assert (version.returncode, version.stdout, version.stderr) == (0, f"ballscrew {__version__}\n", "")
    bad = process("quality", "bad.h5", "--channels", "channels.toml", cwd=rig)
    assert bad.returncode == 1
    assert bad.stdout.startswith("bad")
    assert "NaN" in bad.stderr
    assert "Traceback" not in bad.stderr
    wrong = process("analyze", "none.h5", "--channels", "channels.toml", cwd=rig)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert one_sentence(wrong.stderr)


def in_encoding(monkeypatch, encoding, *arguments):
    """Exit status and output of a command whose streams cannot encode every sign, in this process."""
    streams = {name: io.TextIOWrapper(io.BytesIO(), encoding=encoding) for name in ("stdout", "stderr")}
    with monkeypatch.context() as patched:
        for name, stream in streams.items():
            patched.setattr(sys, name, stream)
        status = run([str(argument) for argument in arguments])
        for stream in streams.values():
            stream.flush()
    return status, streams["stdout"].buffer.getvalue().decode(encoding)


@pytest.mark.parametrize(
    ("encoding", "arguments", "status", "printed"),
    [
        ("cp1252", ["analyze", "run.toml", "--method", "paper"], 0, "synthetic"),
        ("cp1252", ["quality", "bad.h5", "--channels", "channels.toml"], 1, "bad"),
        ("ascii", ["analyze", "run.toml", "--method", "paper", "--json"], 0, "{"),
    ],
)
def test_a_console_of_another_code_page(rig, monkeypatch, encoding, arguments, status, printed):
    """A Windows console in its old code page cannot print every sign: it must not end in a traceback."""
    monkeypatch.chdir(rig)
    found, out = in_encoding(monkeypatch, encoding, *arguments)
    assert found == status
    assert out.startswith(printed)
    out.encode(encoding)
