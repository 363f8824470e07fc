"""MODEL.json: there and back, and files that are not what they claim."""

from __future__ import annotations

import contextlib
import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import KIND, model_json, read_model, write_model


@pytest.fixture(scope="module")
def model(experiment, sheet) -> CalibratedAxis:
    day, later = "2026-01-01T08:00+00:00", "2026-03-01T08:00+00:00"
    runs = [*experiment(measured_at=day), *experiment(ratio=0.5, measured_at=later, loads=(100.0,))]
    return calibrate(runs, sheet, known={runs[0].id: Quantity(600.0, 12.0, "N")})


@pytest.fixture(scope="module")
def document(model) -> dict[str, Any]:
    whole: dict[str, Any] = json.loads(write_json(model_json(model)))
    return whole


def test_there_and_back(model, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    write_model(model, path)
    back = read_model(path)
    for name in ("covariance", "prior_covariance", "log_ratios", "log_ratio_covariance", "cross_covariance"):
        np.testing.assert_allclose(getattr(back, name), getattr(model, name), rtol=1e-8)
    assert back.model.share == pytest.approx(model.model.share, rel=1e-8)
    assert (back.axis, back.free, len(back.runs)) == (model.axis, model.free, len(model.runs))
    assert back.runs[5].group == 1
    assert back.anchors[0].kind == "known preload"
    assert [c.chosen for c in back.candidates] == [c.chosen for c in model.candidates]
    assert [number.field for number in back.tolerances] == ["rigidity", "stiffness", "preload_ratio"]
    for number, other in zip(back.tolerances, model.tolerances, strict=True):
        np.testing.assert_allclose(
            [*number.effects, number.estimate], [*other.effects, other.estimate], rtol=1e-8
        )
    assert [(c.convention, len(c.change)) for c in back.conventions] == [
        (c.convention, 9) for c in model.conventions
    ]
    write_model(back, tmp_path / "again.json")
    assert read_model(tmp_path / "again.json").model == back.model


def test_the_document_states_kind_units_and_provenance(document) -> None:
    assert (document["schema"], document["kind"]) == (SCHEMA, KIND)
    assert document["units"]["compliance"] == "m/N"
    assert len(document["runs"]) == 6
    assert all(len(run["id"]) == 64 for run in document["runs"])
    assert document["made"]["settings"]["sheet"]["name"] == "bench"
    assert len(document["made"]["inputs"]["axis"]) == 64


def test_an_infinite_rotor_is_null(document, tmp_path: Path) -> None:
    other = copy.deepcopy(document)
    other["parameters"]["rotor"] = None
    with pytest.raises(InputError, match="rotor is null"):
        read_model(written(tmp_path, other))
    other["free"].remove("rotor")
    for key in ("covariance", "prior_covariance"):
        other[key] = [
            [0.0 if 4 in (i, j) else v for j, v in enumerate(row)] for i, row in enumerate(other[key])
        ]
    other["cross_covariance"][4] = [0.0] * len(other["cross_covariance"][4])
    (tmp_path / "m.json").write_text(json.dumps(other), encoding="utf-8")
    assert math.isinf(read_model(tmp_path / "m.json").model.rotor)


def written(folder: Path, document: dict[str, Any]) -> Path:
    (folder / "m.json").write_text(json.dumps(document), encoding="utf-8")
    return folder / "m.json"


def wrong(document: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    other = copy.deepcopy(document)
    *tables, last = path.split(".")
    table: Any = other
    for name in tables:
        table = table[int(name)] if name.isdigit() else table[name]
    if value is KeyError:
        del table[last]
    else:
        table[int(last) if last.isdigit() else last] = value
    return other


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("kind", "a cake"), ("kind", KeyError), ("schema", 99), ("schema", "1"), ("schema", True),
        ("parameters", []), ("parameters.share", 1.5), ("parameters.mass", "32 kg"),
        ("parameters.preload", -1), ("parameters.slope", True), ("parameters.compliance", 10**400),
        ("parameters.mass", None), ("covariance", "x"), ("covariance", [[1.0]]), ("covariance.0", []),
        ("covariance.0.0", -1.0), ("covariance.0.1", 99.0), ("covariance.2.3", None),
        ("covariance", {"a": 1}), ("cross_covariance.0.1", 1e6), ("log_ratios", []), ("log_ratios.0", 0.3),
        ("log_ratios", [0.0] * 300), ("log_ratio_covariance", [[0.0]]), ("load_rating_N", 0),
        ("nut_mass_kg", -3), ("bearing_share", 2.0), ("chi2", None), ("runs", {}), ("runs.0", 3),
        ("runs.0.group", 7), ("runs.0.group", -1), ("runs.0.id", 5), ("runs.0.id", KeyError),
        ("runs.0.outliers", [1]), ("anchors.0.preload", "600"), ("candidates.0.chosen", 1),
        ("knowledge", [1]), ("made", {}), ("made.settings", 4), ("free", ["soul"]), ("rotor", "held"),
        ("axis", None), ("reasons", [None]), ("log_ratios.1", 1000), ("log_ratios.1", -11.0),
        ("parameters.preload", 1e308), ("parameters.compliance", 1e-300), ("parameters.slope", 1e300),
        ("parameters.share", 1e-300), ("parameters.centre", 1e200), ("parameters.mass", 1e300),
        ("parameters.mass", 1e-300), ("parameters.rotor", 1e-300), ("load_rating_N", 5e-324),
        ("nut_mass_kg", 1e300), ("covariance.0.1", 1e308), ("covariance.5.5", 0.0),
        ("covariance.5.5", 1e300), ("prior_covariance.0.0", 1e308), ("log_ratio_covariance.1.1", 1e308),
        ("runs.0.load", 1e308), ("tolerances", 3), ("tolerances", [1]), ("tolerances.0.effects", [0.1] * 6),
        ("tolerances.0.effects.3", 1e300), ("tolerances.0.effects", None), ("tolerances.0.estimate", 1e4),
        ("tolerances.0.estimate", None), ("tolerances.0.field", 7),
        ("tolerances", [{"field": f"f{k}", "effects": [0.0] * 7, "estimate": 0.0} for k in range(31)]),
        ("tolerances", [{"field": "rigidity", "effects": [0.0] * 7, "estimate": 0.0}] * 2),
        ("verdict", "suspect"), ("verdict", "fine"), ("reasons", [{"name": "misfit", "text": "it scatters"}]),
        ("conventions.0.change", [0.0] * 8), ("conventions.0.change.2", 1e300), ("conventions", 3),
        ("conventions.0.probability", -0.1), ("conventions.0.probability", 1.0),
        ("conventions.0.ratio", None), ("conventions.0.estimates", [0.0]),
        ("tolerances.0.effects", [10.0] * 7), ("tolerances.0.effects", [1.0, 0, 0, 0, 0, 0, 0]),
    ],
)  # fmt: skip
def test_a_file_that_is_not_what_it_claims_is_refused(
    document, tmp_path: Path, path: str, value: Any
) -> None:
    (tmp_path / "m.json").write_text(json.dumps(wrong(document, path, value)), encoding="utf-8")
    with pytest.raises(InputError):
        read_model(tmp_path / "m.json")


def test_a_verdict_against_its_reasons_is_one_sentence(document, tmp_path: Path) -> None:
    other = wrong(document, "reasons", [{"name": "misfit", "text": "it scatters"}])
    path = tmp_path / "m.json"
    path.write_text(json.dumps(other), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_model(path)
    assert str(refused.value) == f"{path}: verdict is 'good'; it must be 'suspect', by its reasons."


def test_a_document_without_conventions_has_none(document, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(json.dumps(wrong(document, "conventions", KeyError)), encoding="utf-8")
    assert read_model(tmp_path / "m.json").conventions == ()


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "3", '{"schema": 2}', "\x00\x01", "[" * 100000])
def test_no_json_of_ours_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError):
        read_model(tmp_path / "m.json")


def test_a_huge_file_a_folder_and_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "m.json").write_bytes(b" " * 2_000_001)
    for path in (tmp_path / "m.json", tmp_path, tmp_path / "none.json"):
        with pytest.raises(InputError):
            read_model(path)


def test_a_folder_is_not_overwritten(model, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        write_model(model, tmp_path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_change_of_one_value_is_read_or_refused(document, tmp_path: Path, data: st.DataObject) -> None:
    key = data.draw(st.sampled_from(sorted(document)))
    value = data.draw(
        st.one_of(
            st.none(),
            st.booleans(),
            st.integers(),
            st.floats(),
            st.text(max_size=5),
            st.just([]),
            st.just({}),
        )
    )
    (tmp_path / "m.json").write_text(json.dumps({**document, key: value}), encoding="utf-8")
    with contextlib.suppress(InputError):
        read_model(tmp_path / "m.json")


@pytest.mark.parametrize("name", ["compliance", "share", "preload"])
def test_a_parameter_that_is_known_too_well_is_refused(document, tmp_path: Path, name: str) -> None:
    exact = copy.deepcopy(document)
    at = PARAMETERS.index(name)
    for row in exact["covariance"]:
        row[at] = 0.0
    exact["covariance"][at] = [0.0] * len(PARAMETERS)
    exact["cross_covariance"][at] = [0.0] * len(exact["cross_covariance"][at])
    path = tmp_path / "model.json"
    path.write_text(json.dumps(exact), encoding="utf-8")
    with pytest.raises(InputError, match=f"covariance of {name} is 0; it must be more than"):
        read_model(path)
