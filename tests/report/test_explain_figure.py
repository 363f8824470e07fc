"""Evidence for the result of one cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from tests.report.some_runs import LINES, WHY, line_named, run_of_modes

from ballscrew.modal.cell import CellResult
from ballscrew.modal.evidence import Evidence
from ballscrew.modal.run import Run
from ballscrew.report.explain_figure import draw_explanation

pytest.importorskip("matplotlib")

PLACE = (0.1, "PA")  # true frequency 170 Hz


def evidence_of(run: Run, *, paper: CellResult | None = None, **changes) -> Evidence:
    """Evidence for the cell of ``PLACE``, changed; by the paper's method it is the same unless given."""
    (cell,) = (cell for cell in run.cells if (cell.position_m, cell.condition) == PLACE)
    return Evidence(run, replace(cell, **changes), paper or cell, 3, 3, ())


def names(axes) -> list[str]:
    return axes.get_legend_handles_labels()[1]


def texts(axes) -> list[str]:
    return [" ".join(text.get_text().split()) for text in axes.texts]


def test_each_response_is_drawn_beside_their_rms_with_its_own_coherence() -> None:
    upper, lower, _ = draw_explanation(evidence_of(run_of_modes())).axes
    assert names(upper).count("each response") == 2
    shown = (upper.get_xlim()[0] <= LINES) & (upper.get_xlim()[1] >= LINES)
    mode = np.abs(3 / (1 - (LINES / 170) ** 2 + 0.06j * LINES / 170))[shown]
    curves = [line for line in upper.get_lines() if line.get_label() == "each response"]
    np.testing.assert_allclose(curves[0].get_ydata(), mode)
    np.testing.assert_allclose(curves[1].get_ydata(), 1.1 * mode)
    f, mean = line_named(upper, "FRF (H1), nut-1:x, nut-2:x")
    np.testing.assert_allclose(mean, np.sqrt((1 + 1.1**2) / 2) * mode)
    assert sum(len(line.get_xdata()) == len(f) for line in lower.get_lines()) == 3


def test_many_responses_are_counted_in_the_legend() -> None:
    run = run_of_modes()
    table = run.frequency_response
    third = table.isel(response=[0]).assign_coords(response=["acceleration:nut-3:x"])
    both = xr.concat([table, third], "response", data_vars="minimal", coords="minimal", compat="override")
    more = replace(run, frequency_response=both)
    upper, *_ = draw_explanation(evidence_of(more)).axes
    assert "FRF (H1), 3 responses" in names(upper)


def test_the_peak_of_the_paper_is_marked_where_it_is_not_the_result_itself() -> None:
    upper, *_ = draw_explanation(evidence_of(run_of_modes())).axes
    assert not any("(paper)" in name for name in names(upper))
    upper, *_ = draw_explanation(evidence_of(run_of_modes(), method="joint", frequency_Hz=169.5)).axes
    assert "peak of the FRF (paper), 171.0 Hz" in names(upper)


def test_a_refused_cell_has_its_reason_and_the_span_of_the_band_searched() -> None:
    given = evidence_of(run_of_modes(refused=[PLACE]))
    upper, *_ = draw_explanation(given).axes
    (text,) = texts(upper)
    assert text == f"refused: {WHY}".replace("$", r"\$")
    assert upper.get_ylim()[1] > 2 * draw_explanation(evidence_of(run_of_modes())).axes[0].get_ylim()[1]
    centre = 170 * np.sqrt(0.8 * 1.2)
    low, high = upper.get_xlim()
    assert low < centre < high
    found = draw_explanation(evidence_of(run_of_modes(), frequency_Hz=centre)).axes[0].get_xlim()
    assert (low, high) == pytest.approx(found)
    without_band = replace(given, paper=replace(given.paper, band_Hz=None))
    assert draw_explanation(without_band).axes[0].get_xlim() != pytest.approx(found)


@pytest.mark.parametrize(
    ("count", "note"), [(0, None), (1, "one repetition: always 1"), (3, "unrelated signals")]
)
def test_the_coherence_of_unrelated_signals_is_one_over_the_repetitions(count: int, note: str | None) -> None:
    _, lower, _ = draw_explanation(evidence_of(run_of_modes(), repetitions=count)).axes
    levels = [line.get_ydata()[0] for line in lower.get_lines() if line.get_linestyle() == ":"]
    assert levels == ([1 / count] if count else [])
    assert texts(lower) == ([note] if note else [])
