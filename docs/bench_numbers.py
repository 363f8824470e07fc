"""Writes the numbers of the pages anew that come from the simulated bench.

Usage: python docs/bench_numbers.py FOLDER

FOLDER holds the bench's recordings, its TOML files and truth.json. Written are the picture, the example of a
run's JSON, the tables of the uncertainty page and the example in the README; the sentences around them are
for whoever ran this to read again. The tests compare all of them.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
from pathlib import Path

import numpy as np

import ballscrew
from ballscrew.base.jsonfile import write_json
from ballscrew.cli.analyze import print_run
from ballscrew.modal.run import Run
from ballscrew.report.canvas import save_figure
from ballscrew.report.run_figure import draw_run

DOCS = Path(__file__).parent
README, UNCERTAINTY = DOCS.parent / "README.md", DOCS / "explanation" / "uncertainty.md"
STATES = ("4", "2")  # preload in per cent
SHOWN = 3  # stops of the README's example


def analyse(bench: Path, method: str = "paper") -> dict[str, Run]:
    """Both states, as the pages say: a method, default settings and the files beside the recordings."""
    channels, axis, plan = (bench / f"{name}.toml" for name in ("channels", "axis", "plan"))
    files = {state: [bench / f"preload-{state}-percent-trip{n}.h5" for n in (1, 2, 3)] for state in STATES}
    return {
        state: ballscrew.analyze(trips, channels=channels, axis=axis, plan=plan, mass="100 kg", method=method)
        for state, trips in files.items()
    }


def table(bench: Path, runs: dict[str, Run]) -> dict[str, list[str]]:
    """Rows of the uncertainty page: first cell to the cells of the two states."""
    truth = json.loads((bench / "truth.json").read_text(encoding="utf-8"))
    rows: dict[str, list[str]] = {}
    for state, run in runs.items():
        true = truth[f"preload-{state}-percent"]["axial_natural_frequency_Hz"]
        found = [(c.frequency_Hz, true[f"{c.position_m:.3f}"], c.standard_uncertainty_Hz) for c in run.cells]
        frequency, right, u = (np.array(column, dtype=np.float64) for column in zip(*found, strict=True))
        off, count = frequency - right, len(found)
        in_interval = (abs(off) <= 1.96 * u).sum()
        parts = {
            name: [c.uncertainty_terms_Hz[name] for c in run.cells]
            for name in run.cells[0].uncertainty_terms_Hz
        }
        values = {
            **{f"`{name}`": _hz(float(np.median(part))) for name, part in parts.items()},
            "median of the absolute error": _hz(float(np.median(abs(off)))),
            "largest error": _hz(float(abs(off).max())),
            "mean error": _hz(float(off.mean())),
            "median standard uncertainty": _hz(float(np.median(u))),
            "cells whose 95 % interval contains the true value": f"**{in_interval} of {count}**",
            "cells within one standard uncertainty": f"{(abs(off) <= u).sum()} of {count}",
        }
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
    return rows


def off(bench: Path, state: str, run: Run) -> tuple[list[float], list[float]]:
    """Errors of the estimated cells, and their standard uncertainties, Hz."""
    truth = json.loads((bench / "truth.json").read_text(encoding="utf-8"))
    true = truth[f"preload-{state}-percent"]["axial_natural_frequency_Hz"]
    cells = [c for c in run.cells if c.frequency_Hz is not None]
    return (
        [(c.frequency_Hz or 0.0) - true[f"{c.position_m:.3f}"] for c in cells],
        [c.standard_uncertainty_Hz or 0.0 for c in cells],
    )


def readme_claim(bench: Path, runs: dict[str, Run]) -> str:
    """Sentence of the README on the accuracy of the natural frequency."""
    medians, inside, count = [], 0, 0
    for state in STATES:
        errors, u = off(bench, state, runs[state])
        medians.append(f"{np.median(np.abs(errors)):.2f} Hz")
        inside += int((np.abs(errors) <= 1.96 * np.array(u)).sum())
        count += len(errors)
    return (
        f"the median error is {medians[0]} at 4 % preload and {medians[1]} at 2 %; the 95 % intervals "
        f"contain the true value in {inside} of {count} cells"
    )


def readme_lines(run: Run) -> list[str]:
    """The example in the README: what ``analyze`` prints, without most of the stops."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        print_run(run, verbose=False)
    lines = [line.rstrip() for line in printed.getvalue().splitlines()]
    first_row = next(index for index, line in enumerate(lines) if line.startswith("│"))
    return lines[: first_row + SHOWN]


def example(run: Run) -> str:
    """The JSON of a run, shortened to one file, one transient and one cell."""
    document = run.to_json()
    document["run"]["files"] = document["run"]["files"][:1]
    document["transients"], document["cells"] = document["transients"][:1], document["cells"][:1]
    for error in document["shared_errors"]:
        error["effects_Hz"] = error["effects_Hz"][:1]
    return write_json(document) + "\n"


def _hz(value: float) -> str:
    return f"{value:.2f}\u00a0Hz".replace("-", "−")


def main(bench: Path) -> None:
    """Write all of them."""
    runs, ours = analyse(bench), analyse(bench, "joint")
    save_figure(draw_run(ours["4"]), DOCS / "_static" / "run.png")
    (DOCS / "reference" / "run.json").write_text(example(ours["4"]), encoding="utf-8", newline="\n")
    text = UNCERTAINTY.read_text(encoding="utf-8")
    for name, values in table(bench, runs).items():
        row = re.compile(rf"^\| {re.escape(name)} \|[^|]*\|[^|]*\|", re.M)
        text = row.sub(f"| {name} | {' | '.join(values)} |", text)
    UNCERTAINTY.write_text(text, encoding="utf-8", newline="\n")
    block = re.compile(r"(?<=```text\n)bench:.*?(?=```)", re.S)
    text = block.sub("\n".join(readme_lines(ours["4"])) + "\n", README.read_text(encoding="utf-8"))
    claim = re.compile(r"the median error is .*? cells", re.S)
    text = claim.sub(readme_claim(bench, ours), text, count=1)  # the next sentence is of other axes
    README.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
