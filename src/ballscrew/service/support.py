"""Support bundle: what helps to find a fault, without secrets, measurements and names of persons.

Everything in it is chosen by name: numbers and switches of the settings, numbers of rows, and of each line of
the log what the program itself wrote.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
import zipfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew._version import __version__
from ballscrew.base.errors import BallscrewError
from ballscrew.base.files import check_folder, replacing
from ballscrew.service.logs import read_log
from ballscrew.service.settings import PREFIX, ServerSettings
from ballscrew.store.folder import DataFolder
from ballscrew.store.opened import OpenStore
from ballscrew.store.service_tables import JobRow, Upload, all_tables
from ballscrew.store.tables import SCHEMA, ResultRow

_LINES = 2000  # of the log
_PACKAGES = (
    "ballscrew", "alembic", "argon2-cffi", "fastapi", "h5py", "httpx", "jinja2", "numba", "numpy", "pg8000",
    "pydantic", "scipy", "sqlalchemy", "starlette", "uvicorn", "zstandard",
)  # fmt: skip
_WORDS = ("method", "log", "working_days")  # settings whose texts are from a fixed list
_LINE = ("at", "level", "logger", "event", "request", "method", "route", "status", "ms", "error", "trace")
_VARIABLES = ("LANG", "LC_ALL", "TZ")  # whose values are shown


def write_bundle(folder: Path, settings: ServerSettings, origins: Mapping[str, str], to: Path) -> None:
    """Write a support bundle, whole or not at all.

    Parameters
    ----------
    folder : Path
        Data folder; it may be damaged, or contain no store.
    settings : ServerSettings
        Settings of the server.
    origins : mapping of str to str
        Where each comes from.
    to : Path
        ZIP file, replaced if it exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    check_folder(to)
    parts = {
        "versions.json": _versions(),
        "settings.json": _settings(settings, origins),
        "store.json": _store(folder),
        "environment.json": _environment(),
    }
    lines = [{name: line[name] for name in _LINE if name in line} for line in read_log(folder, _LINES)]
    with replacing(to) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as bundle:
        for name, document in parts.items():
            bundle.writestr(name, json.dumps(document, indent=1, sort_keys=True) + "\n")
        bundle.writestr("log.jsonl", "".join(json.dumps(line) + "\n" for line in lines))


def _versions() -> dict[str, Any]:
    packages = {}
    for name in _PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = "not installed"
    return {
        "ballscrew": __version__,
        "python": sys.version,
        "system": platform.platform(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "schema": SCHEMA,
        "packages": packages,
    }


def _settings(settings: ServerSettings, origins: Mapping[str, str]) -> dict[str, Any]:
    """Numbers, switches and words of a list; of other settings, whether they are set."""
    found: dict[str, Any] = {"on_loopback": settings.on_loopback}
    for name in ServerSettings.model_fields:
        value = getattr(settings, name)
        if isinstance(value, bool | int | float) or value is None or name in _WORDS:
            shown = value
        elif value:
            shown = "set"
        else:
            shown = "not set"
        origin = origins.get(name, "default")
        if origin not in ("default", "option") and not origin.startswith(PREFIX):
            origin = "file"
        found[name] = {"value": shown, "from": origin}
    return found


def _environment() -> dict[str, Any]:
    """Names of the variables of this program, and the language."""
    names = sorted(name for name in os.environ if name.startswith("BALLSCREW_"))
    return {"set": names, "values": {name: os.environ.get(name) for name in _VARIABLES}}


def _store(folder: Path) -> dict[str, Any]:
    """Numbers of rows and sizes; where the store cannot be read, the kind of the error."""
    place = DataFolder(folder)
    found: dict[str, Any] = {"exists": place.exists(), "checks": _checks(place)}
    if folder.is_dir():
        usage = shutil.disk_usage(folder)
        found["disk"] = {"total": usage.total, "free": usage.free}
    if not place.exists():
        return found
    if place.sqlite.is_file():
        found["sqlite_bytes"] = place.sqlite.stat().st_size
    found["is_served"], found["is_damaged"] = None, (folder / "damaged.txt").exists()
    try:
        found["is_served"] = place.is_served()
        store = OpenStore(folder)
        found["database"] = store.engine(writing=False).dialect.name
        with store.read() as session:
            found |= _counts(session)
    except BallscrewError as error:
        cause = error.__cause__ or error
        found["error"] = type(cause).__name__
    return found


def _checks(folder: DataFolder) -> dict[str, Any]:
    """Time and numbers of the last verification, and time of the last backup."""
    checks = folder.checks()
    found = {}
    for kind, names in (("verification", ("at", "faults", "files", "rows")), ("backup", ("at",))):
        if kind in checks:
            found[kind] = {name: checks[kind].get(name) for name in names}
    return found


def _counts(session: Session) -> dict[str, Any]:
    rows = {}
    for table in all_tables():
        rows[table.name] = session.scalar(select(func.count()).select_from(table))
    groups = {
        "uploads": select(Upload.status, func.count()).group_by(Upload.status),
        "results": select(ResultRow.verdict, func.count()).group_by(ResultRow.verdict),
        "jobs_set_aside": select(JobRow.kind, func.count()).where(JobRow.set_aside).group_by(JobRow.kind),
    }
    found: dict[str, Any] = {"rows": rows}
    for name, query in groups.items():
        found[name] = {str(key): number for key, number in session.execute(query)}
    return found
