"""Kind and range of every field of RUN.json, by name: no machine leaves these ranges."""

from __future__ import annotations

from collections.abc import Mapping

from ballscrew.base import json_fields
from ballscrew.fcft.conditions import Condition

_HERTZ = (0.1, 1e6)  # of a natural frequency; its errors may be smaller
_KILOGRAMS, _NEWTONS, _SECONDS = (-1e7, 1e7), (-1e9, 1e9), (-1e9, 1e9)

_SPREAD = json_fields.number(0.0, _HERTZ[1], optional=True)
_COUNT = json_fields.whole(1_000_000)

FIELDS: Mapping[str, json_fields.Field] = {
    # run
    "axis": json_fields.text(optional=True),
    "mass_kg": json_fields.number(0.0, _KILOGRAMS[1], optional=True),
    "measured_at": json_fields.time,
    "temperature_C": json_fields.number(-273.15, 2000.0, optional=True),
    "sha256": json_fields.text(),
    # run.temperature
    "mean_C": json_fields.number(-273.15, 2000.0),
    "start_C": json_fields.number(-273.15, 2000.0),
    "end_C": json_fields.number(-273.15, 2000.0),
    "range_K": json_fields.number(0.0, 2000.0),
    "screw_above_nut_K": json_fields.number(-2000.0, 2000.0, optional=True),
    "place": json_fields.text(),
    # run.drive_input
    "quantity": json_fields.text(),
    "channels": json_fields.listed(json_fields.text()),
    "commutation": json_fields.text(optional=True),
    # rigid_body
    "equivalent_mass_kg": json_fields.number(*_KILOGRAMS, optional=True),
    "moving_mass_kg": json_fields.number(*_KILOGRAMS, optional=True),
    "frf_equivalent_mass_kg": json_fields.number(*_KILOGRAMS, optional=True),
    "viscous_N_s_per_m": json_fields.number(*_NEWTONS, optional=True),
    "coulomb_N": json_fields.number(*_NEWTONS, optional=True),
    "offset_N": json_fields.number(*_NEWTONS, optional=True),
    "standard_uncertainty": json_fields.mapping(json_fields.number(0.0, 1e9, optional=True)),
    "repeatability": json_fields.mapping(json_fields.number(0.0, 1e9)),
    # transients and cells
    "file": _COUNT,
    "start_s": json_fields.number(*_SECONDS),
    "stop_s": json_fields.number(*_SECONDS),
    "position_m": json_fields.number(-1e3, 1e3),
    "condition": json_fields.choice(*Condition),
    "motion": _COUNT,
    "repetition": _COUNT,
    "repetitions": _COUNT,
    "frequency_Hz": json_fields.number(*_HERTZ, optional=True),
    "standard_uncertainty_Hz": _SPREAD,
    "damping_ratio": json_fields.number(0.0, 1.0, optional=True),
    "method": json_fields.text(),
    "verdict": json_fields.choice("good", "suspect", "refused"),
    "reasons": json_fields.listed(json_fields.text()),
    "reason_kinds": json_fields.listed(json_fields.text()),
    "coherence": json_fields.number(-0.01, 1.01, optional=True),
    "band_Hz": json_fields.listed(json_fields.number(0.0, _HERTZ[1]), length=2, optional=True),
    "uncertainty_terms_Hz": json_fields.mapping(json_fields.number(0.0, _HERTZ[1])),
    "rotor_held_frequency_Hz": json_fields.number(*_HERTZ, optional=True),
    "rotor_held_standard_uncertainty_Hz": _SPREAD,
    "deviation_Hz": json_fields.number(-_HERTZ[1], _HERTZ[1], optional=True),
    "deviation_standard_uncertainty_Hz": _SPREAD,
    "nut_load_over_preload": json_fields.number(0.0, 1e6, optional=True),
    # shared_errors; a file has a name too
    "name": json_fields.text(),
    "repeats": json_fields.flag,
    "effects_Hz": json_fields.listed(json_fields.number(-_HERTZ[1], _HERTZ[1], optional=True)),
    # lost_motion
    "lost_m": json_fields.number(-1.0, 1.0),
    "standard_uncertainty_m": json_fields.number(0.0, 1.0, optional=True),
    # motor_ripple
    "order": _COUNT,
    "torque_Nm": json_fields.number(0.0, 1e6, optional=True),
    "standard_uncertainty_Nm": json_fields.number(0.0, 1e6, optional=True),
    # frame_mode
    "mass_ratio": json_fields.number(0.0, 1e6, optional=True),
    "residual_ratio": json_fields.number(0.0, 1.0),
    "distinct": json_fields.flag,
    "pitching": json_fields.flag,
    # table_rotation
    "direction": json_fields.choice("pitch", "yaw"),
    "ratio_at_mode": json_fields.number(0.0, 1e6, optional=True),
    "ratio": json_fields.number(0.0, 1e6, optional=True),
    # clock
    "rate_error": json_fields.number(-1.0, 1.0),
    "rate_error_uncertainty": json_fields.number(0.0, 1.0),
    "servo_uncertainty": json_fields.number(0.0, 1.0),
    # made
    "version": json_fields.text(),
    "settings": json_fields.mapping(json_fields.anything),
    "inputs": json_fields.mapping(json_fields.text(optional=True)),
}
