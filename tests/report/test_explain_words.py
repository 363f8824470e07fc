"""Explanation of a deviation, and advice on every term of the uncertainty."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from ballscrew.modal.evidence import Evidence
from ballscrew.modal.run import MotorRipple, Run
from ballscrew.report.explain_words import _HELP, _MEANS, _deviation, _ripple, _verdict


def evidence_of(deviation: float, scatter: float | None) -> Evidence:
    cell = SimpleNamespace(
        frequency_Hz=150.0,
        deviation_Hz=deviation,
        deviation_standard_uncertainty_Hz=0.1,
        verdict="good",
        reasons=(),
    )
    return cast("Evidence", SimpleNamespace(cell=cell, scatter=scatter, siblings=()))


@pytest.mark.parametrize(
    ("deviation", "scatter", "words"),
    [
        (0.1, 0.3, "No problems found."),
        (0.8, 0.3, "No problems found."),
        (2.2, 0.3, "this cell's own data do not"),
        (-2.2, None, "this cell's own data do not"),
    ],
)
def test_a_cell_far_off_by_its_own_data_has_a_problem(
    deviation: float, scatter: float | None, words: str
) -> None:
    given = evidence_of(deviation, scatter)
    assert words in _verdict(given).lines[0]
    if scatter is not None:
        assert ("outlier" in _deviation(given)[1]) == ("do not" in words)


def test_there_is_help_against_every_part_of_the_uncertainty() -> None:
    named: Any = {name for means in _MEANS.values() for name in means}
    assert named <= set(_HELP)


def test_the_motors_ripple_is_reported_with_its_known_sizes() -> None:
    rows = (MotorRipple(6, 0.0042, 0.0001), MotorRipple(12, None, None))
    (words,) = _ripple(cast("Run", SimpleNamespace(motor_ripple=rows, cells=())))
    assert "6 (4.2 ± 0.2 N·mm), 12 (size unknown)" in words
    assert _ripple(cast("Run", SimpleNamespace(motor_ripple=()))) == ()
    wide = SimpleNamespace(uncertainty_terms_Hz={"ripple": 0.3})
    (fraction,) = _ripple(cast("Run", SimpleNamespace(motor_ripple=rows, cells=(wide,))))
    assert "as behind a belt" in fraction
    assert "belt" not in words
