"""The health of an axis as a document, and back."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from typing import Any

import pytest
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import at, history, worn

from ballscrew.base.errors import InputError
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event
from ballscrew.monitoring.health import health_state
from ballscrew.monitoring.state import HealthState


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    found = health_state(
        history(range(14), worn(8.0, 60.0)),
        calibrated(),
        events=[Event(at(3.5), "greased", "by hand"), Event(at(90), "nut replaced")],
        settings=MonitorSettings(draws=1000),
    )
    result: dict[str, Any] = json.loads(json.dumps(found.to_json(), allow_nan=False))
    return result


def test_what_is_written_is_read_back(document: dict[str, Any]) -> None:
    assert len(document["notes"]) == 1
    assert json.loads(json.dumps(HealthState.from_json(document).to_json())) == document


def test_keys_of_a_later_version_are_ignored(document: dict[str, Any]) -> None:
    later = copy.deepcopy(document)
    later["new"] = later["runs"][0]["new"] = later["epochs"][0]["new"] = 1
    assert HealthState.from_json(later).to_json() == HealthState.from_json(document).to_json()


@pytest.mark.parametrize("key", ["axis", "state", "runs", "epochs", "alarm_at", "stage", "causes", "made"])
def test_a_missing_key_is_refused(document: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match="is not a health state"):
        HealthState.from_json({k: v for k, v in document.items() if k != key}, "M.json")


@pytest.mark.parametrize(
    ("where", "value"),
    [
        (("state",), "fine"),
        (("runs",), 3),
        (("runs", 0), None),
        (("runs", 0, "state"), ["alarm"]),
        (("runs", 0, "reading", "level"), "much"),
        (("runs", 0, "relative_to_baseline", "interval95"), [1]),
        (("epochs", 0, "events"), [{"at": "never", "kind": "note"}]),
        (("causes",), [{"cause": "nut"}]),
        (("scale_uncertainty",), True),
    ],
)
def test_wrong_kinds_are_refused(document: dict[str, Any], where: tuple[Any, ...], value: Any) -> None:
    wrong = copy.deepcopy(document)
    inner = wrong
    for key in where[:-1]:
        inner = inner[key]
    inner[where[-1]] = value
    with pytest.raises(InputError):
        HealthState.from_json(wrong, "M.json")


def test_a_state_that_was_read_back_has_no_charts(document: dict[str, Any]) -> None:
    runs = history(range(8), lambda day: 1.0 if day < 4 else 1.5)
    found = health_state(runs, calibrated(), settings=MonitorSettings(draws=1000))
    assert found.stiffer
    assert not HealthState.from_json(found.to_json()).stiffer
    assert not HealthState.from_json(document).stiffer


def test_a_loss_while_learning_is_that_of_an_unfinished_baseline_alone() -> None:
    settings = MonitorSettings(draws=1000)
    runs = history(range(6), lambda day: 1 - 0.1 * day)
    learning = health_state(runs[:2], calibrated(), settings=settings)
    assert learning.state == "learning"
    assert learning.loss_while_learning == pytest.approx(0.1, abs=0.02)
    assert health_state(runs, calibrated(), settings=settings).loss_while_learning is None


def test_what_is_due_follows_from_the_state() -> None:
    found = health_state(history(range(6)), calibrated(), settings=MonitorSettings(draws=1000))
    due = [replace(found, state=state).urgency for state in ("normal", "watch", "alarm")]
    assert due == ["none", "repeat", "plan"]
