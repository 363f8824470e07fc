"""What each field of RUN.json may hold: the kind, and a range that no machine leaves."""

from __future__ import annotations

from collections.abc import Mapping

from ballscrew.base.json_fields import (
    Field,
    anything,
    choice,
    flag,
    listed,
    mapping,
    number,
    quantity,
    text,
    whole,
)

HERTZ = (0.1, 1e6)
"""Of a natural frequency. Its errors may be smaller."""
METRES = (-1e3, 1e3)
KILOGRAMS = (-1e7, 1e7)

_HERTZ = number(*HERTZ, optional=True)
_SPREAD = number(0.0, HERTZ[1], optional=True)
_MASS, _FORCE = number(*KILOGRAMS, optional=True), number(-1e9, 1e9, optional=True)
_TEXTS = listed(text())

HEAD: Mapping[str, Field] = {
    "axis": text(optional=True),
    "mass_kg": number(0.0, KILOGRAMS[1], optional=True),
    "measured_at": text(optional=True),
    "temperature_C": number(-273.15, 2000.0, optional=True),
}
FILE: Mapping[str, Field] = {"name": text(), "sha256": text()}
RIGID_BODY: Mapping[str, Field] = {
    "equivalent_mass_kg": _MASS,
    "moving_mass_kg": _MASS,
    "frf_equivalent_mass_kg": _MASS,
    "viscous_N_s_per_m": _FORCE,
    "coulomb_N": _FORCE,
    "offset_N": _FORCE,
    "standard_uncertainty": mapping(number(0.0, 1e9, optional=True)),
    "reasons": _TEXTS,
}
TRANSIENT: Mapping[str, Field] = {
    "file": whole(1_000_000),
    "start_s": number(-1e9, 1e9),
    "stop_s": number(-1e9, 1e9),
    "position_m": number(*METRES),
    "condition": text(),
    "motion": whole(1_000_000),
    "repetition": whole(1_000_000),
}
CELL: Mapping[str, Field] = {
    "position_m": number(*METRES),
    "condition": text(),
    "motion": whole(1_000_000),
    "repetitions": whole(1_000_000),
    "frequency_Hz": _HERTZ,
    "standard_uncertainty_Hz": _SPREAD,
    "damping_ratio": number(-10.0, 10.0, optional=True),
    "method": text(),
    "verdict": choice("good", "suspect", "refused"),
    "reasons": _TEXTS,
    "coherence": number(-0.01, 1.01, optional=True),
    "band_Hz": listed(number(0.0, HERTZ[1]), length=2, optional=True),
    "uncertainty_terms_Hz": mapping(number(0.0, HERTZ[1])),
    "rotor_held_frequency_Hz": _HERTZ,
    "rotor_held_standard_uncertainty_Hz": _SPREAD,
    "deviation_Hz": number(-HERTZ[1], HERTZ[1], optional=True),
    "deviation_standard_uncertainty_Hz": _SPREAD,
}
SHARED: Mapping[str, Field] = {
    "name": text(),
    "repeats": flag,
    "effects_Hz": listed(number(-HERTZ[1], HERTZ[1], optional=True)),
}
MADE: Mapping[str, Field] = {
    "version": text(), "settings": mapping(anything), "inputs": mapping(text(optional=True)),
}  # fmt: skip
LOST_MOTION: Mapping[str, Field] = {
    "position_m": number(*METRES),
    "lost_m": number(-1.0, 1.0),
    "standard_uncertainty_m": number(0.0, 1.0, optional=True),
    "repetitions": whole(1_000_000),
}
RIPPLE: Mapping[str, Field] = {
    "order": whole(1_000_000),
    "torque_Nm": number(0.0, 1e6, optional=True),
    "standard_uncertainty_Nm": number(0.0, 1e6, optional=True),
}
SOFTENING = quantity(1e-9, 1e6, unit="kg/N")
