from __future__ import annotations

import copy
import json
import math
from dataclasses import replace

import pytest

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.base.provenance import FileRef, Made
from ballscrew.modal.cell import CellResult, TransientRow
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.recording.quality.finding import Quality

CELL = CellResult(
    position_m=0.045,
    condition="PA",
    motion=0,
    repetitions=3,
    frequency_Hz=164.25,
    standard_uncertainty_Hz=0.5,
    damping_ratio=None,
    method="paper",
    verdict="good",
    reasons=(),
    coherence=0.99,
    band_Hz=(123.0, 205.0),
    uncertainty_terms_Hz={"repetitions": 0.25, "window": 0.125},
)
REFUSED = CellResult(
    0.0, "ND", 1, 0, None, None, None, "paper", "refused", ("no transient of this cell was measured",)
)
RUN = Run(
    id="ab" * 32,
    axis="bench",
    mass_kg=100.0,
    measured_at="2026-01-31T08:00:00+00:00",
    temperature_C=23.5,
    files=(FileRef("trip1.h5", "0" * 64), FileRef("trip2.h5", "1" * 64)),
    quality=Quality("suspect", ("trip1.h5: torque hums at 50 Hz",)),
    rigid_body=RigidBodyResult(
        equivalent_mass_kg=317.0,
        moving_mass_kg=132.0,
        viscous_N_s_per_m=390.0,
        coulomb_N=42.0,
        offset_N=-0.5,
        frf_equivalent_mass_kg=316.5,
        standard_uncertainty={"equivalent_mass_kg": 1.0},
        reasons=(),
    ),
    transients=(TransientRow(0, 0.4, 0.46, 0.0, "PA", 0, 1), TransientRow(0, 0.9, 0.96, 0.045, "PD", 0, 0)),
    cells=(CELL, REFUSED),
    made=Made({"method": "paper", "window_before": 7.0}, "0.1.0"),
)
EMPTY = Run("x", None, None, None, None, (), Quality("bad", ("none",)), RigidBodyResult(), (), (), Made({}))


@pytest.mark.parametrize("run", [RUN, EMPTY], ids=["full", "empty"])
def test_there_and_back(run):
    assert Run.from_json(run.to_json()) == run
    assert Run.from_json(json.loads(write_json(run.to_json()))) == run
    assert Run.from_json(run.to_json()).to_json() == run.to_json()


def test_a_file_there_and_back(tmp_path):
    path = tmp_path / "RUN.json"
    path.write_text(write_json(RUN.to_json()), encoding="utf-8")
    assert Run.read(path) == RUN
    assert Run.of(path) == RUN
    assert Run.of(RUN) is RUN
    assert len({RUN, Run.read(path), EMPTY}) == 2
    path.write_text(path.read_text(encoding="utf-8").replace('"id"', '"number"'), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        Run.read(path)
    assert str(refused.value).startswith(f"{path}: is not a run of ballscrew")


def test_the_keys_that_stay():
    document = RUN.to_json()
    assert document["schema"] == SCHEMA
    assert set(document) >= {"schema", "id", "run", "quality", "rigid_body", "transients", "cells", "made"}
    assert set(document["run"]) >= {"axis", "mass_kg", "measured_at", "temperature_C", "files"}
    assert set(document["run"]["files"][0]) >= {"name", "sha256"}
    assert set(document["quality"]) >= {"verdict", "reasons"}
    assert set(document["rigid_body"]) >= {
        "equivalent_mass_kg", "moving_mass_kg", "viscous_N_s_per_m", "coulomb_N", "offset_N",
        "frf_equivalent_mass_kg",
    }  # fmt: skip
    assert set(document["transients"][0]) >= {
        "file", "start_s", "stop_s", "position_m", "condition", "repetition",
    }  # fmt: skip
    assert set(document["cells"][0]) >= {
        "position_m", "condition", "motion", "repetitions", "frequency_Hz", "standard_uncertainty_Hz",
        "damping_ratio", "method", "verdict", "reasons",
    }  # fmt: skip
    assert set(document["made"]) >= {"version", "settings"}


def test_what_a_later_version_adds_is_passed_over():
    document = RUN.to_json()
    document["weather"] = "fine"
    document["run"]["operator"] = "me"
    document["run"]["files"][0]["size"] = 7
    for part in ("rigid_body", "made"):
        document[part]["more"] = 1
    for rows in ("cells", "transients"):
        for row in document[rows]:
            row["more"] = {"a": 1}
    assert Run.from_json(document) == RUN


REQUIRED = [
    ("id",), ("run",), ("quality",), ("rigid_body",), ("transients",), ("cells",), ("made",),
    ("run", "axis"), ("run", "files"), ("run", "mass_kg"), ("quality", "verdict"),
    ("cells", 0, "frequency_Hz"), ("cells", 0, "condition"), ("transients", 0, "start_s"),
    ("run", "files", 0, "sha256"),
]  # fmt: skip


@pytest.mark.parametrize("path", REQUIRED, ids=str)
def test_a_missing_key_is_said(path):
    document = copy.deepcopy(RUN.to_json())
    table = document
    for key in path[:-1]:
        table = table[key]
    del table[path[-1]]
    with pytest.raises(InputError) as caught:
        Run.from_json(document, "RUN.json")
    assert str(path[-1]) in str(caught.value)


@pytest.mark.parametrize("path", REQUIRED[1:7], ids=str)
@pytest.mark.parametrize("junk", [None, 7, "text"])
def test_junk_is_said(path, junk):
    document = copy.deepcopy(RUN.to_json())
    document[path[0]] = junk
    with pytest.raises(InputError):
        Run.from_json(document, "RUN.json")


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '{"schema": 2}', '{"schema": 99}', '{"schema": 2, "id": NaN}']
)
def test_a_file_that_is_no_run(tmp_path, text):
    path = tmp_path / "RUN.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"RUN\.json"):
        Run.read(path)


def test_what_cannot_be_known_is_null_and_never_nan():
    run = Run.from_json(
        {
            **RUN.to_json(),
            "cells": [{**RUN.to_json()["cells"][0], "coherence": float("nan")}],
        }
    )
    assert run.to_json()["cells"][0]["coherence"] is None
    assert "NaN" not in write_json(run.to_json())


@pytest.mark.parametrize("wrong", ["warm", True, [20.0], float("inf")])
def test_a_temperature_that_is_no_number_is_said(wrong: object) -> None:
    document = RUN.to_json()
    document["run"]["temperature_C"] = wrong
    with pytest.raises(InputError, match="not a run of ballscrew"):
        Run.from_json(document)


def test_lost_motion_is_read_back_with_and_without_its_uncertainty():
    stops = (LostMotion(0.1, 2e-6, 3e-7, 3), LostMotion(0.2, 1e-6, math.nan, 1))
    document = json.loads(write_json(replace(RUN, lost_motion=stops).to_json()))
    read = Run.from_json(document).lost_motion
    assert read[0] == stops[0]
    assert replace(read[1], standard_uncertainty_m=0.0) == replace(stops[1], standard_uncertainty_m=0.0)
    assert math.isnan(read[1].standard_uncertainty_m)


def test_the_text_of_a_run_has_its_load_and_its_time():
    first, *_ = str(RUN).splitlines()
    assert first.startswith("<Run> bench with 100 kg, 2026-01-31T08:00:00+00:00: the measurement is suspect")
    assert str(EMPTY).startswith("<Run> axis without a name: the measurement is bad")
