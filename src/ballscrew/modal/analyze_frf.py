"""Run of frequencies from broadband excitation, as a controller or a drive records it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import Made, digest
from ballscrew.base.units import parse_named
from ballscrew.base.words import plural
from ballscrew.modal.cell import CellResult, SharedError
from ballscrew.modal.excited_record import ExcitedRecord, Signals, check_rates, read_record
from ballscrew.modal.job import Files, Job
from ballscrew.modal.resonances import Resonances, resonances
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.recording import Recording

METHOD = "frf"
"""Name of the method in RUN.json."""

_CONDITION = "PA"  # a run states a condition; an excited table has none
_LONGEST = 30.0  # m: ball screws are shorter
_SAME_PLACE = 1e-3  # m, positions that differ by less are one cell
_SHARED = ("clock", "model")  # terms that repeat in every run


def analyze_frf(
    files: Files,
    input: str,  # noqa: A002
    output: str,
    *,
    reference: str | None = None,
    quantities: tuple[str | None, str | None] = (None, None),
    channels: str | Path | ChannelMap | None = None,
    axis: str | Path | DataSheet | None = None,
    position: float | str | Sequence[float | str] | None = None,
    mass: float | str | None = None,
    measured_at: str | datetime | None = None,
    band: tuple[float | str, float | str] | None = None,
) -> Run:
    """Estimate the axial natural frequency from noise, a chirp or sine steps that the drive added.

    Parameters
    ----------
    files : path-like, Recording or sequence of these
        Recordings; those at the same position are one cell.
    input, output : str
        Channels of the torque and of the motor's motion.
    reference : str, optional
        Channel of the excitation that was added to a set-point.
    quantities : tuple of str, optional
        Of input and output, where neither channel map nor names state them; see
        :func:`~ballscrew.modal.resonances.resonances`.
    channels : path-like or ChannelMap, optional
        Channel map; without one the channels are read as the file has them.
    axis : path-like or DataSheet, optional
        Data sheet, for its name and the ends of its screw.
    position : float or str, or sequence of these, optional
        Of the table, m, or with a unit: one for all files or one for each. By default the mean of the channel
        of the position.
    mass : float or str, optional
        Load on the table, kg.
    measured_at : str or datetime, optional
        ISO 8601; by default as the first file states it.
    band : tuple of (float or str), optional
        Range of frequencies that is fitted, Hz.

    Returns
    -------
    Run
        With a cell for each position, by method ``frf``.

    Raises
    ------
    InputError
        If a file has no such channel, the quantities or the position are not known, the position is not on
        the screw, or the signals are too short.
    """
    job = frf_job(files, channels, axis, mass, measured_at)
    places = () if position is None else listed_places(position)
    return examine_frf(job, Signals(input, output, reference, quantities), places, band)[0]


def listed_places(position: float | str | Sequence[float | str]) -> tuple[float, ...]:
    """Positions in m."""
    given = [position] if isinstance(position, float | int | str) else position
    places = tuple(parse_named("a position", place, "m") for place in given)
    for place in places:
        if abs(place) > _LONGEST:
            raise InputError(
                f'a position of {place:g} m was given; state the unit, such as "200 mm": a number without '
                f"one is in m, up to {_LONGEST:g} m."
            )
    return places


def frf_job(
    files: Files,
    channels: str | Path | ChannelMap | None,
    axis: str | Path | DataSheet | None,
    mass: float | str | None,
    measured_at: str | datetime | None,
) -> Job:
    """Job without plan, for which no channel map is required; parameters as :func:`analyze_frf`."""
    given = [files] if isinstance(files, str | Path | Recording) else files
    recordings = tuple(file if isinstance(file, Recording) else Path(file) for file in given)
    if not recordings:
        raise InputError("no file is given.")
    job = Job.read((), channels=channels, axis=axis, mass=mass, measured_at=measured_at)
    return replace(job, files=recordings)


def examine_frf(
    job: Job,
    signals: Signals,
    places: Sequence[float],
    band: tuple[float | str, float | str] | None,
) -> tuple[Run, list[tuple[float, Resonances]]]:
    """Run of a job, and position and result of each of its cells."""
    records = _records(job, signals)
    groups = _groups(records, places)
    if job.sheet is not None:
        for place, _ in groups:
            job.sheet.check_position(place)
    found = []
    for place, group in groups:
        found.append((place, len(group), _resonances(group, band)))
    cells = tuple(_cell(*each) for each in found)
    files = tuple(record.file for record in records)
    measured_at = job.measured_at or _time(records[0].started_at)
    settings = {
        "method": METHOD,
        "channels": signals.names,
        "quantities": list(records[0].quantities),
        "band": [parse_named("the band", limit, "Hz") for limit in band or ()],
        "positions": [cell.position_m for cell in cells],
    }
    run = Run(
        id=digest([job.identity(files, measured_at), settings]),
        axis=job.sheet.name if job.sheet else None,
        mass_kg=job.mass,
        measured_at=measured_at,
        temperature_C=None,
        files=files,
        quality=Quality("good"),
        rigid_body=RigidBodyResult(),
        transients=(),
        cells=cells,
        made=Made(settings=settings, inputs=job.inputs()),
        shared_errors=_shared_errors(cells),
    )
    return run, [(place, each) for place, _, each in found]


def _records(job: Job, signals: Signals) -> list[ExcitedRecord]:
    """Records of all files, which must be different and alike."""
    records = [read_record(file, signals, job.channels) for file in job.files]
    _check_alike(records)
    return records


def _resonances(records: Sequence[ExcitedRecord], band: tuple[float | str, float | str] | None) -> Resonances:
    """Resonances of the records of one position."""
    columns = [[*column] for column in zip(*(record.arrays for record in records), strict=True)]
    return resonances(
        columns[0],
        columns[1],
        records[0].rate,
        quantities=records[0].quantities,
        reference=columns[2] if len(columns) > 2 else None,
        band=band,
    )


def _check_alike(records: Sequence[ExcitedRecord]) -> None:
    """Refuse files that are the same, or of different rates or quantities."""
    first = records[0]
    if len({record.file.sha256 for record in records}) < len(records):
        raise InputError("a file is given twice.")
    for record in records[1:]:
        check_rates(record.file.name, [first.file.name, record.file.name], [first.rate, record.rate])
        if record.quantities != first.quantities:
            raise InputError(f"{record.file.name}: its quantities differ from those of {first.file.name}.")


def _groups(
    records: Sequence[ExcitedRecord], places: Sequence[float]
) -> list[tuple[float, list[ExcitedRecord]]]:
    """Records of each position, by rising position."""
    if len(places) not in (0, 1, len(records)):
        raise InputError(
            f"{plural(len(places), 'position')} given for {plural(len(records), 'file')}; give one, or one "
            "for each file."
        )
    placed = []
    for index, record in enumerate(records):
        place = record.position
        if places:
            place = places[index % len(places)]
        if place is None:
            raise InputError(
                f"{record.file.name}: the position of the table is not known; state it, such as "
                '--position "200 mm".'
            )
        placed.append((place, record))
    groups: list[tuple[float, list[ExcitedRecord]]] = []
    for place, record in sorted(placed, key=lambda pair: pair[0]):
        if groups and place - groups[-1][0] < _SAME_PLACE:
            groups[-1][1].append(record)
        else:
            groups.append((place, [record]))
    return groups


def _cell(place: float, count: int, found: Resonances) -> CellResult:
    """Cell of a position."""
    mode, rotor_held = found.resonance, found.antiresonance
    cell = CellResult(
        position_m=place,
        condition=_CONDITION,
        motion=0,
        repetitions=count,
        frequency_Hz=None,
        standard_uncertainty_Hz=None,
        damping_ratio=None,
        method=METHOD,
        verdict="refused",
        reasons=(),
        coherence=found.coherence,
        band_Hz=found.band,
    ).with_reasons(*mode.reasons)
    if rotor_held.frequency is not None:
        cell = replace(
            cell,
            rotor_held_frequency_Hz=rotor_held.frequency.value,
            rotor_held_standard_uncertainty_Hz=rotor_held.frequency.standard_uncertainty,
        )
    if mode.frequency is None or found.closed_loop:
        return cell
    return replace(
        cell,
        frequency_Hz=mode.frequency.value,
        standard_uncertainty_Hz=mode.frequency.standard_uncertainty,
        damping_ratio=mode.damping,
        verdict=mode.verdict,
        uncertainty_terms_Hz=mode.terms,
    )


def _shared_errors(cells: Sequence[CellResult]) -> tuple[SharedError, ...]:
    """Terms of the uncertainty that all cells have in common."""
    errors = []
    for name in _SHARED:
        effects = tuple(cell.uncertainty_terms_Hz.get(name, 0.0) for cell in cells)
        errors.append(SharedError(name, True, effects))
    return tuple(errors)


def _time(text: str | None) -> str | None:
    """Start time of a file, where it is one."""
    try:
        return datetime.fromisoformat(text or "").isoformat()
    except ValueError:
        return None
