"""Everything that goes wrong with a measurement, by name and by strength.

>>> import numpy as np
>>> from ballscrew.testbed.faults import Taken, spoil
>>> good = Taken(({"torque": np.sin(np.arange(9.0))},), rate=12800.0)
>>> spoil("inverted torque", good, 1.0, np.random.default_rng(0)).trips[0]["torque"][1] < 0
True
"""

from __future__ import annotations

from ballscrew.testbed.faults.catalogue import FAULTS, spoil
from ballscrew.testbed.faults.fault import Channels, Fault, Setup, Taken

__all__ = ["FAULTS", "Channels", "Fault", "Setup", "Taken", "spoil"]
