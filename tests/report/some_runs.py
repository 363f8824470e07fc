"""Runs made of nothing but a formula: one mode a cell, so that a test knows what must be drawn."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import xarray as xr

from ballscrew.base.provenance import FileRef, Made
from ballscrew.base.tables import FREQUENCY_RESPONSE, validate
from ballscrew.fcft.conditions import conditions_at
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality

PLACES = (0.0, 0.1, 0.2)
LINES = np.arange(20.0, 400.0, 2.0)
WHY = "the FRF has no peak <&> $\\frac$"


def cell_names(places: Sequence[float] = PLACES) -> list[tuple[float, str]]:
    return [(x, str(c)) for i, x in enumerate(places) for c in conditions_at(i, len(places))]


def true_frequencies(first: float, places: Sequence[float] = PLACES) -> dict[float, float]:
    return {x: first - 100 * x for x in places}


def run_of_modes(
    first: float = 180.0,
    *,
    load: float | None = 50.0,
    refused: Collection[tuple[float, str]] = (),
    missing: Collection[tuple[float, str]] = (),
    spectra: bool = True,
    places: Sequence[float] = PLACES,
) -> Run:
    """Natural frequency ``first`` Hz at 0, 100 Hz/m less further out, read 1 Hz too high, ± 0.5 Hz."""
    names, f, cells, curves = cell_names(places), true_frequencies(first, places), [], []
    for x, condition in names:
        good = (x, condition) not in refused
        cells.append(
            CellResult(
                x,
                condition,
                0,
                3,
                f[x] + 1 if good else None,
                0.5 if good else None,
                None,
                "paper",
                "good" if good else "refused",
                () if good else (WHY,),
                0.99,
                (0.8 * f[x], 1.2 * f[x]),
            )
        )
        mode = 3 / (1 - (LINES / f[x]) ** 2 + 0.06j * LINES / f[x])
        curves.append(np.stack([mode, 1.1 * mode]))
    shown = [index for index, name in enumerate(names) if name not in missing]
    return Run(
        "ab" * 32, "bench $1", load, None, None, (FileRef("a.h5", "0" * 64),), Quality("good"),
        RigidBodyResult(), (), tuple(cells), Made({"estimator": "H1"}),
        _table([names[i] for i in shown], np.stack([curves[i] for i in shown]), load) if spectra else None,
    )  # fmt: skip


def _table(names: Sequence[tuple[float, str]], h: np.ndarray, load: float | None) -> xr.Dataset:
    of = ("cell", "response", "frequency")
    dataset = xr.Dataset(
        {
            "S_uu": (("cell", "frequency"), np.ones((len(names), len(LINES)))),
            "S_yy": (of, np.abs(h) ** 2),
            "S_uy": (of, h),
            **dict.fromkeys(("H1", "H2", "Hv"), (of, h)),
            "coherence": (of, np.full(h.shape, 0.99)),
            "repetitions": ("cell", np.full(len(names), 3)),
        },
        coords={
            "position_m": ("cell", np.array([x for x, _ in names])),
            "condition": ("cell", np.array([c for _, c in names])),
            "motion": ("cell", np.zeros(len(names), np.int64)),
            "mass_kg": ("cell", np.full(len(names), np.nan if load is None else load)),
            "response": ("response", np.array(["acceleration:nut-1:x", "acceleration:nut-2:x"])),
            "frequency": ("frequency", LINES),
        },
        attrs={"input": "torque", "input_unit": "N m"},
    )
    return validate(dataset, FREQUENCY_RESPONSE)


def points(axes, marker: str) -> list[tuple[float, float]]:
    """Positions of the marks of a kind."""
    found = []
    for line in axes.get_lines():
        if line.get_marker() == marker and line.get_color() != "white":
            found += list(zip(map(float, line.get_xdata()), map(float, line.get_ydata()), strict=True))
    return found


def crosses(axes) -> list[float]:
    """Across which places a refusal is marked."""
    return sorted(x for x, _ in points(axes, "x"))


def line_named(axes, name: str) -> tuple[np.ndarray, np.ndarray]:
    (line,) = [line for line in axes.get_lines() if line.get_label() == name]
    return np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)


def intervals(axes) -> dict[str, list[tuple[float, float, float]]]:
    """Each group of error bars by name: across, lower and upper end."""
    found = {}
    for bars in axes.containers:
        segments = bars.lines[2][0].get_segments()
        found[bars.get_label()] = [(float(s[0, 0]), float(s[0, 1]), float(s[1, 1])) for s in segments]
    return found
