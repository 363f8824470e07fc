from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from ballscrew.modal.paper.judge import judge
from ballscrew.modal.paper.lines import Lines
from ballscrew.modal.paper.peak import Peak
from ballscrew.modal.paper.phase import Phase
from ballscrew.modal.paper.settings import PaperSettings

GRID = np.linspace(100.0, 200.0, 201)
DEFAULT = PaperSettings()
PEAK = Peak(150.0, 5.0, at_edge=False)


def lines(count=3, null=1.0):
    power = np.ones(201)
    power[100] = null
    row = np.sqrt(power).astype(complex)
    return Lines(GRID, np.tile(row, (count, 1)), np.ones((1, count, 201), complex))


ON_A_MODE = Phase(at_peak=-88.0, fall=150.0)


def of(
    peak=PEAK, uncertainty=0.3, reading=0.99, amplification=10.0, at=None, settings=DEFAULT, phase=ON_A_MODE
):
    verdict, reasons = judge(peak, uncertainty, reading, amplification, phase, at or lines(), settings)
    return SimpleNamespace(verdict=verdict, reasons=tuple(reason.text for reason in reasons))


def test_good():
    assert (of().verdict, of().reasons) == ("good", ())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"reading": 0.85},
            r"the coherence at the peak \(150\.0 Hz\) is 0\.850; with 3 repetitions it must be",
        ),
        ({"reading": 0.0}, "the coherence"),
        ({"amplification": 2.0}, "2.0 times as high"),
        ({"amplification": float("nan")}, "times as high"),
        ({"at": lines(null=1e-4)}, "the torque hardly excites 150.0 Hz: 0.0% of the band's median power"),
        (
            {"phase": Phase(-40.0, 150.0)},
            "the phase at 150.0 Hz is -40° against that of the axis as one mass",
        ),
        ({"phase": Phase(90.0, 150.0)}, "the phase at 150.0 Hz is 90°"),
        ({"phase": Phase(-90.0, 20.0)}, "the phase does not fall through the peak at 150.0 Hz"),
        ({"phase": Phase(-90.0, 340.0)}, "the phase does not fall"),
        ({"phase": Phase(float("nan"), float("nan"))}, "the phase at"),
        ({"uncertainty": 5.0}, "repetitions and windows disagree about the peak by ± 5.0 Hz"),
        (
            {"peak": Peak(150.0, 5.0, at_edge=True)},
            "higher at the edge of the band than at its peak of 150.0 Hz",
        ),
    ],
)
def test_refused(given, message):
    verdict = of(**given)
    assert verdict.verdict == "refused"
    assert len(verdict.reasons) == 1
    assert re.search(message, verdict.reasons[0])


def test_all_reasons_are_given():
    bad = of(Peak(150.0, 5.0, at_edge=True), 50.0, 0.1, 1.0, lines(null=1e-9))
    assert len(bad.reasons) == 5


def test_suspect():
    wide = of(uncertainty=2.5)
    message = "the standard uncertainty is ± 2.5 Hz, above 1.5 % of the frequency"
    assert (wide.verdict, wide.reasons) == ("suspect", (message,))
    single = of(at=lines(1))
    assert single.verdict == "suspect"
    assert "one repetition" in single.reasons[0]


def test_many_repetitions_need_less_coherence():
    assert of(reading=0.85).verdict == "refused"
    assert of(reading=0.85, at=lines(10)).verdict == "good"
    assert of(reading=0.55, at=lines(10)).verdict == "refused"
    assert of(reading=0.55, at=lines(10), settings=PaperSettings(least_coherence=0.5)).verdict == "good"


def test_limits_are_settings():
    for settings_ in (
        PaperSettings(least_excitation=2.0),
        PaperSettings(least_amplification=20.0),
        PaperSettings(most_uncertainty=1e-4),
    ):
        assert of(settings=settings_).verdict == "refused"
