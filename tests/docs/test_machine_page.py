"""The page *The machine and the test* agrees with the code, and its pictures are there."""

from __future__ import annotations

import importlib.util
import re
import struct
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ballscrew.axis import compliance
from ballscrew.axis.equations import preload_at_frequency
from ballscrew.axis.frequency import axial_natural_frequency, nut_share
from ballscrew.axis.hertz import RELEASE, apparent_preload, preload_deflection, tangent_ratio
from ballscrew.axis.model import kappa, moving_mass, rotor_mass, theta
from ballscrew.axis.wear import (
    WEAR_LAWS,
    backlash_after_wear,
    contact_pressure_law,
    end_of_preload,
    preload_after_wear,
)
from ballscrew.fcft.cells import cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.excitation import blow_spectrum, nulls
from ballscrew.fcft.nutload import ADVISED, nut_load
from ballscrew.fcft.schedule import duration, move_time, trip_time

pytest.importorskip("matplotlib")

from docs.pictures.quarter import smallest_loss

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs" / "explanation" / "machine.md"


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"docs_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


FIGURES = load(ROOT / "docs" / "figures.py")
AXIS, PLAN, MOTION = FIGURES.AXIS, FIGURES.PLAN, FIGURES.MOTION
NEW, KAPPA = AXIS.nominal_preload, kappa(AXIS)


@pytest.fixture(scope="module")
def text() -> str:
    return " ".join(PAGE.read_text(encoding="utf-8").split())


def assert_on_page(text: str, *sentences: str) -> None:
    missing = [sentence for sentence in sentences if sentence not in text]
    assert missing == [], "the page differs"


def f(x: float = 0.0, mass: float = 0.0, preload: float = NEW, rotor: str = "free") -> float:
    return float(axial_natural_frequency(AXIS, x, mass, preload, rotor))  # type: ignore[arg-type]


def test_the_days_of_the_wear_law(text: str) -> None:
    days = np.linspace(0, 79.999, 400001)
    depth = float(preload_deflection(NEW, KAPPA))
    preload = preload_after_wear(depth * days / 80, NEW, KAPPA)
    lower = f() - axial_natural_frequency(AXIS, 0.0, 0.0, preload)
    first, five, ten = (float(np.interp(fall, lower, days)) for fall in (1, 5, 10))
    alone = contact_pressure_law(days, NEW, 80 / float(end_of_preload("contact-pressure", 1.0)))
    remaining = alone > 0
    dashed = f() - axial_natural_frequency(AXIS, 0.0, 0.0, alone[remaining])
    last = 80 * (1 + 0.4e-6 / 2 / depth)
    assert float(backlash_after_wear(depth * last / 80, NEW, KAPPA)) == pytest.approx(0.4e-6)
    half, quarter = (float(np.interp(-part * NEW, -preload, days)) for part in (0.5, 0.75))
    assert (round(last) - round(first)) / 7 == pytest.approx(11, abs=0.2)
    assert_on_page(
        text,
        f"1 Hz lower on day {first:.0f}, 5 Hz on day {five:.0f} and 10 Hz on day {ten:.0f}",
        f"Backlash reaches the paper's final 0.4 µm on day {last:.0f}",
        "shows the wear eleven weeks earlier",
        f"here {1e6 * depth:.1f} µm",
        f"Half of the preload is gone on day {half:.0f}",
        f"The frequency is 5 Hz lower on day {np.interp(5, dashed, days[remaining]):.0f}",
        f"{NEW:.0f} N against {0.75 * NEW:.0f} N. "
        f"By the solid line of the first picture that is day {quarter:.0f} of 80",
    )
    assert {"external-load", "contact-pressure"} <= set(WEAR_LAWS)


def test_the_compliance_chain(text: str) -> None:
    screw = AXIS.screw
    steel = {"diameter": screw.root_diameter, "youngs_modulus": screw.youngs_modulus, "support": "fixed-free"}
    nut = 1 / float(
        compliance.nut_rigidity(NEW, screw.rigidity, screw.dynamic_load_rating, screw.rigidity_preload_ratio)
    )
    bearing = compliance.bearing_compliance(AXIS.bearing.stiffness)
    shaft = compliance.shaft_compliance(np.array(FIGURES.TRAVEL) + screw.bearing_to_zero, **steel)
    rows = {
        "nut, 4 % of C_a": [nut, nut],
        "shaft": shaft,
        "thrust bearing": [bearing, bearing],
        "all": nut + bearing + shaft,
    }
    for name, values in rows.items():
        assert_on_page(text, f"| {name} | {1e9 * values[0]:.2f} nm/N | {1e9 * values[1]:.2f} nm/N |")
    shares = nut_share(AXIS, np.array(FIGURES.TRAVEL), torsion=False)
    assert_on_page(text, f"| the nut's share s | {100 * shares[0]:.0f} % | {100 * shares[1]:.0f} % |")


def test_theta_rotor_and_load(text: str) -> None:
    of, rotor = theta(AXIS), rotor_mass(AXIS)
    lost = {}
    for name, mass in (("held", np.inf), ("free", rotor)):
        read = preload_at_frequency(
            0.0, f(mass=50.0, rotor=name), moving_mass(AXIS, 0.0), of, rotor_mass=float(mass)
        )
        lost[name] = 100 * (1 - float(read) / NEW)
    assert_on_page(
        text,
        f"a = −{-of.a:.4f}, b = −{-of.b:.4f}, c = {round(of.c, -2):.0f} and d = {of.d:.2f} kg",
        f"Table and nut weigh {AXIS.table.mass:g} kg",
        f"All rotating parts weigh {rotor:.0f} kg",
        f"At 0 mm the frequency is {f():.1f} Hz instead of {f(rotor='held'):.1f} Hz; with 50 kg of load, "
        f"{f(mass=50.0):.1f} instead of {f(mass=50.0, rotor='held'):.1f} Hz",
        f"a loss of {lost['held']:.0f} % of the preload with the rotor held, and of {lost['free']:.0f} %",
        f"with {AXIS.guide.friction:g} N of friction in its guides",
    )


def test_fixed_at_both_ends(text: str) -> None:
    both = replace(AXIS, support="fixed-fixed")
    x = np.linspace(-0.12, 0.78, 9001)
    along = axial_natural_frequency(both, x, 0.0)
    assert_on_page(text, f"at {1e3 * x[along.argmin()]:.0f} mm on this axis, with {along.min():.1f} Hz")
    assert np.all(along >= axial_natural_frequency(AXIS, x, 0.0))


def test_a_quarter_of_the_preload(text: str) -> None:
    near, far = (f(x) - f(x, preload=FIGURES.LEFT * NEW) for x in FIGURES.TRAVEL)
    assert 0.5 < far / near < 0.6
    now, hoped = FIGURES.UNCERTAINTIES[::-1]
    single, all_of_them = (
        [100 * float(smallest_loss(AXIS, PLAN, u, count)) for u in (now, hoped)] for count in (1, 40)
    )
    assert_on_page(
        text,
        f"At 0 mm a quarter of the preload is {near:.1f} Hz, at 450 mm {far:.1f} Hz",
        f"With ± {now:g} Hz, [the uncertainty of a cell by the paper's method](uncertainty.md), "
        f"one average cell detects a loss of {single[0]:.0f} %",
        f"With ± {hoped:g} Hz it detects {single[1]:.0f} %",
        f"The {len(cells(PLAN))} cells of eleven stops detect {all_of_them[0]:.1f} % "
        f"and {all_of_them[1]:.1f} %",
    )
    assert single[0] > 25 > single[1]


def test_what_a_cell_has_today_is_what_the_page_on_uncertainty_says() -> None:
    page = (ROOT / "docs" / "explanation" / "uncertainty.md").read_text(encoding="utf-8").replace("\xa0", " ")
    found = re.search(r"median standard uncertainty \| ([\d.]+) Hz \| ([\d.]+) Hz", page)
    assert found is not None
    assert [f"{float(value):.1f}" for value in found.groups()] == [f"{FIGURES.UNCERTAINTIES[1]:g}"] * 2


def test_the_loaded_nut(text: str) -> None:
    ratios = [float(tangent_ratio(q, 1.0)) for q in (0.5, ADVISED, RELEASE)]
    reads = [100 * float(apparent_preload(q, 1.0)) for q in (ADVISED, 2.0, RELEASE)]
    assert float(apparent_preload(4.0, 1.0)) == pytest.approx(4 / 8)
    load = {c: nut_load(AXIS, MOTION, 0.0, c) for c in Condition}
    one_percent = 0.01 * AXIS.screw.dynamic_load_rating
    assert_on_page(
        text,
        f"({ratios[0]:.3f} at 0.5 P, {ratios[1]:.3f} at 1.5 P), then steeply, down to {ratios[2]:.3f}",
        f"at 1.5 P as {reads[0]:.0f} % of the preload, at 2 P as {reads[1]:.0f} %, "
        f"at release as {reads[2]:.0f} %",
        f"has {load[Condition.PA]:.0f} N on its nut: {load[Condition.PA] / NEW:.2f} P when it is new",
        f"is {load[Condition.PA] / one_percent:.1f} P when 1 % of $C_a$ is left",
        f"unloads a flank at {load[Condition.PA] / RELEASE / one_percent:.2f} %",
        f"± {load[Condition.PA]:.0f} N in PA and NA, and ∓ {load[Condition.ND]:.0f} N in PD and ND",
        f"print the same {RELEASE:.2f}",
    )
    assert load[Condition.PA] == -load[Condition.NA]
    assert load[Condition.ND] == -load[Condition.PD]


def test_the_round_trip_and_its_time(text: str) -> None:
    count = len(PLAN.positions)
    assert_on_page(
        text,
        f"{1e3 * MOTION.speed:g} mm/s, {MOTION.acceleration:g} m/s², {MOTION.jerk:g} m/s³, "
        f"{1e3 * MOTION.dwell:g} ms of standstill",
        f"Eleven stops, 45 mm apart, are {2 * (count - 1)} moves of {move_time(0.045, MOTION):.3f} s and "
        f"{2 * count - 1} dwells: {trip_time(PLAN, MOTION):.2f} s a round trip, "
        f"{duration(PLAN) / 60:.1f} min for {PLAN.repetitions} of them",
    )
    assert count == 11
    assert len(FIGURES.SHORT_PLAN.positions) == 5
    assert 2 * (count - 1) * (move_time(0.045, MOTION) + MOTION.dwell) + MOTION.dwell == pytest.approx(
        trip_time(PLAN, MOTION)
    )


def test_the_spectrum_of_a_jerk_phase(text: str) -> None:
    slow = replace(MOTION, jerk=450.0)
    assert float(blow_spectrum(f(), slow)) < 0.01
    assert_on_page(
        text,
        f"here every {MOTION.acceleration / MOTION.speed:.1f} Hz",
        f"$T_j$ is {1e3 * MOTION.jerk_time:.2f} ms, the first null lies at {nulls(MOTION, 1000)[0]:.0f} Hz, "
        f"and {100 * float(blow_spectrum(f(), MOTION)):.0f} % of the excitation remains at {f():.0f} Hz",
        f"With 450 m/s³ it would lie at {nulls(slow, 200)[0]:.0f} Hz",
    )


def size(path: Path) -> tuple[int, int]:
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", content[16:24])
    return width, height


def test_every_picture_is_shown_and_every_one_shown_is_drawn(text: str) -> None:
    assert re.findall(r"\{image\} \.\./_static/(\w+)\.png", text) == [
        "degradation", "theory", "supports", "quarter", "nut", "conditions",
    ]  # fmt: skip
    assert set(re.findall(r"\{image\} \.\./_static/(\w+)\.png", text)) == set(FIGURES.FIGURES)


@pytest.mark.slow
def test_the_pictures_are_those_of_the_script(tmp_path: Path) -> None:
    FIGURES.main(tmp_path)
    for name in FIGURES.FIGURES:
        committed, current = (folder / f"{name}.png" for folder in (ROOT / "docs" / "_static", tmp_path))
        assert size(committed) == size(current), f"run python -m docs.figures: {name}"
