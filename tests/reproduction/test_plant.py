"""Axes of the simulated plant: as each is in a week of its story."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ballscrew.reproduction import plant
from ballscrew.reproduction.plant import PLANT, PlantAxis, rig_of
from ballscrew.testbed.instruments import Instruments

LOOSE = Instruments(pitch_frequency=300.0)
NEW = replace(PLANT[0], worn=None)


@pytest.fixture(autouse=True)
def _constant_temperature(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant, "temperature", lambda *_: plant._MEAN)


def preload(axis: PlantAxis, week: int) -> float:
    """Preload over that of the same machine when new."""
    return rig_of(axis, week, 0).machine.preload / rig_of(NEW, week, 0).machine.preload


@pytest.mark.parametrize(
    ("week", "expected"),
    [(0, 1.0), (40, 1.0), (55, 0.5**1.5), (60, 1.0), (1000, 1.0), (59, (11 / 30) ** 1.5)],
)
def test_the_preload_decreases_from_the_begin_of_the_wear_until_the_nut_is_replaced(
    week: int, expected: float
) -> None:
    axis = replace(NEW, worn=(40.0, 30.0), replaced=59)
    assert preload(axis, week) == pytest.approx(expected)


def test_a_nut_that_is_not_replaced_keeps_a_rest_of_its_preload() -> None:
    assert preload(replace(NEW, worn=(40.0, 30.0)), 1000) == pytest.approx(0.05**1.5)


def test_a_support_bearing_loses_a_part_of_its_preload_each_week_and_the_nut_none() -> None:
    axis = replace(NEW, bearing=(94.0, 0.03))
    ratios = [rig_of(axis, week, 0).machine.bearing_preload_ratio for week in (90, 94, 96, 104)]
    assert ratios == pytest.approx([1.0, 1.0, 0.94, 0.7])
    assert preload(axis, 104) == 1.0


def test_instruments_are_the_newest_that_came_loose() -> None:
    axis = replace(NEW, loose={10: LOOSE, 20: Instruments(pitch_frequency=1.0)})
    pitches = [rig_of(axis, week, 0).instruments.pitch_frequency for week in (9, 10, 19, 20)]
    assert pitches == [Instruments().pitch_frequency, 300.0, 300.0, 1.0]
