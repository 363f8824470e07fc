"""The main job: from the files of a run to its axial natural frequencies."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress
from ballscrew.base.provenance import Made
from ballscrew.base.threads import single_threaded
from ballscrew.fcft.plan import Plan
from ballscrew.modal.cells import identify_cells
from ballscrew.modal.excited import excited
from ballscrew.modal.job import Files, Job
from ballscrew.modal.joint.settings import JointSettings, Response
from ballscrew.modal.masses import rigid_body_result
from ballscrew.modal.ml import Identified, identify_ml, keeping
from ballscrew.modal.motor_ripple import motor_ripple
from ballscrew.modal.paper import highest_line
from ballscrew.modal.run import CellResult, Run, TransientRow
from ballscrew.modal.settings import PaperSettings
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.measure import measure
from ballscrew.recording.quality.finding import Quality

__all__ = ["METHODS", "Analysis", "analyze", "examine", "highest", "quality"]

METHODS = ("joint", "paper")


@dataclass(frozen=True, eq=False)
class Analysis:
    """A run, and what it was made from.

    Parameters
    ----------
    run : Run
        The result.
    paper : tuple of CellResult
        The same cells by the paper's method; without frequencies where it was not compared.
    transients : Dataset or None
        The table *Transients*, thinned to :func:`highest`; None where no recording could be used.
    """

    run: Run
    paper: tuple[CellResult, ...]
    transients: xr.Dataset | None


def analyze(
    files: Files,
    *,
    channels: str | Path | ChannelMap | None = None,
    axis: str | Path | DataSheet | None = None,
    plan: str | Path | Plan | None = None,
    mass: str | float | None = None,
    measured_at: str | None = None,
    temperature: str | float | None = None,
    method: str = "joint",
    response: Response = "both",
    settings: PaperSettings | None = None,
    joint: JointSettings | None = None,
    progress: Progress | None = None,
) -> Run:
    """Analyse the files of one run: quality, masses, transients, natural frequencies.

    Parameters
    ----------
    files : path-like or sequence of path-like
        Recordings, usually one a round trip; or one RUN.toml, which names files and all else. What is given
        here as well goes before what RUN.toml says.
    channels : path-like or ChannelMap
        What each channel of the files is.
    axis : path-like or DataSheet, optional
        The axis; without it there is no band to look in and no torque in newtons.
    plan : path-like or Plan, optional
        The test; without it stops and speeds are found by clustering, and nothing is known to be missing.
    mass : str or float, optional
        Load on the table, ``"100 kg"``, a bare number in kg; by default the plan's, where it has one only.
    measured_at : str, optional
        ISO 8601; by default the start time of the first file.
    temperature : str or float, optional
        Of the axis, ``"23 degC"``, a bare number in kelvin.
    method : {"joint", "paper"}
        How the natural frequency is found: all cells of the run as one, or each from the peak of its FRF.
    response : {"both", "nut", "motor"}
        What answers to the torque by method ``joint``: accelerometers at the nut, the motor by its encoder,
        or what the channels allow.
    settings : PaperSettings, optional
        Settings of the FRFs and of method ``paper``.
    joint : JointSettings, optional
        Settings of method ``joint``.
    progress : callable, optional
        Called with how many files are done, how many there are, and which comes next.

    Returns
    -------
    Run
        Where the measurement is bad, every cell is refused.

    Raises
    ------
    InputError
        If a file, the channel map, the plan or a setting is wrong.

    Examples
    --------
    >>> run = analyze("run.toml")  # doctest: +SKIP
    >>> [(c.position_m, c.condition, c.frequency_Hz) for c in run.cells]  # doctest: +SKIP
    """
    job = Job.of(files, channels, axis, plan, mass, measured_at, temperature)
    return examine(
        job, method=method, response=response, settings=settings, joint=joint, progress=progress
    ).run


@single_threaded
def examine(
    job: Job,
    *,
    method: str = "joint",
    response: Response = "both",
    settings: PaperSettings | None = None,
    joint: JointSettings | None = None,
    compared: bool = False,
    progress: Progress | None = None,
) -> Analysis:
    """As :func:`analyze`, and keep what the result was made from.

    Parameters
    ----------
    job : Job
        What is to be analysed.
    method, response, settings, joint, progress
        As for :func:`analyze`.
    compared : bool
        Whether the paper's method is followed to its end beside another one.

    Returns
    -------
    Analysis
        The run and its transients.

    Raises
    ------
    InputError
        If a file, the channel map, the plan or a setting is wrong.
    """
    if method not in METHODS:
        raise InputError(f"the method is {method!r}; it must be one of {', '.join(METHODS)}.")
    settings = settings or PaperSettings()
    load = job.mass
    told = job.sheet if settings.band is None else None
    searched = _searched(joint or JointSettings(), settings)
    measurement = measure(
        job.files,
        job.channels,
        sheet=job.sheet,
        plan=job.plan,
        mass=job.mass,
        extract=keeping(told, load or 0.0, searched) if method == "joint" else None,
        top=highest(job.sheet, load or 0.0, settings),
        progress=progress,
    )
    paper, table = identify_cells(
        measurement.transients,
        measurement.quality,
        job.sheet,
        job.plan,
        load or 0.0,
        settings,
        spectra_alone=method == "joint" and not compared,
    )
    made: dict[str, Any] = {"method": method, **settings.to_settings()}
    found = Identified(paper)
    if method == "joint":
        if progress:
            progress(len(job.files), len(job.files), "fitting all cells as one")
        found = identify_ml(measurement, paper, table, told, load or 0.0, searched, response)
        made |= {"response": response, "joint": asdict(searched)}
    measured = job.measured_at or measurement.started_at
    body = rigid_body_result(measurement, job.sheet, load or 0.0)
    run = Run(
        id=job.identity(measurement.files, measured),
        axis=job.sheet.name if job.sheet else None,
        mass_kg=load,
        measured_at=measured,
        temperature_C=job.temperature,
        files=measurement.files,
        quality=measurement.quality,
        rigid_body=body,
        transients=_rows(measurement.transients),
        cells=excited(found.cells, job.plan) if method == "joint" else found.cells,
        made=Made(made, inputs=job.inputs()),
        shared_errors=found.shared_errors,
        mass_over_preload_kg_per_N=found.mass_over_preload,
        lost_motion=measurement.lost_motion,
        motor_ripple=motor_ripple(found.pushes, body, job.sheet),
        frequency_response=table,
    )
    return Analysis(run, paper, measurement.transients)


def quality(
    files: Files,
    *,
    channels: str | Path | ChannelMap | None = None,
    axis: str | Path | DataSheet | None = None,
    plan: str | Path | Plan | None = None,
    mass: str | float | None = None,
    progress: Progress | None = None,
) -> Quality:
    """Say whether the files of a run are a good measurement.

    Parameters
    ----------
    files, channels, axis, plan, mass, progress
        As for :func:`analyze`; the more is given, the more can be checked.

    Returns
    -------
    Quality
        good, suspect or bad, with the reasons in words.

    Raises
    ------
    InputError
        If a file, the channel map or the plan is wrong.
    """
    job = Job.of(files, channels, axis, plan, mass, None, None)
    return measure(
        job.files, job.channels, sheet=job.sheet, plan=job.plan, mass=job.mass, progress=progress
    ).quality


def highest(sheet: DataSheet | None, load: float, settings: PaperSettings) -> float:
    """Highest frequency that is wanted of the transients, Hz.

    Parameters
    ----------
    sheet : DataSheet or None
        Says where modes are expected: the highest one where the table is next to the thrust bearing.
    load : float
        On the table, kg.
    settings : PaperSettings
        May name a band.

    Returns
    -------
    float
        Up to there the spectra of every cell are told.
    """
    if settings.band is not None or sheet is None:
        return highest_line(settings.band)
    places = (0.0, sheet.travel_limit)
    mode = max(float(predicted_frequency(sheet, place, load)) for place in places)
    return highest_line((0.0, mode * (1 + settings.band_half_width)))


def _searched(joint: JointSettings, settings: PaperSettings) -> JointSettings:
    """A band that was asked for says where the mode is sought; then the data sheet does not."""
    if settings.band is None:
        return joint
    return replace(joint, lowest=settings.band[0], highest=settings.band[1])


def _rows(transients: xr.Dataset | None) -> tuple[TransientRow, ...]:
    if transients is None:
        return ()
    names = ("file", "start_s", "stop_s", "position_m", "condition", "motion", "repetition")
    columns = [transients[name].values.tolist() for name in names]
    return tuple(TransientRow(*row) for row in zip(*columns, strict=True))
