"""Explanation of a deviation, and advice on every term of the uncertainty."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from tests.estimation.made_runs import run_of

from ballscrew.modal.cell import CellResult
from ballscrew.modal.evidence import Evidence
from ballscrew.modal.joint import frequencies
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import FrameMode, MotorRipple, Run
from ballscrew.recording.quality.finding import Quality
from ballscrew.report import explain_words
from ballscrew.report.explain_words import (
    _HELP,
    _MEANS,
    _deviation,
    _ripple,
    _verdict,
    advice,
    explain,
    headline,
    place,
)


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


def evidence_for(run: Run, number: int = 5, **others: Any) -> Evidence:
    """Evidence for a cell of a run, measured in all of its transients."""
    cell = run.cells[number]
    given = {"cell": cell, "paper": cell, "found": 10, "whole": 10, "siblings": ()} | others
    return Evidence(run, **given)


def lines_of(given: Evidence, title: str) -> str:
    (part,) = (part for part in explain(given) if part.title == title)
    return " ".join(part.lines)


def test_the_headline_names_the_motion_where_there_are_several() -> None:
    run = run_of()
    first = run.cells[0]
    gentle = replace(first, motion=1)
    both = replace(run, cells=(*run.cells, gentle))
    where = f"bench, {place(first)}"
    assert headline(evidence_for(run, 0)).startswith(f"{where}, load 100 kg: ")
    assert headline(evidence_for(both, 0)).startswith(f"{where}, motion 0, load 100 kg: ")
    assert headline(evidence_for(both, -1)).startswith(f"{where}, motion 1, load 100 kg: ")


def test_a_frequency_without_a_finite_uncertainty_has_no_interval() -> None:
    cell = replace(run_of().cells[0], frequency_Hz=151.26, standard_uncertainty_Hz=math.inf)
    assert headline(Evidence(run_of(), cell, cell, 1, 1, ())).endswith(": 151.3 Hz")
    known = replace(cell, standard_uncertainty_Hz=0.5)
    assert headline(Evidence(run_of(), known, known, 1, 1, ())).endswith(": 151.3 ± 1.0 Hz (95 %)")


def test_transients_that_were_not_used_are_counted_with_the_reason() -> None:
    run = run_of()  # ten repetitions a cell
    assert "10 transients of this cell in 1 recording, all used." in lines_of(
        evidence_for(run), "Measurement"
    )
    words = lines_of(evidence_for(run, found=15, whole=12), "Measurement")
    assert (
        "15 transients of this cell in 1 recording, 10 used; 3 cut by the start or end of a recording, or "
        "part of a warm-up; 2 could not be aligned with the others." in words
    )
    words = lines_of(evidence_for(run, found=12, whole=12), "Measurement")
    assert words.endswith("10 used; 2 could not be aligned with the others.")
    words = lines_of(evidence_for(run, found=11, whole=10), "Measurement")
    assert words.endswith("10 used; 1 cut by the start or end of a recording, or part of a warm-up.")


def test_the_mode_of_the_frame_has_its_mass_where_it_is_known() -> None:
    mode = FrameMode(41.0, 0.5, 0.02, 12.34, 0.1, True)
    words = lines_of(evidence_for(replace(run_of(), frame_mode=mode)), "Mode of frame or table")
    assert words.startswith("The machine's frame has a mode at 41.0 ± 1.0 Hz (95 %), with 12.3 times the")
    words = lines_of(
        evidence_for(replace(run_of(), frame_mode=replace(mode, mass_ratio=None))), "Mode of frame or table"
    )
    assert "(95 %). Frequencies are" in words
    words = lines_of(
        evidence_for(replace(run_of(), frame_mode=replace(mode, pitching=True))), "Mode of frame or table"
    )
    assert (
        words
        == "The table pitches at 41.0 ± 1.0 Hz (95 %). Frequencies are those of the axis without pitching."
    )


def test_the_peak_of_the_frf_is_compared_with_the_result_of_the_run() -> None:
    title = "Peak of the FRF (method of the paper)"
    run = run_of()
    cell = replace(run.cells[5], frequency_Hz=150.0, standard_uncertainty_Hz=0.3)
    peak = replace(cell, method="paper", frequency_Hz=150.5, standard_uncertainty_Hz=0.4, verdict="suspect")
    given = evidence_for(run, cell=cell, paper=peak)
    words = lines_of(given, title)
    assert words == "150.5 ± 0.8 Hz (95 %), suspect; 0.50 Hz above the result of the run: consistent."
    far = replace(given, paper=replace(peak, frequency_Hz=148.9))
    assert lines_of(far, title).endswith(
        "1.10 Hz below the result of the run: more than their uncertainties explain."
    )
    refused = CellResult.refused(cell.key, 10, "joint", [Reason("noise", "there is noise")])
    alone = lines_of(replace(given, cell=refused), title)
    assert alone == "150.5 ± 0.8 Hz (95 %), suspect."
    none = CellResult.refused(cell.key, 10, "paper", [Reason("no-peak", "no peak"), Reason("noise", "noise")])
    assert lines_of(replace(given, paper=none), title) == "Refused: no peak; noise."


def test_advice_follows_from_the_measurement_and_from_the_reason_of_a_refusal() -> None:
    run = run_of()
    cell = run.cells[5]
    bad = replace(run, quality=Quality("bad", ("clipped",)))
    assert advice(evidence_for(bad)) == (
        "Correct what the reasons of the measurement name, and measure again.",
    )
    assert advice(evidence_for(run, found=2, whole=0))[0].startswith("Run the whole plan")
    few = replace(cell, repetitions=4, uncertainty_terms_Hz={})
    assert "More repetitions: 4 now; 10 or more allow outliers to be found." in advice(
        evidence_for(run, cell=few)
    )
    assert not any("More repetitions" in each for each in advice(evidence_for(run)))
    tone = CellResult.refused(cell.key, 10, "joint", [Reason("tone", "a tone")])
    assert advice(evidence_for(run, cell=tone))[0].startswith("Provide a data sheet (--axis): with the lead")
    noisy = CellResult.refused(cell.key, 10, "joint", [Reason("noise", "noise")])
    peak = replace(cell, method="paper", frequency_Hz=148.0)
    assert advice(evidence_for(run, cell=noisy, paper=peak))[0].startswith(
        "A search with --band around the peak at 148.0 Hz"
    )
    none = replace(noisy, method="paper")
    assert advice(evidence_for(run, cell=noisy, paper=none))[0].startswith("A motion that excites the mode")


def test_every_term_of_the_uncertainty_is_explained() -> None:
    source = Path(frequencies.__file__).read_text(encoding="utf-8")
    terms = set(re.findall(r'UncertaintyTerm\("(\w+)"', source))
    assert len(terms) > 10
    assert terms <= explain_words._MEANS["joint"].keys()
    assert terms <= explain_words._HELP.keys()
