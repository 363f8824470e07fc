"""What is to be analysed: the files of a run, and all that is said about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ballscrew.axis.sheet import DataSheet, read_axis
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, digest
from ballscrew.base.units import parse
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.modal.runfile import RunFile, read_run, timestamp
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.motions import order_matters

__all__ = ["Files", "Job"]

Files = str | Path | Sequence[str | Path]


@dataclass(frozen=True)
class Job:
    """Files of a run with the axis, the plan, the channel map and the circumstances.

    Parameters
    ----------
    files : tuple of Path
        Recordings.
    channels : ChannelMap
        What each channel is.
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
    """

    files: tuple[Path, ...]
    channels: ChannelMap
    sheet: DataSheet | None
    plan: Plan | None
    mass: float | None
    measured_at: str | None
    temperature: float | None

    @classmethod
    def of(
        cls,
        files: Files,
        channels: str | Path | ChannelMap | None,
        axis: str | Path | DataSheet | None,
        plan: str | Path | Plan | None,
        mass: str | float | None,
        measured_at: str | None,
        temperature: str | float | None,
    ) -> Job:
        """Read all files about the run; what is given by hand goes before what RUN.toml says.

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
            If one of them is wrong, or the load of an axis is not said.
        """
        paths = [Path(files)] if isinstance(files, (str, Path)) else [Path(file) for file in files]
        said = _said(paths)
        channels = channels if channels is not None else said.channels
        if channels is None:
            raise InputError(
                "no channel map is given (--channels); 'ballscrew init FILES' writes one to fill in."
            )
        axis, plan = (axis if axis is not None else said.axis), (plan if plan is not None else said.plan)
        sheet = axis if axis is None or isinstance(axis, DataSheet) else read_axis(axis)
        test = plan if plan is None or isinstance(plan, Plan) else read_plan(plan)
        return cls(
            files=said.files,
            channels=channels if isinstance(channels, ChannelMap) else read_channels(channels),
            sheet=sheet,
            plan=test,
            mass=_load(said.load if mass is None else _parsed(mass, "kg", "the load (--mass)"), sheet, test),
            measured_at=timestamp(measured_at, "--measured-at") if measured_at else said.measured_at,
            temperature=said.temperature
            if temperature is None
            else _parsed(temperature, "kelvin", "the temperature") - 273.15,
        )

    def identity(self, files: Sequence[FileRef], measured_at: str | None) -> str:
        """The run's id: the hash of all that was said of it, and of its files' hashes."""
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
        """Digests of axis, plan and channel map, as far as they were given."""
        return {
            name: digest(document) for name, document in self._documents().items() if document is not None
        }

    def _documents(self) -> dict[str, Any]:
        return {
            "axis": self.sheet.to_settings() if self.sheet else None,
            "plan": self.plan.to_settings() if self.plan else None,
            "channels": self.channels.to_settings(),
        }


@dataclass(frozen=True, slots=True)
class _Nothing:
    """What is said where there is no RUN.toml."""

    files: tuple[Path, ...]
    channels: Path | None = None
    axis: Path | None = None
    plan: Path | None = None
    load: float | None = None
    measured_at: str | None = None
    temperature: float | None = None


def _said(paths: Sequence[Path]) -> RunFile | _Nothing:
    tomls = [path for path in paths if path.suffix.lower() == ".toml"]
    if not tomls:
        return _Nothing(tuple(paths))
    if len(paths) > 1:
        raise InputError(f"{tomls[0]}: a RUN.toml names its files itself; give it alone.")
    return read_run(tomls[0])


def _parsed(value: str | float, unit: str, what: str) -> float:
    try:
        return parse(value, unit)
    except InputError as error:
        raise InputError(f"{what} is {value!r}: {error}.") from None


def _load(given: float | None, sheet: DataSheet | None, plan: Plan | None) -> float | None:
    """The load: as said, or the plan's where it has one only; an axis cannot do without."""
    if given is not None:
        if given < 0:
            raise InputError(f"the load on the table (--mass) is {given:g} kg; it must be 0 kg or more.")
        return given
    if plan is not None and len(plan.masses) == 1:
        return plan.masses[0]
    if sheet is not None:
        raise InputError('what lies on the table is not said; give the load, such as --mass "0 kg".')
    return None
