"""Third-party recordings, and runs of the bench that several test files use."""

from __future__ import annotations

import gc
import hashlib
import os
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

# As the command line has it, and before numpy is loaded: a second thread on matrices this small takes eight
# times the processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("BALLSCREW_IN_PROCESS", "1")  # readers/test_process.py tests the processes

import numpy as np
import pytest
from hypothesis import settings
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from tests.simulated_bench import simulate_bench

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.files import replacing
from ballscrew.base.locks import try_lock, unlock
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.prognosis.family_average import FamilyAverage

ROOT = Path(__file__).parent.parent
DATA = Path(os.environ.get("BALLSCREW_DATA", ROOT.parent / "shared" / "data"))
BENCH_STATES = ("preload-4-percent", "preload-2-percent")
BenchRun = Callable[..., ballscrew.Run]
# Files of more than about 5 s of processor time: they come first, so that parallel processes end together.
LONG_FILES = (
    "test_acceptance_joint.py",
    "report/test_plan_figure.py",  # beside the first, which compiles: of two processes both would compile
    "test_acceptance.py",
    "service/pages/test_browser.py",
    "cli/test_analyze.py",
    "modal/joint/test_ripple.py",
    "modal/joint/test_identify.py",
    "cli/test_reproduce.py",
    "cli/test_demo.py",
    "recording/quality/test_motion.py",
    "report/test_run_figure.py",
    "cli/test_app.py",
    "docs/test_tutorial.py",
    "prognosis/test_resumed.py",
    "testbed/test_run.py",
    "monitoring/test_health.py",
    "monitoring/detection/test_limits.py",
    "base/test_native.py",
    "fcft/test_concerns.py",
    "store/test_orders.py",
    "store/test_damage.py",
    "store/test_store.py",
    "store/test_database.py",
    "store/test_copies.py",
    "store/test_recordings.py",
    "store/test_checkpoints.py",
    "store/test_method_changes.py",
    "store/test_kills.py",
    "cli/test_store.py",
    "calibration/test_calibration.py",
    "monitoring/detection/test_visits.py",
)

# A shared machine can be slow at any moment: no test has a time limit.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

# A process that is killed leaves the same files with and without: no test switches the power off.
os.fsync = os.fstat  # type: ignore[assignment]  fails for the same handles


DEAR_ON_POSTGRESQL = (
    *("test_checkpoints.py", "test_copies.py", "test_damage.py", "test_explaining.py"),
    *("test_method_changes.py", "test_orders.py"),
)
"""Files of the store whose tests, but that of a backup, are slow ones on PostgreSQL: they test other code."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the long files first; the order within a file stays."""
    for item in items:
        of_backup = item.name.startswith("test_a_restored_backup")
        if item.path.name in DEAR_ON_POSTGRESQL and "[postgresql" in item.name and not of_backup:
            item.add_marker(pytest.mark.slow)
    place = {Path(__file__).parent / name: index for index, name in enumerate(LONG_FILES)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


def pytest_collection_finish() -> None:
    """Collect garbage seldom, and never look at what was imported."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of foreign data, or a skip that says so."""
    if not (DATA / "bench").is_dir():
        pytest.skip(f"no data at {DATA}: set BALLSCREW_DATA to the folder that holds bench/ and emps/")
    return DATA


@pytest.fixture(scope="session")
def foreign_bench(data: Path) -> Path:
    """The bench that another program simulated, with known truth."""
    return data / "bench"


@pytest.fixture(scope="session")
def bench(shared_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bench; where there is no foreign data, one of the testbed with the same files."""
    if (DATA / "bench").is_dir():
        return DATA / "bench"
    folder = shared_folder / "bench"
    if not folder.is_dir():
        made = tmp_path_factory.mktemp("bench")
        simulate_bench(made)
        with suppress(OSError):  # another process was faster
            made.rename(folder)
    return folder


@pytest.fixture(scope="session")
def emps(data: Path) -> Path:
    """The record of a real ball-screw drive."""
    return data / "emps"


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the processes of a test session share."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    return folder


@pytest.fixture(scope="session", autouse=True)
def compiled_once(shared_folder: Path) -> Iterator[None]:
    """Let one process of a test session compile at a time: the others load what it has stored."""
    compile_function, nested = Dispatcher.compile, False

    def compile_alone(dispatcher: Dispatcher, signature: Any) -> Any:
        nonlocal nested
        with global_compiler_lock:  # threads wait for each other first, and for other processes then
            if nested:
                return compile_function(dispatcher, signature)
            with (shared_folder / "compiling").open("w") as stream:
                while not try_lock(stream):
                    time.sleep(0.02)
                nested = True
                try:
                    return compile_function(dispatcher, signature)
                finally:
                    nested = False
                    unlock(stream)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Dispatcher, "compile", compile_alone)
        yield


@pytest.fixture(scope="session")
def joint_fit(shared_folder: Path) -> Callable[..., JointResult]:
    """``identify_jointly`` that fits equal input once per session."""

    def fitted(
        trips: Sequence[TripSignals], transients: object, sheet: DataSheet | None, *others: object
    ) -> JointResult:
        arrays = hashlib.sha256()
        for trip in trips:
            for array in (trip.force, trip.position, trip.response):
                arrays.update(np.ascontiguousarray(array))
        like = sheet and replace(sheet, source="")
        rest = repr(([trip.rate for trip in trips], transients, like, others))
        key = hashlib.sha256(arrays.digest() + rest.encode()).hexdigest()
        path = shared_folder / f"{key}.pickle"
        if not path.exists():
            result = identify_jointly(trips, transients, sheet, *others)  # type: ignore[arg-type]
            with replacing(path) as temporary:
                temporary.write_bytes(pickle.dumps(result))
        found: JointResult = pickle.loads(path.read_bytes())  # noqa: S301  written above
        return found

    return fitted


@pytest.fixture
def fitted_once(monkeypatch: pytest.MonkeyPatch, joint_fit: Callable[..., JointResult]) -> None:
    """For tests of what surrounds the joint fit: ``analyze`` takes equal fits from earlier tests."""
    monkeypatch.setattr("ballscrew.modal.joint.analysis.identify_jointly", joint_fit)


@pytest.fixture(scope="module")
def few_members() -> Iterator[None]:
    """Forecasts of few members, for files whose tests compare their numbers with none of more."""
    with pytest.MonkeyPatch.context() as patched:
        few = partial(FamilyAverage, members=20, samples=200)
        patched.setattr("ballscrew.prognosis.monitor.FamilyAverage", few)
        patched.setattr("ballscrew.prognosis.family_fit._MOST_ROUNDS", 1)
        yield


@pytest.fixture(scope="session")
def bench_run(bench: Path, shared_folder: Path, joint_fit: Callable[..., JointResult]) -> BenchRun:
    """Run of a state of the bench by a method, ``bench_run("preload-4-percent", "paper")``.

    Each is analysed once and shared by the processes of a test session.
    """
    runs: dict[tuple[str, str], ballscrew.Run] = {}

    def analysed(state: str, method: str = "joint") -> ballscrew.Run:
        path = shared_folder / f"{state}-{method}.pickle"
        if not path.exists():
            with pytest.MonkeyPatch.context() as patched:
                patched.setattr("ballscrew.modal.joint.analysis.identify_jointly", joint_fit)
                run = ballscrew.analyze(
                    sorted(bench.glob(f"{state}-trip*.h5")),
                    channels=bench / "channels.toml",
                    axis=bench / "axis.toml",
                    plan=bench / "plan.toml",
                    mass="100 kg",
                    method=method,
                )
            with replacing(path) as temporary:
                temporary.write_bytes(pickle.dumps(run))
        if (state, method) not in runs:
            runs[state, method] = pickle.loads(path.read_bytes())  # noqa: S301  written above
        return runs[state, method]

    return analysed
