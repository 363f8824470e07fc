"""Input of an analysis: the files of a run with axis, plan, channel map and circumstances."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path
from typing import Any, TypeVar, cast

from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.base.files import open_regular
from ballscrew.base.provenance import FileRef, digest
from ballscrew.base.settings import timestamp
from ballscrew.base.tomlfile import Fields, read_toml
from ballscrew.base.units import parse_named
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.motions import order_matters
from ballscrew.recording.recording import Recording
from ballscrew.recording.temperature import POSSIBLE

File = str | Path | Recording
Files = File | Sequence[File]
_Document = TypeVar("_Document", DataSheet, Plan, ChannelMap)

_FIELDS = ("axis", "plan", "channels", "load", "measured_at", "temperature", "files")
_KELVIN = 273.15  # of 0 °C


@dataclass(frozen=True)
class Job:
    """Files of a run with the axis, the plan, the channel map and the circumstances.

    Parameters
    ----------
    files : tuple of Path or Recording
        Recordings.
    channels : ChannelMap or None
        Quantity, place and unit of each channel of a file; None where there are none.
    sheet : DataSheet or None
        The axis.
    plan : Plan or None
        The test.
    mass : float or None
        Load on the table, kg.
    measured_at : str or None
        ISO 8601.
    temperature : float or None
        °C.
    documents : tuple of Path
        Files that were read besides the recordings.
    """

    files: tuple[Path | Recording, ...]
    channels: ChannelMap | None
    sheet: DataSheet | None
    plan: Plan | None
    mass: float | None
    measured_at: str | None
    temperature: float | None
    documents: tuple[Path, ...] = ()

    @property
    def inputs_read(self) -> tuple[Path, ...]:
        """All files that the analysis reads."""
        recordings = [file for file in self.files if isinstance(file, Path)]
        return (*self.documents, *recordings)

    @classmethod
    def read(
        cls,
        files: Files,
        *,
        channels: str | Path | ChannelMap | None = None,
        axis: str | Path | DataSheet | None = None,
        plan: str | Path | Plan | None = None,
        mass: str | float | None = None,
        measured_at: str | datetime | None = None,
        temperature: str | float | None = None,
    ) -> Job:
        """Read all files about the run; options override RUN.toml.

        Parameters
        ----------
        files, channels, axis, plan, mass, measured_at, temperature
            As for :func:`~ballscrew.modal.analyze.analyze`.

        Returns
        -------
        Job
            With everything but the recordings read.

        Raises
        ------
        InputError
            If one of them is wrong, or an axis is given without the load.
        """
        listed = _listed(files)
        stated = _stated(listed)
        sheet = _resolve(axis, stated.axis, DataSheet, read_axis)
        test = _resolve(plan, stated.plan, Plan, read_plan)
        channel_map = _resolve(channels, stated.channels, ChannelMap, read_channels)
        if channel_map is None and not all(isinstance(file, Recording) for file in stated.files):
            _check_readable(stated.files)
            raise InputError(
                "no channel map is given (--channels); 'ballscrew init FILES' writes one to fill in."
            )
        load = stated.load
        if mass is not None:
            load = parse_named("the load (mass)", mass, "kg")
        celsius = stated.temperature
        if temperature is not None:
            celsius = _celsius(parse_named("the temperature", temperature, "kelvin"), "the temperature")
        return cls(
            files=stated.files,
            channels=channel_map,
            sheet=sheet,
            plan=test,
            mass=_load(load, sheet, test),
            measured_at=timestamp(measured_at, "measured_at") if measured_at else stated.measured_at,
            temperature=celsius,
            documents=_paths(*listed, axis or stated.axis, plan or stated.plan, channels or stated.channels),
        )

    def identity(self, files: Sequence[FileRef], measured_at: str | None) -> str:
        """The run's id: the hash of its circumstances and of its files' hashes."""
        hashes = [file.sha256 for file in files]
        if not order_matters(self.plan):
            hashes.sort()
        return digest(
            {
                **self._documents(),
                "mass_kg": self.mass,
                "measured_at": measured_at,
                "temperature_C": self.temperature,
                "files": hashes,
            }
        )

    def inputs(self) -> dict[str, str]:
        """Digests of axis, plan and channel map, if given."""
        documents = self._documents().items()
        return {name: digest(document) for name, document in documents if document is not None}

    def _documents(self) -> dict[str, Any]:
        return {
            "axis": self.sheet.to_settings() if self.sheet else None,
            "plan": self.plan.to_settings() if self.plan else None,
            "channels": self.channels.to_settings() if self.channels else None,
        }


def _listed(files: Files) -> list[File]:
    """Files as a list; refuses arrays and tables, whose elements are no files."""
    if isinstance(files, str | Path | Recording):
        return [files]
    if isinstance(files, Iterable) and not hasattr(files, "keys"):
        listed = list(files)
        if all(isinstance(each, str | Path | Recording) for each in listed):
            return listed
    raise InputError(
        "the recordings of a run are paths or Recordings; ballscrew.Recording.from_arrays(torque=..., "
        "position=..., sample_rate=...) makes a Recording of arrays."
    )


def _paths(*given: object) -> tuple[Path, ...]:
    """The paths among what was given."""
    return tuple(Path(value) for value in given if isinstance(value, str | Path))


def _check_readable(files: Sequence[Path | Recording]) -> None:
    for file in files:
        if isinstance(file, Path):
            open_regular(file).close()


def _resolve(
    given: str | Path | _Document | None,
    stated: Path | None,
    kind: type[_Document],
    read: Callable[[str | Path], _Document],
) -> _Document | None:
    """Document given as an option, or else by RUN.toml, read if it is a path; None if there is neither."""
    value = stated if given is None else given
    if value is None or isinstance(value, kind):
        return value
    return read(cast("str | Path", value))


def _load(given: float | None, sheet: DataSheet | None, plan: Plan | None) -> float | None:
    """The load as given, or the plan's if it has one only; an axis requires it."""
    if given is not None:
        if given < 0:
            raise InputError(f"the load on the table (mass) is {given:g} kg; it must be 0 kg or more.")
        return given
    if plan is not None and len(plan.masses) == 1:
        return plan.masses[0]
    if sheet is not None:
        raise InputError('the load on the table is not stated; give it, such as --mass "0 kg".')
    return None


@dataclass(frozen=True, slots=True)
class RunFile:
    """Content of RUN.toml; paths are relative to its folder.

    Parameters
    ----------
    files : tuple of Path or Recording
        Recordings; of a RUN.toml, files.
    channels, axis, plan : Path or None
        Channel map, data sheet and plan; a RUN.toml always has the first.
    load : float or None
        On the table, kg.
    measured_at : str or None
        ISO 8601.
    temperature : float or None
        Of the axis, °C.
    """

    files: tuple[Path | Recording, ...]
    channels: Path | None = None
    axis: Path | None = None
    plan: Path | None = None
    load: float | None = None
    measured_at: str | None = None
    temperature: float | None = None


def _stated(files: Sequence[File]) -> RunFile:
    """Content of RUN.toml, or the recordings alone."""
    recordings = [file if isinstance(file, Recording) else Path(file) for file in files]
    run_files = [each for each in recordings if isinstance(each, Path) and each.suffix.lower() == ".toml"]
    if not run_files:
        return RunFile(tuple(recordings))
    if len(recordings) > 1:
        raise InputError(f"{run_files[0]}: a RUN.toml names its files itself; give it alone.")
    return read_run(run_files[0])


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
    celsius = None
    if "temperature" in fields:
        celsius = _celsius(fields.quantity("temperature", "kelvin", None, least=0), f"{path}: temperature")
    return RunFile(
        files=tuple(folder / name for name in names),
        channels=folder / fields.text("channels"),
        axis=folder / axis if axis else None,
        plan=folder / plan if plan else None,
        load=fields.quantity("load", "kg", None, least=0),
        measured_at=_time(fields),
        temperature=celsius,
    )


def _celsius(kelvin: float, where: str) -> float:
    """Temperature of an axis in °C; ``where`` is its name in a message."""
    celsius = kelvin - _KELVIN
    low, high = POSSIBLE
    if not low <= celsius <= high:
        raise InputError(
            f"{where} is {celsius:g} °C; it must be between {low:g} and {high:g} °C. A number without a unit "
            'is in kelvin: state the unit, such as "21 degC".'
        )
    return celsius


def _time(fields: Fields) -> str | None:
    value = fields.table.get("measured_at")
    if value is None:
        return None
    if isinstance(value, datetime | date):  # TOML has times of its own
        return value.isoformat()
    return timestamp(value, f"{fields.source}: measured_at")
