"""Pictures of the pages, from the simulated plant: ``python docs/pictures/pages.py [--data DIR]``.

Needs Debian's Chromium and playwright. ``--data`` uses the folder of an earlier ``ballscrew serve --demo``.
"""

from __future__ import annotations

import argparse
import io
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import httpx
from PIL import Image
from playwright.sync_api import Page, sync_playwright

FOLDER = Path(__file__).parent.parent / "_static"
WIDTH = 1200
COLOURS = 96
COMPLETE = """() => [...document.querySelectorAll("[data-chart]")].every(
  (each) => each.childElementCount || !each.checkVisibility())"""
HEIGHTS = {
    "fleet": 760,
    "axis": 1000,
    "run": 940,
    "signals": 720,
    "alarms": 620,
    "actions": 760,
    "compare": 900,
}
"""Of each picture, in pixels."""


@contextmanager
def serving(data: Path | None) -> Iterator[str]:
    """Address of a server of the simulated plant."""
    command = [sys.executable, "-m", "ballscrew", "serve", "--demo", "--port", "0"]
    if data is not None:
        command += ["--data", str(data)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603
    try:
        for line in process.stdout or ():
            if found := re.search(r"https?://\S+", line):
                yield found[0]
                break
    finally:
        process.terminate()
        process.wait()


def addresses(url: str) -> dict[str, str]:
    """Address of each page: of the axis with the least stiffness, and of its newest run with recordings."""
    with httpx.Client(base_url=url, timeout=60) as client:
        while client.get("/api/v1/jobs").json()["jobs"]:  # recordings are still analysed
            time.sleep(1.0)
        axes = client.get("/api/v1/axes").json()["axes"]
        worst = min((axis for axis in axes if axis["stiffness"]), key=lambda axis: axis["stiffness"][0])
        name = quote(worst["axis"], safe="")
        runs = [quote(run["run"]) for run in client.get(f"/api/v1/axes/{name}").json()["runs"]]
        recorded = runs[-1]
        for each in reversed(runs):
            if f"/runs/{each}/signals" in client.get(f"/runs/{each}").text:
                recorded = each
                break
    return {
        "fleet": "/",
        "axis": f"/axes/{name}",
        "run": f"/runs/{recorded}",
        "signals": f"/runs/{recorded}/signals",
        "alarms": "/alarms",
    }


def take(page: Page, path: str, target: Path, height: int) -> None:
    """Picture of the upper part of a page, with few colours."""
    page.set_viewport_size({"width": WIDTH, "height": height})
    page.goto(path)
    page.wait_for_function(COMPLETE)
    for _ in range(20):
        text = page.locator("main").inner_text()
        if "file is read" not in text and "being read" not in text:
            break
        page.wait_for_timeout(2000)
        page.reload()
    page.wait_for_timeout(500)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    few = picture.quantize(COLOURS, dither=Image.Dither.NONE)
    few.save(target, optimize=True)
    print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB")  # noqa: T201


def main() -> None:
    """Take all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--url", help="of a server that runs")
    given = parser.parse_args()
    if given.url:
        take_all(given.url)
        return
    with serving(given.data) as url:
        take_all(url)


def take_all(url: str) -> None:
    """Take the pictures from a server."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(base_url=url, color_scheme="light", locale="en-GB", timezone_id="UTC")
        for name, path in addresses(url).items():
            take(page, path, FOLDER / f"pages-{name}.png", HEIGHTS[name])
        browser.close()


if __name__ == "__main__":
    main()
