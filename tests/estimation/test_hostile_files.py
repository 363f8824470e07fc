"""A changed file gives a number or a sentence, never a traceback."""

from __future__ import annotations

import contextlib
import copy
import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.estimation.made_runs import calibrated, run_of

from ballscrew.base.errors import BallscrewError
from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import model_json, read_model
from ballscrew.estimation.preload import preload
from ballscrew.fcft.optimise import optimise
from ballscrew.modal.run import Run
from ballscrew.monitoring.capability import capability
from ballscrew.testbed.example import AXIS, PLAN

MODEL: dict[str, Any] = json.loads(write_json(model_json(calibrated())))
RUN: dict[str, Any] = json.loads(write_json(run_of(0.9, name="run", temperature_C=21.0).to_json()))
BASE = run_of(name="base", temperature_C=20.0)
SHEET = replace(AXIS, name="bench")
VALUES = (
    None, True, -1, 0, 1e-300, 5e-324, 1e300, -1e300, 10**400, 1e-6, 1e-3, 0.5, 10, 1e3, 1e6, -1e6, "x", "",
    "[/x]", [], {}, [1],
)  # fmt: skip
FACTORS = (-1.0, 1e-3, 0.1, 0.5, 1.5, 10.0, 1e3)


def leaves(table: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place of a document; of a list the first and the last."""
    inner: list[tuple[Any, Any]] = []
    if isinstance(table, dict):
        inner = list(table.items())
    elif isinstance(table, list):
        inner = [(i, table[i]) for i in sorted({0, len(table) - 1}) if table]
    found = [path] if path else []
    for key, value in inner:
        found += leaves(value, (*path, key))
    return found


def changed(document: dict[str, Any], path: tuple[Any, ...], value: Any, factor: float) -> dict[str, Any]:
    """Another value in a place, or the number there times a factor."""
    other = copy.deepcopy(document)
    table: Any = other
    for key in path[:-1]:
        table = table[key]
    old = table[path[-1]]
    number = isinstance(old, (int, float)) and not isinstance(old, bool)
    table[path[-1]] = old * factor if value is KeyError and number else None if value is KeyError else value
    return other


def changed_documents(document: dict[str, Any]) -> st.SearchStrategy[dict[str, Any]]:
    return st.builds(
        changed,
        st.just(document),
        st.sampled_from(leaves(document)),
        st.sampled_from((*VALUES, *[KeyError] * 10)),
        st.sampled_from(FACTORS),
    )


often = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@often
@given(document=changed_documents(RUN))
def test_a_run_that_was_changed_is_used_or_refused(document: dict[str, Any]) -> None:
    with contextlib.suppress(BallscrewError):
        run = Run.from_json(document)
        preload(run, calibrated(), BASE)
    with contextlib.suppress(BallscrewError):
        capability(PLAN, axis=SHEET, baseline=[Run.from_json(document), BASE])
    with contextlib.suppress(BallscrewError):
        calibrate([BASE, Run.from_json(document)], SHEET)


@often
@given(document=changed_documents(MODEL))
def test_a_model_that_was_changed_is_used_or_refused(tmp_path, document: dict[str, Any]) -> None:
    (tmp_path / "m.json").write_text(json.dumps(document), encoding="utf-8")
    with contextlib.suppress(BallscrewError):
        model = read_model(tmp_path / "m.json")
        preload(Run.from_json(RUN), model, BASE)
    with contextlib.suppress(BallscrewError):
        capability(PLAN, axis=SHEET, model=tmp_path / "m.json")
    with contextlib.suppress(BallscrewError):
        model = read_model(tmp_path / "m.json")
        optimise(replace(PLAN, repetitions=1), SHEET, model=model.model, covariance=model.covariance)


def test_the_documents_themselves_are_used(tmp_path) -> None:
    (tmp_path / "m.json").write_text(json.dumps(MODEL), encoding="utf-8")
    model = read_model(tmp_path / "m.json")
    ratio = preload(Run.from_json(RUN), model, BASE).relative_to_baseline
    assert ratio is not None
    assert ratio.value == pytest.approx(0.9, abs=0.02)
    assert capability(PLAN, axis=SHEET, model=model, baseline=[Run.from_json(RUN), BASE]).baseline_runs == 2
