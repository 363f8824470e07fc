"""The notebook runs from its first cell to its last."""

from __future__ import annotations

import ast
import json
from typing import Any

import pytest
from tests.docs.pages import page


def show(cell: str, space: dict[str, Any]) -> Any:
    """Run a cell and return its last expression, as a notebook does; None if it ends in a statement."""
    parsed = ast.parse(cell)
    last = None
    if isinstance(parsed.body[-1], ast.Expr):
        last = ast.Expression(parsed.body.pop().value)
    exec(compile(parsed, "notebook", "exec"), space)  # noqa: S102  the notebook's own lines
    return None if last is None else eval(compile(last, "notebook", "eval"), space)  # noqa: S307


@pytest.mark.slow
@pytest.mark.usefixtures("fitted_once")
def test_the_notebook_finds_the_simulated_preload() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    document = json.loads(page("docs/tutorial/arrays.ipynb"))
    space: dict[str, Any] = {}
    cells = ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "code"]
    displayed = [show(cell, space) for cell in cells]
    results = [result for result in displayed if hasattr(result, "_repr_html_")]
    assert len(results) == 5
    assert all(result._repr_html_().endswith("</table>") for result in results)
    assert results[0].verdict == "good"
    for estimate in (space["estimate"], results[-1]):
        low, high = estimate.stiffness_relative_to_baseline.interval
        assert low < 476 / 680 < high
    pyplot.close("all")
