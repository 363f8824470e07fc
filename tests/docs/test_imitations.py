"""The numbers of the page *What imitates a loss of preload* are the code's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ballscrew.axis import imitation

PAGE = Path(__file__).parent.parent.parent / "docs" / "explanation" / "imitations.md"
AT = {"position": 0.0, "load": 0.0, "preload": 680.0}


def documented(name):
    row = re.search(rf"^\|[^|]*\| ([^|]*) \| ([^|]*)\| `{name}` \|", PAGE.read_text(encoding="utf-8"), re.M)
    assert row is not None, name
    return [text.strip() for text in row.groups()]


def shown(change, digits=1):
    text = f"{100 * float(change):+.{digits}f} %"
    return text.replace("-", "−")


@pytest.mark.parametrize("rotor", ["held", "free"])
@pytest.mark.parametrize(
    ("name", "arguments"), [("wrong_load", (1.0,)), ("wrong_position", (1e-3,)), ("bearing_change", (-0.1,))]
)
def test_what_acts_on_the_frequency(axes_m, rotor, name, arguments):
    change = getattr(imitation, name)(axes_m, *arguments, **AT, rotor=rotor)
    assert documented(name)[rotor == "free"] == shown(change)


def test_what_presses_the_nut(axes_m):
    assert documented("warm_screw")[0] == shown(imitation.warm_screw(axes_m, 5.0, 0.0125, preload=680.0))
    assert documented("oil_film")[0] == shown(imitation.oil_film(axes_m, 0.3e-6, preload=680.0))


def test_a_wrong_rate(axes_m):
    change = imitation.wrong_sample_rate(axes_m, 12e3, 12.8e3, **AT)
    assert documented("wrong_sample_rate")[0] == shown(change, 0)


@pytest.fixture
def axes_m():
    from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table

    return DataSheet(
        name="M",
        support="fixed-free",
        screw=Screw(0.01, 0.0214, 0.025, 0.9, 0.12, 17e3, 450e6, 0.1, 0.04),
        bearing=Bearing(180e6),
        table=Table(101.5),
        drive=Drive(3e-4),
        guide=Guide(0.0),
    )
