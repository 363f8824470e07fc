"""RUN.toml: the files of one run, and all that must be said about them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.base.tomlfile import Fields, read_toml

__all__ = ["RunFile", "read_run", "timestamp"]

_FIELDS = ("axis", "plan", "channels", "load", "measured_at", "temperature", "files")


@dataclass(frozen=True, slots=True)
class RunFile:
    """What RUN.toml says; paths are taken from the folder that it lies in.

    Parameters
    ----------
    files : tuple of Path
        Recordings.
    channels : Path
        Channel map.
    axis, plan : Path or None
        Data sheet and plan.
    load : float or None
        On the table, kg.
    measured_at : str or None
        ISO 8601.
    temperature : float or None
        Of the axis, °C.
    """

    files: tuple[Path, ...]
    channels: Path
    axis: Path | None
    plan: Path | None
    load: float | None
    measured_at: str | None
    temperature: float | None


def read_run(path: str | Path) -> RunFile:
    """Read RUN.toml.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    RunFile
        With paths resolved against the file's own folder.

    Raises
    ------
    InputError
        If it is not TOML, or a field is missing, unknown or impossible.
    """
    fields = read_toml(path)
    fields.only(_FIELDS)
    folder = Path(path).parent
    names = fields.table.get("files")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) and n for n in names):
        raise fields.error("files", "a list of file names, one or more")
    axis, plan = fields.text("axis", None), fields.text("plan", None)
    kelvin = fields.quantity("temperature", "kelvin", None, least=0) if "temperature" in fields else None
    return RunFile(
        files=tuple(folder / name for name in names),
        channels=folder / fields.text("channels"),
        axis=folder / axis if axis else None,
        plan=folder / plan if plan else None,
        load=fields.quantity("load", "kg", None, least=0),
        measured_at=_time(fields),
        temperature=None if kelvin is None else kelvin - 273.15,
    )


def timestamp(text: str, where: str) -> str:
    """Check a time and return it in ISO 8601.

    Parameters
    ----------
    text : str
        ``"2026-01-31T08:00Z"``.
    where : str
        Where it stands, for the message.

    Returns
    -------
    str
        The same time, as :meth:`datetime.datetime.isoformat` writes it.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        return datetime.fromisoformat(text).isoformat()
    except (ValueError, TypeError):
        raise InputError(
            f"{where} is {text!r}; it must be a time in ISO 8601, such as 2026-01-31T08:00Z."
        ) from None


def _time(fields: Fields) -> str | None:
    value = fields.table.get("measured_at")
    if value is None:
        return None
    if isinstance(value, (datetime, date)):  # TOML has times of its own
        return value.isoformat()
    return timestamp(value, f"{fields.source}: measured_at")
