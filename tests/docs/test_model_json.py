"""Every key of MODEL.json is documented."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from tests.docs.pages import page, section

from ballscrew.axis.axial import AxialModel
from ballscrew.calibration.calibrated_axis import (
    Anchor,
    CalibratedAxis,
    CalibrationRun,
    ConventionEvidence,
    FormEvidence,
    ToleranceEstimate,
)
from ballscrew.calibration.modelfile import model_json

PAGE = "docs/reference/model-json.md"


def documented(text: str) -> set[str]:
    rows = re.findall(r"^\| (`[^|]+) \|", text, re.M)
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


@pytest.mark.parametrize(
    ("heading", "kind"),
    [
        ("`runs`", CalibrationRun),
        ("`anchors`", Anchor),
        ("`candidates`", FormEvidence),
        ("`tolerances`", ToleranceEstimate),
        ("`conventions`", ConventionEvidence),
    ],
)
def test_every_key_of_a_row(heading: str, kind: Any) -> None:
    assert documented(section(page(PAGE), heading)) == {field.name for field in fields(kind)}


def test_every_key_of_the_document() -> None:
    model = AxialModel(0.2, 1.6e-8, 1.4, 0.0, 32.4, 185.0, 0.22, 600.0)
    nothing, single = np.zeros((7, 7)), np.zeros((1, 1))
    empty = CalibratedAxis(
        "bench",
        model,
        nothing,
        (),
        (),
        np.zeros(1),
        single,
        np.zeros((7, 1)),
        nothing,
        0.0,
        0.0,
        (),
        (),
        1.0,
        1.0,
        0.1,
    )
    assert documented(page(PAGE).split("\n## ")[0]) == set(model_json(empty))
