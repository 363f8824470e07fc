"""Does a run give the same bytes in every order of its files, folder, locale and time zone?  Ten analyses.

    python -m benchmarks.determinism [--times 10] [--bench FOLDER]

The trips of the bench given in BALLSCREW_DATA are analysed again and again, each time in a new process: in
another order, folder, locale and time zone, with another seed of hashes, and with one or two threads of the
libraries of linear algebra. The program prints the SHA-256 of each RUN.json, and ends with 1 if they differ.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.faults import bench_folder
from benchmarks.machine import heading

_LOCALES = ("C", "C.UTF-8", "de_DE.UTF-8", "tr_TR.UTF-8")
_ZONES = ("UTC", "Asia/Kathmandu", "America/St_Johns", "Pacific/Auckland")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def analysed(bench: Path, folder: Path, index: int) -> tuple[str, str]:
    """SHA-256 of one RUN.json, and its circumstances."""
    choice = np.random.default_rng(index)
    names = [f"preload-4-percent-trip{trip}.h5" for trip in (1, 2, 3)]
    choice.shuffle(names)
    for name in (*names, "axis.toml", "plan.toml", "channels.toml"):
        shutil.copy(bench / name, folder / name)
    language, zone = str(choice.choice(_LOCALES)), str(choice.choice(_ZONES))
    threads = "12"[index % 2]
    environment = {
        **os.environ, **dict.fromkeys(_THREADS, threads), "LC_ALL": language, "TZ": zone,
        "PYTHONHASHSEED": str(index),
    }  # fmt: skip
    command = [
        sys.executable, "-m", "ballscrew", "analyze", *names, "--axis", "axis.toml", "--plan", "plan.toml",
        "--channels", "channels.toml", "--mass", "100 kg", "--json",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=True)  # noqa: S603  this Python
    order = " ".join(Path(name).stem[-1] for name in names)
    return hashlib.sha256(done.stdout).hexdigest(), f"trips {order}, {threads} threads, {language}, {zone}"


def main() -> None:
    """Analyse, print, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--bench", type=Path, help="folder of the bench, else that of BALLSCREW_DATA")
    given = parser.parse_args()
    print(heading("python -m benchmarks.determinism") + "\n")
    found = set()
    for index in range(given.times):
        with tempfile.TemporaryDirectory(prefix=f"{index} ä ") as name:
            digest, circumstances = analysed(given.bench or bench_folder(), Path(name), index)
        print(f"{digest}  {circumstances}", flush=True)
        found.add(digest)
    print(f"\n{len(found)} different")
    sys.exit(len(found) > 1)


if __name__ == "__main__":
    main()
