"""Time and load of an analysed run, added later."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.cli.conftest import FILES
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import history

from ballscrew import InputError, Run, amend, read_axis, read_plan
from ballscrew.axis.model import rotor_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.provenance import Made, digest
from ballscrew.fcft.plan import Plan
from ballscrew.modal.amend import current_runs
from ballscrew.modal.run import RigidBodyResult
from ballscrew.monitoring.health import health_state
from ballscrew.recording.quality.finding import Quality

UNCERTAINTY = {"equivalent_mass_kg": 0.3, "viscous_N_s_per_m": 1.0, "coulomb_N": 1.0, "offset_N": 0.1}


@pytest.fixture
def documents(tmp_path: Path) -> tuple[DataSheet, Plan]:
    for name in ("axis.toml", "plan.toml"):
        (tmp_path / name).write_text(FILES[name], encoding="utf-8")
    return read_axis(tmp_path / "axis.toml"), read_plan(tmp_path / "plan.toml")


def measured(sheet: DataSheet, plan: Plan, load: float, declared: float | None) -> Run:
    """Run with a load on the table that need not be the declared one."""
    body = RigidBodyResult(
        equivalent_mass_kg=sheet.table.mass + rotor_mass(sheet) + load,
        viscous_N_s_per_m=100.0, coulomb_N=25.0, offset_N=0.0, standard_uncertainty=UNCERTAINTY,
    )  # fmt: skip
    inputs = {"axis": digest(sheet.to_settings()), "plan": digest(plan.to_settings())}
    run = history([0.0])[0]
    return replace(run, rigid_body=body, mass_kg=declared, made=Made(inputs=inputs), measured_at=None)


def test_a_time_makes_a_new_run_that_supersedes_the_old_one() -> None:
    first, second = history([0.0, 1.0])
    later = amend(second, measured_at="2026-01-05T08:00Z")
    assert later.measured_at == "2026-01-05T08:00:00+00:00"
    assert later.id not in (first.id, second.id)
    assert later.made.inputs["supersedes"] == second.id
    assert later == replace(second, id=later.id, measured_at=later.measured_at, made=later.made)
    assert amend(second, measured_at="2026-01-05T08:00Z").id == later.id
    assert current_runs([first, second, later]) == [first, later]
    state = health_state([first, second, later], calibrated())
    assert [row.reading.run for row in state.runs] == [first.id, later.id]


def test_a_load_is_checked_again(documents: tuple[DataSheet, Plan]) -> None:
    sheet, plan = documents
    unknown = measured(sheet, plan, 100.0, None)
    good = amend(unknown, mass="100 kg", axis=sheet, plan=plan)
    assert (good.mass_kg, good.quality.verdict) == (100.0, "good")
    wrong = amend(unknown, mass=60.0, axis=sheet, plan=plan)
    assert wrong.quality.verdict == "suspect"
    assert any("a load of 100 kg would explain it" in reason for reason in wrong.quality.reasons)
    assert any("not in the plan" in reason for reason in wrong.quality.reasons)
    corrected = amend(wrong, mass=100.0, axis=sheet, plan=plan)
    assert corrected.quality == Quality("good")
    hummed = replace(wrong, quality=Quality("suspect", ("torque hums", *wrong.quality.reasons)))
    assert amend(hummed, mass=100.0, axis=sheet, plan=plan).quality == Quality("suspect", ("torque hums",))
    assert corrected.cells == wrong.cells


def test_what_cannot_be_amended(documents: tuple[DataSheet, Plan]) -> None:
    sheet, plan = documents
    run = measured(sheet, plan, 100.0, None)
    with pytest.raises(InputError, match="nothing is to be amended"):
        amend(run)
    with pytest.raises(InputError, match="must be a time"):
        amend(run, measured_at="yesterday")
    with pytest.raises(InputError, match="requires the run's axis"):
        amend(run, mass=100.0)
    with pytest.raises(InputError, match="requires the run's plan"):
        amend(run, mass=100.0, axis=sheet)
    with pytest.raises(InputError, match="not that of the analysis"):
        amend(run, mass=100.0, axis=replace(sheet, name="another"), plan=plan)
    with pytest.raises(InputError, match="too much for a wrong load"):
        amend(run, mass=1000.0, axis=sheet, plan=plan)
    with pytest.raises(InputError, match="0 kg or more"):
        amend(run, mass=-1.0, axis=sheet, plan=plan)


def test_a_load_that_is_no_mass_is_refused(documents: tuple[DataSheet, Plan]) -> None:
    sheet, plan = documents
    run = measured(sheet, plan, 100.0, None)
    with pytest.raises(InputError, match=r"the load \(mass\) is '5 mm'; it must be a quantity in kg"):
        amend(run, mass="5 mm", axis=sheet, plan=plan)


def test_a_run_that_was_refused_for_its_load_is_to_be_analysed_again(
    documents: tuple[DataSheet, Plan],
) -> None:
    sheet, plan = documents
    refused = measured(sheet, plan, 100.0, 1000.0)
    with pytest.raises(InputError, match="refused because of its load; analyse it again with --mass"):
        amend(refused, mass=100.0, axis=sheet, plan=plan)


def test_a_bad_measurement_stays_bad_with_another_load(documents: tuple[DataSheet, Plan]) -> None:
    sheet, plan = documents
    wrong = amend(measured(sheet, plan, 100.0, None), mass=60.0, axis=sheet, plan=plan)
    clipped = replace(wrong, quality=Quality("bad", ("clipped", *wrong.quality.reasons)))
    assert amend(clipped, mass=100.0, axis=sheet, plan=plan).quality == Quality("bad", ("clipped",))


def test_without_a_fitted_mass_the_load_is_compared_with_the_plan_alone(
    documents: tuple[DataSheet, Plan],
) -> None:
    sheet, plan = documents
    run = replace(measured(sheet, plan, 100.0, None), rigid_body=RigidBodyResult())
    assert amend(run, mass=100.0, axis=sheet, plan=plan).quality.verdict == "good"
    other = amend(run, mass=60.0, axis=sheet, plan=plan)
    (reason,) = other.quality.reasons
    assert "not in the plan" in reason
