"""The service as a process: how fast it is, and what kills of its processes leave.

``python -m benchmarks.service --uploads 40`` measures uploads of 25 MB, ``--verdicts 3`` the time to
``/readyz`` and from an upload to its verdict (with ``BALLSCREW_DATA``), ``--burst 100`` ten senders,
``--steady 30`` the memory over 30 minutes of runs and page views, and ``--kills 100`` kills the server, a
worker or a sender, or stops a worker, at random moments while three senders send: nothing that was
acknowledged may be lost or doubled. With ``--full FOLDER``, on a small file system, the data folder is there,
and its disk is filled at random moments, too; ``--readers 40`` kills processes that read files. In all but
``--verdicts`` and ``--readers`` the analysis is one that takes
``--analysis`` seconds and no processor time.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from tests.simulated_bench import AXIS

from ballscrew.store.checking import verify
from ballscrew.store.opened import OpenStore
from ballscrew.store.service_tables import Upload
from ballscrew.store.tables import ResultRow, RunRow
from benchmarks import store_kills

_SHEET = AXIS.replace('"bench"', '"axis"')
_CHANNELS = '[[channel]]\nsource = "a"\nquantity = "torque"\nunit = "N m"\n'
_ANALYSIS = "BALLSCREW_BENCHMARK_ANALYSIS"
_PATIENCE = 600.0  # s
_LEASE = 5.0  # s
_MOST_WAITING = 30  # jobs


def imitated_work(pipe: Connection, scratch: str) -> None:
    """Main function of a worker whose analyses take a stated time."""
    from ballscrew.service.working import work
    from ballscrew.store import analysing

    def examine(*arguments: Any, **options: Any) -> Any:
        time.sleep(float(os.environ[_ANALYSIS]))
        return store_kills.imitate_analysis(*arguments, **options)

    setattr(analysing, "examine", examine)  # noqa: B010  mypy
    work(pipe, scratch)


def serve_imitated(folder: str, port: int) -> None:
    """Serve with such workers."""
    from ballscrew.service import server, working

    setattr(server, "Worker", partial(working.Worker, target=imitated_work))  # noqa: B010  mypy
    server.serve(
        folder, port=port, workers=2, back_off_s=0.2, attempts=1000, lease_s=_LEASE, min_free_bytes=0
    )


class Process:
    """A server process, and a client that waits for it.

    Parameters
    ----------
    folder : Path
        Data folder.
    port : int
        Port.
    analysis : float or None
        Seconds of an imitated analysis; None for the real one.
    **settings
        Of the server with the real one.
    """

    def __init__(self, folder: Path, port: int, analysis: float | None, **settings: Any) -> None:
        self.folder, self.port, self.analysis = folder, port, analysis
        self.settings = {f"BALLSCREW_SERVER_{name.upper()}": str(value) for name, value in settings.items()}
        self.url = f"http://127.0.0.1:{port}"
        self.process: subprocess.Popen[bytes] | None = None
        self.stopped: list[int] = []

    def start(self) -> float:
        """Start it; seconds until it is ready."""
        command = [sys.executable, "-m", "ballscrew", "serve", "--data", str(self.folder)]
        command += ["--port", str(self.port)]
        environment = os.environ | self.settings
        if self.analysis is not None:
            command = [
                sys.executable,
                "-m",
                "benchmarks.service",
                "--serve",
                str(self.folder),
                str(self.port),
            ]
            environment[_ANALYSIS] = str(self.analysis)
        begin = time.perf_counter()
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment)  # noqa: S603
        with httpx.Client(base_url=self.url, timeout=10) as client:
            wait_for(lambda: client.get("/readyz").status_code == 200)
        return time.perf_counter() - begin

    def kill(self) -> None:
        """Kill the server, and then its workers that are stopped: others end with it."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()
        for number in self.stopped:
            with suppress(OSError):
                os.kill(number, signal.SIGKILL)
        self.stopped.clear()

    def signal_worker(self, chance: random.Random, number: signal.Signals) -> bool:
        """Kill or stop one of its workers; whether there was one."""
        found = self.workers()
        if found:
            chosen = chance.choice(found)
            self.stopped.append(chosen)
            with suppress(OSError):
                os.kill(chosen, number)
        return bool(found)

    def workers(self) -> list[int]:
        """Numbers of the processes of its workers."""
        assert self.process is not None
        found = []
        for number in children(self.process.pid):
            with suppress(OSError):
                if b"spawn_main" in Path(f"/proc/{number}/cmdline").read_bytes():
                    found.append(number)
        return found

    def readers(self) -> list[int]:
        """Numbers of the processes that read a file, and of those that start them."""
        starting = [number for worker in self.workers() for number in children(worker)]
        reading = [number for each in starting for number in children(each)]
        return starting + reading if reading else []

    def memory(self) -> tuple[float, float]:
        """Resident memory of the server, and of all its workers, MB."""
        assert self.process is not None
        sizes = []
        for number in (self.process.pid, *self.workers()):
            pages = Path(f"/proc/{number}/statm").read_text().split()[1]
            sizes.append(int(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6)
        return sizes[0], sum(sizes[1:])

    def stop(self) -> int:
        """Stop it; its exit status."""
        assert self.process is not None
        self.process.terminate()
        return self.process.wait(60)


def children(number: int) -> list[int]:
    """Numbers of the processes that a process has started."""
    found: list[int] = []
    for path in Path(f"/proc/{number}/task").glob("*/children"):
        with suppress(OSError):
            found += map(int, path.read_text().split())
    return found


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds; a server that does not answer is waited for."""
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline:
        with suppress(httpx.HTTPError):
            if condition():
                return
        time.sleep(0.05)
    raise SystemExit("the server does not answer")


@contextmanager
def serving(process: Process) -> Iterator[httpx.Client]:
    """A server that runs, with an axis."""
    process.start()
    with httpx.Client(base_url=process.url, timeout=60) as client:
        axis = {"machine": "mill", "sheet": _SHEET, "channels": _CHANNELS}
        client.put("/api/v1/axes/axis", json=axis).raise_for_status()
        yield client
    assert process.stop() == 0


def contents_of(number: int) -> dict[str, bytes]:
    """Two recordings of a run, which its number determines."""
    generator = random.Random(number)  # noqa: S311
    return {f"trip{trip}.bin": generator.randbytes(50_000) for trip in range(2)}


def send(client: httpx.Client, key: str, contents: dict[str, bytes], number: int) -> httpx.Response:
    """Send a run once."""
    url = f"/api/v1/axes/axis/runs/{key}"
    files = []
    text = run_toml(contents, number)
    for name, content in contents.items():
        sha256 = hashlib.sha256(content).hexdigest()
        client.put(f"{url}/files/{sha256}", content=content).raise_for_status()
        files.append({"name": name, "sha256": sha256})
    return client.post(f"{url}/complete", json={"files": files, "run_toml": text})


def run_toml(contents: dict[str, bytes], number: int) -> str:
    """RUN.toml of a run."""
    time_of = (datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=number)).isoformat()
    return f'channels = "c.toml"\nload = "100 kg"\nmeasured_at = "{time_of}"\nfiles = {list(contents)}\n'


def send_with_kills(url: str, folder: Path, number: int, chance: random.Random) -> int:
    """Send a run by ``ballscrew send``, which is killed at random moments; number of kills."""
    run, kills = folder / f"run{number}", 0
    run.mkdir(parents=True)
    contents = contents_of(number)
    for name, content in contents.items():
        run.joinpath(name).write_bytes(content)
    run.joinpath("RUN.toml").write_text(run_toml(contents, number), encoding="utf-8")
    command = [sys.executable, "-m", "ballscrew", "send", str(run / "RUN.toml"), "--to", url]
    command += ["--axis", "axis", "--run", f"run{number}", "--spool", str(folder / "spool")]
    while True:
        sender = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603
        try:
            status = sender.wait(chance.uniform(0.5, 5.0))
        except subprocess.TimeoutExpired:
            sender.kill()
            sender.wait()
            kills += 1
            continue
        if status == 0:
            return kills


def send_until_acknowledged(url: str, number: int, key: str | None = None) -> str:
    """Send a run until the server acknowledges it; its content id."""
    while True:
        with suppress(httpx.HTTPError), httpx.Client(base_url=url, timeout=30) as client:
            answer = send(client, key or f"run{number}", contents_of(number), number)
            if answer.status_code in (200, 202):
                return str(answer.json()["id"])
            assert answer.status_code >= 500 or answer.status_code == 429, answer.text
        time.sleep(0.05)


def content_of(url: str, key: str) -> str:
    """Content id of a run that was sent under a key."""
    found: list[str] = []

    def is_answered() -> bool:
        sent = client.get("/api/v1/axes/axis/runs").raise_for_status().json()["sent"]
        found[:] = [each["id"] for each in sent if each["run"] == key]
        return True

    with httpx.Client(base_url=url, timeout=30) as client:
        wait_for(is_answered)
    assert len(found) == 1, f"{key} is lost or doubled"
    return found[0]


def wait_for_verdicts(url: str) -> None:
    """Wait until no job waits."""
    with httpx.Client(base_url=url, timeout=30) as client:
        wait_for(lambda: client.get("/api/v1/jobs").raise_for_status().json()["jobs"] == [])


def check(folder: Path, acknowledged: dict[str, str]) -> None:
    """Check the promises against what was acknowledged: content id by key."""
    found = verify(folder)
    assert found.faults == (), found.faults[:3]
    assert found.orphans == (), found.orphans[:3]
    with OpenStore(folder).read() as session:
        rows = session.query(Upload).all()
        runs = session.query(RunRow).count()
        results = session.query(ResultRow).count()
    by_key = {row.key: row for row in rows if row.status != "conflict"}
    for key, content in acknowledged.items():
        assert key in by_key, f"{key} is lost"
        row = by_key[key]
        assert (row.content, row.status, row.verdict) == (content, "done", "good"), (
            key,
            row.status,
            row.error,
        )
    contents = {row.content for row in by_key.values()}
    assert runs == results == len(contents), (runs, results, len(contents))


def measure_uploads(folder: Path, port: int, number: int, megabytes: float) -> None:
    """Print times of uploads, one after the other."""
    times = []
    with serving(Process(folder, port, 0.0)) as client:
        for _ in range(number):
            content = os.urandom(int(megabytes * 1e6))
            sha256 = hashlib.sha256(content).hexdigest()
            begin = time.perf_counter()
            client.put(f"/api/v1/axes/axis/runs/r/files/{sha256}", content=content).raise_for_status()
            times.append(time.perf_counter() - begin)
    p50, p99 = np.quantile(times, [0.5, 0.99])
    print(f"| upload of {megabytes:g} MB, {number} times: p50, p99, largest | "
          f"{p50:.3f}, {p99:.3f}, {max(times):.3f} s |")  # fmt: skip


def set_up_bench(client: httpx.Client, bench: Path) -> None:
    """Set up the axis of the bench."""
    axis: dict[str, Any] = {"machine": "mill", "plan": (bench / "plan.toml").read_text()}
    axis |= {"sheet": (bench / "axis.toml").read_text()}
    axis |= {"channels": (bench / "channels.toml").read_text()}
    client.put("/api/v1/axes/bench", json=axis).raise_for_status()


def send_bench(client: httpx.Client, bench: Path, day: int) -> str:
    """Send a run of the bench; its content id."""
    url, files = f"/api/v1/axes/bench/runs/{day}", []
    for path in sorted(bench.glob("preload-4-percent-trip*.h5")):
        content = path.read_bytes() + bytes([day])  # the same recordings are one run
        sha256 = hashlib.sha256(content).hexdigest()
        client.put(f"{url}/files/{sha256}", content=content).raise_for_status()
        files.append({"name": path.name, "sha256": sha256})
    measured_at = (datetime(2026, 1, 1, 8, tzinfo=UTC) + timedelta(days=day)).isoformat()
    document = {"files": files, "measured_at": measured_at}
    return str(client.post(f"{url}/complete", json=document).raise_for_status().json()["id"])


def kill_readers(folder: Path, port: int, bench: Path, kills: int, seed: int) -> None:
    """Kill processes that read files, or that start those, and check that every run has its verdict."""
    chance = random.Random(seed)  # noqa: S311
    process, killed = Process(folder, port, None, attempts=1000, back_off_s=0.2), 0
    sent: dict[str, str] = {}
    process.start()
    with httpx.Client(base_url=process.url, timeout=60) as client:
        set_up_bench(client, bench)
        while killed < kills:
            number = len(sent) + 1
            identity = sent[str(number)] = send_bench(client, bench, number)
            spared = False
            while not _is_done(client, identity):
                found = [] if spared else _wait_for_readers(process)
                if found:
                    time.sleep(chance.uniform(0.0, 0.05))
                    with suppress(OSError):
                        os.kill(chance.choice(found), signal.SIGKILL)
                        killed += 1
                    spared = chance.random() < 0.1  # so that the run ends
    assert process.stop() == 0
    check(folder, sent)
    print(f"| kills: {killed} of a reader; {len(sent)} runs | all done, all good |")


def _wait_for_readers(process: Process) -> list[int]:
    """Processes that read, as soon as there are any; none after half a second."""
    deadline = time.monotonic() + 0.5
    while time.monotonic() < deadline:
        found = process.readers()
        if found:
            return found
        time.sleep(0.005)
    return []


def measure_verdict(folder: Path, port: int, bench: Path, number: int) -> None:
    """Print times from the completion of a run of three recordings to its verdict."""
    process = Process(folder, port, None)
    print(f"| new folder to /readyz, real workers | {process.start():.1f} s |")
    with httpx.Client(base_url=process.url, timeout=60) as client:
        set_up_bench(client, bench)
        times = []
        for day in range(1, number + 1):
            begin = time.perf_counter()
            wait_for(partial(_is_done, client, send_bench(client, bench, day)))
            times.append(time.perf_counter() - begin)
    assert process.stop() == 0
    shown = ", ".join(f"{each:.1f}" for each in times)
    print(f"| upload of three trips to verdict, idle, one after the other | {shown} s |")


def _is_done(client: httpx.Client, identity: str) -> bool:
    (sent, *_) = client.get(f"/api/v1/runs/{identity}").json()["sent"]
    assert sent["status"] in ("queued", "done"), sent
    return bool(sent["status"] == "done")


def measure_burst(folder: Path, port: int, runs: int, senders: int, analysis: float) -> None:
    """Print the time of a burst: each run is sent by two senders."""
    process = Process(folder, port, analysis)
    with serving(process):
        begin = time.perf_counter()
        numbers = [number for number in range(runs) for _ in range(2)]
        with ThreadPoolExecutor(senders) as pool:
            identities = list(pool.map(partial(send_until_acknowledged, process.url), numbers))
        acknowledged = time.perf_counter() - begin
        wait_for_verdicts(process.url)
        done = time.perf_counter() - begin
    check(folder, {f"run{number}": identity for number, identity in zip(numbers, identities, strict=True)})
    print(f"| burst of {runs} runs, each twice, from {senders} senders: acknowledged, all verdicts | "
          f"{acknowledged:.1f}, {done:.1f} s; none lost, none doubled |")  # fmt: skip
    with OpenStore(folder).read() as session:
        rows = session.query(Upload).order_by(Upload.id).all()
    ended = {row.id: place for place, row in enumerate(sorted(rows, key=lambda row: str(row.finished_at)))}
    most = max(abs(ended[row.id] - place) for place, row in enumerate(rows))
    print(f"| order of verdicts, against that of receipt | displaced by {most} at most |")


def measure_steady(folder: Path, port: int, minutes: float, analysis: float) -> None:
    """Print the memory while a run is sent, and three pages are shown, every second."""
    process = Process(folder, port, analysis)
    sizes: list[tuple[float, float]] = []
    latencies = []
    with serving(process) as client:
        begin, number = time.monotonic(), 0
        while time.monotonic() < begin + 60 * minutes:
            start = time.monotonic()
            send_until_acknowledged(process.url, number)
            latencies.append(time.monotonic() - start)
            for path in ("/", "/axes/axis", "/api/v1/axes"):
                client.get(path).raise_for_status()
            number += 1
            if time.monotonic() - begin > 60 * len(sizes):
                sizes.append(process.memory())
            time.sleep(max(0.0, begin + number - time.monotonic()))
        sizes.append(process.memory())
        wait_for_verdicts(process.url)
    check(folder, {})
    for place in sorted({0, min(5, len(sizes) - 1), len(sizes) // 2, len(sizes) - 1}):
        server, workers = sizes[place]
        print(f"| memory after {place} min of a run a second: server, workers | "
              f"{server:.0f}, {workers:.0f} MB |")  # fmt: skip
    print(f"| {number} runs: upload to acknowledgement p50, p99 | "
          f"{np.quantile(latencies, 0.5):.3f}, {np.quantile(latencies, 0.99):.3f} s |")  # fmt: skip


def kill_all(
    folder: Path, port: int, kills: int, minutes: float, analysis: float, seed: int, *, small: Path | None
) -> None:
    """Kill processes, or fill a small disk, while runs are sent; check after each kill of a server."""
    chance = random.Random(seed)  # noqa: S311
    faults, data = ["server", "worker", "stopped worker"], folder / "data"
    if small is not None:
        faults.append("full disk")
        data = small / "data"
    process, acknowledged, outcomes = Process(data, port, analysis), {}, Counter[str]()
    stop = threading.Event()
    lock = threading.Lock()
    deadline = time.monotonic() + 60 * minutes

    def send_on(first: int) -> None:
        number = first
        while not stop.is_set():
            wait_for(partial(_is_short, process.url))
            identity = send_until_acknowledged(process.url, number)
            with lock:
                acknowledged[f"run{number}"] = identity
            if number % 5 == 0:
                twin = send_until_acknowledged(process.url, number, f"twin{number}")
                assert twin == identity
            number += 2

    def send_by_command() -> None:
        number, moments = 1_000_000, random.Random(seed)  # noqa: S311
        while not stop.is_set():
            outcomes["sender"] += send_with_kills(process.url, folder / "senders", number, moments)
            with lock:
                acknowledged[f"run{number}"] = content_of(process.url, f"run{number}")
            number += 1

    with serving(process):
        with ThreadPoolExecutor(3) as pool:
            senders = [pool.submit(send_on, first) for first in range(2)]
            senders.append(pool.submit(send_by_command))
            try:
                while sum(outcomes.values()) < kills and time.monotonic() < deadline:
                    time.sleep(chance.uniform(0.0, 1.5))
                    fault = chance.choice(faults)
                    if fault == "worker":
                        outcomes[fault] += process.signal_worker(chance, signal.SIGKILL)
                        continue
                    if fault == "stopped worker":  # past its lease
                        outcomes[fault] += process.signal_worker(chance, signal.SIGSTOP)
                        continue
                    if small is not None and fault == "full disk":
                        fill(small / "filler", chance.uniform(0.5, 3.0))
                        outcomes[fault] += 1
                        continue
                    process.kill()
                    outcomes["server"] += 1
                    with lock:
                        known = dict(acknowledged)
                    check_uploads(data, known)
                    process.start()
            finally:
                stop.set()
            for sender in senders:
                sender.result()
        wait_for_verdicts(process.url)
    check(data, acknowledged)
    names = ", ".join(f"{number} of a {name}" for name, number in sorted(outcomes.items()))
    print(f"| faults: {names}; {len(acknowledged)} runs acknowledged | all done, none lost, none doubled |")


def fill(path: Path, seconds: float) -> None:
    """Fill the disk with a file for some time."""
    with suppress(OSError), path.open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12):
            with suppress(OSError):
                while True:
                    file.write(bytes(size))
    time.sleep(seconds)
    path.unlink(missing_ok=True)


def _is_short(url: str) -> bool:
    """Whether few jobs wait, so that no sender is refused for long."""
    with httpx.Client(base_url=url, timeout=30) as client:
        return len(client.get("/api/v1/jobs").raise_for_status().json()["jobs"]) < _MOST_WAITING


def check_uploads(folder: Path, acknowledged: dict[str, str]) -> None:
    """Check that what was acknowledged is in the store of a server that was just killed."""
    with OpenStore(folder).read() as session:
        by_key = {row.key: row.content for row in session.query(Upload).all() if row.status != "conflict"}
    lost = [key for key, content in acknowledged.items() if by_key.get(key) != content]
    assert lost == [], lost[:3]


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--serve", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, default=8765)
    parser.add_argument("--uploads", type=int, default=0)
    parser.add_argument("--megabytes", type=float, default=25.0)
    parser.add_argument("--verdicts", type=int, default=0)
    parser.add_argument("--burst", type=int, default=0, help="runs")
    parser.add_argument("--senders", type=int, default=10)
    parser.add_argument("--steady", type=float, default=0, help="minutes")
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--readers", type=int, default=0, help="kills of processes that read files")
    parser.add_argument("--minutes", type=float, default=math.inf, help="end kills after this time")
    parser.add_argument("--full", type=Path, help="folder on a small file system")
    parser.add_argument("--analysis", type=float, default=0.2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if given.serve is not None:
        serve_imitated(given.serve[0], int(given.serve[1]))
        return
    with tempfile.TemporaryDirectory(prefix="ballscrew-service-") as temporary:
        folder, bench = Path(temporary), Path(os.environ.get("BALLSCREW_DATA", "")) / "bench"
        print("| | |\n|---|---|")
        if given.uploads:
            measure_uploads(folder / "uploads", given.port, given.uploads, given.megabytes)
        if given.verdicts:
            measure_verdict(folder / "verdicts", given.port, bench, given.verdicts)
        if given.burst:
            measure_burst(folder / "burst", given.port, given.burst, given.senders, given.analysis)
        if given.steady:
            measure_steady(folder / "steady", given.port, given.steady, given.analysis)
        if given.readers:
            kill_readers(folder / "readers", given.port, bench, given.readers, given.seed)
        if given.kills:
            times = (given.minutes, given.analysis, given.seed)
            kill_all(folder / "kills", given.port, given.kills, *times, small=given.full)


if __name__ == "__main__":
    main()
