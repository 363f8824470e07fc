"""Precision and lead time by what was found after alarms."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from ballscrew.base.errors import InputError
from ballscrew.store.findings import (
    CONFIRMED,
    NOTHING,
    OTHER,
    _machine_name,
    precision,
    split_finding,
    stored_finding,
    summarise,
)
from ballscrew.store.tables import MachineRow


def alarm(finding: str | None, lead: float | None = None, *, closed: bool = True) -> dict[str, Any]:
    return {"closed_at": "2026-01-01T00:00Z" if closed else None, "finding": finding, "lead_days": lead}


@given(st.integers(1, 200), st.data())
def test_the_interval_is_that_of_wilson(inspected: int, data: st.DataObject) -> None:
    confirmed = data.draw(st.integers(0, inspected))
    low, high = binomtest(confirmed, inspected).proportion_ci(0.95, "wilson")
    assert precision(confirmed, inspected) == pytest.approx([confirmed / inspected, low, high], abs=1e-9)


def test_without_an_inspected_alarm_there_is_no_number() -> None:
    assert precision(0, 0) is None
    found = summarise([alarm("not inspected"), alarm(None), alarm(None, closed=False)])
    assert (found["alarms"], found["closed"], found["not_inspected"]) == (3, 2, 2)
    assert (found["inspected"], found["precision"], found["lead_days"]) == (0, None, None)


def test_counts_precision_and_lead_time_are_those_of_the_alarms() -> None:
    found = summarise(
        [alarm(CONFIRMED, 3.0), alarm(CONFIRMED, 10.0), alarm(CONFIRMED, 5.0), alarm(OTHER), alarm(NOTHING)]
    )
    assert (found["inspected"], found["confirmed"], found["another_cause"], found["nothing_found"]) == (
        5,
        3,
        1,
        1,
    )
    assert found["lead_days"] == [5.0, 3.0, 10.0]
    assert found["precision"][0] == pytest.approx(0.6)


def test_another_cause_says_which_and_no_other_finding_does() -> None:
    assert split_finding(stored_finding(OTHER, " bearing: loose ")) == (OTHER, "bearing: loose")
    assert split_finding(stored_finding(CONFIRMED, "")) == (CONFIRMED, None)
    assert split_finding(None) == (None, None)
    for finding, cause in ((OTHER, " "), (NOTHING, "bearing")):
        with pytest.raises(InputError, match="which other cause"):
            stored_finding(finding, cause)


@pytest.mark.parametrize(
    ("machine", "name"),
    [
        (None, None),
        (MachineRow(name="mill 4", site="hall 2"), "hall 2: mill 4"),
        (MachineRow(name="mill 4", site=""), "mill 4"),
    ],
)
def test_a_machine_is_named_with_its_site_where_the_axis_has_one(
    machine: MachineRow | None, name: str | None
) -> None:
    assert _machine_name(machine) == name
