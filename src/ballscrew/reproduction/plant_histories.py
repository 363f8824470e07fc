"""Histories of the simulated plant, made by several processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.blocks import make_block
from ballscrew.modal.joint.fit import fit_modes
from ballscrew.modal.joint.mode import AxialMode, compliance_of
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import average_windows
from ballscrew.monitoring.detection.design import design_of
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.reproduction.plant import PlantAxis
from ballscrew.reproduction.plant_runs import AxisHistory, Template, make_history, record_tests


def make_histories(
    pool: Executor, axes: Sequence[PlantAxis], present: datetime, seed: int, folder: Path
) -> Iterator[AxisHistory]:
    """Record and analyse the tests of all axes.

    In a new installation the loops of simulation, fit and detection are compiled first, each by another
    process. Other axes are analysed after the first.

    Parameters
    ----------
    pool : Executor
        Processes that record and analyse.
    axes : sequence of PlantAxis
        The plant.
    present : datetime
        Present time, at which the history ends.
    seed : int
        Of the plant.
    folder : Path
        Folder for the recordings.

    Yields
    ------
    AxisHistory
        Of each axis, as it is finished.
    """
    followers: dict[str, list[PlantAxis]] = {axis.name: [] for axis in axes}
    own = []
    for axis in axes:
        if axis.like in followers:
            followers[axis.like].append(axis)
        else:
            own.append(replace(axis, like=None))
    # Those first that others wait for, and those with the most analyses, so that both processes end together.
    first, *rest = sorted(own, key=lambda axis: (-len(followers[axis.name]), -axis.effort))
    alike = [axis for axis in axes if axis.like in followers]
    followers[first.name] += rest
    making = _Making(pool, present, seed, folder, followers)
    making.record(first)
    compiled = pool.submit(_compile_detection)
    for axis in rest:
        making.record(axis)
    _compile_analysis()  # in this process: the second one still imports
    history = pool.submit(make_history, first, present, seed, making.recorded[first.name].result())
    for axis in alike:
        making.record(axis)
    history.add_done_callback(partial(making.complete, first))  # from now on all axes are being recorded
    for _ in axes:
        yield making.finished.get().result()
    compiled.result()  # the error, if there was one


@dataclass(frozen=True)
class _Making:
    """Tests of the axes in the making: their recordings, and the histories that are finished.

    ``followers`` are the axes that are analysed after an axis.
    """

    pool: Executor
    present: datetime
    seed: int
    folder: Path
    followers: dict[str, list[PlantAxis]]
    recorded: dict[str, Future[dict[int, Path]]] = field(default_factory=dict)
    finished: SimpleQueue[Future[AxisHistory]] = field(default_factory=SimpleQueue)

    def record(self, axis: PlantAxis) -> None:
        """Record the tests of an axis."""
        folder = self.folder / axis.name
        self.recorded[axis.name] = self.pool.submit(record_tests, axis, self.present, self.seed, folder)

    def analyse(
        self, axis: PlantAxis, template: Template | None, recordings: Future[dict[int, Path]]
    ) -> None:
        """Analyse an axis that is recorded, then its followers."""
        try:
            future = self.pool.submit(
                make_history, axis, self.present, self.seed, recordings.result(), template
            )
        except Exception as error:  # noqa: BLE001  the main process waits for a result of each axis
            future = Future()
            future.set_exception(error)
        future.add_done_callback(partial(self.complete, axis))

    def complete(self, axis: PlantAxis, future: Future[AxisHistory]) -> None:
        """Pass on the history of an axis, and analyse its followers."""
        self.finished.put(future)
        if not future.cancelled() and future.exception() is None:
            for other in self.followers[axis.name]:
                template = future.result().template if other.like else None
                self.recorded[other.name].add_done_callback(partial(self.analyse, other, template))


def _compile_analysis() -> None:
    """Compile the loops of the fit, by a step of it on a window of noise."""
    random = np.random.default_rng(0)
    force, position = random.standard_normal(400), np.linspace(0.0, 0.4, 400)
    trip = TripSignals(1000.0, force, position, random.standard_normal((1, 400)))
    transient = TransientRow(0, 0.1, 0.2, 0.0, str(Condition.PA), 0, 1)
    windows = average_windows([trip], [transient], 1.0, 60.0, 300.0)
    assert windows is not None  # noqa: S101  there is one
    mode = AxialMode(compliance_of(150.0), 0.0, 0.0, 0.03, 0.01, 1.0, 0.0, 300.0, 0.03)
    fit_modes([make_block("torque-nut", windows)], [mode], ("compliance",), most_steps=1)


def _compile_detection() -> None:
    """Compile the loops of the detection, by the limits of a few visits."""
    days = np.arange(8.0)
    compute_limits(design_of(days, 0.003 + 0 * days, 20 + 0 * days, (), MonitorSettings(draws=1000)))
