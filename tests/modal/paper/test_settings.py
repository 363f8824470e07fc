from __future__ import annotations

import math

import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.paper.settings import PaperSettings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"estimator": "H3"}, "the estimator is 'H3'; it must be one of H1, H2, Hv"),
        ({"estimator": ""}, "the estimator is ''"),
        ({"average": "peaks"}, "the average is 'peaks'; it must be one of spectra, ratios"),
        ({"band": (200.0, 100.0)}, "the band is 200 to 100 Hz; it must rise"),
        ({"band": (100.0, 100.0)}, "must rise"),
        ({"band": (0.0, 100.0)}, "from above 0 Hz"),
        ({"band": (-50.0, 100.0)}, "from above 0 Hz"),
        ({"band": (100.0, math.inf)}, "the band is 100 to inf Hz"),
        ({"band": (math.nan, 100.0)}, "the band is nan to 100 Hz"),
        ({"band": (100.0, math.nan)}, "the band is 100 to nan Hz"),
        ({"band_half_width": 0.0}, "between 0 and 1"),
        ({"band_half_width": 1.0}, "between 0 and 1"),
        ({"band_half_width": math.nan}, "between 0 and 1"),
        ({"window_before": 0.0}, "must be more than 0"),
        ({"window_after": -1.0}, "must be more than 0"),
        ({"line_spacing": 0.0}, "must be more than 0"),
        ({"line_spacing": math.nan}, "must be more than 0"),
        ({"window_before": math.nan}, "must be more than 0"),
    ],
)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        PaperSettings(**changes)


def test_all_settings_are_stored_with_a_result():
    stored = PaperSettings(band=(100.0, 200.0)).to_settings()
    assert stored["band"] == (100.0, 200.0)
    assert set(stored) == set(PaperSettings.__dataclass_fields__)


def test_what_is_documented_is_there():
    for name in PaperSettings.__dataclass_fields__:
        assert name in PaperSettings.__doc__
