"""Loss of power at every moment of what writes to a store with SQLite, by a record of its system calls.

``python -m benchmarks.store_power_loss`` records writes, fsyncs, renames and removals with strace and repeats
them up to each of them in three ways: without whatever was not synced, neither content nor names; with all
names, but without content that was not synced; and with everything, which is a kill. Each resulting folder
must be a store without a fault, and after the last call contain what was acknowledged.

``--flips N`` changes single bytes of a store's files instead, and counts what ``verify`` finds.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.store import adding
from ballscrew.store.adding import add, add_run
from ballscrew.store.checking import gc, verify
from ballscrew.store.copying import archive, backup
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.reprocessing import reprocess
from ballscrew.store.service_tables import all_tables
from ballscrew.store.tables import RunRow
from benchmarks.store_kills import (
    add_stand_ins,
    later_migrations,
    made_run,
    migrated_copy,
    verify_schema,
    write_recordings,
)

CALLS = (
    "openat,open,creat,write,pwrite64,fsync,fdatasync,rename,renameat,renameat2,unlink,unlinkat,ftruncate,"
    "mkdir,mkdirat,rmdir"
)
KINDS = ("init", "add a result", "add recordings", "reprocess", "backup", "archive", "gc", "migrate")
_NO_FSYNC = "BALLSCREW_NO_FSYNC"
_TEXT = r'"((?:\\x[0-9a-f]{2})*)"'


def act(kind: str, folder: Path) -> None:
    """Do what is recorded."""
    add_stand_ins()
    if _NO_FSYNC in os.environ:
        setattr(os, "fsync", lambda _: None)  # noqa: B010  mypy
    path = folder / "store"
    actions: dict[str, Callable[[], object]] = {
        "init": lambda: create_store(folder / "new"),
        "add a result": lambda: add_run(OpenStore(path), made_run(100)),
        "add recordings": lambda: add(OpenStore(path), folder / "recordings" / "run.toml"),
        "backup": lambda: backup(OpenStore(path), folder / "backup"),
        "archive": lambda: archive(OpenStore(path), "axis", folder / "archive", newest=0),
        "gc": lambda: gc(OpenStore(path)),
        "migrate": lambda: migrated_copy(path, folder),
    }
    if kind == "reprocess":
        adding.METHOD_REVISION = 2
        reprocess(OpenStore(path))
    else:
        actions[kind]()


def prepare(folder: Path) -> None:
    """A store with results, recordings and an orphan, and recordings to be added."""
    add_stand_ins()
    store = create_store(folder / "store")
    chance = random.Random(0)  # noqa: S311
    for number in range(3):
        add_run(store, made_run(number))
    add(store, write_recordings(folder / "run", 50, chance))
    write_recordings(folder / "recordings", 51, chance)
    later_migrations(folder)
    (folder / "store" / "files" / ".incoming-x").write_bytes(b"orphan")


@dataclass(eq=False)
class Inode:
    """Content of a file, as written and as synced."""

    content: bytearray
    synced: bytes


@dataclass
class Disk:
    """Files by path, as the system shows them and as they would be after a loss of power."""

    names: dict[str, Inode] = field(default_factory=dict)
    durable: dict[str, Inode] = field(default_factory=dict)
    folders: set[str] = field(default_factory=set)
    durable_folders: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, folder: Path) -> Disk:
        """What is in a folder, all of it durable."""
        disk = cls()
        for path in (folder, *folder.rglob("*")):
            if path.is_dir():
                disk.folders.add(str(path))
            else:
                disk.names[str(path)] = Inode(bytearray(path.read_bytes()), path.read_bytes())
        disk.durable, disk.durable_folders = dict(disk.names), set(disk.folders)
        return disk

    def sync(self, path: str) -> None:
        """Sync a file, or the names in a folder."""
        if path in self.names:
            self.names[path].synced = bytes(self.names[path].content)
            return
        for name in {*self.names, *self.durable}:
            if str(Path(name).parent) == path:
                if name in self.names:
                    self.durable[name] = self.names[name]
                else:
                    del self.durable[name]
        inside = {name for name in self.folders if str(Path(name).parent) == path}
        gone = {name for name in self.durable_folders - self.folders if str(Path(name).parent) == path}
        self.durable_folders = (self.durable_folders | inside) - gone

    def rename(self, old: str, new: str) -> None:
        """Rename a file, or a folder with what is in it."""
        if old in self.names:
            self.names[new] = self.names.pop(old)
            return
        for name in [name for name in self.names if name.startswith(f"{old}/")]:
            self.names[new + name.removeprefix(old)] = self.names.pop(name)
        moved = {name for name in self.folders if name == old or name.startswith(f"{old}/")}
        self.folders = (self.folders - moved) | {new + name.removeprefix(old) for name in moved}
        for name in [name for name in self.durable if name.startswith(f"{old}/")]:
            self.durable[new + name.removeprefix(old)] = self.durable[name]  # durable once the parent is
        self.durable_folders |= {new + name.removeprefix(old) for name in moved & self.durable_folders} - {
            new
        }

    def write_out(self, folder: Path, to: Path, variant: str) -> str:
        """Write what is left to another folder; a digest of it."""
        names = self.durable if variant == "nothing unsynced" else self.names
        folders = self.durable_folders if variant == "nothing unsynced" else self.folders
        digest = hashlib.sha256()
        to.mkdir()
        for name in sorted(folders):
            if name != str(folder) and self._reachable(name, folder, folders):
                (to / Path(name).relative_to(folder)).mkdir(parents=True, exist_ok=True)
                digest.update(name.encode())
        for name, inode in sorted(names.items()):
            if name.endswith("-shm") or not self._reachable(str(Path(name).parent), folder, folders):
                continue
            content = bytes(inode.content) if variant == "a kill" else inode.synced
            (to / Path(name).relative_to(folder)).write_bytes(content)
            digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
        return digest.hexdigest()

    def _reachable(self, name: str, folder: Path, folders: set[str]) -> bool:
        path = Path(name)
        while path != folder:
            if str(path) not in folders:
                return False
            path = path.parent
        return True


def record(kind: str, folder: Path) -> list[tuple[str, list[str]]]:
    """System calls of an action on files in a folder, in order."""
    trace = folder.parent / "trace"
    command = [sys.executable, "-m", "benchmarks.store_power_loss", "--act", kind, "--folder", str(folder)]
    options = ["-f", "-y", "-xx", "-s", "100000000", "-e", f"trace={CALLS}", "-o", str(trace)]
    subprocess.run(["strace", *options, *command], check=True)  # noqa: S603, S607
    calls = []
    with trace.open(encoding="ascii", errors="replace") as stream:
        for line in stream:
            found = re.match(r"\d+ +(\w+)\((.*)\) += (-?\d+)", line)
            if found and int(found[3]) >= 0:
                calls.append((found[1], _arguments(found[2])))
            elif "unfinished" in line and _hexadecimal(str(folder)) in line:
                raise SystemExit("a system call was interrupted by another thread; record again")
    return calls


def _hexadecimal(text: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in text.encode())


def _arguments(text: str) -> list[str]:
    """Arguments of a call: paths of descriptors, texts, numbers."""
    found = re.findall(rf"\d+<((?:\\x[0-9a-f]{{2}})*)>|{_TEXT}|\b(0x[0-9a-f]+|-?\d+|[A-Z_|]+)", text)
    return [next(filter(None, each), "") for each in found]


def _plain(text: str) -> str:
    return bytes.fromhex(text.replace("\\x", "")).decode(errors="replace")


def replay(disk: Disk, calls: list[tuple[str, list[str]]], folder: Path) -> Iterator[str]:
    """Repeat calls on a disk; yields the name of each that changed something."""
    inside = f"{folder}/"
    for name, arguments in calls:
        # A path may follow the folder that it is relative to; all of them are absolute here.
        paths = [_plain(each) for each in arguments if each.startswith("\\x")]
        own = [path for path in paths if (path + "/").startswith(inside)]
        if not own:
            continue
        path = own[0]
        if name in ("openat", "open", "creat"):
            flags = " ".join(arguments)
            if "O_DIRECTORY" in flags or path in disk.folders or "O_CREAT" not in flags + name:
                continue
            inode = disk.names.setdefault(path, Inode(bytearray(), b""))
            if "O_TRUNC" in flags:
                inode.content.clear()
        elif name in ("write", "pwrite64"):
            if path not in disk.names:
                continue
            data = bytes.fromhex(arguments[1].replace("\\x", ""))
            content = disk.names[path].content
            place = len(content)
            if name == "pwrite64":
                place = int(arguments[3])
            content.extend(bytes(max(place - len(content), 0)))
            content[place : place + len(data)] = data
        elif name in ("fsync", "fdatasync"):
            disk.sync(path)
        elif name == "ftruncate" and path in disk.names:
            content, size = disk.names[path].content, int(arguments[1])
            del content[size:]
            content.extend(bytes(size - len(content)))
        elif name.startswith("rename"):
            disk.rename(own[0], own[-1])
        elif name in ("unlink", "unlinkat", "rmdir"):
            disk.names.pop(own[-1], None)
            disk.folders.discard(own[-1])
        elif name in ("mkdir", "mkdirat"):
            disk.folders.add(own[-1])
        yield name


def check(kind: str, folder: Path, *, acknowledged: bool) -> None:
    """Check the promises on what a loss of power left."""
    path = folder / ("new" if kind == "init" else "store")
    if kind == "migrate":
        assert verify_schema(path) in ("0001", "0002")
        if acknowledged:
            assert verify_schema(path) == "0002"
        return
    if kind == "init" and not (path / "store.toml").exists():
        assert not acknowledged
        create_store(path)  # goes on where it was interrupted
    assert verify(path).faults == (), verify(path).faults
    if kind == "backup":
        assert (folder / "backup").exists() or not acknowledged
        if (folder / "backup").exists():
            assert verify(folder / "backup").faults == ()
    if acknowledged and kind.startswith("add"):
        with OpenStore(path).read() as session:
            assert session.query(RunRow).count() == 5
    try:
        gc(OpenStore(path))
    except InputError as error:
        raise AssertionError(str(error)) from error
    assert verify(path).orphans == ()


def lose_power(kind: str, folder: Path) -> tuple[int, int]:
    """Record an action, and check every moment; numbers of calls and of different disks."""
    work = folder / "work"
    work.mkdir()
    prepare(work)
    disk = Disk.of(work)
    calls = record(kind, work)
    states: set[str] = set()
    number = 0
    variants = ("nothing unsynced", "names without content", "a kill")
    for number, _ in enumerate(replay(disk, calls, work), 1):  # noqa: B007
        for variant in variants:
            _check_disk(kind, disk, work, folder / "replayed", variant, states, acknowledged=False)
    assert number, "no call was recorded"
    for variant in variants:
        _check_disk(kind, disk, work, folder / "replayed", variant, set(), acknowledged=True)
    return number, len(states)


def _check_disk(
    kind: str, disk: Disk, work: Path, to: Path, variant: str, known: set[str], *, acknowledged: bool
) -> None:
    shutil.rmtree(to, ignore_errors=True)
    digest = disk.write_out(work, to, variant)
    if digest not in known:
        known.add(digest)
        check(kind, to, acknowledged=acknowledged)


def flip_bytes(folder: Path, flips: int, chance: random.Random) -> Counter[tuple[str, str]]:
    """Change a byte at a random place, again and again; by kind of file, how many ``verify`` finds."""
    prepare(folder)
    path = folder / "store"
    for number in range(200, 300):
        add_run(OpenStore(path), made_run(number))
    gc(OpenStore(path))
    sqlite3.connect(path / "store.sqlite").execute("PRAGMA wal_checkpoint(TRUNCATE)")
    whole = _rows(path)
    raw = [each for each in (path / "files").rglob("*") if each.is_file()]
    outcomes: Counter[tuple[str, str]] = Counter()
    for number in range(flips):
        file = path / "store.sqlite" if number % 2 else chance.choice(raw)
        content = file.read_bytes()
        place = chance.randrange(len(content))
        changed = bytes([content[place] ^ chance.randrange(1, 256)])
        file.write_bytes(content[:place] + changed + content[place + 1 :])
        outcome = "found"
        if not verify(path).faults:
            outcome = (
                "without effect, all rows as before" if number % 2 and _rows(path) == whole else "missed"
            )
        outcomes["database" if number % 2 else "raw file", outcome] += 1
        file.write_bytes(content)
        for rest in ("store.sqlite-wal", "store.sqlite-shm"):
            (path / rest).unlink(missing_ok=True)
    assert verify(path).faults == ()
    return outcomes


def _rows(path: Path) -> object:
    """All rows of a database; the error where they cannot be read."""
    connection = sqlite3.connect(path / "store.sqlite")
    try:
        return [connection.execute(f'SELECT * FROM "{table.name}"').fetchall() for table in all_tables()]  # noqa: S608
    except sqlite3.Error as error:
        return error
    finally:
        connection.close()


def main() -> None:
    """Record, replay and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--act", choices=KINDS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    parser.add_argument("--without-fsync", action="store_true", help="show that the check finds what is lost")
    parser.add_argument("--flips", type=int, metavar="N", help="change bytes instead")
    given = parser.parse_args()
    if given.flips:
        with tempfile.TemporaryDirectory(prefix="ballscrew-flips-") as name:
            outcomes = flip_bytes(Path(name), given.flips, random.Random(0))  # noqa: S311
        print("| a byte of | outcome | times |\n|---|---|---|")
        for (kind, outcome), number in sorted(outcomes.items()):
            print(f"| {kind} | {outcome} | {number} |")
        return
    if given.without_fsync:
        os.environ[_NO_FSYNC] = "1"
    if given.act:
        act(given.act, given.folder)
        return
    print("| action | calls | different disks |\n|---|---|---|", flush=True)
    for kind in given.kinds:
        folder = Path(tempfile.mkdtemp(prefix="ballscrew-power-")).resolve()
        calls, disks = lose_power(kind, folder)
        print(f"| {kind} | {calls} | {disks} |", flush=True)
        shutil.rmtree(folder, ignore_errors=True)
    print("Every one is a store without a fault, and has what was acknowledged.")


if __name__ == "__main__":
    main()
