"""Early detection of preload loss in ball screws, weeks before backlash appears.

The commands are functions of the same name:

>>> import ballscrew
>>> run = ballscrew.analyze("run.toml")  # doctest: +SKIP
>>> run.cells[0].frequency_Hz  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ballscrew._version import __version__

if TYPE_CHECKING:
    from ballscrew.axis.sheet_file import read_axis as read_axis
    from ballscrew.base.errors import BallscrewError as BallscrewError
    from ballscrew.base.errors import InputError as InputError
    from ballscrew.base.errors import MeasurementError as MeasurementError
    from ballscrew.base.quantity import Quantity as Quantity
    from ballscrew.calibration.calibrated_axis import CalibratedAxis as CalibratedAxis
    from ballscrew.calibration.calibration import calibrate as calibrate
    from ballscrew.calibration.modelfile import read_model as read_model
    from ballscrew.calibration.modelfile import write_model as write_model
    from ballscrew.cli.init import init as init
    from ballscrew.cli.simulate import simulate as simulate
    from ballscrew.cli.watch import WatchedAxis as WatchedAxis
    from ballscrew.cli.watch import watch as watch
    from ballscrew.estimation.estimate import PreloadEstimate as PreloadEstimate
    from ballscrew.estimation.from_frequency import preload_from_frequency as preload_from_frequency
    from ballscrew.estimation.preload import preload as preload
    from ballscrew.fcft.optimise import optimise as optimise
    from ballscrew.fcft.plan import read_plan as read_plan
    from ballscrew.fcft.planned import plan as plan
    from ballscrew.modal.amend import amend as amend
    from ballscrew.modal.analyze import analyze as analyze
    from ballscrew.modal.analyze import quality as quality
    from ballscrew.modal.analyze_frf import analyze_frf as analyze_frf
    from ballscrew.modal.natural_frequency import NaturalFrequency as NaturalFrequency
    from ballscrew.modal.natural_frequency import natural_frequency as natural_frequency
    from ballscrew.modal.paper.settings import PaperSettings as PaperSettings
    from ballscrew.modal.resonances import Resonances as Resonances
    from ballscrew.modal.resonances import resonances as resonances
    from ballscrew.modal.response import FrequencyResponse as FrequencyResponse
    from ballscrew.modal.response import frf as frf
    from ballscrew.modal.run import Run as Run
    from ballscrew.monitoring.capability import capability as capability
    from ballscrew.monitoring.checkpoint import Checkpoint as Checkpoint
    from ballscrew.monitoring.checkpoint import checkpoint_before as checkpoint_before
    from ballscrew.monitoring.epochs import read_events as read_events
    from ballscrew.prognosis.duty import read_duty as read_duty
    from ballscrew.prognosis.monitor import Monitored as Monitored
    from ballscrew.prognosis.monitor import monitor as monitor
    from ballscrew.recording.channels import read_channels as read_channels
    from ballscrew.recording.load import read_recording as read_recording
    from ballscrew.recording.recording import Recording as Recording
    from ballscrew.reproduction.demo import demo as demo
    from ballscrew.reproduction.reproduce import reproduce as reproduce
    from ballscrew.sending.sender import send as send
    from ballscrew.service.server import serve as serve
    from ballscrew.store.reprocessing import reprocess as reprocess
    from ballscrew.store.store import Store as Store

# Where each public name lives; it is loaded when it is first asked for, so that the package itself is light.
_HOME = {
    "BallscrewError": "base.errors",
    "CalibratedAxis": "calibration.calibrated_axis",
    "Checkpoint": "monitoring.checkpoint",
    "FrequencyResponse": "modal.response",
    "InputError": "base.errors",
    "MeasurementError": "base.errors",
    "Monitored": "prognosis.monitor",
    "NaturalFrequency": "modal.natural_frequency",
    "PaperSettings": "modal.paper.settings",
    "PreloadEstimate": "estimation.estimate",
    "Quantity": "base.quantity",
    "Resonances": "modal.resonances",
    "Recording": "recording.recording",
    "Run": "modal.run",
    "Store": "store.store",
    "WatchedAxis": "cli.watch",
    "amend": "modal.amend",
    "analyze": "modal.analyze",
    "analyze_frf": "modal.analyze_frf",
    "calibrate": "calibration.calibration",
    "capability": "monitoring.capability",
    "checkpoint_before": "monitoring.checkpoint",
    "demo": "reproduction.demo",
    "frf": "modal.response",
    "init": "cli.init",
    "monitor": "prognosis.monitor",
    "natural_frequency": "modal.natural_frequency",
    "optimise": "fcft.optimise",
    "plan": "fcft.planned",
    "preload": "estimation.preload",
    "preload_from_frequency": "estimation.from_frequency",
    "quality": "modal.analyze",
    "read_axis": "axis.sheet_file",
    "read_channels": "recording.channels",
    "read_duty": "prognosis.duty",
    "read_events": "monitoring.epochs",
    "read_model": "calibration.modelfile",
    "read_plan": "fcft.plan",
    "read_recording": "recording.load",
    "reprocess": "store.reprocessing",
    "reproduce": "reproduction.reproduce",
    "resonances": "modal.resonances",
    "send": "sending.sender",
    "serve": "service.server",
    "simulate": "cli.simulate",
    "watch": "cli.watch",
    "write_model": "calibration.modelfile",
}

__all__ = ["__version__", *_HOME]


if not TYPE_CHECKING:  # a checker would accept any name

    def __getattr__(name: str) -> Any:
        if name in _HOME:
            return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
