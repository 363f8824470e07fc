"""Parameters of the fit: fields of the modes, and their conversion to a vector of values and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import ROTOR_FREE, ROTOR_HELD, Block
from ballscrew.modal.joint.mode import AxialMode

# One per block. The first block is of the mode ROTOR_FREE, and the second, if there is one, of ROTOR_HELD, so
# the index of a mode is also that of an element.
Modes = tuple[AxialMode, ...]
# A field of AxialMode and the index of its mode, ROTOR_FREE or ROTOR_HELD. The index is None for a field that
# has the same value in both modes. The field "local:3" is the local compliance at the fourth stop.
Parameter = tuple[str, int | None]

LOCAL = "local:"
"""Beginning of the field of a local compliance."""

FRAME_FIELDS = ("frame", "frame_damping", "coupling")
"""Fields fitted where the frame has a mode near the axial one."""

PITCH_FIELDS = ("pitch", "pitch_damping")
"""Fields fitted where the table pitches near the axial mode, or the frame has a mode near it."""

MODE_FIELDS = ("compliance", "slope", "curve", "damping")
"""Fields with one value for the rotor free and another for the rotor held; the others have the same value."""

# Fields whose logarithm is the parameter.
LOGARITHMIC = ("compliance", "damping", "mass_over_preload", *FRAME_FIELDS, *PITCH_FIELDS)
# Least and largest value of a field, all without unit. They are wider than the values of any machine, but for
# the guide's part: a trial step of the fit stays where the model is defined.
_LIMITS = {
    "damping": (1e-3, 0.5),
    "pitch_damping": (1e-3, 0.5),
    "damping_exponent": (-2.0, 2.0),
    "guide_part": (0.0, 1.0),
    "frame_damping": (2e-3, 0.3),
    "coupling": (1e-5, 1.0),
}
_LOCAL_LIMITS = (-0.8, 20.0)  # likewise of a local compliance, over the compliance in the middle


def limits_of(parameters: Sequence[Parameter]) -> Array:
    """Least and largest values of parameters, shape (2, parameters); logarithms for logarithmic fields."""
    out = np.empty((2, len(parameters)))
    for k, (field, _) in enumerate(parameters):
        limits = _LIMITS.get(field, (-math.inf, math.inf))
        if field.startswith(LOCAL):
            limits = _LOCAL_LIMITS
        elif field in LOGARITHMIC and field in _LIMITS:
            limits = math.log(limits[0]), math.log(limits[1])
        out[:, k] = limits
    return out


def stop_of(field: str) -> int:
    """Index of the stop of a field that begins with :data:`LOCAL`."""
    return int(field.removeprefix(LOCAL))


def read_parameter(mode: AxialMode, field: str) -> float:
    """Value of the parameter of a field: the field itself, or its logarithm for a logarithmic field."""
    if field.startswith(LOCAL):
        return mode.local[stop_of(field)]
    value = float(getattr(mode, field))
    if field in LOGARITHMIC:
        return math.log(value)
    return value


def modes_with(
    modes: Modes, blocks: Sequence[Block], parameters: Sequence[Parameter], values: Array
) -> Modes:
    """Modes, one per block, with new values of the parameters, shape (parameters,); others are unchanged."""
    out = []
    for mode, b in zip(modes, blocks, strict=True):
        changes: dict[str, Any] = {}
        local = list(mode.local)
        for (field, index), value in zip(parameters, values.tolist(), strict=True):
            if index is not None and index != b.mode_index:
                continue
            if field.startswith(LOCAL):
                local[stop_of(field)] = value
            else:
                changes[field] = math.exp(value) if field in LOGARITHMIC else value
        out.append(replace(mode, local=tuple(local), **changes))
    return with_rotor_parts(blocks, out)


def with_rotor_parts(blocks: Sequence[Block], modes: Sequence[AxialMode]) -> Modes:
    """Modes with the ``rotor_part`` that follows from both frequencies by Eq. (3) and ``rotor_correction``.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    modes : sequence of AxialMode
        One per block.

    Returns
    -------
    tuple of AxialMode
        Unchanged if the frame does not move, or if only one of the two frequencies is fitted.
    """
    mode_by_index = {b.mode_index: mode for b, mode in zip(blocks, modes, strict=True)}
    if len(mode_by_index) == 1 or not modes[0].coupling > 0:
        return tuple(modes)
    # The compliance is proportional to 1/f².
    squares = mode_by_index[ROTOR_FREE].compliance / mode_by_index[ROTOR_HELD].compliance
    rotor_part = min(modes[0].rotor_correction * squares, 1.0)
    parts = {ROTOR_FREE: rotor_part, ROTOR_HELD: 1.0}
    return tuple(replace(m, rotor_part=parts[b.mode_index]) for b, m in zip(blocks, modes, strict=True))
