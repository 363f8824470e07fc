"""What is left of a file when its writer is killed, or the disk is full?  Every command that writes.

    python -m benchmarks.interruptions [--random 200] [--long 15] [--only PART,PART] [--page PAGE]

Each command writes over older files, and again where there are none. At its first change of the folder its
process forks; each copy goes on alone and is killed before one of its calls that creates, opens, flushes,
renames or removes a file or changes its mode, or by the kernel within writing after a number of bytes; or the
disk is full (a tmpfs, where one may be mounted). ``calibrate`` is also killed at random moments between that
change and its end; ``demo`` and ``reproduce``, which take minutes, are killed at random moments alone, over
older files. Afterwards each file must be the old or the new one, byte by byte, and no other may have
changed; temporary files of killed processes are swept a day later. It needs a system that can fork.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import bilinear, lfilter

import ballscrew
from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.jsonfile import write_json
from ballscrew.cli.shell import run
from ballscrew.fcft.planfile import plan_toml
from ballscrew.testbed.example import AXIS, PLAN
from benchmarks.identification_tables import write
from benchmarks.machine import heading

_CHANGES = ("os.rename", "os.remove", "os.chmod", "os.mkdir", "os.rmdir", "os.fsync")
_BYTES = (0, 1, 100, 1000, 4096, 20_000)
_SECONDS = 300  # of one copy; a longer one hangs
State = dict[str, bytes]


@dataclass(frozen=True)
class Command:
    """A command line, the files that it writes into its folder, and whether it reads older ones of them."""

    line: str
    outputs: tuple[str, ...]
    reads_older: bool = False

    @property
    def name(self) -> str:
        """First word, and the option that makes it another command."""
        command = self.line.split()[0]
        marks = [word for word in ("--optimize", "--plot", "--spectra", "--export") if word in self.line]
        marks += [self.outputs[0]] if command == "report" else []
        return " ".join([command, *marks])


_TOML = ("axis.toml", "plan.toml", "channels.toml", "run.toml")
_PLAN = "plan day-0/plan.toml --axis day-0/axis.toml"
COMMANDS = (
    Command("calibrate day-0/run.json load/run.json --axis day-0/axis.toml --out m.json", ("m.json",)),
    Command("amend load/run.json --measured-at 2026-02-01T08:00Z --out amended.json", ("amended.json",)),
    Command("init day-0/trip001.h5 --out . --force", _TOML),
    Command(
        f"{_PLAN} --gcode test.nc --csv test.csv --plot plan.png",
        ("test.nc", "test-dry-run.nc", "test.csv", "plan.png"),
    ),
    Command(f"{_PLAN} --optimize --out best.toml", ("best.toml",)),
    Command("analyze day-0/run.toml --plot run.png", ("run.png",)),
    Command("analyze day-0/run.toml --spectra run.h5", ("run.h5",)),
    Command("analyze day-0/run.toml --export run.csv", ("run.csv",)),
    Command(
        "frf noise.csv --input torque --output speed --quantities torque speed --position 200mm "
        "--plot frf.png --export frf.csv",
        ("frf.png", "frf.csv"),
    ),
    Command("report --data ../../store --out fleet.html", ("fleet.html",)),
    Command("report --data ../../store --out fleet.pdf", ("fleet.pdf",)),
    Command("preload day-2/run.json --model model.json --baseline day-0/run.json --plot p.pdf", ("p.pdf",)),
    Command(
        "monitor day-0/run.json day-1/run.json day-2/run.json --model model.json --plot m.png", ("m.png",)
    ),
    Command(
        "watch . --model model.json",
        ("day-0/run.preload.json", "day-1/run.preload.json", "day-2/run.preload.json", "axis.html"),
        reads_older=True,
    ),
    Command(
        "simulate run day-0/small.toml --axis day-0/axis.toml --out made",
        tuple(f"made/{name}" for name in ("trip001.h5", *_TOML, "truth.json")),
    ),
)  # fmt: skip

LONG = (Command("demo --out made", ()), Command("reproduce --quick --out made", ()))
"""Commands whose files are known after their end."""


def prepare(folder: Path) -> None:
    """Analysed runs of three days, one at another load, a model, and preloads under other assumptions."""
    plans = {
        "plan": replace(PLAN, positions=PLAN.positions[::3], repetitions=2),
        "small": replace(PLAN, positions=PLAN.positions[:2], repetitions=1),
    }
    for name, plan in plans.items():
        (folder / f"{name}.toml").write_text(plan_toml(plan), encoding="utf-8")
    (folder / "axis.toml").write_text(axis_toml(AXIS), encoding="utf-8")
    for seed, name in enumerate(("day-0", "day-1", "day-2", "load")):
        load = "10 kg" if name == "load" else None
        files = ballscrew.simulate(
            folder / "plan.toml", axis=folder / "axis.toml", out=folder / name, mass=load, seed=seed
        )
        with files.run.open("a", encoding="utf-8") as stream:
            stream.write(f'measured_at = 2026-01-{seed + 5:02d}T08:00:00Z\ntemperature = "21 degC"\n')
        result = write_json(ballscrew.analyze(files.run).to_json())
        files.run.with_suffix(".json").write_text(f"{result}\n", encoding="utf-8")
        if name != "day-0":  # not analysed again
            for path in files.recordings:
                path.unlink()
    (folder / "small.toml").rename(folder / "day-0" / "small.toml")
    (folder / "load" / "run.toml").unlink()
    for line in (
        "calibrate day-0/run.json load/run.json --axis axis.toml --out model.json",
        "watch . --model model.json --bearing-drift 0.05",  # others than the benchmark's
    ):
        assert run_in(folder, line) == 0, line
    (folder / "axis.toml").unlink()
    (folder / "plan.toml").unlink()
    _write_noise(folder / "noise.csv")
    for line in ("store init ../../store", "store add day-0/run.json model.json --store ../../store"):
        assert run_in(folder, line) == 0, line


def _write_noise(path: Path) -> None:
    """Torque and speed of an axis with a mode that is excited by noise."""
    rate, count = 2000.0, 40_000
    torque = np.random.default_rng(0).standard_normal(count)
    numerator, denominator = bilinear([900.0], [1.0, 30.0, (2 * np.pi * 150) ** 2], rate)
    speed = np.cumsum(torque) / rate + np.gradient(lfilter(numerator, denominator, torque), 1 / rate)
    table = np.column_stack([np.arange(count) / rate, torque, speed])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header="time,torque,speed", comments="")


def run_in(folder: Path, line: str) -> int:
    """Run a command in a folder without its output."""
    os.chdir(folder)
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        own, sys.stdout = sys.stdout, nowhere
        try:
            return run(line.split())
        finally:
            sys.stdout = own


def contents(folder: Path) -> State:
    """Every file of a folder and its bytes."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def restore(folder: Path, state: State) -> None:
    """Give a folder the files that it had."""
    now = contents(folder)
    for name in now.keys() - state.keys():
        (folder / name).unlink()
    for name, content in state.items():
        if now.get(name) != content:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)


def temporary_of(name: str) -> str:
    """Name of a temporary file of an output."""
    path = Path(name)
    return path.with_name(f".{path.stem}-12345678{path.suffix}").as_posix()


def leave_old_files(folder: Path, outputs: Iterable[str]) -> None:
    """A temporary file of each output, a day old and more."""
    for name in outputs:
        left = folder / temporary_of(name)
        left.parent.mkdir(exist_ok=True)
        left.write_bytes(b"half")
        os.utime(left, (0, 0))


class Interruptions:
    """Forks one copy of this process for each ending, at the first change of a folder.

    Parameters
    ----------
    folder : Path
        The folder; the disk on which it lies has no other files.
    outputs : sequence of str
        Files that are written.
    report : Path
        File for the endings, on another disk.
    number : int
        How many copies are killed at random moments.
    fillable : bool
        Whether the disk can be filled.
    """

    def __init__(
        self, folder: Path, outputs: Sequence[str], report: Path, number: int, *, fillable: bool
    ) -> None:
        self.folder, self.outputs, self.report = folder, outputs, report
        self.number, self.fillable = number, fillable
        leave_old_files(self.folder, self.outputs)
        self.start = contents(folder)
        self.endings: list[dict[str, Any]] = []
        self.is_copy = self.is_busy = False
        self.calls, self.last = 0, -1
        self.new: dict[str, bytes | None] = {}

    def install(self) -> None:
        """Watch the calls of this process; flushing has no audit event of its own."""
        flush = os.fsync

        def audited_fsync(handle: int) -> None:
            sys.audit("os.fsync", str(self.folder))
            flush(handle)

        os.fsync = audited_fsync  # type: ignore[assignment]
        sys.addaudithook(self._before_call)

    def _before_call(self, event: str, given: tuple[Any, ...]) -> None:
        if self.is_busy or not self._is_change(event, given):
            return
        self.is_busy = True
        if not self.is_copy:
            self._fork_each()
        self.is_busy = False
        if self.calls == self.last:
            os.kill(os.getpid(), signal.SIGKILL)
        self.calls += 1

    def _is_change(self, event: str, given: tuple[Any, ...]) -> bool:
        if event == "open":
            if not isinstance(given[2], int) or not given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                return False
        elif event not in _CHANGES:
            return False
        paths = [os.fsdecode(each) for each in given if isinstance(each, str | bytes | Path)]
        return any((self.folder / path).is_relative_to(self.folder) for path in paths)

    def _fork_each(self) -> None:
        """Every ending in turn, each from the same state; returns in the copies only."""
        for kind, at in self._kinds():
            restore(self.folder, self.start)
            leave_old_files(self.folder, self.outputs)
            if kind == "full disk":
                for name in self.outputs:  # whose removal would make space
                    (self.folder / temporary_of(name)).unlink()
                _fill(self._filler)
            begin = time.monotonic()
            process = os.fork()
            if process == 0:
                self._begin_copy(kind, at)
                return
            if kind == "random":
                time.sleep(at)
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            _, status = os.waitpid(process, 0)
            self._filler.unlink(missing_ok=True)
            self._note(kind, os.waitstatus_to_exitcode(status), time.monotonic() - begin)
        self.report.write_text(json.dumps(self.endings), encoding="utf-8")
        os._exit(0)

    @property
    def _filler(self) -> Path:
        return self.folder.parent / "filler"

    def _kinds(self) -> Iterator[tuple[str, float]]:
        yield "whole", -1
        span = self.endings[-1]["seconds"]
        number = 0
        while number == 0 or self.endings[-1]["status"] == -signal.SIGKILL:
            yield "call", number
            number += 1
        self.endings.pop()  # it was not killed, but ended
        for size in _BYTES:
            yield "bytes", size
        if self.fillable:
            yield "full disk", 0
        choice = random.Random(0)  # noqa: S311  moments, no secrets
        for _ in range(self.number):
            yield "random", choice.uniform(0, 1.1 * span)

    def _begin_copy(self, kind: str, at: float) -> None:
        self.is_copy, self.calls = True, 0
        self.last = int(at) if kind == "call" else -1
        signal.alarm(_SECONDS)
        with self._errors.open("w") as stream:
            os.dup2(stream.fileno(), 2)
        if kind == "bytes":
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores it
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_FSIZE, (int(at), int(at)))

    @property
    def _errors(self) -> Path:
        return self.report.with_suffix(".err")

    def _note(self, kind: str, status: int, seconds: float) -> None:
        """What is there now: outputs old or new, and whatever else has changed."""
        now = contents(self.folder)
        if kind == "whole":
            self.new = {name: now.get(name) for name in self.outputs}
        states = {}
        for name in self.outputs:
            states[name] = "third"
            if now.get(name) == self.new[name]:
                states[name] = "new"
            if now.get(name) == self.start.get(name):
                states[name] = "old"
        touched = {name for name in now.keys() | self.start.keys() if now.get(name) != self.start.get(name)}
        left = {name for name in now if Path(name).name.startswith(".")}
        others = touched - left - {*self.outputs, *map(temporary_of, self.outputs)}
        self.endings.append(
            {
                "kind": kind, "status": status, "seconds": seconds, "states": states, "left": sorted(left),
                "others": sorted(others), "error": self._errors.read_text(encoding="utf-8"),
            }
        )  # fmt: skip


def _fill(path: Path) -> None:
    """Fill the disk to its last byte."""
    with suppress(OSError), path.open("wb", buffering=0) as stream:
        while True:
            stream.write(bytes(4096))


def examine(
    command: Command, folder: Path, scratch: Path, number: int, *, fillable: bool
) -> list[dict[str, Any]]:
    """Endings of one command, over older files and where there are none."""
    start = contents(folder)
    endings = []
    for is_older in (True, False):
        for name in command.outputs:
            path = folder / name
            path.parent.mkdir(exist_ok=True)
            if not is_older:
                path.unlink(missing_ok=True)
            elif not command.reads_older:
                path.write_bytes(b"an older file\n")
        report = scratch / "report.json"
        report.unlink(missing_ok=True)
        process = os.fork()
        if process == 0:
            times = number if is_older and command.name == "calibrate" else 0
            Interruptions(folder, command.outputs, report, times, fillable=fillable).install()
            os._exit(run_in(folder, command.line))
        os.waitpid(process, 0)
        endings += json.loads(report.read_text(encoding="utf-8"))
        restore(folder, start)
    return endings


def examine_long(command: Command, scratch: Path, number: int) -> tuple[Command, list[dict[str, Any]]]:
    """The command with its files, and endings of it at random moments, over older files."""
    folder = scratch / "long"
    folder.mkdir(exist_ok=True)
    begin = time.monotonic()
    assert _start(command.line, folder).wait() == 0, command.line
    span, new = time.monotonic() - begin, contents(folder)
    assert new, command.line
    old = dict.fromkeys(new, b"an older file\n")
    moments = random.Random(0)  # noqa: S311  no secrets
    endings: list[dict[str, Any]] = []
    while len(endings) < number:
        restore(folder, old)
        process = _start(command.line, folder)
        time.sleep(moments.uniform(0, span))
        process.kill()
        if process.wait() == -signal.SIGKILL:  # else it had ended
            endings.append(_ending_of("random", contents(folder), old, new))
    restore(folder, old)
    leave_old_files(folder, new)
    status = _start(command.line, folder).wait()
    endings.append(_ending_of("whole", contents(folder), old, new) | {"status": status})
    shutil.rmtree(folder)
    return replace(command, outputs=tuple(new)), endings


def _start(line: str, folder: Path) -> subprocess.Popen[bytes]:
    words = [sys.executable, "-m", "ballscrew", *line.split()]
    return subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603


def _ending_of(kind: str, now: State, old: State, new: State) -> dict[str, Any]:
    """What is there after an end: files old or new, and temporary ones and recordings beside them."""
    states = {}
    for name in new:
        states[name] = "third"
        if now.get(name) == new[name]:
            states[name] = "new"
        if now.get(name) == old[name]:
            states[name] = "old"
    left = {name for name in now if Path(name).name.startswith(".") or "recordings-" in name}
    return {
        "kind": kind, "status": -signal.SIGKILL, "states": states, "left": sorted(left),
        "others": sorted(now.keys() - new.keys() - left), "error": "",
    }  # fmt: skip


_COLUMNS = (
    "command", "files", "kills before a call", "while writing", "at random", "file old", "new", "neither",
    "others changed", "status, full disk", "swept",
)  # fmt: skip


def row(command: Command, endings: Sequence[dict[str, Any]]) -> str:
    """Line of the table."""
    killed = [each for each in endings if each["kind"] in ("call", "bytes", "random", "full disk")]
    kinds = Counter(each["kind"] for each in endings)
    states = Counter(state for each in killed for state in each["states"].values())
    full = sorted({str(each["status"]) for each in endings if each["kind"] == "full disk"})
    is_swept = not any(each["left"] for each in endings if each["kind"] == "whole")
    cells = [
        f"`{command.name}`", len(command.outputs), kinds["call"], kinds["bytes"], kinds["random"],
        states["old"], states["new"], states["third"], sum(len(each["others"]) for each in endings),
        ", ".join(full) or "not tried", "yes" if is_swept else "no",
    ]  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def faults(command: Command, endings: Sequence[dict[str, Any]]) -> list[str]:
    """Endings that should not be."""
    found = []
    for each in endings:
        sentences = each["error"].splitlines()
        is_bad = each["others"] or "third" in each["states"].values()
        if each["kind"] == "full disk":
            is_bad = is_bad or each["status"] != 2 or len(sentences) != 1
        if each["kind"] == "whole":
            is_bad = is_bad or each["status"] not in (0, 1) or bool(each["left"])
        if is_bad:
            found.append(f"{command.name}: {each}")
    return found


@contextmanager
def disk(scratch: Path) -> Iterator[tuple[Path, bool]]:
    """Folder on a small disk of its own where one may be mounted, else a plain one; and which it is."""
    place = scratch / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=96m", "tmpfs", str(place)]
    is_mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0  # noqa: S603  as it is
    folder = place / "axis"
    folder.mkdir()
    try:
        yield folder, is_mounted
    finally:
        os.chdir(scratch)
        if is_mounted:
            subprocess.run(["umount", str(place)], check=True)  # noqa: S603, S607  as above


def main() -> None:
    """Interrupt each command and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--random", type=int, default=200, help="kills of calibrate at random moments")
    parser.add_argument("--long", type=int, default=15, help="kills of each command that takes minutes")
    parser.add_argument("--only", default="", help="parts of names")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    page = None if given.page is None else given.page.resolve()
    lines = [
        heading("python -m benchmarks.interruptions"),
        "",
        f"| {' | '.join(_COLUMNS)} |",
        "|---" * len(_COLUMNS) + "|",
    ]
    wrong = []
    os.environ["SOURCE_DATE_EPOCH"] = "1767600000"  # reports state the minute, which passes meanwhile
    with tempfile.TemporaryDirectory() as name, disk(Path(name)) as (folder, fillable):
        prepare(folder)
        for command in COMMANDS:
            if any(part in command.name for part in given.only.split(",")):
                endings = examine(command, folder, Path(name), given.random, fillable=fillable)
                lines.append(row(command, endings))
                print(lines[-1], flush=True)
                wrong += faults(command, endings)
        for command in LONG:
            if any(part in command.name for part in given.only.split(",")):
                command, endings = examine_long(command, Path(name), given.long)
                lines.append(row(command, endings))
                print(lines[-1], flush=True)
                wrong += faults(command, endings)
    print("\n".join(["", *lines, *wrong]))
    if page is not None:
        write(page, "interruptions", lines)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
