"""Masses and friction of a run, twice: from the moving record, and from the FRF below its modes."""

from __future__ import annotations

import math

from ballscrew.axis.frequency import predicted_frequency, rotor_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.modal.inertia import frf_equivalent_mass
from ballscrew.modal.run import RigidBodyResult
from ballscrew.recording.measure import Measurement, force_scale

__all__ = ["rigid_body_result"]

_ROTOR_TOLERANCE = 0.02  # of the rotor's inertia: what makers' sheets state it to


def rigid_body_result(measurement: Measurement, sheet: DataSheet | None, mass: float) -> RigidBodyResult:
    """Masses and friction of a run.

    Parameters
    ----------
    measurement : Measurement
        Of the run.
    sheet : DataSheet or None
        The axis; tells the rotor's part of the mass.
    mass : float
        Load on the table, kg.

    Returns
    -------
    RigidBodyResult
        Values that cannot be known are None, with the reason.
    """
    fit, transients = measurement.rigid_body, measurement.transients
    if fit is None or transients is None:
        return RigidBodyResult(reasons=measurement.reasons)
    reasons = []
    uncertainty = dict(
        zip(
            ("equivalent_mass_kg", "viscous_N_s_per_m", "coulomb_N", "offset_N"), fit.uncertainty, strict=True
        )
    )
    moving = mode = second = None
    if sheet is None:
        reasons.append("the moving mass takes a data sheet (--axis), which tells the rotor's inertia")
    else:
        moving = fit.equivalent_mass - rotor_mass(sheet)
        uncertainty["moving_mass_kg"] = math.hypot(fit.uncertainty[0], _ROTOR_TOLERANCE * rotor_mass(sheet))
    scale = force_scale(str(transients["input"].attrs["quantity"]), sheet)
    if scale is not None and transients.sizes["transient"]:
        if sheet is not None:
            mode = float(predicted_frequency(sheet, sheet.travel_limit / 2, mass))
        second = frf_equivalent_mass(transients, scale, mode)
    if second is None:
        reasons.append("too few transients for the equivalent mass from the FRF")
    else:
        uncertainty["frf_equivalent_mass_kg"] = second.standard_uncertainty
    return RigidBodyResult(
        equivalent_mass_kg=fit.equivalent_mass,
        moving_mass_kg=moving,
        viscous_N_s_per_m=fit.viscous,
        coulomb_N=fit.coulomb,
        offset_N=fit.offset,
        frf_equivalent_mass_kg=second.value if second else None,
        standard_uncertainty=uncertainty,
        reasons=tuple(reasons),
    )
