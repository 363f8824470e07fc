from __future__ import annotations

import math

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.paper.settings import PaperSettings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"estimator": "H3"}, "the estimator is 'H3'; it must be one of H1, H2, Hv"),
        ({"estimator": ""}, "the estimator is ''"),
        ({"average": "peaks"}, "the average is 'peaks'; it must be one of spectra, ratios"),
        ({"band": (200.0, 100.0)}, "upper end of the band is 100.0; it must be a number, more than 200"),
        ({"band": (100.0, 100.0)}, "upper end of the band is 100.0; it must be a number, more than 100"),
        ({"band": (0.0, 100.0)}, "lower end of the band is 0.0; it must be a number, more than 0"),
        ({"band": (-50.0, 100.0)}, "lower end of the band is -50.0"),
        ({"band": (100.0, math.inf)}, "upper end of the band is inf"),
        ({"band": (math.nan, 100.0)}, "lower end of the band is nan"),
        ({"band": (100.0, math.nan)}, "upper end of the band is nan"),
        ({"band": ("100", "200")}, "lower end of the band is '100'"),
        ({"band": 100.0}, "the band is 100.0; it must be two frequencies in Hz"),
        ({"band": (100.0,)}, "it must be two frequencies in Hz"),
        ({"band_half_width": 0.0}, "band_half_width is 0.0; it must be a number, more than 0"),
        ({"band_half_width": 1.0}, "band_half_width is 1; it must be less than 1"),
        ({"band_half_width": math.nan}, "band_half_width is nan"),
        ({"window_before": 0.0}, "window_before is 0.0; it must be a number, more than 0"),
        ({"window_after": -1.0}, "window_after is -1.0"),
        ({"window_after": "10"}, "window_after is '10'"),
        ({"line_spacing": 0.0}, "line_spacing is 0.0"),
        ({"line_spacing": math.nan}, "line_spacing is nan"),
        ({"window_before": math.nan}, "window_before is nan"),
    ],
)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        PaperSettings(**changes)


def test_a_band_may_be_an_array():
    assert PaperSettings(band=np.array([100.0, 200.0])).band[1] == 200.0


def test_all_settings_are_stored_with_a_result():
    stored = PaperSettings(band=(100.0, 200.0)).to_settings()
    assert stored["band"] == (100.0, 200.0)
    assert set(stored) == set(PaperSettings.__dataclass_fields__)


def test_what_is_documented_is_there():
    for name in PaperSettings.__dataclass_fields__:
        assert name in PaperSettings.__doc__
