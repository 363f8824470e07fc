from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis import hertz
from ballscrew.axis.rigidity import at_preload, kappa, tolerance
from ballscrew.axis.tolerances import tolerances

FLANK = 3.0e10  # K_h of one flank, N/m^1.5
RATING = 17e3


def one_flank(load):
    """Deflection of a nut with clearance, m."""
    return (load / FLANK) ** (2 / 3)


TRUE = 3 * FLANK ** (2 / 3)
"""κ of two such flanks."""


def screw(axes, convention, rigidity, **more):
    given = {"rigidity_preload_ratio": None, "rigidity_convention": convention, "rigidity": rigidity}
    return replace(axes["M"].screw, **{**given, **more})


def test_the_rigidity_at_rest_is_three_times_one_flank_s_load_over_deflection():
    preload = 680.0
    secant = preload / one_flank(preload)
    assert hertz.nut_rigidity_under_load(0.0, preload, TRUE) == pytest.approx(3 * secant)


def test_at_the_same_force_a_preloaded_nut_is_twice_as_stiff():
    preload = 0.1 * RATING
    release = float(hertz.release_load(preload))
    deflection = float(hertz.nut_deflection(release, preload, TRUE))
    assert one_flank(release) / deflection == pytest.approx(2)


def test_catalogue_values_of_one_nut_in_each_convention_have_the_same_kappa(axes):
    at_preload = 3 * 0.1 * RATING / one_flank(0.1 * RATING)
    at_load = 0.3 * RATING / one_flank(0.3 * RATING)
    at_nominal = TRUE * (0.04 * RATING) ** (1 / 3)
    screws = [
        screw(axes, "preloaded", at_preload, rigidity_preload_ratio=0.1),
        screw(axes, "clearance", at_load, rigidity_load_ratio=0.3),
        screw(axes, "iso", 0.8 * at_preload, rigidity_preload_ratio=0.1),
        screw(axes, "measured", 0.8 * at_nominal),
    ]
    np.testing.assert_allclose([kappa(s) for s in screws], 0.8 * TRUE, rtol=1e-12)
    assert at_preload / at_load == pytest.approx(3 ** (2 / 3))


@pytest.mark.parametrize("ratio", [0.05, 0.08, 0.10])
def test_the_secant_at_release_lies_six_per_cent_below_the_tangent(axes, ratio):
    preload = ratio * RATING
    secant = float(hertz.release_load(preload)) / one_flank(preload)
    found = kappa(screw(axes, "preloaded", secant, rigidity_preload_ratio=ratio))
    assert found / (0.8 * TRUE) == pytest.approx(2 * math.sqrt(2) / 3)
    assert abs(math.log(found / (0.8 * TRUE))) < 0.2


def test_an_unknown_convention_covers_every_other_with_its_tolerance(axes):
    unknown = screw(axes, "unknown", 450e6)
    others = [
        screw(axes, "preloaded", 450e6, rigidity_preload_ratio=0.05),
        screw(axes, "preloaded", 450e6, rigidity_preload_ratio=0.10),
        screw(axes, "clearance", 450e6),
        screw(axes, "clearance", 450e6, preload_by="offset lead"),
        screw(axes, "iso", 450e6, rigidity_preload_ratio=0.08),
        screw(axes, "measured", 450e6, preload_ratio=0.03),
    ]
    for other in others:
        assert abs(math.log(kappa(other) / kappa(unknown))) <= tolerance(unknown) - 0.1


@pytest.mark.parametrize("preload", [0.01, 0.04, 0.10])
def test_an_unknown_convention_of_a_nut_with_a_spring_covers_a_measured_rigidity_too(axes, preload):
    spring = {"preload_by": "spring", "preload_ratio": preload}
    unknown = screw(axes, "unknown", 450e6, **spring)
    others = [
        screw(axes, "preloaded", 450e6, rigidity_preload_ratio=0.10, **spring),
        screw(axes, "clearance", 450e6, **spring),
        screw(axes, "measured", 450e6, **spring),
    ]
    for other in others:
        assert abs(math.log(kappa(other) / kappa(unknown))) <= tolerance(unknown) - 0.1


def test_an_offset_lead_may_divide_the_turns_of_a_nut_with_clearance(axes):
    whole, divided = (
        screw(axes, "clearance", 450e6),
        screw(axes, "clearance", 450e6, preload_by="offset lead"),
    )
    highest = kappa(divided) * math.exp(tolerance(divided) - tolerance(whole))
    lowest = kappa(divided) * math.exp(tolerance(whole) - tolerance(divided))
    assert highest == pytest.approx(kappa(whole))
    assert lowest == pytest.approx(kappa(whole) / 2 ** (2 / 3))


def test_a_spring_leaves_one_flank(axes):
    nut = screw(axes, "preloaded", 450e6, rigidity_preload_ratio=0.1)
    assert kappa(replace(nut, preload_by="spring")) == pytest.approx(kappa(nut) / 2)
    measured = replace(nut, rigidity_convention="measured")
    assert kappa(replace(measured, preload_by="spring")) == kappa(measured)
    assert kappa(replace(nut, preload_by="spacer")) == kappa(nut)


def test_a_stated_tolerance_is_used(axes):
    measured = replace(axes["M"], screw=screw(axes, "measured", 450e6))
    assert tolerances(measured)["rigidity"] == 0.10
    assert tolerances(replace(measured, tolerances={"rigidity": 0.03}))["rigidity"] == 0.03


@pytest.mark.parametrize(
    ("convention", "stated"), [("preloaded", 0.1), ("clearance", None), ("measured", 0.04), ("unknown", 0.04)]
)
def test_a_rigidity_stays_that_of_the_preload_at_which_it_was_stated(axes, convention, stated):
    given = screw(axes, convention, 400e6, rigidity_preload_ratio=0.1 if convention == "preloaded" else None)
    sheet = replace(axes["M"], screw=replace(given, preload_ratio=0.04))
    half = at_preload(sheet, 0.02 * sheet.screw.dynamic_load_rating)
    assert (half.screw.preload_ratio, half.screw.rigidity_preload_ratio) == (pytest.approx(0.02), stated)
    assert kappa(half.screw) == pytest.approx(kappa(sheet.screw))
    assert at_preload(sheet, None) is sheet
