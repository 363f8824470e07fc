"""Analysis of a run: from its files to the axial natural frequencies of its cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import Progress
from ballscrew.base.provenance import Made
from ballscrew.base.threads import single_threaded
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.trace import SAMPLES_PER_PERIOD
from ballscrew.modal.cell import CellResult, TransientRow, transient_rows
from ballscrew.modal.job import Files, Job
from ballscrew.modal.joint.analysis import (
    analyse_jointly,
    motor_ripple,
    signal_reducer,
    suspect_delayed,
    suspect_rotating,
    suspect_unexcited,
)
from ballscrew.modal.joint.identify import rate_refusal
from ballscrew.modal.joint.initial import initial_values
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.settings import JointSettings, Response
from ballscrew.modal.masses import rigid_body_result
from ballscrew.modal.paper.cell import highest_line
from ballscrew.modal.paper.cells import identify_cells
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import Run
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.measure import Measurement, measure
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.rotation import table_rotations

METHODS = ("joint", "paper")


@dataclass(frozen=True, slots=True)
class AnalysisOptions:
    """Method and settings of the estimate of natural frequencies.

    Parameters
    ----------
    method : {"joint", "paper"}
        One model of all cells of the run, or each cell from the peak of its FRF.
    response : {"both", "nut", "motor"}
        Response to the torque fitted by method ``joint``: the accelerometers at the nut, the motor's encoder,
        or what the channels allow.
    paper : PaperSettings
        Settings of the FRFs and of method ``paper``.
    joint : JointSettings
        Settings of method ``joint``.
    """

    method: str = "joint"
    response: Response = "both"
    paper: PaperSettings = field(default_factory=PaperSettings)
    joint: JointSettings = field(default_factory=JointSettings)

    def __post_init__(self) -> None:
        """Refuse an unknown method, and what are no settings."""
        for given, kind in ((self.paper, PaperSettings), (self.joint, JointSettings)):
            if not isinstance(given, kind):
                raise InputError(f"the settings are {shown(given)}; they must be {kind.__name__}.")
        if self.method not in METHODS:
            raise InputError(f"the method is {self.method!r}; it must be one of {', '.join(METHODS)}.")

    @property
    def joint_in_band(self) -> JointSettings:
        """Settings of method ``joint``, searching in the given band, if any."""
        if self.paper.band is None:
            return self.joint
        return replace(self.joint, lowest=self.paper.band[0], highest=self.paper.band[1])

    def to_settings(self) -> dict[str, Any]:
        """All settings that the result depends on, as a plain dict."""
        settings: dict[str, Any] = {"method": self.method, **self.paper.to_settings()}
        if self.method == "joint":
            settings["response"] = self.response
            settings["joint"] = asdict(self.joint_in_band)
        return settings


@dataclass(frozen=True, eq=False)
class Analysis:
    """A run, and what it was made from.

    Parameters
    ----------
    run : Run
        The result.
    paper : tuple of CellResult
        The same cells by the paper's method; without frequencies if it was not compared.
    transients : Dataset or None
        The table *Transients*, thinned to :func:`highest`; None if no recording could be used.
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
    measured_at: str | datetime | None = None,
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
    files : path-like or Recording, or a sequence of these
        Recordings, usually one per round trip: files, or arrays by
        :meth:`Recording.from_arrays <ballscrew.recording.recording.Recording.from_arrays>`; or one RUN.toml,
        which names files and all else. Arguments override RUN.toml.
    channels : path-like or ChannelMap, optional
        Quantity, place and unit of each channel; files require it.
    axis : path-like or DataSheet, optional
        The axis; without it there is no search band, and a torque gives no force.
    plan : path-like or Plan, optional
        The test; without it stops and speeds are found by clustering, and missing stops are not detected.
    mass : str or float, optional
        Load on the table, ``"100 kg"``, a bare number in kg; by default the plan's, where it has one only.
    measured_at : str or datetime, optional
        ISO 8601; by default the start time of the first file.
    temperature : str or float, optional
        Of the axis, ``"23 degC"``, a bare number in kelvin; by default the mean of a recorded temperature.
    method : {"joint", "paper"}
        One model of all cells of the run, or each cell from the peak of its FRF.
    response : {"both", "nut", "motor"}
        Response to the torque fitted by method ``joint``: the accelerometers at the nut, the motor's encoder,
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
    options = AnalysisOptions(method, response, settings or PaperSettings(), joint or JointSettings())
    job = Job.read(
        files,
        channels=channels,
        axis=axis,
        plan=plan,
        mass=mass,
        measured_at=measured_at,
        temperature=temperature,
    )
    return examine(job, options, progress=progress).run


@single_threaded
def examine(
    job: Job, options: AnalysisOptions, *, compared: bool = False, progress: Progress | None = None
) -> Analysis:
    """Analyse a run as :func:`analyze`, and return what the result was made from as well.

    Parameters
    ----------
    job : Job
        Files of the run.
    options : AnalysisOptions
        Method and settings.
    compared : bool
        Whether the paper's method estimates frequencies as well, if another method was chosen.
    progress : callable, optional
        As for :func:`analyze`.

    Returns
    -------
    Analysis
        The run and its transients.

    Raises
    ------
    InputError
        If a file, the channel map or the plan is wrong.
    """
    by_joint = options.method == "joint"
    settings, load = options.paper, job.mass or 0.0
    measurement = _measured(job, options, progress)
    paper, table = identify_cells(
        measurement.transients,
        measurement.quality,
        job.sheet,
        job.plan,
        load,
        settings,
        spectra_alone=by_joint and not compared,
    )
    found = JointResult(paper)
    if by_joint:
        if progress:
            progress(len(job.files), len(job.files), "fitting all cells as one")
        sheet = _predicting_sheet(job, options)
        found = analyse_jointly(
            measurement, paper, table, sheet, load, options.joint_in_band, options.response
        )
        found = replace(found, cells=suspect_unexcited(found.cells, job.plan))
        if measurement.motor_delayed:
            found = replace(found, cells=suspect_delayed(found.cells))
    found = replace(found, cells=suspect_rotating(found.cells, measurement.rotations))
    measured_at = job.measured_at or measurement.started_at
    rows: tuple[TransientRow, ...] = ()
    if measurement.transients is not None:
        rows = transient_rows(measurement.transients)
    body = rigid_body_result(measurement, job.sheet, load)
    celsius = job.temperature
    if celsius is None and measurement.temperature is not None:
        celsius = measurement.temperature.mean_C
    frequencies = [cell.frequency_Hz for cell in found.cells if cell.frequency_Hz is not None]
    run = Run(
        id=job.identity(measurement.files, measured_at),
        axis=job.sheet.name if job.sheet else None,
        mass_kg=job.mass,
        measured_at=measured_at,
        temperature_C=celsius,
        temperature=measurement.temperature,
        files=measurement.files,
        # Without a data sheet no mode is expected: masses and friction are then the result.
        quality=_with_rate(measurement.quality, found.reasons if job.sheet else ()),
        rigid_body=body,
        transients=rows,
        cells=found.cells,
        made=Made(options.to_settings(), inputs=job.inputs()),
        shared_errors=found.shared_errors,
        mass_over_preload_kg_per_N=found.mass_over_preload,
        lost_motion=measurement.lost_motion,
        motor_ripple=motor_ripple(found.ripple, body, job.sheet),
        frame_mode=found.frame_mode,
        drive_input=measurement.drive,
        table_rotation=table_rotations(measurement.rotations, frequencies),
        clock=measurement.clock,
        frequency_response=table,
    )
    return Analysis(run, paper, measurement.transients)


def _measured(job: Job, options: AnalysisOptions, progress: Progress | None) -> Measurement:
    """The recordings of a run, reduced to what the method needs."""
    load = job.mass or 0.0
    reducer = None
    if options.method == "joint":
        reducer = signal_reducer(_predicting_sheet(job, options), load, options.joint_in_band)
    return measure(
        job.files,
        job.channels,
        sheet=job.sheet,
        plan=job.plan,
        mass=job.mass,
        extract=reducer,
        top=highest(job.sheet, load, options.paper),
        progress=progress,
    )


def _predicting_sheet(job: Job, options: AnalysisOptions) -> DataSheet | None:
    """The data sheet, unless a band was given: then the data sheet does not predict the mode."""
    return job.sheet if options.paper.band is None else None


def quality(
    files: Files,
    *,
    channels: str | Path | ChannelMap | None = None,
    axis: str | Path | DataSheet | None = None,
    plan: str | Path | Plan | None = None,
    mass: str | float | None = None,
    progress: Progress | None = None,
) -> Quality:
    """Assess whether the files of a run are a good measurement.

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
    job = Job.read(files, channels=channels, axis=axis, plan=plan, mass=mass)
    measurement = measure(
        job.files,
        job.channels,
        sheet=job.sheet,
        plan=job.plan,
        mass=job.mass,
        extract=lambda aligned: (aligned.rate, aligned.position.min(), aligned.position.max()),
        progress=progress,
    )
    if not measurement.extracts or measurement.quality.verdict == "bad":
        return measurement.quality
    rates, lows, highs = zip(*measurement.extracts.values(), strict=True)
    settings = JointSettings()
    if job.sheet is not None:
        mode = initial_values(job.sheet, job.mass or 0.0, min(lows), max(highs)).rotor_free
        return _with_rate(measurement.quality, [rate_refusal(rates[0], mode, settings)])
    low_rate = rate_refusal(rates[0], settings.lowest, settings)
    if low_rate is not None or rate_refusal(rates[0], settings.highest, settings) is None:
        return _with_rate(measurement.quality, [low_rate])
    note = (
        f"{rates[0]:.0f} samples per second suffice for a mode up to {rates[0] / SAMPLES_PER_PERIOD:.0f} Hz; "
        "with a data sheet (--axis) this is checked."
    )
    return replace(measurement.quality, notes=(*measurement.quality.notes, note))


def _with_rate(verdict: Quality, reasons: Iterable[Reason | None]) -> Quality:
    """Verdict on a measurement, bad if one of the reasons is that its rate is too low for the mode."""
    for reason in reasons:
        if reason is not None and reason.kind == "low-rate":
            return replace(verdict, verdict="bad", reasons=(reason.text, *verdict.reasons))
    return verdict


def highest(sheet: DataSheet | None, load: float, settings: PaperSettings) -> float:
    """Highest frequency of the transients' spectra, Hz.

    Parameters
    ----------
    sheet : DataSheet or None
        Predicts the modes; the highest one is that with the table next to the thrust bearing.
    load : float
        On the table, kg.
    settings : PaperSettings
        May contain a band.

    Returns
    -------
    float
        Highest line of the table *FrequencyResponse*.
    """
    if settings.band is not None or sheet is None:
        return highest_line(settings.band)
    near = float(predicted_frequency(sheet, 0.0, load))
    far = float(predicted_frequency(sheet, sheet.travel_limit, load))
    return highest_line((0.0, max(near, far) * (1 + settings.band_half_width)))
