"""A run: one execution of a plan on an axis, analysed.  Turns into JSON and back."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballscrew.base import json_fields
from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import write_text
from ballscrew.base.jsonfile import SCHEMA, plain, read_json, write_json
from ballscrew.base.provenance import FileRef, Made
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import PlottedResult, first_sentences
from ballscrew.base.words import plural
from ballscrew.modal.cell import CellResult, SharedError, TransientRow
from ballscrew.modal.run_json import FIELDS
from ballscrew.recording.drive_input import DriveInput
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.recording.quality.clock import Clock
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.rotation import TableRotation
from ballscrew.recording.temperature import TemperatureCourse

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SOFTENING_SPREAD = 0.10
"""Relative uncertainty of mass over preload by the law of the softening and the nut's share.

No scatter of a run shows it: it repeats from run to run, the rest of a run's uncertainty is noise."""

_MOST_AWAY = 0.9  # of a frequency: further from the curve through all cells no peak is another cell's
_LEAST_SPREAD = 1e-6  # of a frequency: clocks of recorders err by more
_MOST_RATIO = 100.0  # of rotor-held to free frequency, or its inverse


@dataclass(frozen=True, slots=True)
class RigidBodyResult:
    """The axis below its modes, SI, referred to the table; None where it cannot be known.

    Parameters
    ----------
    equivalent_mass_kg : float or None
        Moving mass and rotating inertia, from the least-squares fit over the moving record.
    moving_mass_kg : float or None
        Table, nut and load: the equivalent mass less the rotor's, which takes a data sheet.
    viscous_N_s_per_m, coulomb_N, offset_N : float or None
        Friction.
    frf_equivalent_mass_kg : float or None
        The equivalent mass a second time, from the FRF below 30 Hz.
    standard_uncertainty : dict
        Of each of these that is known, by its name: of the value itself.
    repeatability : dict
        Standard uncertainty of fitted mass and friction for a comparison with another run of the same test.
    reasons : tuple of str
        Why a value is None.
    """

    equivalent_mass_kg: float | None = None
    moving_mass_kg: float | None = None
    viscous_N_s_per_m: float | None = None  # noqa: N815  the unit's own letters
    coulomb_N: float | None = None  # noqa: N815
    offset_N: float | None = None  # noqa: N815
    frf_equivalent_mass_kg: float | None = None
    standard_uncertainty: dict[str, float] = field(default_factory=dict)
    repeatability: dict[str, float] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class MotorRipple:
    """An unmeasured force that repeats with every turn of the screw, as a torque of the motor.

    Parameters
    ----------
    order : int
        Per turn of the screw.
    torque_Nm, standard_uncertainty_Nm : float or None
        Its amplitude; None if its standard uncertainty exceeds half of it, if the order stays well below the
        mode at full speed, if a neighbouring order was found too, or if mass or lead are not known.
    """

    order: int
    torque_Nm: float | None  # noqa: N815  the unit's own letters
    standard_uncertainty_Nm: float | None  # noqa: N815


@dataclass(frozen=True, slots=True)
class FrameMode:
    """Mode of the machine's frame or of the pitching table near the axial one, fitted with it.

    Parameters
    ----------
    frequency_Hz, standard_uncertainty_Hz : float
        Of the frame without the table.
    damping_ratio : float
        Of the frame.
    mass_ratio : float or None
        Mass of the frame that moves along the axis, over the moving mass; None for a table that pitches,
        and without an accelerometer at the nut.
    residual_ratio : float
        Rms residual of the fit with the frame over that without, the pitching mode being fitted in both.
    distinct : bool
        Whether the run shows which of the two modes is the axis.
    pitching : bool
        Whether the table pitches, by two accelerometers; if so, its frequency takes the frame's place.
    """

    frequency_Hz: float  # noqa: N815  the unit's own letters
    standard_uncertainty_Hz: float  # noqa: N815
    damping_ratio: float
    mass_ratio: float | None
    residual_ratio: float
    distinct: bool
    pitching: bool = False


@dataclass(frozen=True, repr=False)
class Run(PlottedResult):
    """One execution of a plan on an axis, analysed.

    Parameters
    ----------
    id : str
        Hash of axis, plan, channel map, load, time, temperature and the files' hashes.
    axis : str or None
        Name of the axis.
    mass_kg : float or None
        Load on the table; None where it was not given.
    measured_at : str or None
        ISO 8601.
    temperature_C : float or None
        Of the axis.
    files : tuple of FileRef
        By start time where every file has one, by SHA-256 otherwise; in the order given where the plan needs
        it, see :func:`~ballscrew.recording.motions.order_matters`.
    quality : Quality
        Verdict on the measurement.
    rigid_body : RigidBodyResult
        Masses and friction.
    transients : tuple of TransientRow
        In the order of time.
    cells : tuple of CellResult
        By position, condition, motion.
    made : Made
        Version and settings.
    frequency_response : Dataset, optional
        The table *FrequencyResponse*; not part of the JSON.
    shared_errors : tuple of SharedError
        Errors that cells share; the remainder of a cell's variance is independent of other cells. Empty
        where the method does not estimate them.
    mass_over_preload_kg_per_N : Quantity or None
        Moving mass over preload, estimated from the softening of the nut under the test's own load without
        the preload of a data sheet; None where the estimate is less certain than a data sheet's tolerance.
    lost_motion : tuple of LostMotion
        By stop, where a probe or a scale shows the table beside the motor.
    motor_ripple : tuple of MotorRipple
        Fitted with the mode, by order; empty if none is significant, or by the paper's method.
    frame_mode : FrameMode or None
        Mode of the frame or of the pitching table; None if none shows near the axial one, or by the paper's
        method.
    temperature : TemperatureCourse or None
        Over the run, where it was recorded.
    drive_input : DriveInput or None
        Channels that drove the axis; None where no recording was usable, and in older documents.
    table_rotation : tuple of TableRotation
        Pitch and yaw, where two accelerometers measure them.
    clock : Clock or None
        Sample rate against the plan's times; None where they do not determine it.
    source : str or None
        File that it was read from; not part of the JSON.
    """

    id: str
    axis: str | None
    mass_kg: float | None
    measured_at: str | None
    temperature_C: float | None  # noqa: N815
    files: tuple[FileRef, ...]
    quality: Quality
    rigid_body: RigidBodyResult
    transients: tuple[TransientRow, ...]
    cells: tuple[CellResult, ...]
    made: Made
    frequency_response: xr.Dataset | None = field(default=None, compare=False, repr=False)
    shared_errors: tuple[SharedError, ...] = ()
    mass_over_preload_kg_per_N: Quantity | None = None  # noqa: N815
    lost_motion: tuple[LostMotion, ...] = ()
    motor_ripple: tuple[MotorRipple, ...] = ()
    frame_mode: FrameMode | None = None
    temperature: TemperatureCourse | None = None
    drive_input: DriveInput | None = None
    table_rotation: tuple[TableRotation, ...] = ()
    clock: Clock | None = None
    source: str | None = field(default=None, compare=False, repr=False)

    @property
    def name(self) -> str:
        """File that it was read from, or the beginning of its id, for messages."""
        return self.source or f"run {shown(self.id[:12])[1:-1]}"

    _drawing = "run_figure:draw_frequencies"

    def _lines(self) -> list[str]:
        title = self.axis or "axis without a name"
        if self.mass_kg is not None:
            title += f" with {self.mass_kg:g} kg"
        if self.measured_at:
            title += f", {self.measured_at}"
        verdicts = Counter(cell.verdict for cell in self.cells)
        counts = ", ".join(f"{verdicts[name]} {name}" for name in ("good", "suspect", "refused"))
        lines = [f"{title}: the measurement is {self.quality.verdict}"]
        lines.append(f"{plural(len(self.cells), 'cell')}: {counts}")
        found = [cell.frequency_Hz for cell in self.cells if cell.frequency_Hz is not None]
        if found:
            lines.append(f"natural frequency {min(found):.1f} to {max(found):.1f} Hz")
        return lines + first_sentences(self.quality.reasons)

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the cells, with the names of the JSON's keys; a column for each limit and term."""
        import pandas as pd

        table = pd.DataFrame(list(map(asdict, self.cells)), columns=[row.name for row in fields(CellResult)])
        for name in ("reasons", "reason_kinds"):
            table[name] = table[name].map("; ".join)
        for index, name in enumerate(("band_low_Hz", "band_high_Hz")):
            table[name] = [None if cell.band_Hz is None else cell.band_Hz[index] for cell in self.cells]
        for term in dict.fromkeys(chain.from_iterable(cell.uncertainty_terms_Hz for cell in self.cells)):
            table[f"uncertainty_{term}_Hz"] = [cell.uncertainty_terms_Hz.get(term) for cell in self.cells]
        return table.drop(columns=["band_Hz", "uncertainty_terms_Hz"])

    def to_json(self, digits: int = 9) -> dict[str, Any]:
        """The document that ``analyze --json`` prints.

        Parameters
        ----------
        digits : int
            Significant digits of its numbers; with 17, they are those of the run.
        """
        over = self.mass_over_preload_kg_per_N
        document = {
            "schema": SCHEMA,
            "id": self.id,
            "run": {
                "axis": self.axis,
                "mass_kg": self.mass_kg,
                "measured_at": self.measured_at,
                "temperature_C": self.temperature_C,
                "temperature": self.temperature,
                "files": self.files,
                "drive_input": self.drive_input,
            },
            "quality": self.quality.to_json(),
            "rigid_body": self.rigid_body,
            "transients": self.transients,
            "cells": self.cells,
            "shared_errors": self.shared_errors,
            "mass_over_preload_kg_per_N": over.to_json() if over else None,
            "lost_motion": self.lost_motion,
            "motor_ripple": self.motor_ripple,
            "frame_mode": self.frame_mode,
            "table_rotation": self.table_rotation,
            "clock": self.clock,
            "made": self.made,
        }
        result: dict[str, Any] = plain(document, digits)
        return result

    @classmethod
    def from_json(cls, document: dict[str, Any], source: str = "RUN.json") -> Run:
        """Read the document back.

        Parameters
        ----------
        document : dict
            As :meth:`to_json` makes it; keys that a later version added are passed over.
        source : str
            Its name, for messages.

        Returns
        -------
        Run
            Without its frequency response.

        Raises
        ------
        InputError
            If a key is missing, of another kind or beyond what a machine can have.
        """
        try:
            return _read(cls, document)
        except InputError as error:
            raise InputError(f"{source}: is not a run of ballscrew: {error}") from None

    @classmethod
    def read(cls, path: str | Path) -> Run:
        """Read what ``analyze --json`` printed."""
        return replace(cls.from_json(read_json(path), str(path)), source=str(path))

    @classmethod
    def of(cls, given: Run | str | Path) -> Run:
        """A run as given, or read from its path."""
        return given if isinstance(given, Run) else cls.read(given)

    def __hash__(self) -> int:
        """Equal runs have equal identities."""
        return hash(self.id)

    def write(self, path: str | Path) -> None:
        """Write what ``analyze --json`` prints; an existing file is replaced whole."""
        write_text(path, write_json(self.to_json()) + "\n")


def _read(kind: type[Run], document: Any) -> Run:
    anything = json_fields.mapping(json_fields.anything)
    contents: dict[str, json_fields.Field] = {
        "id": json_fields.text(),
        "run": anything,
        "quality": anything,
        "rigid_body": _row(RigidBodyResult),
        "transients": json_fields.listed(_row(TransientRow)),
        "cells": json_fields.listed(_cell),
        "made": _row(Made),
        "shared_errors": json_fields.listed(_row(SharedError)),
        "mass_over_preload_kg_per_N": json_fields.quantity(1e-9, 1e6, unit="kg/N"),
        "lost_motion": json_fields.listed(_lost),
        "motor_ripple": json_fields.listed(_ripple),
        "frame_mode": _frame_mode,
        "table_rotation": json_fields.listed(_row(TableRotation)),
        "clock": json_fields.optional(_row(Clock)),
    }
    values = json_fields.fields(contents, document, "", required=tuple(contents)[:7])
    head = {name: FIELDS[name] for name in ("axis", "mass_kg", "measured_at", "temperature_C")}
    head["files"] = json_fields.listed(_row(FileRef))
    required = tuple(head)
    head["temperature"] = json_fields.optional(_row(TemperatureCourse))
    head["drive_input"] = json_fields.optional(_row(DriveInput))
    circumstances = json_fields.fields(head, values.pop("run"), "run", required=required)
    quality = Quality.from_json(values.pop("quality"))
    return kind(quality=quality, **circumstances, **values)


def _row(kind: type[Any]) -> json_fields.Field:
    """Reader of a dataclass from an object with its fields; fields without a default are required."""
    needed = []
    for name, definition in kind.__dataclass_fields__.items():
        if definition.default is MISSING and definition.default_factory is MISSING:
            needed.append(name)
    kinds = {name: FIELDS[name] for name in kind.__dataclass_fields__}
    return lambda row, where: kind(**json_fields.fields(kinds, row, where, tuple(needed)))


def _lost(row: Any, where: str) -> Any:
    """Lost motion, whose uncertainty is null in JSON where it is NaN."""
    lost = _row(LostMotion)(row, where)
    if lost.standard_uncertainty_m is None:
        return replace(lost, standard_uncertainty_m=math.nan)
    return lost


def _ripple(row: Any, where: str) -> Any:
    """An order from 1 on, with a size and its uncertainty or with neither."""
    values = _row(MotorRipple)(row, where)
    if values.order < 1:
        raise json_fields.wrong(values.order, f"{where}.order", "1 or more")
    if (values.torque_Nm is None) != (values.standard_uncertainty_Nm is None):
        raise json_fields.wrong(None, f"{where}.standard_uncertainty_Nm", "beside torque_Nm, or neither")
    return values


def _frame_mode(row: Any, where: str) -> Any:
    """A mode of the frame with a frequency, or null."""
    if row is None:
        return None
    mode = _row(FrameMode)(row, where)
    for name in ("frequency_Hz", "standard_uncertainty_Hz", "damping_ratio"):
        if getattr(mode, name) is None:
            raise json_fields.wrong(None, f"{where}.{name}", "a number")
    return mode


def _check_spread(cell: CellResult, where: str) -> None:
    f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
    if f is not None and u is not None and u < _LEAST_SPREAD * f:
        allowed = f"at least {_LEAST_SPREAD:g} of frequency_Hz"
        raise json_fields.wrong(u, f"{where}.standard_uncertainty_Hz", allowed)


def _cell(row: Any, where: str) -> Any:
    """A cell whose numbers are consistent with each other."""
    cell = _row(CellResult)(row, where)
    f, away, rotor_held = cell.frequency_Hz, cell.deviation_Hz, cell.rotor_held_frequency_Hz
    if f is not None and away is not None and not abs(away) <= _MOST_AWAY * f:
        raise json_fields.wrong(away, f"{where}.deviation_Hz", f"less than {_MOST_AWAY:g} of frequency_Hz")
    if f is not None and rotor_held is not None and not f / _MOST_RATIO <= rotor_held <= f * _MOST_RATIO:
        raise json_fields.wrong(
            rotor_held, f"{where}.rotor_held_frequency_Hz", f"within {_MOST_RATIO:g} times frequency_Hz"
        )
    _check_spread(cell, where)
    if cell.reason_kinds and len(cell.reason_kinds) != len(cell.reasons):
        raise json_fields.wrong(list(cell.reason_kinds), f"{where}.reason_kinds", "one for each reason")
    return cell
