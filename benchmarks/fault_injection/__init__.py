"""Everything that goes wrong with a measurement, by name and by strength.

>>> import numpy as np
>>> from benchmarks.fault_injection import RecordedTrips, inject
>>> good = RecordedTrips(({"torque": np.sin(np.arange(9.0))},), rate=12800.0)
>>> inject("inverted torque", good, 1.0, np.random.default_rng(0)).trips[0]["torque"][1] < 0
True
"""

from __future__ import annotations

from benchmarks.fault_injection.catalogue import FAULTS, inject
from benchmarks.fault_injection.fault import Channels, Fault, RecordedTrips, Setup

__all__ = ["FAULTS", "Channels", "Fault", "RecordedTrips", "Setup", "inject"]
