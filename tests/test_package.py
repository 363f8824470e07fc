"""The package as it is imported: light, lazy, and whole."""

from __future__ import annotations

import importlib
import pkgutil
import re
import subprocess
import sys
from importlib.metadata import entry_points, metadata
from pathlib import Path
from zipfile import ZipFile

import pytest
import typer

import ballscrew
from ballscrew.cli.app import app

ROOT = Path(__file__).parents[1]
HEAVY = (
    "numpy",
    "scipy",
    "pandas",
    "xarray",
    "typer",
    "rich",
    "matplotlib",
    "pint",
    "h5py",
    "pyarrow",
    "click",
    "sqlalchemy",
)


def loaded_after(code: str) -> set[str]:
    """Which of the heavy libraries a fresh process has loaded after some code."""
    program = f"{code}\nimport sys\nprint(*sorted(set({HEAVY!r}) & set(sys.modules)))"
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=600
    )
    return set(done.stdout.splitlines()[-1].split())


def test_the_import_loads_nothing_heavy():
    assert loaded_after("import ballscrew") == set()


def test_the_probe_sees_what_is_loaded():
    assert "numpy" in loaded_after("import numpy")


def test_the_version_loads_nothing_heavy():
    code = "import sys; sys.argv = ['ballscrew', '--version']\nfrom ballscrew.__main__ import main\nmain()"
    assert loaded_after(code) == set()


def test_the_errors_load_nothing_heavy():
    assert loaded_after("from ballscrew import BallscrewError, InputError, MeasurementError") == set()


def test_an_analysis_loads_no_plotting_library():
    assert "matplotlib" not in loaded_after("from ballscrew import analyze")
    assert "typer" not in loaded_after("from ballscrew import analyze")


@pytest.mark.parametrize("name", ballscrew.__all__)
def test_every_public_name_is_there(name):
    assert getattr(ballscrew, name) is not None
    assert name in dir(ballscrew)


def test_a_command_is_a_function_of_the_same_name():
    commands = typer.main.get_command(app).commands
    assert len(commands) > 10
    for name in set(commands) - {"store", "token", "user", "report"}:  # methods of Store
        assert getattr(ballscrew, name).__name__ == name


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="has no attribute 'analyse'"):
        _ = ballscrew.analyse


def test_what_checkers_see_is_what_is_loaded():
    """The names under TYPE_CHECKING come from where they are loaded from."""
    source = Path(ballscrew.__file__).read_text(encoding="utf-8")
    for name, home in ballscrew._HOME.items():
        assert f"from ballscrew.{home} import {name} as {name}" in source


def test_the_version_is_the_distributions():
    assert metadata("ballscrew")["Version"] == ballscrew.__version__


def test_the_wheel_has_the_package_and_nothing_else(tmp_path):
    builders = pytest.importorskip("hatchling.builders.wheel")
    (path,) = builders.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    names = set(ZipFile(path).namelist())
    files = (ROOT / "src").rglob("*")
    modules = {
        f.relative_to(ROOT / "src").as_posix()
        for f in files
        if f.is_file() and f.suffix not in {".pyc", ".nbi", ".nbc", ".po"}
    }
    about = f"ballscrew-{ballscrew.__version__}.dist-info"
    assert names - modules == {
        f"{about}/{name}" for name in ("METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE")
    }
    assert modules - names == set()
    assert "ballscrew/py.typed" in names
    assert Path(path).stat().st_size < 2e6  # the package is text: 1.5 MB with pages and German


def test_parquet_and_pictures_are_extras():
    needed = [line for line in metadata("ballscrew").get_all("Requires-Dist") if "extra ==" not in line]
    names = {re.match(r"[\w-]+", line)[0].lower() for line in needed}
    assert len(names) == 11
    assert names.isdisjoint({"pyarrow", "matplotlib", "emcee"})


def test_every_module_can_be_imported_and_says_what_it_is_for():
    for module in pkgutil.walk_packages(ballscrew.__path__, "ballscrew."):
        loaded = importlib.import_module(module.name)
        assert loaded.__doc__, module.name


def test_the_console_script_and_the_readers_are_installed():
    (script,) = entry_points(group="console_scripts", name="ballscrew")
    assert script.load() is importlib.import_module("ballscrew.__main__").main
    assert {e.name for e in entry_points(group="ballscrew.readers")} >= {
        "hdf5",
        "mat",
        "parquet",
        "npz",
        "text",
    }
