"""Judging from a checkpoint is judging from the first run, byte for byte."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.estimation.made_runs import LOAD, calibrated
from tests.monitoring.histories import at, history, unloading, worn

from ballscrew.base.errors import InputError
from ballscrew.base.exactfile import to_bytes
from ballscrew.modal.amend import amend
from ballscrew.modal.run import Run
from ballscrew.monitoring.checkpoint import Checkpoint, _hash_of, checkpoint_before
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event
from ballscrew.prognosis.families import FAMILIES
from ballscrew.prognosis.family_average import FamilyAverage
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.recording.quality.finding import Quality

MODEL = calibrated()
FEW = MonitorSettings(draws=1000)
LIFE = FamilyAverage(families=FAMILIES[1:2], members=20, samples=100, most=10)
DAYS = (*np.arange(0.0, 12.0), 12.1, *np.arange(13.0, 29.0), 28.2, *np.arange(40.0, 46.0))
EVENTS = (Event(at(6.5), "greased"), Event(at(22.5), "sensor remounted"), Event(at(33.0), "note"))


def judged(runs: Sequence[Run], events: Sequence[Event] = (), known: Checkpoint | None = None) -> Monitored:
    return monitor(runs, MODEL, events=events, settings=FEW, life=LIFE, checkpoint=known)


def content(found: Monitored) -> tuple[str, bytes]:
    """The whole document, and the checkpoint."""
    assert found.checkpoint is not None
    return json.dumps(found.to_json()), found.checkpoint.to_bytes()


def stored(found: Monitored) -> Checkpoint:
    """Checkpoint as another process reads it."""
    assert found.checkpoint is not None
    return Checkpoint.from_bytes(found.checkpoint.to_bytes())


def made_runs(seed: int = 3, scatter: float = 4e-4) -> list[Run]:
    """Runs with repeats, outliers, runs set aside, a refused one, pauses, and wear at last."""
    random = np.random.default_rng(seed)
    outliers = {int(k): 4e-3 for k in random.integers(4, len(DAYS), 2)} | {12: 3e-3}

    def temperature(day: float) -> float | None:
        return None if day < 2 else 20 + 3 * np.sin(day / 5)

    made: list[Any] = history(
        DAYS, worn(24.0, 120.0), scatter=scatter, seed=seed, outliers=outliers, temperature=temperature
    )
    made[1] = replace(made[1], quality=Quality("suspect", ("it is doubtful",)))
    made[15] = replace(made[15], quality=Quality("bad", ("it is bad",)))
    made[18] = replace(made[18], mass_kg=LOAD + 90)
    made[20:21] = unloading(3.5, made[20:21], refused=True)
    return made


RUNS = made_runs()
NEW_NUT = (*EVENTS, Event(at(19.5), "nut replaced"))


@pytest.mark.slow
@pytest.mark.parametrize("events", [(), EVENTS, NEW_NUT])
def test_any_split_gives_the_same_document(events: tuple[Event, ...]) -> None:
    whole = content(judged(RUNS, events))
    for count in (1, 2, 3, 5, 11, 13, 20, 21, 22, 30, len(RUNS)):
        known = stored(judged(RUNS[:count], events))
        assert content(judged(RUNS[count:], events, known)) == whole


def test_run_by_run_through_bytes_is_the_same_at_every_run() -> None:
    known = None
    for number, run in enumerate(RUNS, 1):
        found = judged([run], EVENTS, known)
        known = stored(found)
        if number % 9 == 0:
            assert content(found) == content(judged(RUNS[:number], EVENTS))
    assert content(found) == content(judged(RUNS, EVENTS))


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=10, deadline=None)
def test_any_order_of_arrival_gives_what_judging_from_the_start_gives(data: st.DataObject) -> None:
    """Late runs, duplicates, corrections and events rewind to a checkpoint before them."""
    offered = data.draw(st.lists(st.sampled_from(RUNS[:26]), min_size=6, max_size=14, unique_by=id))
    runs: dict[str, Run] = {}
    events: list[Event] = []
    checkpoints: list[Checkpoint] = []
    for run in offered:
        changed = [str(run.measured_at)]
        action = data.draw(st.sampled_from(["add", "add", "add", "twice", "correct", "event"]))
        runs[run.id] = run
        if action == "correct":
            corrected = amend(run, measured_at=at(data.draw(st.integers(1, 40)) + 0.3))
            runs[corrected.id] = corrected
            changed.append(str(corrected.measured_at))
        if action == "event":
            event = Event(at(data.draw(st.integers(1, 40)) - 0.25), data.draw(st.sampled_from(KINDS)))
            events.append(event)
            changed.append(event.at)
        known = checkpoint_before(checkpoints, changed)
        checkpoints = [] if known is None else [each for each in checkpoints if each.until <= known.until]
        superseded = {each.made.inputs.get("supersedes") for each in runs.values()}
        current = [each for each in runs.values() if each.id not in superseded]
        later = [each for each in current if known is None or str(each.measured_at) > known.until]
        found = judged([*later, *later[:1]] if action == "twice" else later, events, known)
        checkpoints.append(stored(found))
    assert content(found) == content(judged(current, events))


KINDS = ("greased", "sensor remounted", "nut replaced", "note")


def test_a_duplicate_changes_nothing_and_a_late_run_needs_an_earlier_checkpoint() -> None:
    first, both = stored(judged(RUNS[:8])), stored(judged(RUNS[:12]))
    assert content(judged([RUNS[5]], (), both)) == content(judged(RUNS[:12]))
    assert content(judged([], (), both)) == content(judged(RUNS[:12]))
    for late in (replace(RUNS[5], id="other"), replace(RUNS[5], temperature_C=30.0)):
        with pytest.raises(InputError, match="late run or corrects one"):
            judged([late], (), both)
    with pytest.raises(InputError, match="late run or corrects one"):
        judged([amend(RUNS[5], measured_at=at(44.5))], (), both)
    assert checkpoint_before([first, both], [str(RUNS[9].measured_at)]) is first
    assert checkpoint_before([first, both], [at(100.0), str(RUNS[11].measured_at)]) is first
    assert checkpoint_before([first, both], [at(100.0)]) is both
    assert checkpoint_before([first, both], [at(-1.0)]) is None


def test_a_checkpoint_of_another_model_settings_or_past_is_refused() -> None:
    known = stored(judged(RUNS[:8]))
    for change, match in (
        ({"model": calibrated(share=0.2)}, "another model"),
        ({"settings": replace(FEW, seed=8)}, "other settings"),
        ({"events": EVENTS}, "events until"),
    ):
        given_ = {"model": MODEL, "settings": FEW, "events": ()} | change
        with pytest.raises(InputError, match=match):
            monitor(RUNS[8:], checkpoint=known, life=LIFE, **given_)  # type: ignore[arg-type]
    note = (Event(at(3.0), "note"), Event(at(8.0), "greased"))
    assert judged(RUNS[8:9], note, known).state.runs[-1].reading.run == RUNS[8].id


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"not",
        b"ballscrew checkpoint 1\n",
        b"ballscrew checkpoint 1\nxx",
        b"ballscrew checkpoint 9\n",
        None,
    ],
)
def test_damaged_bytes_are_refused(data: bytes | None) -> None:
    whole = judged(RUNS[:4]).checkpoint.to_bytes()  # type: ignore[union-attr]
    if data is None:
        head, _, text = whole.split(b"\n", 2)
        text = zlib.compress(zlib.decompress(text).replace(b"EpochState", b"EpochStare"))
        data = b"\n".join([head, hashlib.sha256(text).hexdigest().encode(), text])
    for damaged in (data, whole[:-9]):
        with pytest.raises(InputError, match="the checkpoint"):
            Checkpoint.from_bytes(damaged)


@pytest.mark.slow
def test_what_is_stored_beside_the_rows_does_not_grow() -> None:
    """The rows alone do: a chart's state has as many numbers after 200 runs as after 60."""
    sizes = []
    for count in (60, 200):
        found = judged(history(np.arange(float(count)), seed=2))
        assert found.checkpoint is not None
        epochs = [replace(epoch, rows=()) for epoch in found.checkpoint.history.epochs]
        bare = replace(found.checkpoint, history=replace(found.checkpoint.history, epochs=tuple(epochs)))
        sizes.append(len(zlib.decompress(bare.to_bytes().split(b"\n", 2)[2])))
    assert sizes[1] < 1.05 * sizes[0]


def test_runs_by_another_method_than_those_of_the_checkpoint_are_refused() -> None:
    runs = history(range(5))
    known = judged(runs[:4], ())
    assert known.checkpoint is not None
    cells = tuple(replace(cell, method="paper") for cell in runs[4].cells)
    with pytest.raises(InputError, match="by method paper, those of the checkpoint by method joint"):
        judged([replace(runs[4], cells=cells)], (), known.checkpoint)


def test_a_document_of_another_kind_is_no_checkpoint() -> None:
    runs = history(range(5))
    found = judged(runs, ())
    assert found.checkpoint is not None
    head, _, _ = found.checkpoint.to_bytes().partition(b"\n")
    content = to_bytes(found.state.runs[0].reading, {})
    data = head + b"\n" + _hash_of(content) + b"\n" + content
    with pytest.raises(InputError, match="the checkpoint: is no checkpoint of ballscrew"):
        Checkpoint.from_bytes(data)
