"""Mode tables of a known axis: runs as ``analyze`` would give them, without any recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.modal.cell import CellResult, SharedError
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality

CONDITIONS = ("PA", "PD", "NA", "ND")


@dataclass(frozen=True)
class Errors:
    """Standard deviations of a run's errors, as parts of the frequency; level and tilt each."""

    noise: float = 1e-3
    method: float = 2e-3
    own: float = 3e-4
    repeats: float = 0.9


def table(
    truth: Callable[[float], float],
    positions: Sequence[float],
    load: float,
    seed: int,
    *,
    axis: str = "bench",
    errors: Errors | None = Errors(),
    bias: Sequence[float] = (0.0, 0.0),
    name: str | None = None,
    measured_at: str | None = None,
    softening: tuple[float, float] | None = None,
) -> Run:
    """A run of four cells a stop; ``bias`` is the axis's own sample of the method's level and tilt."""
    random = np.random.default_rng([seed, 7])
    x = np.repeat(np.asarray(positions, dtype=float), 4)
    f = np.repeat([truth(p) for p in positions], 4)
    e = errors or Errors()
    along = (x - x.mean()) / max(np.ptp(x) / 2, 1e-9)
    shapes = np.stack([f, along * f])
    draws = random.normal(size=5)
    method = np.sqrt(e.repeats) * np.asarray(bias) + np.sqrt(1 - e.repeats) * draws[2:4]
    causes = [
        ("noise", False, e.noise * shapes[0], draws[0]),
        ("noise", False, e.noise * shapes[1], draws[1]),
        ("method", True, e.method * shapes[0], method[0]),
        ("method", True, e.method * shapes[1], method[1]),
    ]
    stated = f + e.own * f * random.normal(size=len(f)) + sum(c[2] * c[3] for c in causes)
    if errors is None:
        stated = f
    u = np.sqrt((e.own * f) ** 2 + sum(c[2] ** 2 for c in causes))
    cells = tuple(
        CellResult(float(p), c, 0, 3, float(v), float(s), 0.03, "joint", "good", ())
        for p, c, v, s in zip(x, CONDITIONS * len(positions), stated, u, strict=True)
    )
    return Run(
        id=name or f"{seed:04d}" + "ab" * 30,
        axis=axis,
        mass_kg=load,
        measured_at=measured_at,
        temperature_C=None,
        files=(),
        quality=Quality("good", ()),
        rigid_body=RigidBodyResult(),
        transients=(),
        cells=cells,
        made=Made(inputs={"plan": "f" * 64}),
        shared_errors=tuple(SharedError(n, r, tuple(float(v) for v in s)) for n, r, s, _ in causes),
        mass_over_preload_kg_per_N=None
        if softening is None
        else Quantity(softening[0], softening[1], "kg/N"),
    )
