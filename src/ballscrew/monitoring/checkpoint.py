"""Checkpoint: estimates from the runs of an axis, from which the next run is assessed.

What follows from a checkpoint is, byte for byte on one machine, what judging from the first run gives, since
both are the same recursion. A late run, a correction or an event in the past needs a checkpoint from before
it: :func:`checkpoint_before` chooses it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from ballscrew.base.errors import InputError
from ballscrew.base.exactfile import from_bytes, to_bytes
from ballscrew.base.jsonfile import plain
from ballscrew.base.provenance import digest
from ballscrew.calibration.assumptions import Assumptions, Priors
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import model_json
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.chart_state import BaselineVisits, ChartedRun, ChartState, VisitedState
from ballscrew.monitoring.detection.design import Design, Layout
from ballscrew.monitoring.detection.growing_design import GrowingDesign
from ballscrew.monitoring.detection.limit_table import LimitTable
from ballscrew.monitoring.detection.limit_values import RunLimits
from ballscrew.monitoring.detection.odds import OddsState
from ballscrew.monitoring.detection.ramp import RampState
from ballscrew.monitoring.detection.residuals import ResidualState
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import StatisticsState
from ballscrew.monitoring.detection.visits import VisitRun
from ballscrew.monitoring.epochs import Event, moment
from ballscrew.monitoring.history import EpochState, HistoryRow, HistoryState
from ballscrew.monitoring.reading import Reading

CHECKPOINT_SCHEMA = 1
"""Version of the layout and of the recursion: raised when a number changes that follows from a checkpoint."""

_HEAD = b"ballscrew checkpoint "
_NOTE = "note"  # kind of an event that changes nothing


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Estimates from the runs of an axis until the newest.

    Parameters
    ----------
    history : HistoryState
        Judged runs.
    basis : str
        Digest of model and settings, by which they were judged.
    events : tuple of tuple of str
        Time and kind of each event until the newest run.
    """

    history: HistoryState
    basis: str
    events: tuple[tuple[str, str], ...]

    @property
    def until(self) -> str:
        """Time of the newest run."""
        return self.history.newest

    def to_bytes(self) -> bytes:
        """Version, SHA-256 and compressed JSON; equal checkpoints give equal bytes."""
        content = to_bytes(self, {Run: _run_document})
        return b"%s%d\n%s\n%s" % (_HEAD, CHECKPOINT_SCHEMA, _hash_of(content), content)

    @classmethod
    def from_bytes(cls, data: bytes, source: str = "the checkpoint") -> Checkpoint:
        """Read a checkpoint back.

        Parameters
        ----------
        data : bytes
            As :meth:`to_bytes` returned it.
        source : str
            Its name, for messages.

        Returns
        -------
        Checkpoint
            The same, to the last bit.

        Raises
        ------
        InputError
            If the bytes are damaged, or of another version.
        """
        first, _, content = data.partition(b"\n")
        if not first.startswith(_HEAD):
            raise InputError(f"{source}: is no checkpoint of ballscrew.")
        if first != b"%s%d" % (_HEAD, CHECKPOINT_SCHEMA):
            raise InputError(
                f"{source}: is of another version than {CHECKPOINT_SCHEMA}, which this program reads: judge "
                "from the first run."
            )
        known, _, content = content.partition(b"\n")
        if known != _hash_of(content):
            raise InputError(f"{source}: is damaged: judge from the first run.")
        found = from_bytes(content, _READERS, source)
        if not isinstance(found, cls):
            raise InputError(f"{source}: is no checkpoint of ballscrew.")
        return found

    def check(self, model: CalibratedAxis, settings: MonitorSettings, events: Sequence[Event]) -> None:
        """Check that it was made with a model, settings and the same past events.

        Parameters
        ----------
        model : CalibratedAxis
            The axis.
        settings : MonitorSettings
            Of the detection.
        events : sequence of Event
            All events of the axis.

        Raises
        ------
        InputError
            If one of them differs.
        """
        if self.basis != _basis(model, settings):
            raise InputError(
                "the checkpoint was made with another model or other settings: judge from the first run."
            )
        if self.events != _past(events, self.until):
            raise InputError(
                f"the events until {self.until} are not those of the checkpoint: judge again from one before "
                "the change."
            )


def make_checkpoint(
    history: HistoryState, model: CalibratedAxis, settings: MonitorSettings, events: Sequence[Event]
) -> Checkpoint:
    """Checkpoint of a history.

    Parameters
    ----------
    history : HistoryState
        Judged runs.
    model, settings, events
        By which they were judged.

    Returns
    -------
    Checkpoint
        As of the newest run.
    """
    return Checkpoint(history, _basis(model, settings), _past(events, history.newest))


def checkpoint_before(checkpoints: Iterable[Checkpoint], changed: Iterable[str]) -> Checkpoint | None:
    """Newest checkpoint from which a change is judged as from the first run.

    Parameters
    ----------
    checkpoints : iterable of Checkpoint
        Of one axis.
    changed : iterable of str
        Times of all that is new or was changed since: new and late runs, runs that were corrected or removed
        (before and after the correction), and events that were added, changed or removed.

    Returns
    -------
    Checkpoint or None
        All runs after its :attr:`Checkpoint.until` have to be given again; None where all runs have to.
    """
    times = [moment(time, "a change") for time in changed]
    best = None
    for checkpoint in checkpoints:
        until = moment(checkpoint.until, "a checkpoint")
        earlier = all(until < time for time in times)
        if earlier and (best is None or until > moment(best.until, "a checkpoint")):
            best = checkpoint
    return best


def _hash_of(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _basis(model: CalibratedAxis, settings: MonitorSettings) -> str:
    return digest({"model": model_json(model), "settings": plain(asdict(settings), 17)})


def _past(events: Sequence[Event], until: str) -> tuple[tuple[str, str], ...]:
    """Time and effect of the events that change something, until a time."""
    last = moment(until, "a run")
    past = [
        (event.when.isoformat(), event.effect)
        for event in events
        if event.when <= last and event.kind != _NOTE
    ]
    return tuple(sorted(past))


def _run_document(run: Run) -> list[Any]:
    return [run.to_json(digits=17), run.source]


def _run(document: list[Any]) -> Run:
    content, source = document
    return replace(Run.from_json(content), source=source)


def _checkpoint(**content: Any) -> Checkpoint:
    events = tuple((at, kind) for at, kind in content.pop("events"))
    return Checkpoint(**content, events=events)


_CLASSES = (
    Assumptions,
    BaselineVisits,
    ChartState,
    ChartedRun,
    Design,
    EpochState,
    GrowingDesign,
    HistoryState,
    HistoryRow,
    Layout,
    LimitTable,
    MonitorSettings,
    OddsState,
    Priors,
    RampState,
    Reading,
    ResidualState,
    RunLimits,
    StatisticsState,
    VisitRun,
    VisitedState,
)
_READERS = {
    **{kind.__name__: kind for kind in _CLASSES},
    "Run": _run,
    "Checkpoint": _checkpoint,
}
