"""``kill -9`` at random moments of what writes to a store, and whether it keeps its promises.

``python -m benchmarks.store_kills --kills 2000`` kills a process that adds a result, adds recordings,
reprocesses an axis, makes a backup, migrates the schema or removes orphans. After each kill the store is
verified, what was acknowledged must be there, and the same action must then succeed without doubling
anything. ``--database URL`` uses an empty database of PostgreSQL; ``--restart COMMAND`` restarts its server
after each kill. ``--full DIR`` lets the same actions fail on a small file system instead, which is filled up
to a random rest before each.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import shutil
import signal
import subprocess
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import func, select

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, Made, digest, hash_file
from ballscrew.modal import analyze
from ballscrew.modal.analyze import Analysis, AnalysisOptions
from ballscrew.modal.cell import CellResult
from ballscrew.modal.job import Job
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality
from ballscrew.store import adding, analysing, database, migrating
from ballscrew.store.adding import add, add_run
from ballscrew.store.checking import gc, verify
from ballscrew.store.copying import backup
from ballscrew.store.migrating import create_store, migrate
from ballscrew.store.opened import OpenStore
from ballscrew.store.reprocessing import reprocess
from ballscrew.store.tables import SCHEMA, RawFile, ResultRow, RunRow

_BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
_LONGER = 1.15  # times the usual duration within which a process is killed
_MOST_RUNS = 20  # of a store: its verification takes most of the time
_LATER_SCHEMA = f"{int(SCHEMA) + 1:04d}"
_LATER = """
import sqlalchemy as sa
from alembic import op

revision = "{later}"
down_revision = "{present}"


def upgrade():
    op.add_column("machines", sa.Column("serial", sa.Text()))
    op.add_column("runs", sa.Column("remark", sa.Text()))
"""


@dataclass
class Campaign:
    """A store that is written to by processes that are killed.

    Parameters
    ----------
    folder : Path
        For the store and the recordings.
    url : str or None
        Database; None for SQLite.
    chance : Random
        Moments of the kills.
    restart : callable
        Called after each kill.
    """

    folder: Path
    url: str | None
    chance: random.Random
    restart: Callable[[], None]
    runs: int = 0

    def __post_init__(self) -> None:
        """Create the store."""
        self.path = self.folder / "store"
        create_store(self.path, database=self.url)
        self.durations: dict[str, float] = {}

    def store(self) -> OpenStore:
        """The store, opened anew."""
        return OpenStore(self.path)

    def prepare(self, kind: str) -> Callable[[], object]:
        """An action that can be repeated until it succeeds."""
        self.runs += 1
        number = self.runs
        if kind == "add a result":
            return lambda: add_run(self.store(), made_run(number))
        if kind == "add recordings":
            path = write_recordings(self.folder / f"run{number}", number, self.chance)
            return lambda: add(self.store(), path)
        if kind == "reprocess":
            adding.METHOD_REVISION += 1
            return lambda: reprocess(self.store(), switch=False)
        if kind == "backup":
            return lambda: self.backup_once(self.folder / f"backup{number}")
        if kind == "gc":
            return lambda: gc(self.store())
        return self.prepare_migration(number)

    def backup_once(self, to: Path) -> None:
        """Make a backup, unless it is there."""
        if not to.exists():
            backup(self.store(), to)

    def prepare_migration(self, number: int) -> Callable[[], object]:
        """Migration of a copy of the store with SQLite."""
        copy = self.folder / f"old{number}"
        backup(self.store(), copy)
        later_migrations(self.folder)
        return lambda: migrated_copy(copy, self.folder)

    def kill_once(self, kind: str) -> str:
        """Kill a process in an action, and check the store; what became of the action."""
        action = self.prepare(kind)
        before = self.numbers()
        usual = self.durations.get(kind)
        begin = time.perf_counter()
        if usual is None:  # the first of its kind is not killed
            assert run_in_process(action, None)
            self.durations[kind] = time.perf_counter() - begin
            self.check()
            return "not killed"
        acknowledged = run_in_process(action, self.chance.uniform(0.0, _LONGER * usual))
        self.restart()
        self.check()
        after = self.numbers()
        assert run_in_process(action, None), kind
        self.check()
        final = self.numbers()
        if kind.startswith("add"):
            assert final[0] == before[0] + 1, (kind, before, final)
        if acknowledged:
            assert final == after, (kind, after, final)
        shutil.rmtree(self.folder / f"backup{self.runs}", ignore_errors=True)
        shutil.rmtree(self.folder / f"old{self.runs}", ignore_errors=True)
        if acknowledged:
            return "acknowledged before the kill"
        if kind in ("backup", "gc", "migrate"):
            return "not acknowledged"
        return "complete, not acknowledged" if after == final else "not done"

    def check(self) -> None:
        """No fault in the store, nor in a backup that exists."""
        found = verify(self.path)
        assert found.faults == (), found.faults
        copy = self.folder / f"backup{self.runs}"
        if copy.exists():
            assert verify(copy).faults == ()

    def numbers(self) -> tuple[int, ...]:
        """Numbers of runs, results and raw files."""
        return count_rows(self.store())


def migrated_copy(copy: Path, folder: Path) -> None:
    """Migrate a store to a later schema; it has one of the two at any time."""
    found = verify_schema(copy)
    assert found in (SCHEMA, _LATER_SCHEMA), found
    migrating._MIGRATIONS = later_migrations(folder)
    for module in (database, migrating):
        module.SCHEMA, module.SCHEMAS = _LATER_SCHEMA, (SCHEMA, _LATER_SCHEMA)  # type: ignore[attr-defined]
    migrate(copy)
    assert verify_schema(copy) == _LATER_SCHEMA
    assert migrating.sqlite_faults(copy / "store.sqlite") == []


def later_migrations(folder: Path) -> Path:
    """Migrations of a version with another schema."""
    later = folder / "migrations"
    if not later.exists():
        shutil.copytree(migrating._MIGRATIONS, later)
        text = _LATER.format(present=SCHEMA, later=_LATER_SCHEMA)
        (later / "versions" / f"{_LATER_SCHEMA}_later.py").write_text(text)
    return later


def verify_schema(folder: Path) -> str | None:
    """Schema of a store with SQLite."""
    engine = database.make_engine(database.sqlite_url(folder / "store.sqlite"), writing=False)
    with engine.connect() as connection:
        return database.schema_of(connection)


def run_in_process(action: Callable[[], object], delay: float | None) -> bool:
    """Run an action in a process, which is killed after a delay; whether it was acknowledged."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.close(reader)
            action()
            os.write(writer, b"done")
            status = 0
        except BaseException:
            traceback.print_exc()
            raise
        finally:
            os._exit(status)
    os.close(writer)
    if delay is not None:
        time.sleep(delay)
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    acknowledged = os.read(reader, 4) == b"done"
    os.close(reader)
    return acknowledged


def made_run(number: int) -> Run:
    """A run that nobody analysed."""
    files = (FileRef("trip.bin", digest(number)),)
    time_of = (_BEGIN + timedelta(days=number)).isoformat()
    return _run(f"run {number:05d}", files, time_of, AnalysisOptions(), {})


def _run(identity: str, files: Any, measured_at: str | None, options: AnalysisOptions, inputs: Any) -> Run:
    cells = []
    for place in range(40):
        frequency = 150.0 - place
        cells.append(CellResult(0.01 * place, "PA", 0, 3, frequency, 0.2, 0.03, "joint", "good", ()))
    return Run(
        id=identity, axis="axis", mass_kg=100.0, measured_at=measured_at, temperature_C=None, files=files,
        quality=Quality("good"), rigid_body=RigidBodyResult(), transients=(), cells=tuple(cells),
        made=Made(options.to_settings(), inputs=inputs),
    )  # fmt: skip


def add_stand_ins() -> None:
    """Replace the analysis by one that takes no time."""
    for module in (analyze, analysing):
        setattr(module, "examine", imitate_analysis)  # noqa: B010  mypy


def imitate_analysis(job: Job, options: AnalysisOptions, **_: Any) -> Analysis:
    """Run of a job, without an analysis."""
    files = tuple(FileRef(Path(str(file)).name, hash_file(str(file))) for file in job.files)
    run = _run(job.identity(files, job.measured_at), files, job.measured_at, options, job.inputs())
    return Analysis(replace(run, mass_kg=job.mass), (), None)


def write_recordings(folder: Path, number: int, chance: random.Random) -> Path:
    """RUN.toml with two recordings of 300 kB."""
    folder.mkdir()
    for trip in range(2):
        (folder / f"trip{trip}.bin").write_bytes(chance.randbytes(200_000) + bytes(100_000))
    (folder / "channels.toml").write_text('[[channel]]\nsource = "a"\nquantity = "torque"\nunit = "N m"\n')
    measured_at = (_BEGIN + timedelta(days=number)).isoformat()
    (folder / "run.toml").write_text(
        f'channels = "channels.toml"\nload = "100 kg"\nmeasured_at = "{measured_at}"\n'
        'files = ["trip0.bin", "trip1.bin"]\n'
    )
    return folder / "run.toml"


def kill_all(
    kills: int,
    *,
    url: str | None = None,
    seed: int = 0,
    restart: Callable[[], None] = lambda: None,
    seconds: float = math.inf,
) -> Counter[tuple[str, str]]:
    """Kill processes, and count what became of their actions.

    Parameters
    ----------
    kills : int
        Number of kills.
    url : str, optional
        Database; SQLite by default.
    seed : int
        Random seed.
    restart : callable
        Called after each kill.
    seconds : float
        Time after which no further process is killed.

    Returns
    -------
    Counter
        By action and outcome. A broken promise raises ``AssertionError``.
    """
    add_stand_ins()
    kinds = ["add a result", "add recordings", "add recordings", "reprocess", "backup", "gc", "migrate"]
    revision = adding.METHOD_REVISION
    folder = Path(tempfile.mkdtemp(prefix="ballscrew-kills-"))
    outcomes: Counter[tuple[str, str]] = Counter()
    chance = random.Random(seed)  # noqa: S311
    try:
        (folder / "0").mkdir()
        campaign = Campaign(folder / "0", url, chance, restart)
        end = time.monotonic() + seconds
        while total_of(outcomes) < kills and time.monotonic() < end:
            kind = chance.choice(kinds)
            outcomes[kind, campaign.kill_once(kind)] += 1
            if campaign.runs % _MOST_RUNS == 0 and url is None:
                shutil.rmtree(campaign.folder)
                durations = campaign.durations
                place = folder / str(campaign.runs)
                place.mkdir()
                campaign = Campaign(place, url, chance, restart, campaign.runs)
                campaign.durations = durations
    finally:
        adding.METHOD_REVISION = revision
        shutil.rmtree(folder, ignore_errors=True)
    return outcomes


def total_of(outcomes: Counter[tuple[str, str]]) -> int:
    """Number of kills."""
    return sum(number for (_, outcome), number in outcomes.items() if outcome != "not killed")


def fill_disk(disk: Path, times: int, *, seed: int = 0) -> Counter[tuple[str, str]]:
    """Let actions fail on a full file system, and repeat each after there is space again.

    Parameters
    ----------
    disk : Path
        Folder of a small file system that is used for nothing else.
    times : int
        Number of actions.
    seed : int
        Random seed.

    Returns
    -------
    Counter
        By action and outcome. A broken promise raises ``AssertionError``.
    """
    add_stand_ins()
    outcomes: Counter[tuple[str, str]] = Counter()
    chance, revision = random.Random(seed), adding.METHOD_REVISION  # noqa: S311
    store = disk / "store"
    with tempfile.TemporaryDirectory(prefix="ballscrew-full-") as folder:
        for number in range(times):
            if number % 20 == 0:
                shutil.rmtree(store, ignore_errors=True)
                create_store(store)
            outcomes[fill_once(store, Path(folder) / f"run{number}", number, chance)] += 1
    adding.METHOD_REVISION = revision
    return outcomes


def fill_once(path: Path, recordings: Path, number: int, chance: random.Random) -> tuple[str, str]:
    """Fill a file system up to a rest, act, make space and act again; the action and what became of it."""
    store, copy, filler = OpenStore(path), path.parent / "backup", path.parent / "filler"
    files = write_recordings(recordings, number, chance)
    actions: dict[str, Callable[[], object]] = {
        "add a result": lambda: add_run(store, made_run(10_000 + number)),
        "add recordings": lambda: add(store, files),
        "reprocess": lambda: reprocess(store),
        "backup": lambda: backup(store, copy),
    }
    kind = chance.choice(list(actions))
    adding.METHOD_REVISION += kind == "reprocess"
    before = count_rows(store)
    rest = chance.randrange(700_000)
    filler.write_bytes(bytes(max(shutil.disk_usage(path).free - rest, 0)))
    outcome = "complete"
    try:
        actions[kind]()
    except InputError:
        outcome = "refused with a sentence"
        assert not copy.exists()
    filler.unlink()
    assert verify(path).faults == (), verify(path).faults
    if outcome != "complete":
        if kind != "reprocess":
            assert count_rows(store) == before
        actions[kind]()
        assert verify(path).faults == ()
    assert count_rows(store)[0] == before[0] + kind.startswith("add")
    shutil.rmtree(copy, ignore_errors=True)
    return kind, outcome


def count_rows(store: OpenStore) -> tuple[int, ...]:
    """Numbers of runs, results and raw files."""
    with store.read() as session:
        tables = (RunRow, ResultRow, RawFile)
        return tuple(int(session.scalar(select(func.count()).select_from(each)) or 0) for each in tables)


def main() -> None:
    """Kill, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--database")
    parser.add_argument("--restart", help="shell command that restarts the server")
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop after this time")
    parser.add_argument("--full", type=Path, metavar="DIR", help="folder of a file system of 20 MB")
    given = parser.parse_args()

    def restart() -> None:
        if given.restart:
            subprocess.run(given.restart, shell=True, check=True)  # noqa: S602
            wait_for(given.database)

    if given.full:
        outcomes = fill_disk(given.full, given.kills, seed=given.seed)
    else:
        outcomes = kill_all(
            given.kills, url=given.database, seed=given.seed, restart=restart, seconds=60 * given.minutes
        )
    print("| action | outcome | times |\n|---|---|---|")
    for (kind, outcome), number in sorted(outcomes.items()):
        print(f"| {kind} | {outcome} | {number} |")
    print(f"{total_of(outcomes)} in all. Nothing acknowledged was lost, and nothing doubled.")


def wait_for(url: str) -> None:
    """Wait until a server answers."""
    for _ in range(600):
        try:
            with database.translated(url), database.make_engine(url, writing=False).connect():
                return
        except InputError:
            time.sleep(0.1)
    raise SystemExit("the server does not answer")


if __name__ == "__main__":
    main()
