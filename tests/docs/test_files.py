"""Every field of a file and every key of a JSON document is documented."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from tests.docs.pages import first_column, page, section
from tests.recording.synthetic import PLAN, SHEET

import ballscrew
from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Limits, Screw, Table
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import write_json
from ballscrew.base.provenance import FileRef, Made
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.planned import plan
from ballscrew.modal.cell import CellResult, SharedError, TransientRow
from ballscrew.modal.job import read_run
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.quality.finding import Quality


def names(kind: Any) -> set[str]:
    return {field.name for field in fields(kind)}


def test_every_field_of_the_data_sheet() -> None:
    text = section(page("docs/reference/files.md"), "axis.toml")
    parts = {
        "screw": Screw, "bearing": Bearing, "table": Table, "drive": Drive, "guide": Guide, "limits": Limits
    }  # fmt: skip
    expected = {f"{part}.{name}" for part, kind in parts.items() for name in names(kind)}
    expected |= (names(DataSheet) - set(parts) - {"source", "tolerances"}) | {"tolerances.…"}
    assert set(re.findall(r"^\| `([^`]+)`", text, re.M)) == expected


def test_every_field_of_the_plan() -> None:
    text = section(page("docs/reference/files.md"), "plan.toml")
    expected = names(Plan) - {"source", "motions"} | {f"motion.{name}" for name in names(Motion)}
    assert set(re.findall(r"^\| `([^`]+)`", text, re.M)) == expected


def known(error: pytest.ExceptionInfo[InputError]) -> set[str]:
    """Fields that the refusal of an unknown field lists."""
    return set(str(error.value).split("known are ")[1].rstrip(".").split(", "))


def test_every_field_of_the_channel_map() -> None:
    text = section(page("docs/reference/files.md"), "channels.toml")
    with pytest.raises(InputError) as top:
        ChannelMap.from_settings({"nonsense": 1})
    with pytest.raises(InputError) as row:
        ChannelMap.from_settings({"channel": [{"nonsense": 1}]})
    documented = re.findall(r"^\| `([^`]+)`", text, re.M)
    assert set(documented) == (known(top) | known(row)) - {"direction"}
    assert "`direction` is the same" in text


def test_every_field_of_the_run(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text("nonsense = 1", encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_run(tmp_path / "run.toml")
    text = section(page("docs/reference/files.md"), "run.toml")
    assert set(re.findall(r"^\| `([^`]+)`", text, re.M)) == known(error)


KEYS = {
    "rigid_body": names(RigidBodyResult),
    "transients": names(TransientRow),
    "cells": names(CellResult),
    "shared_errors": names(SharedError),
    "made": names(Made),
}


def a_run() -> Run:
    row = TransientRow(0, 0.0, 1.0, 0.0, "PA", 0, 1)
    cell = CellResult(0.0, "PA", 0, 3, None, None, None, "paper", "refused", ("a reason",))
    return Run("id", None, None, None, None, (FileRef("a.h5", "00"),), Quality("good"), RigidBodyResult(), (row,), (cell,), Made())  # fmt: skip  # noqa: E501


def test_every_key_of_a_run_is_documented_and_every_documented_key_exists() -> None:
    text = page("docs/reference/run-json.md")
    document = a_run().to_json()
    assert first_column(text.split("\n## ")[0]) == list(document)
    for key, expected in {**KEYS, "run": set(document["run"]), "quality": set(document["quality"])}.items():
        assert set(first_column(section(text, f"`{key}`"))) == expected, key


def test_the_example_of_a_run_is_one() -> None:
    document = json.loads(page("docs/reference/run.json"))
    run = Run.from_json(document)
    assert json.loads(write_json(run.to_json())) == document
    assert run.made.version == ballscrew.__version__


def test_every_key_of_a_planned_test_is_documented() -> None:
    document = plan(PLAN, axis=SHEET).to_json()
    text = page("docs/reference/cli.md").split("### Keys of `plan --json`")[1].split("\n## ")[0]
    asked_for = {"optimized", "capability"}  # keys of options
    assert set(first_column(text)) == set(document) | asked_for
    for key in ("motions", "cells"):
        row = next(line for line in text.splitlines() if line.startswith(f"| `{key}`"))
        assert set(re.findall(r"`(\w+)`", row.split("|")[2])) == set(document[key][0])
