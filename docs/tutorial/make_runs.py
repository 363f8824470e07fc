"""Simulate six tests of one axis whose nut wears: a folder axis-1/DATE with run.toml and recordings for each.

Usage: python make_runs.py

Uses axis.toml and plan.toml of the first part. Nothing is measured; truth.json in each folder contains the
true values.
"""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import ballscrew

PRELOADS = (680, 680, 680, 650, 580, 510)  # N; the data sheet's is 680 N
FIRST, EVERY = datetime(2026, 1, 5, 6, tzinfo=UTC), timedelta(days=4)


def simulate(folder: Path) -> None:
    """Simulate the tests, each in a folder named by its date."""
    for number, preload in enumerate(PRELOADS):
        time = FIRST + number * EVERY
        files = ballscrew.simulate(
            "plan.toml",
            axis="axis.toml",
            out=folder / f"{time:%Y-%m-%d}",
            preload=f"{preload} N",
            seed=number,
        )
        with files.run.open("a", encoding="utf-8") as run:
            run.write(f'measured_at = {time:%Y-%m-%dT%H:%M:%SZ}\ntemperature = "21 degC"\n')


if __name__ == "__main__":
    simulate(Path("axis-1"))
