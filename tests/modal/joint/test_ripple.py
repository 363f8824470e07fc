"""The motor's ripple: its orders are found, it is told beside the mode, and nothing is told where none is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun, small_run

from ballscrew.axis.sheet import DataSheet
from ballscrew.modal.joint import ripple
from ballscrew.modal.joint.fit import Fit, fit
from ballscrew.modal.joint.guess import whole_mass
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.model import Shape, block
from ballscrew.modal.joint.ripple import rippled
from ballscrew.modal.joint.windows import of_trip, windows
from ballscrew.testbed.disturbances import Disturbances
from ballscrew.testbed.example import AXIS, LOAD
from ballscrew.testbed.trip import Rig

LEAD = AXIS.screw.lead


@pytest.fixture(scope="module")
def cogging(rig: Rig) -> SmallRun:
    """An axis whose motor has a strong twelfth order and no other."""
    strong = Disturbances(ripple_orders=(12.0,), ripple=0.012, ball_pass=0.0)
    return small_run(replace(rig, disturbances=strong))


@pytest.fixture(scope="module")
def smooth(rig: Rig) -> SmallRun:
    return small_run(replace(rig, disturbances=Disturbances(ripple=0.0, ball_pass=0.0)))


def first_fit(run: SmallRun, names: tuple[str, ...] = ("torque-nut",)) -> tuple[Fit, float]:
    mass = whole_mass(run.trips)
    assert mass is not None
    middle = np.mean([run.free[x] for x in (0.1, 0.2)])
    w = windows(run.trips, run.marks, mass, 0.5 * middle, 2.6 * middle)
    assert w is not None
    shapes = [
        Shape(1 / (2 * np.pi * f) ** 2, slope_of(of), 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)
        for of, f in ((run.free, middle), (run.held, np.mean([run.held[x] for x in (0.1, 0.2)])))
    ]
    blocks = [block(name, w, whole=False) for name in names]
    return fit(blocks, shapes, ("compliance", "damping", "slope"), most=8), mass


def slope_of(truth: dict[float, float]) -> float:
    """Of the compliance along the axis, over that in the middle."""
    rise, level = np.polyfit(np.array(list(truth)) - 0.15, np.array(list(truth.values())) ** -2.0, 1)
    return float(rise / level)


def test_the_order_is_found_and_explains_most_of_what_was_left(cogging: SmallRun) -> None:
    now, mass = first_fit(cogging)
    assert ripple._orders(now, LEAD)[0] == 12
    (b,) = rippled(cogging.trips, now, mass, LEAD)
    assert b.ripple is not None
    then = fit([b], now.shapes, ("compliance", "damping", "slope"), most=4)
    assert then.unexplained(0) < 0.5 * now.unexplained(0)


def test_where_there_is_no_ripple_it_changes_nothing(
    smooth: SmallRun, sheet: DataSheet, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = identify_jointly(smooth.trips, smooth.marks, sheet, LOAD)
    monkeypatch.setattr(ripple, "_MOST", 0)
    without = identify_jointly(smooth.trips, smooth.marks, sheet, LOAD)
    for one, other in zip(found.cells, without.cells, strict=True):
        assert one.frequency == pytest.approx(other.frequency, abs=0.05)


def test_without_an_order_the_blocks_stay_as_they_are(
    cogging: SmallRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, mass = first_fit(cogging)
    monkeypatch.setattr(ripple, "_MOST", 0)
    assert all(b.ripple is None for b in rippled(cogging.trips, now, mass, LEAD))


def test_what_the_motors_motion_drives_has_the_ripple_in_it(cogging: SmallRun) -> None:
    now, mass = first_fit(cogging, ("torque-nut", "motor-nut"))
    torque, motion = rippled(cogging.trips, now, mass, LEAD)
    assert torque.ripple is not None
    assert motion.ripple is None


def test_ripple_costs_little_of_the_accuracy(cogging: SmallRun, sheet: DataSheet) -> None:
    result = identify_jointly(cogging.trips, cogging.marks, sheet, LOAD)
    off = [abs(c.frequency - cogging.free[c.position]) for c in result.cells if c.frequency is not None]
    assert len(off) == 12
    assert max(off) < 0.9


def test_windows_of_single_trips_average_to_those_of_all(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 400.0)
    assert w is not None
    alone = [of_trip(run.trips, w, trip, 1.0) for trip in range(3)]
    assert all(one.cells == w.cells for one in alone)
    assert np.mean([one.nut for one in alone], axis=0) == pytest.approx(w.nut, abs=1e-9)
    assert np.mean([one.place for one in alone], axis=0) == pytest.approx(w.place, abs=1e-12)
