"""A small controller on top of a parser of another make: what a program really makes an axis do.

It shares nothing with the package: its moves are a step that is limited in speed and smoothed twice by moving
averages, the way drives make their set-points, so that acceleration and jerk keep to their limits.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from gcodeparser import parse_gcode_lines

_BLOCK = re.compile(r"(?:[A-Z]=?[-+]?\d+\.?\d*)(?: [A-Z]\d?=?[-+]?\d+\.?\d*)*")
_DWELLS = {"iso": ("P", 1.0), "fanuc": ("P", 1e-3), "siemens": ("F", 1.0)}
_MODES = {"iso": {21, 90, 94, 61}, "fanuc": {21, 90, 94, 61}, "siemens": {710, 90, 94, 60}}


@dataclass(frozen=True)
class Block:
    """A move (to, feed in m and m/s), a dwell (in s), or a stop for the operator."""

    kind: str
    to: float = 0.0
    feed: float = 0.0
    seconds: float = 0.0


def blocks(text: str, dialect: str = "iso", axis: str = "X") -> list[Block]:
    """Interpret a program; anything that is not understood fails."""
    assert text.isascii()
    lines = text.split("\n")
    assert lines.pop() == ""
    if dialect != "siemens":
        assert lines[0] == lines[-1] == "%"
        lines = lines[1:-1]
        if dialect == "fanuc":
            assert re.fullmatch(r"O\d{4}", lines.pop(0))
    modes, found, ended = set(), [], False
    for line in lines:
        assert "%" not in line
        if dialect == "siemens":
            bare = line.partition(";")[0]
        else:
            assert len(line) <= 80
            bare = re.sub(r"\([^()]*\)", "", line)
        if not bare:
            continue
        assert _BLOCK.fullmatch(bare), bare
        (command,) = parse_gcode_lines(bare)
        assert not ended
        if command.command_str in {"M30", "M0"}:
            ended = command.command_str == "M30"
            found += [Block("stop")] * (not ended)
        elif command.command_str == "G1":
            assert modes == _MODES[dialect], "moves before the modes are set"
            assert set(command.params) == {axis, "F"}
            found.append(Block("move", command.params[axis] / 1000, command.params["F"] / 60_000))
        elif command.command_str == "G4":
            word, scale = _DWELLS[dialect]
            assert set(command.params) == {word}
            assert dialect != "fanuc" or isinstance(command.params[word], int)
            found.append(Block("dwell", seconds=command.params[word] * scale))
        else:
            assert command.command[0] == "G"
            assert not command.params
            modes.add(command.command[1])
    assert ended
    return found


@lru_cache(maxsize=4096)
def move_time(distance: float, speed: float, acceleration: float, jerk: float) -> float:
    """Time of a jerk-limited move from standstill to standstill, by stepping it."""
    rise = min(acceleration / jerk, (speed / jerk) ** 0.5)  # the triangle: acceleration is not reached
    ramp = speed / (jerk * rise)
    step = (distance / speed + ramp + rise) / 20_000
    left = np.maximum(distance - np.arange(20_400) * step * speed, 0.0)  # so that the end is exactly 0
    for window in (ramp, rise):
        count = max(1, round(window / step))
        sums = np.concatenate([distance * np.arange(1 - count, 1), np.cumsum(left)])
        left = (sums[count:] - sums[:-count]) / count
    return float(np.flatnonzero(left == 0)[0] * step)
