"""Every key that ``monitor --json`` prints is documented."""

from __future__ import annotations

import re
from dataclasses import fields

import pytest
from tests.docs.pages import page, section
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import history, worn

from ballscrew.monitoring.epochs import Epoch
from ballscrew.prognosis.monitor import Monitored, monitor

PAGE = "docs/reference/monitor-json.md"


def documented(heading: str) -> set[str]:
    rows = re.findall(r"^\| (`[^|]+) \|", section(page(PAGE), heading), re.M)
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


@pytest.fixture(scope="module")
def monitored() -> Monitored:
    return monitor(history(range(0, 36, 3), worn(15.0, 80.0)), calibrated())


def test_every_key_of_a_run_and_its_reading(monitored: Monitored) -> None:
    run = monitored.to_json()["runs"][-1]
    assert documented("`runs`") == set(run)
    assert documented("`reading`") == set(run["reading"])


def test_every_key_of_an_epoch_and_of_the_prognosis(monitored: Monitored) -> None:
    assert documented("`epochs`") == {field.name for field in fields(Epoch)}
    assert documented("`prognosis`") == set(monitored.to_json()["prognosis"])


def test_every_key_of_the_document(monitored: Monitored) -> None:
    text = page(PAGE)
    head = text[: text.index("## ")]
    keys = {
        name for row in re.findall(r"^\| (`[^|]+) \|", head, re.M) for name in re.findall(r"`([^`]+)`", row)
    }
    assert keys == set(monitored.to_json())
