"""A run: one execution of a plan on an axis, analysed.  Turns into JSON and back."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain, read_json
from ballscrew.base.provenance import FileRef, Made
from ballscrew.base.quantity import Quantity
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.recording.quality.finding import Quality

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["CellResult", "RigidBodyResult", "Run", "SharedError", "TransientRow"]


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
        Of each of these that is known, by its name.
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
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TransientRow:
    """One transient: where it lies in which file, and what it is.

    Parameters
    ----------
    file : int
        Which of the run's files, from 0.
    start_s, stop_s : float
        Of the acceleration phase, from the file's first sample, s.
    position_m : float
        The stop, m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Which motion, from 0.
    repetition : int
        From 1; 0 for a phase that the record cuts.
    """

    file: int
    start_s: float
    stop_s: float
    position_m: float
    condition: str
    motion: int
    repetition: int


@dataclass(frozen=True, slots=True)
class CellResult:
    """The axial natural frequency of one cell.

    Parameters
    ----------
    position_m : float
        Nominal position of the stop, m.
    condition : str
        PA, PD, NA or ND.
    motion, repetitions : int
        Which motion, and how many transients were averaged.
    frequency_Hz, standard_uncertainty_Hz : float or None
        Undamped natural frequency of the first axial mode, rotor free; None where refused.
    damping_ratio : float or None
        None where the method cannot know it.
    method, verdict : str
        Verdict good, suspect or refused.
    reasons : tuple of str
        Why it is not good.
    coherence : float or None
        At the peak.
    band_Hz : tuple of float or None
        Where it was sought.
    uncertainty_terms_Hz : dict
        Parts of the standard uncertainty.
    rotor_held_frequency_Hz, rotor_held_standard_uncertainty_Hz : float or None
        The same mode with the rotor held, as Eq. (3) of the paper has it; None where it cannot be known.
    deviation_Hz, deviation_standard_uncertainty_Hz : float or None
        What this cell's own data say beyond the curve through all cells; None where a cell stands alone.
    """

    position_m: float
    condition: str
    motion: int
    repetitions: int
    frequency_Hz: float | None  # noqa: N815
    standard_uncertainty_Hz: float | None  # noqa: N815
    damping_ratio: float | None
    method: str
    verdict: str
    reasons: tuple[str, ...]
    coherence: float | None = None
    band_Hz: tuple[float, float] | None = None  # noqa: N815
    uncertainty_terms_Hz: dict[str, float] = field(default_factory=dict)  # noqa: N815
    rotor_held_frequency_Hz: float | None = None  # noqa: N815
    rotor_held_standard_uncertainty_Hz: float | None = None  # noqa: N815
    deviation_Hz: float | None = None  # noqa: N815
    deviation_standard_uncertainty_Hz: float | None = None  # noqa: N815


@dataclass(frozen=True, slots=True)
class SharedError:
    """One cause of error that cells of a run share: a standard normal number times its effect on each.

    Parameters
    ----------
    name : str
        The term of ``uncertainty_terms_Hz`` that it is a part of.
    repeats : bool
        Whether it acts alike in another run of the same plan, so that it cancels in a change.
    effects_Hz : tuple of float
        In the order of the run's cells; 0 where a cell is refused.
    """

    name: str
    repeats: bool
    effects_Hz: tuple[float, ...]  # noqa: N815  the unit's own letters


@dataclass(frozen=True)
class Run:
    """One execution of a plan on an axis, analysed.

    Parameters
    ----------
    id : str
        Hash of axis, plan, channel map, load, time, temperature and the files' hashes.
    axis : str or None
        Name of the axis.
    mass_kg : float or None
        Load on the table; None where nobody said.
    measured_at : str or None
        ISO 8601.
    temperature_C : float or None
        Of the axis.
    files : tuple of FileRef
        In the order given.
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
        What the cells' uncertainties have in common; what is left of a cell's variance is its own. Empty
        where the method does not say.
    mass_over_preload_kg_per_N : Quantity or None
        What the nut moves over its preload, as the softening under the test's own load tells it without the
        preload of a data sheet; None where it tells less than a data sheet's tolerance.
    lost_motion : tuple of LostMotion
        By stop, where a probe or a scale shows the table beside the motor.
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

    def to_json(self) -> dict[str, Any]:
        """The document that ``analyze --json`` prints."""
        rigid, over = asdict(self.rigid_body), self.mass_over_preload_kg_per_N
        document = {
            "schema": SCHEMA,
            "id": self.id,
            "run": {
                "axis": self.axis,
                "mass_kg": self.mass_kg,
                "measured_at": self.measured_at,
                "temperature_C": self.temperature_C,
                "files": [asdict(file) for file in self.files],
            },
            "quality": self.quality.to_json(),
            "rigid_body": rigid,
            "transients": [asdict(row) for row in self.transients],
            "cells": [asdict(cell) for cell in self.cells],
            "shared_errors": [asdict(error) for error in self.shared_errors],
            "mass_over_preload_kg_per_N": over.to_json() if over else None,
            "lost_motion": [asdict(row) for row in self.lost_motion],
            "made": asdict(self.made),
        }
        result: dict[str, Any] = plain(document)
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
            If a key is missing or of another kind.
        """
        try:
            head = document["run"]
            return cls(
                id=document["id"],
                axis=head["axis"],
                mass_kg=_number(head["mass_kg"]),
                measured_at=None if head["measured_at"] is None else str(head["measured_at"]),
                temperature_C=_number(head["temperature_C"]),
                files=tuple(FileRef(file["name"], file["sha256"]) for file in head["files"]),
                quality=Quality.from_json(document["quality"]),
                rigid_body=_fields(RigidBodyResult, document["rigid_body"]),
                transients=tuple(_fields(TransientRow, row) for row in document["transients"]),
                cells=tuple(_fields(CellResult, row) for row in document["cells"]),
                made=_fields(Made, document["made"]),
                shared_errors=tuple(_fields(SharedError, row) for row in document.get("shared_errors", ())),
                mass_over_preload_kg_per_N=_quantity(document.get("mass_over_preload_kg_per_N"), "kg/N"),
                lost_motion=tuple(_lost(row) for row in document.get("lost_motion", ())),
            )
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InputError(
                f"{source}: is not a run of ballscrew: {error!r} is missing or of another kind."
            ) from None

    @classmethod
    def read(cls, path: str | Path) -> Run:
        """Read what ``analyze --json`` printed."""
        return cls.from_json(read_json(path), Path(path).name)


def _number(value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"a number, where {str(value)[:40]!r} stands")
    return value


def _lost(row: dict[str, Any]) -> LostMotion:
    position, lost = _number(row["position_m"]), _number(row["lost_m"])
    spread, count = _number(row["standard_uncertainty_m"]), _number(row["repetitions"])
    if position is None or lost is None or count is None or (spread is not None and spread < 0):
        raise ValueError("lost_motion")
    return LostMotion(position, lost, math.nan if spread is None else spread, int(count))


def _quantity(row: dict[str, Any] | None, unit: str) -> Quantity | None:
    if not row:
        return None
    low, high = row["interval95"]
    return Quantity(row["value"], row["standard_uncertainty"], unit, (low, high))


def _fields(kind: type[Any], row: dict[str, Any]) -> Any:
    """Make a frozen result of the keys that it knows; lists become tuples."""
    known = kind.__dataclass_fields__
    return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in row.items() if k in known})
