from __future__ import annotations

from dataclasses import replace

import pytest

from ballscrew.modal.output_error import identify_cell, over_windows
from ballscrew.modal.output_error.estimate import CellEstimate


def said(frequency, uncertainty=0.1):
    verdict, reasons = ("good", ()) if frequency else ("refused", ("the records show no mode",))
    return CellEstimate(
        frequency, uncertainty if frequency else None, 0.03, 0.001, verdict, reasons, None, (), 3
    )


def test_what_windows_disagree_by_is_in_the_uncertainty():
    joined = over_windows([said(150.0), said(151.0), said(152.0)])
    assert joined.frequency == 151.0
    assert dict(joined.terms)["windows"] == pytest.approx(1.0)
    assert joined.uncertainty == pytest.approx((1 + 0.1**2) ** 0.5)


def test_a_window_on_another_mode_does_not_count():
    joined = over_windows([said(150.0), said(150.2), said(150.1), said(190.0)])
    assert joined.frequency == pytest.approx(150.1)
    assert joined.uncertainty < 0.2


def test_windows_that_show_nothing():
    assert over_windows([said(150.0), said(None), said(None)]).verdict == "refused"
    assert "only 1 of 3 windows" in over_windows([said(None), said(None), said(150.0)]).reasons[0]
    assert over_windows([said(None)]).reasons == ("the records show no mode",)
    assert over_windows([said(150.0), said(None)]).frequency == 150.0
    with pytest.raises(ValueError, match="no estimate"):
        over_windows([])


def test_one_window_changes_nothing(ring, rate):
    found = identify_cell(*ring()[:2], rate, (100.0, 300.0))
    joined = over_windows([found])
    assert joined == replace(found, terms=(*found.terms, ("windows", 0.0)))
