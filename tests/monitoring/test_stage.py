"""Stage of wear by preload and lost motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import history

from ballscrew.base.quantity import Quantity
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.health import health_state
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.stage import stage

HALF = Quantity(0.1, 0.04, "", (0.04, 0.22))  # about even odds


@pytest.fixture(scope="module")
def reading() -> Reading:
    """Of a run without lost motion."""
    found = health_state(history(range(3)), calibrated(), settings=MonitorSettings(draws=1000))
    return found.runs[0].reading


def moved(reading: Reading, lost: float, uncertainty: float) -> Reading:
    return replace(reading, backlash=lost, backlash_uncertainty=uncertainty)


def test_without_a_preload_there_is_no_stage(reading: Reading) -> None:
    assert stage(None, [moved(reading, 2e-6, 1e-7)], [reading]) is None


def test_lost_motion_counts_as_far_as_it_is_certain(reading: Reading) -> None:
    silent = stage(HALF, [reading], [reading])
    assert silent is not None
    assert silent.how.endswith("backlash is not observable")
    second: dict[str, Any] = {}
    for name, lost, uncertainty in (
        ("backlash", 2e-6, 1e-7), ("none", 0.0, 1e-7), ("uncertain", 2e-6, 3e-6),
    ):  # fmt: skip
        found = stage(HALF, [moved(reading, lost, uncertainty)], [reading])
        assert found is not None
        assert found.how.endswith("the lost motion in excess of the baseline's")
        second[name] = found.II
        assert sum((found.I, found.II)) == pytest.approx(1.0)
    assert second["none"] < silent.II < second["backlash"]
    assert second["uncertain"] == pytest.approx(silent.II)
