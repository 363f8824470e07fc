"""RUN.json is what people and programs hand on: any field may hold anything."""

from __future__ import annotations

import contextlib
import copy
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.estimation.made_runs import run_of

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import write_json
from ballscrew.base.quantity import Quantity
from ballscrew.modal.run import Run

DOCUMENT: dict[str, Any] = json.loads(
    write_json(
        run_of(
            0.9, temperature_C=20.0, mass_over_preload_kg_per_N=Quantity(0.2, 0.02, "kg/N"),
        ).to_json()
    )
)  # fmt: skip
DOCUMENT["shared_errors"] = [{"name": "model", "repeats": True, "effects_Hz": [0.1] * 40}]
DOCUMENT["motor_ripple"] = [{"order": 6, "torque_Nm": 0.004, "standard_uncertainty_Nm": 1e-4}]
DOCUMENT["frame_mode"] = {
    "frequency_Hz": 180.0, "standard_uncertainty_Hz": 0.2, "damping_ratio": 0.05, "mass_ratio": 8.0,
    "residual_ratio": 0.2, "distinct": True, "pitching": False,
}  # fmt: skip
DOCUMENT["transients"] = [
    {"file": 0, "start_s": 0.1, "stop_s": 0.2, "position_m": 0.0, "condition": "PA", "motion": 0,
     "repetition": 1}
]  # fmt: skip


def changed(path: str, value: Any) -> dict[str, Any]:
    """The document with one value in another's place; KeyError takes it out."""
    other = copy.deepcopy(DOCUMENT)
    *tables, last = path.split(".")
    table: Any = other
    for name in tables:
        table = table[int(name)] if name.isdigit() else table[name]
    if value is KeyError:
        del table[last]
    else:
        table[int(last) if last.isdigit() else last] = value
    return other


def test_the_document_itself_is_read_and_written_alike() -> None:
    run = Run.from_json(DOCUMENT)
    assert Run.from_json(run.to_json()) == run
    assert json.loads(write_json(run.to_json())) == DOCUMENT


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("id", 5), ("id", None), ("id", "x" * 20_000), ("run", []), ("run.temperature_C", "warm"),
        ("run.temperature_C", [20]), ("run.temperature_C", -300), ("run.temperature_C", 10**400),
        ("run.mass_kg", True), ("run.mass_kg", -1), ("run.mass_kg", 1e300), ("run.axis", 7),
        ("run.measured_at", 3), ("run.measured_at", "yesterday"),
        ("run.files", [{"name": 4, "sha256": "0"}]), ("run.files", "a.h5"),
        ("rigid_body", None), ("rigid_body.coulomb_N", "x"), ("rigid_body.coulomb_N", 1e300),
        ("rigid_body.standard_uncertainty", None), ("rigid_body.standard_uncertainty", [1]),
        ("rigid_body.standard_uncertainty.coulomb_N", "x"), ("rigid_body.equivalent_mass_kg", 1e308),
        ("rigid_body.reasons", "none"), ("made.inputs", []), ("made.inputs", None),
        ("made.inputs.plan", 4), ("made.settings", 4), ("made.version", 1), ("cells", {}),
        ("cells.0", 3), ("cells.0.frequency_Hz", "x"), ("cells.0.frequency_Hz", 1e-200),
        ("cells.0.frequency_Hz", -100), ("cells.0.frequency_Hz", 1e300),
        ("cells.0.standard_uncertainty_Hz", 1e-300), ("cells.0.standard_uncertainty_Hz", 0.0),
        ("cells.0.standard_uncertainty_Hz", -1), ("cells.0.standard_uncertainty_Hz", 1e300),
        ("cells.0.rotor_held_frequency_Hz", "x"), ("cells.0.rotor_held_frequency_Hz", 1e300),
        ("cells.0.rotor_held_frequency_Hz", 1e5), ("cells.0.deviation_Hz", "x"),
        ("cells.0.deviation_Hz", 1e300), ("cells.0.deviation_Hz", -1e3), ("cells.0.position_m", 1e300),
        ("cells.0.position_m", None), ("cells.0.condition", {}), ("cells.0.condition", KeyError),
        ("cells.0.condition", "XX"), ("transients.0.condition", "pa"), ("cells.0.damping_ratio", -1),
        ("cells.0.motion", -1), ("cells.0.motion", 0.5), ("cells.0.verdict", "fine"),
        ("cells.0.reasons", [1]), ("cells.0.reason_kinds", ["tone"]), ("cells.0.reason_kinds", [1]),
        ("cells.0.band_Hz", [1]), ("cells.0.band_Hz", ["a", "b"]),
        ("cells.0.uncertainty_terms_Hz", 3), ("cells.0.uncertainty_terms_Hz.noise", -1),
        ("cells.0.coherence", 2), ("cells.0.damping_ratio", "x"), ("shared_errors", 3),
        ("shared_errors.0.repeats", 1), ("shared_errors.0.name", None),
        ("shared_errors.0.effects_Hz.0", 1e300), ("shared_errors.0.effects_Hz.0", "x"),
        ("mass_over_preload_kg_per_N.value", 0), ("mass_over_preload_kg_per_N.value", 10**400),
        ("mass_over_preload_kg_per_N.standard_uncertainty", KeyError),
        ("mass_over_preload_kg_per_N.interval95", [2, 1]), ("mass_over_preload_kg_per_N", 4),
        ("frame_mode", 3), ("frame_mode.frequency_Hz", None), ("frame_mode.residual_ratio", 2),
        ("frame_mode.mass_ratio", -1), ("frame_mode.distinct", KeyError),
        ("frame_mode.pitching", 1),
        ("motor_ripple", 3), ("motor_ripple.0.order", 0.5), ("motor_ripple.0.torque_Nm", -1),
        ("motor_ripple.0.standard_uncertainty_Nm", "x"), ("motor_ripple.0.order", KeyError),
        ("motor_ripple.0.order", 0), ("motor_ripple.0.standard_uncertainty_Nm", None),
        ("transients.0.start_s", "x"), ("transients.0.file", -1), ("quality", 3),
    ],
)  # fmt: skip
def test_what_no_run_can_hold_is_one_sentence_that_says_where(path: str, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        Run.from_json(changed(path, value), "odd.json")
    message = str(caught.value)
    last = [part for part in path.split(".") if not part.isdigit()][-1]
    assert message.startswith("odd.json: is not a run of ballscrew: ")
    assert last in message
    assert len(message) < 400


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("rigid_body", {}), ("rigid_body.equivalent_mass_kg", None), ("shared_errors", KeyError),
        ("motor_ripple", KeyError), ("motor_ripple", []), ("frame_mode", KeyError), ("frame_mode", None),
        ("mass_over_preload_kg_per_N", None), ("cells.0.frequency_Hz", None), ("cells.0.coherence", None),
        ("cells.0.deviation_Hz", KeyError), ("run.temperature_C", None), ("made.inputs.plan", None),
    ],
)  # fmt: skip
def test_what_may_be_missing_is_read(path: str, value: Any) -> None:
    assert Run.from_json(changed(path, value)).id == "run"


ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=100, deadline=None)
@given(path=st.sampled_from(["run", "quality", "rigid_body", "cells", "cells.0", "made", "shared_errors.0"]),
       value=ANY)  # fmt: skip
def test_anything_in_the_place_of_a_table_is_read_or_refused(path: str, value: Any) -> None:
    with contextlib.suppress(InputError):
        Run.from_json(changed(path, value))


def test_control_characters_of_texts_are_escaped() -> None:
    document = changed("quality", {"verdict": "bad", "reasons": ["a\x1b[31m\nNORMAL"]})
    document["cells"][0] |= {"reasons": ["b\r\n"], "reason_kinds": ["tone"]}
    run = Run.from_json(document)
    assert run.quality.reasons == ("a\\x1b[31m\\nNORMAL",)
    assert run.cells[0].reasons == ("b\\r\\n",)
