"""Pages of a fleet of 300 axes over five years: time of answers, sizes, time to interactive, memory.

``python -m benchmarks.pages`` fills a store in a temporary folder with synthetic rows, serves it by a process
of its own, and prints a table; ``--store DIR`` uses a store that was filled before. Times to interactive need
Chromium, memory needs Linux.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import httpx
import numpy as np

from ballscrew.store.fleet import simulate_fleet
from ballscrew.store.migrating import create_store
from benchmarks.machine import heading

_FEWER = 10  # of the requests for the longest documents
_LOADS = 9  # of a page in the browser
_VIEWS = 1000

_INTERACTIVE = """async () => {
  const charts = [...document.querySelectorAll("[data-chart]")];
  const complete = () => charts.every((each) => each.childElementCount);
  while (!complete()) await new Promise((next) => setTimeout(next, 5));
  await new Promise((next) => requestAnimationFrame(() => setTimeout(next)));
  const [page] = performance.getEntriesByType("navigation");
  return [page.domContentLoadedEventEnd, performance.now()];
}"""


@contextmanager
def serving(folder: Path) -> Iterator[tuple[str, int]]:
    """Address and process number of a server of a store."""
    command = [
        sys.executable,
        "-m",
        "ballscrew",
        "serve",
        "--data",
        str(folder),
        "--port",
        "0",
        "--workers",
        "1",
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603
    try:
        assert process.stdout is not None
        found = re.search(r"https?://\S+", process.stdout.readline())
        assert found is not None
        wait_until_ready(found[0])
        yield found[0], process.pid
    finally:
        process.terminate()
        process.wait()


def wait_until_ready(url: str) -> None:
    """Wait for the worker, whose start takes processor time."""
    with httpx.Client(base_url=url, timeout=60) as client:
        while client.get("/readyz").status_code != 200:
            time.sleep(0.2)


def resident_mb(process: int) -> float:
    """Memory of a process, in MB; NaN where it is not known."""
    path = Path(f"/proc/{process}/status")
    if not path.exists():
        return float("nan")
    found = re.search(r"VmRSS:\s+(\d+) kB", path.read_text(encoding="ascii"))
    return int(found[1]) / 1e3 if found else float("nan")


def measure_answers(client: httpx.Client, what: str, paths: Sequence[str]) -> None:
    """Print percentiles of the times of requests, and the size of an answer."""
    times, size, compressed = [], 0, 0
    for path in paths:
        begin = time.perf_counter()
        with client.stream("GET", path) as answer:
            compressed = sum(len(part) for part in answer.iter_raw())
        times.append(1e3 * (time.perf_counter() - begin))
        if answer.status_code != 200:
            print(f"| {what} | {answer.status_code} | | | |")
            return
    size = len(client.get(paths[-1]).content)
    middle, high = np.percentile(times, (50, 99))
    print(
        f"| {what} | {len(times)} | {middle:.0f} | {high:.0f} | {compressed / 1e3:.0f} of {size / 1e3:.0f} |"
    )


def measure_browser(url: str, pages: dict[str, str]) -> None:
    """Print the times until the content is usable and until all charts are drawn, with an empty cache."""
    program = shutil.which("chromium")
    if program is None:
        print("no Chromium")
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        for what, path in pages.items():
            found = []
            for _ in range(_LOADS):
                context = browser.new_context(base_url=url)
                page = context.new_page()
                page.goto(path)
                found.append(page.evaluate(_INTERACTIVE))
                context.close()
            usable, charted = np.median(found, axis=0)
            print(f"{what}: content and controls after {usable:.0f} ms, charts drawn after {charted:.0f} ms")
        browser.close()


def measure_memory(client: httpx.Client, process: int, paths: Sequence[str]) -> None:
    """Print the memory of the server before, while and after pages are viewed."""
    found = [resident_mb(process)]
    for number in range(_VIEWS):
        client.get(paths[number % len(paths)])
        if (number + 1) % (_VIEWS // 4) == 0:
            found.append(resident_mb(process))
    shown = ", ".join(f"{each:.0f}" for each in found)
    print(f"memory after 0, 250, … {_VIEWS} page views: {shown} MB")


def measure(folder: Path, requests: int) -> None:
    """Print all."""
    with serving(folder) as (url, process), httpx.Client(base_url=url, timeout=60) as client:
        names = [axis["axis"] for axis in client.get("/api/v1/axes").json()["axes"]]
        order = np.random.default_rng(1).integers(0, len(names), requests)
        axes = [quote(names[index], safe="") for index in order]
        print(f"load average {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "")
        print("| | requests | median, ms | 99th percentile, ms | size, kB |\n|---|---|---|---|---|")
        fleet = ["/"] * (requests // 3)
        measure_answers(client, "fleet", fleet)
        measure_answers(client, "fleet, update", ["/?part=rows"] * (requests // 3))
        measure_answers(client, "axis", [f"/axes/{name}" for name in axes])
        measure_answers(client, "trend, JSON", [f"/api/v1/axes/{name}/trend" for name in axes])
        measure_answers(client, "frequencies, JSON", [f"/api/v1/axes/{name}/frequencies" for name in axes])
        measure_answers(client, "all of an axis, JSON", [f"/api/v1/axes/{name}" for name in axes[:_FEWER]])
        measure_answers(client, "alarms", ["/alarms"] * (requests // 3))
        measure_answers(client, "server", ["/status"] * (requests // 3))
        measure_browser(url, {"fleet": "/", "axis": f"/axes/{axes[0]}"})
        measure_memory(client, process, ["/", *(f"/axes/{name}" for name in axes[:3])])


def main() -> None:
    """Fill a store, serve it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axes", type=int, default=300)
    parser.add_argument("--years", type=float, default=5.0)
    parser.add_argument("--requests", type=int, default=300)
    parser.add_argument("--store", type=Path, help="store that was filled before")
    given = parser.parse_args()
    print(heading("python -m benchmarks.pages"))
    if given.store:
        measure(given.store, given.requests)
        return
    folder = Path(tempfile.mkdtemp(prefix="ballscrew-pages-"))
    try:
        store = create_store(folder / "store")
        rows = simulate_fleet(store, axes=given.axes, years=given.years)
        print(f"{rows['axes']} axes, {rows['runs']} runs", flush=True)
        measure(store.path, given.requests)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
