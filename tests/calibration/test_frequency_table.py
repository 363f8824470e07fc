"""Frequencies of a run as arrays, and the correlation of their errors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.tables import table

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.covariance import joint_covariance, run_covariance
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.modal.cell import SharedError
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import RigidBodyResult
from ballscrew.recording.quality.finding import Quality


@pytest.mark.parametrize(
    ("kind", "verdict"),
    [
        ("few-repetitions", "suspect"),
        ("unloaded", "suspect"),
        ("nearly-unloaded", "good"),
        ("uncertain", "good"),
        ("ripple", "good"),
    ],
)
def test_a_reason_of_half_of_the_cells_makes_the_run_suspect_unless_its_uncertainty_contains_it(
    kind, verdict
):
    run = table(lambda x: 150.0 - 100 * x, (0.0, 0.1, 0.2), 50.0, 1)
    cells = [
        replace(cell, verdict="suspect").with_reasons(Reason(kind, f"why {row}"), Reason(kind, "again"))
        for row, cell in enumerate(run.cells[:6])
    ]
    assert frequency_table(replace(run, cells=(*cells, *run.cells[6:]))).verdict == verdict
    assert frequency_table(replace(run, cells=(*cells[:5], *run.cells[5:]))).verdict == "good"


def test_reasons_of_a_document_without_kinds_are_doubts():
    run = table(lambda x: 150.0 - 100 * x, (0.0, 0.1, 0.2), 50.0, 1)
    cells = tuple(replace(cell, verdict="suspect", reasons=("why",)) for cell in run.cells)
    assert frequency_table(replace(run, cells=cells)).reasons == ("why",)


def test_the_variance_of_a_cell_is_its_own_and_the_shared(experiment) -> None:
    run = experiment()[0]
    table = frequency_table(run)
    np.testing.assert_allclose(
        np.diag(run_covariance(table)), [c.standard_uncertainty_Hz**2 for c in run.cells], rtol=1e-9
    )
    assert run_covariance(table)[0, -1] > 0 or run_covariance(table)[0, 4] > 0
    assert table.frequency.tolist() == [c.frequency_Hz for c in run.cells]


def test_refused_cells_and_their_effects_are_omitted(experiment) -> None:
    run = experiment()[0]
    cells = list(run.cells)
    cells[3] = replace(cells[3], verdict="refused", frequency_Hz=None, standard_uncertainty_Hz=None)
    effects = tuple(
        replace(e, effects_Hz=(*e.effects_Hz[:3], None, *e.effects_Hz[4:])) for e in run.shared_errors
    )
    table = frequency_table(replace(run, cells=tuple(cells), shared_errors=effects))
    assert len(table.frequency) == len(cells) - 1
    assert table.shared.shape == (4, len(cells) - 1)
    np.testing.assert_allclose(table.shared[:, 3], frequency_table(run).shared[:, 4])


def test_a_run_without_cells_is_bad(experiment) -> None:
    run = experiment()[0]
    table = frequency_table(replace(run, cells=tuple(replace(c, verdict="refused") for c in run.cells)))
    assert (table.verdict, len(table.frequency)) == ("bad", 0)
    assert "every cell was refused" in table.reasons


def test_what_repeats_correlates_from_run_to_run(experiment) -> None:
    runs = [frequency_table(run) for run in experiment()[:2]]
    n = len(runs[0].frequency)
    whole = joint_covariance(runs, 0.9)
    repeating = runs[0].shared[runs[0].repeats]
    wanted = 0.9 * repeating.T @ runs[1].shared[runs[1].repeats]
    np.testing.assert_allclose(whole[:n, n:], wanted, atol=1e-12)
    assert np.linalg.eigvalsh(whole).min() > -1e-9
    np.testing.assert_allclose(whole[:n, :n], run_covariance(runs[0]))
    assert not joint_covariance(runs, 0.0)[:n, n:].any()


def test_an_older_joint_document_shares_level_and_tilt(experiment) -> None:
    run = replace(experiment()[0], shared_errors=())
    cells = tuple(
        replace(c, standard_uncertainty_Hz=0.5, uncertainty_terms_Hz={"noise": 0.3, "model": 0.4})
        for c in run.cells
    )
    table = frequency_table(replace(run, cells=cells))
    matrix = run_covariance(table)
    np.testing.assert_allclose(np.diag(matrix), 0.25, rtol=1e-9)
    assert matrix[0, 1] == pytest.approx(0.25)  # the same stop
    assert matrix[0, -1] == pytest.approx(0.0, abs=1e-9)  # the ends of the travel
    assert dict(zip(table.shared_names, table.repeats, strict=True))["model: level"]
    assert not dict(zip(table.shared_names, table.repeats, strict=True))["noise: level"]


def test_an_older_document_of_the_papers_method_shares_its_method(experiment) -> None:
    run = replace(experiment()[0], shared_errors=())
    terms = {"method": 0.4, "window": 0.3}
    cells = tuple(
        replace(c, method="paper", standard_uncertainty_Hz=0.5, uncertainty_terms_Hz=terms) for c in run.cells
    )
    table = frequency_table(replace(run, cells=cells))
    assert table.shared_names == ("method",)
    np.testing.assert_allclose(table.own, 0.3)


def test_masses_come_with_their_uncertainties(experiment) -> None:
    rigid = RigidBodyResult(
        equivalent_mass_kg=300.0, moving_mass_kg=132.0, standard_uncertainty={"equivalent_mass_kg": 1.0}
    )
    table = frequency_table(replace(experiment()[0], rigid_body=rigid))
    assert table.equivalent_mass == Quantity(300.0, 1.0, "kg")
    bare = frequency_table(replace(experiment()[0], rigid_body=replace(rigid, standard_uncertainty={})))
    assert bare.equivalent_mass is None  # no uncertainty: no measurement


@pytest.mark.parametrize("wrong", ["warm", [20], float("nan"), -300.0])
def test_a_temperature_that_is_none_is_refused(experiment, wrong) -> None:
    assert frequency_table(replace(experiment()[0], temperature_C=21.5)).temperature == 21.5
    with pytest.raises(InputError, match="temperature_C"):
        frequency_table(replace(experiment()[0], temperature_C=wrong))


def test_the_softening_of_a_run_is_an_anchor(experiment) -> None:
    run, softening = experiment()[0], Quantity(0.2, 0.01, "kg/N")
    table = frequency_table(replace(run, mass_over_preload_kg_per_N=softening))
    assert table.mass_over_preload == softening
    with pytest.raises(InputError, match="mass_over_preload"):
        frequency_table(replace(run, mass_over_preload_kg_per_N=Quantity(-1.0, 0.1, "kg/N")))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1.0, 0.0, "170", True, [1.0], 10**400])
@pytest.mark.parametrize("field", ["frequency_Hz", "standard_uncertainty_Hz"])
def test_a_cell_that_cannot_be_is_refused(experiment, field: str, bad: object) -> None:
    run = experiment()[0]
    cells = (replace(run.cells[0], **{field: bad}), *run.cells[1:])
    with pytest.raises(InputError, match=rf"cells\[0\].{field}"):
        frequency_table(replace(run, cells=cells))


@pytest.mark.parametrize("bad", [None, math.nan, "100 kg", -3.0])
def test_a_load_that_cannot_be_is_refused(experiment, bad: object) -> None:
    with pytest.raises(InputError, match="mass_kg"):
        frequency_table(replace(experiment()[0], mass_kg=bad))


def test_effects_of_the_wrong_length_are_refused(experiment) -> None:
    run = replace(experiment()[0], shared_errors=(SharedError("noise", False, (0.1, 0.2)),))
    with pytest.raises(InputError, match="effects_Hz has 2 numbers"):
        frequency_table(run)
    wrong = SharedError("noise", False, (math.nan,) * len(run.cells))
    with pytest.raises(InputError, match="effects_Hz"):
        frequency_table(replace(run, shared_errors=(wrong,)))


def test_a_suspect_run_stays_so(experiment) -> None:
    table = frequency_table(replace(experiment()[0], quality=Quality("suspect", ("noisy",))))
    assert (table.verdict, table.reasons) == ("suspect", ("noisy",))


def test_a_run_of_very_many_cells_is_refused(experiment, monkeypatch) -> None:
    run = experiment()[0]
    count = len(run.cells)
    monkeypatch.setattr("ballscrew.calibration.frequency_table._MOST_CELLS", count - 1)
    with pytest.raises(InputError, match=f"has {count} cells; it must have {count - 1} or fewer"):
        frequency_table(run)
    monkeypatch.setattr("ballscrew.calibration.frequency_table._MOST_CELLS", count)
    assert len(frequency_table(run).frequency) == count
