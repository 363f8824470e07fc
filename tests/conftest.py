"""What all tests share: where the inputs lie that this project did not make."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# As the command line has it: a second thread on matrices this small costs time, and gains none.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).parent.parent

# A shared machine can be slow at any moment: no test has a time limit.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of foreign data, or a skip that says so."""
    folder = Path(os.environ.get("BALLSCREW_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}: set BALLSCREW_DATA to the folder that holds bench/ and emps/")
    return folder


@pytest.fixture(scope="session")
def bench(data: Path) -> Path:
    """The simulated bench with known truth."""
    return data / "bench"


@pytest.fixture(scope="session")
def emps(data: Path) -> Path:
    """The record of a real ball-screw drive."""
    return data / "emps"
