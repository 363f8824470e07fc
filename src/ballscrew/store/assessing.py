"""Assessment of an axis by its stored runs: state and forecast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from ballscrew.base.errors import InputError
from ballscrew.calibration.assumptions import Assumptions, Priors
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.prognosis.duty import DutyRecord
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.store.alarms import ENDED, alarm_documents, to_close
from ballscrew.store.assessment_rows import MadeAssessment, inputs_of, store_assessment
from ballscrew.store.histories import StoredHistory, history_key, read_stored_history
from ballscrew.store.opened import OpenStore, why_read_only
from ballscrew.store.reading import find_axis

_ATTEMPTS = 5  # runs may be added meanwhile


@dataclass(frozen=True)
class StoredAssessment:
    """Result of :func:`monitor_axis`.

    Parameters
    ----------
    monitored : Monitored
        Health state and remaining life.
    new_runs : int
        Runs that were assessed for it; the others follow from a checkpoint.
    newest : Run
        Newest run of the history.
    notes : tuple of str
        Sentences about runs that are no part of it, and why it is not stored.
    """

    monitored: Monitored
    new_runs: int
    newest: Run
    notes: tuple[str, ...]


def monitor_axis(
    store: OpenStore,
    axis: str,
    *,
    settings: MonitorSettings | None = None,
    failure: Failure | None = None,
    largest_load: float | None = None,
    duty: float | DutyRecord | None = None,
    accept: Sequence[str] = (),
) -> StoredAssessment:
    """Assess an axis by its stored runs, events and model, and store the result.

    Parameters
    ----------
    store : OpenStore
        The store.
    axis : str
        Name of the axis.
    settings, failure, largest_load, duty, accept
        As for :func:`ballscrew.monitor`.

    Returns
    -------
    StoredAssessment
        As :func:`ballscrew.monitor` of the same runs; it does not depend on the order of addition, but for
        several corrections of one run. If the store cannot be written, the result is not stored.

    Raises
    ------
    InputError
        If the axis has no run or model, or as :func:`ballscrew.monitor` raises.
    """
    reason = why_read_only(store, "monitor --store")
    for _ in range(_ATTEMPTS):
        made = compute_assessment(
            store,
            axis,
            settings=settings,
            failure=failure,
            largest_load=largest_load,
            duty=duty,
            accept=accept,
        )
        history = made.history
        notes = _notes(history, reason)
        assessed = StoredAssessment(made.monitored, len(history.runs), history.newest, notes)
        if reason is not None:
            return assessed
        with store.write("monitor --store") as session:
            if store_assessment(session, made):
                session.flush()
                alarms = alarm_documents(session, find_axis(session, axis))
                standing = [alarm for alarm in reversed(alarms) if alarm["state"] not in ENDED]
                sentences = to_close(standing, made.monitored.state.state)
                return replace(assessed, notes=(*notes, *sentences))
    raise InputError(f"{store.path}: runs of {axis} are added all the time; try again.")


def compute_assessment(
    store: OpenStore,
    axis: str,
    *,
    settings: MonitorSettings | None = None,
    failure: Failure | None = None,
    largest_load: float | None = None,
    duty: float | DutyRecord | None = None,
    accept: Sequence[str] = (),
) -> MadeAssessment:
    """Assess an axis as :func:`monitor_axis` does, without storing the result.

    Parameters
    ----------
    store, axis, settings, failure, largest_load, duty, accept
        As for :func:`monitor_axis`.

    Returns
    -------
    MadeAssessment
        For :func:`~ballscrew.store.assessment_rows.store_assessment`.
    """
    settings = settings or MonitorSettings()
    stated = {
        "settings": asdict(settings),
        "failure": asdict(failure or Failure()),
        "largest_load": largest_load,
        "duty": repr(duty),
        "accept": sorted(set(accept)),
    }
    with store.read() as session:
        history = read_stored_history(session, axis, settings)
    monitored = monitor(
        history.runs,
        history.model,
        events=history.events,
        settings=settings,
        failure=failure,
        largest_load=largest_load,
        duty=duty,
        accept=accept,
        checkpoint=history.checkpoint,
    )
    return MadeAssessment(history, monitored, stated)


def newest_assessment(
    store: OpenStore, axis: str, inputs: str, stated: Mapping[str, Any]
) -> Monitored | None:
    """The newest assessment of an axis, made again from the same inputs and therefore with the same result.

    Parameters
    ----------
    store : OpenStore
        The store, which is only read.
    axis : str
        Name of the axis.
    inputs : str
        Digest of its inputs; empty without an assessment.
    stated : mapping
        Its settings.

    Returns
    -------
    Monitored or None
        None if the newest assessment is not of the present history by this version, or of counters of duty,
        which are not stored.

    Raises
    ------
    InputError
        If the axis has no model, or as :func:`compute_assessment` raises.
    """
    with store.read() as session:
        key = history_key(session, find_axis(session, axis))
        if inputs_of(key, stated) != inputs:
            return None
    try:
        duty = None if stated["duty"] == repr(None) else float(stated["duty"])
    except ValueError:
        return None
    made = compute_assessment(
        store,
        axis,
        settings=_settings(stated["settings"]),
        failure=Failure(**stated["failure"]),
        largest_load=stated["largest_load"],
        duty=duty,
        accept=stated["accept"],
    )
    if inputs_of(made.history.key, made.stated) != inputs:  # a run was added meanwhile
        return None
    return made.monitored


def _settings(stated: Mapping[str, Any]) -> MonitorSettings:
    """Settings of the detection as they were stored."""
    assumptions = dict(stated["assumptions"])
    assumptions["priors"] = Priors(**assumptions["priors"])
    return MonitorSettings(**dict(stated) | {"assumptions": Assumptions(**assumptions)})


def _notes(history: StoredHistory, reason: str | None) -> tuple[str, ...]:
    """Sentences about runs that are no part of a history, and why a result is not stored."""
    notes = []
    if reason is not None:
        notes.append(f"The result is not stored: {reason}")
    if history.missing:
        notes.append(
            f"{history.missing} of the runs have no result by the method of the history "
            f"({history.method.name}, revision {history.method.revision}) and are no part of it: "
            "'ballscrew reprocess'."
        )
    if history.untimed:
        notes.append(f"{history.untimed} of the runs have no time and are no part of the history.")
    return tuple(notes)
