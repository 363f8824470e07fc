"""Runs made of nothing but the model, with errors that a test knows, and a calibration made by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import AxialModel, frequency
from ballscrew.base.provenance import FileRef, Made, digest
from ballscrew.calibration.calibrated_axis import CalibratedAxis, CalibrationRun
from ballscrew.fcft.conditions import conditions_at
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality

Array = NDArray[np.float64]
MODEL = AxialModel(
    centre=0.225, compliance=1.7e-8, slope=1.4, curve=0.0, mass=32.0, rotor=157.0, share=0.2, preload=600.0
)
STOPS = tuple(round(0.045 * i, 3) for i in range(11))
LOAD = 100.0
BEARING = 0.37
UNCERTAIN = {"share": 0.145, "preload": 0.09, "compliance": 0.004, "mass": 0.01, "slope": 0.02, "rotor": 0.02}
_ORDER = ("compliance", "slope", "curve", "mass", "rotor", "share", "preload")


def calibrated(
    model: AxialModel = MODEL, *, runs: Sequence[str] = ("base",), **uncertain: float
) -> CalibratedAxis:
    """A model whose parameters err independently, share and preload as a data sheet has them."""
    spread = np.array([(UNCERTAIN | uncertain).get(name, 0.0) for name in _ORDER])
    covariance = np.diag(spread**2)
    return CalibratedAxis(
        axis="bench",
        model=model,
        covariance=covariance,
        free=_ORDER,
        runs=tuple(CalibrationRun(name, LOAD, None, 0, 40) for name in runs),
        log_ratios=np.zeros(1),
        log_ratio_covariance=np.zeros((1, 1)),
        cross_covariance=np.zeros((7, 1)),
        prior_covariance=covariance,
        chi2=40.0,
        degrees=36.0,
        candidates=(),
        anchors=(),
        load_rating=15_000.0,
        nut_mass=32.0,
        bearing_share=BEARING,
    )


def run_of(
    ratio: float | Callable[[Array], Array] = 1.0,
    *,
    name: str = "run",
    model: AxialModel = MODEL,
    load: float = LOAD,
    true_load: float | None = None,
    softer: Callable[[Array], Array] | None = None,
    level: float = 0.0,
    tilt: float = 0.0,
    moved: float = 0.0,
    torque: float = 1.0,
    friction: float = 1.0,
    scatter: float = 0.0,
    uncertainty: float = 2e-4,
    local: bool = False,
    seed: int = 0,
    nut_load: float = 0.0,
    stops: Sequence[float] = STOPS,
    **others: Any,
) -> Run:
    """A run by method "joint", as in a document without shared errors.

    ``level``, ``tilt`` and ``scatter`` are relative errors of the frequency, ``uncertainty`` the stated one;
    ``softer`` is a part of the compliance that is added, ``local`` whether the preload is a function of the
    position, which the curve through all cells does not follow but the deviations do.
    """
    rng = np.random.default_rng(seed)
    names = [(x, str(c)) for i, x in enumerate(stops) for c in conditions_at(i, len(stops))]
    x = np.array([at for at, _ in names])
    mass = load if true_load is None else true_load
    part = np.broadcast_to(ratio(x) if callable(ratio) else ratio, x.shape)
    true = [frequency(model, x + moved, mass, part, rotor) for rotor in ("free", "held")]
    if softer is not None:
        true = [f / np.sqrt(1 + softer(x)) for f in true]
    off = np.zeros_like(x)
    if local:
        basis = np.vander(x, 2)
        smooth = 1 / np.sqrt(basis @ np.linalg.lstsq(basis, true[0] ** -2.0, rcond=None)[0])
        off = true[0] - smooth
        true = [smooth, true[1] * smooth / true[0]]
    way = (x - np.mean(stops)) / (np.ptp(stops) / 2)
    wrong = 1 + level + tilt * way
    noise = scatter * rng.standard_normal(len(x))
    condition = {"PA": 1e-3, "PD": -2e-3, "NA": 5e-4, "ND": 0.0}
    cells = tuple(
        CellResult(
            place,
            name_,
            0,
            10,
            float(f * w),
            uncertainty * float(f) * (1 + nut_load / max(uncertainty, 1e-12)),
            0.03,
            "joint",
            "good",
            (),
            uncertainty_terms_Hz={"noise": uncertainty * float(f), "load": nut_load * float(f)},
            rotor_held_frequency_Hz=float(h * w),
            rotor_held_standard_uncertainty_Hz=float(1e-3 * h),
            deviation_Hz=float(f * (condition[name_] + n) + o),
            deviation_standard_uncertainty_Hz=float(f) * 1e-3,
        )
        for (place, name_), f, h, w, n, o in zip(names, *true, wrong, noise, off, strict=True)
    )
    whole = (model.mass + mass + model.rotor) * torque
    rigid = RigidBodyResult(
        equivalent_mass_kg=whole,
        moving_mass_kg=whole - model.rotor,
        viscous_N_s_per_m=360.0 * torque * friction,
        coulomb_N=45.0 * torque * friction,
        standard_uncertainty={
            "equivalent_mass_kg": 0.002 * whole,
            "viscous_N_s_per_m": 7.0,
            "coulomb_N": 1.0,
            "moving_mass_kg": 3.0,
        },
    )
    given = {
        "axis": "bench",
        "measured_at": None,
        "temperature_C": None,
        "quality": Quality("good"),
        "made": Made({"method": "joint"}, inputs={"plan": "p" * 64}),
    }
    return Run(
        id=name, mass_kg=load, files=(FileRef("a.h5", digest(name)),), rigid_body=rigid, transients=(),
        cells=cells, **(given | others),
    )  # fmt: skip
