"""Temperature of the axis during a run, from recorded channels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.recording.recording import Recording

_KELVIN = 273.15
POSSIBLE = (-40.0, 150.0)
"""Least and highest temperature of an axis, °C: an open thermocouple reads far outside."""
_END = 0.1  # of a recording, whose mean is its first or last temperature
_PLACES = ("nut", "screw")  # the first that has a sensor is the axis's
# In the location of a sensor, else in its channel's name: what its temperature says nothing about the nut's.
_ELSEWHERE = re.compile(
    r"motor|drive|servo|encoder|spindle|room|hall|ambient|air|coolant|antrieb|raum|umgebung|luft"
)


def is_elsewhere(location: str) -> bool:
    """Whether a location, or the name of a channel, is that of a motor or of the room."""
    return _ELSEWHERE.search(location.casefold()) is not None


@dataclass(frozen=True, slots=True)
class TemperatureCourse:
    """Temperature over a run.

    Parameters
    ----------
    mean_C, start_C, end_C : float
        Of the axis: at the nut, else at the screw, else of the first sensor that is not on a motor or in the
        room.
    range_K : float
        Highest less lowest of the starts and ends of the recordings.
    screw_above_nut_K : float or None
        Mean difference, where both have a sensor (``location`` begins with "screw" and "nut").
    place : str
        "nut", "screw", or another location of that sensor; empty where none is stated.
    """

    mean_C: float  # noqa: N815
    start_C: float  # noqa: N815
    end_C: float  # noqa: N815
    range_K: float  # noqa: N815
    screw_above_nut_K: float | None = None  # noqa: N815
    place: str = ""

    @property
    def is_of_axis(self) -> bool:
        """Whether the sensor is at the nut or at the screw."""
        return self.place in _PLACES


def trip_temperatures(recording: Recording) -> dict[str, tuple[float, float, float]]:
    """Temperature at each place of one recording.

    Parameters
    ----------
    recording : Recording
        Channels in SI.

    Returns
    -------
    dict of str to (float, float, float)
        Place ("nut", "screw" or another location) to mean, first and last temperature, °C; without sensors
        on a motor or in the room, and without those whose values no axis has.
    """
    found: dict[str, list[tuple[float, float, float]]] = {}
    for name in recording.of("temperature"):
        attrs = recording.channels[name].attrs
        location = str(attrs["location"]).casefold()
        place = next(filter(location.startswith, _PLACES), location)
        if place not in _PLACES and is_elsewhere(location or str(attrs.get("source", ""))):
            continue
        values = recording.array(name) - _KELVIN
        if not np.all((values >= POSSIBLE[0]) & (values <= POSSIBLE[1])):
            continue
        count = max(int(_END * len(values)), 1)
        row = float(values.mean()), float(values[:count].mean()), float(values[-count:].mean())
        found.setdefault(place, []).append(row)
    means = {}
    for place, rows in found.items():
        mean, first, last = np.mean(rows, axis=0).tolist()
        means[place] = (mean, first, last)
    return means


def temperature_course(
    trips: Sequence[Mapping[str, tuple[float, float, float]]],
) -> TemperatureCourse | None:
    """Temperature over a run.

    Parameters
    ----------
    trips : sequence of mapping
        By :func:`trip_temperatures`, in the order of time.

    Returns
    -------
    TemperatureCourse or None
        None without a sensor that all recordings have.
    """
    if not trips:
        return None
    places = dict.fromkeys([*_PLACES, *trips[0]])
    common = [place for place in places if all(place in trip for trip in trips)]
    if not common:
        return None
    rows = np.array([trip[common[0]] for trip in trips])
    excess = None
    if "nut" in common and "screw" in common:
        excess = float(np.mean([trip["screw"][0] - trip["nut"][0] for trip in trips]))
    return TemperatureCourse(
        mean_C=float(rows[:, 0].mean()),
        start_C=float(rows[0, 1]),
        end_C=float(rows[-1, 2]),
        range_K=float(np.ptp(rows[:, 1:])),
        screw_above_nut_K=excess,
        place=common[0],
    )
