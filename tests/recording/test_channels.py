from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.quantities import SI_UNITS, to_si

TORQUE = {"source": "trq", "quantity": "torque", "unit": "Nm"}
POSITION = {"source": "pos", "quantity": "position", "unit": "mm"}


def made(*rows: dict[str, Any], **top: Any) -> ChannelMap:
    return ChannelMap.from_settings({"channel": list(rows), **top}, "channels.toml")


def test_there_and_back() -> None:
    derived = {"source": "pos", "quantity": "acceleration", "derive": "second-derivative", "axis": "x"}
    channels = made(
        TORQUE | {"scale": 2.5, "sample_rate": "1 kHz"}, POSITION, derived, sample_rate="12.8 kHz"
    )
    assert channels.sample_rate == 12800.0
    assert channels.channels[0].sample_rate == 1000.0
    assert ChannelMap.from_settings(channels.to_settings(), "channels.toml") == channels
    assert [channel.name for channel in channels.channels] == ["torque", "position", "acceleration:x"]


def test_an_acceleration_by_the_speed() -> None:
    speed = {"source": "n", "quantity": "speed", "unit": "mm/min", "scale": 10.0}
    derived = {"source": "n", "quantity": "acceleration", "derive": "derivative", "axis": "x"}
    channels = made(TORQUE, POSITION, speed, derived)
    assert ChannelMap.from_settings(channels.to_settings(), "channels.toml") == channels
    with pytest.raises(InputError, match="must be mapped as a speed by another"):
        made(TORQUE, POSITION, derived)
    with pytest.raises(InputError, match="give the travel per revolution as scale"):
        made(speed | {"unit": "rpm"})
    with pytest.raises(InputError, match="give the travel per radian as scale"):
        made(speed | {"unit": "rad/s"})


def test_phases_and_filters_there_and_back() -> None:
    filters = [
        {"type": "notch", "frequency": "300 Hz", "bandwidth": "60 Hz"},
        {"type": "delay", "time": "1 ms"},
    ]
    low = [{"type": "low pass", "frequency": "1 kHz", "order": 2}]
    rows = [{"source": name, "quantity": "current", "phase": name} for name in "uv"]
    channels = made(*rows, TORQUE | {"followed_by": filters, "filtered_by": low})
    assert ChannelMap.from_settings(channels.to_settings(), "channels.toml") == channels
    assert [channel.name for channel in channels.channels] == ["current:u", "current:v", "torque"]
    assert [each.type for each in channels.channels[2].followed_by] == ["notch", "delay"]
    assert set(made(TORQUE).to_settings()["channel"][0]) == set(TORQUE)


@pytest.mark.parametrize(
    ("names", "phases"),
    [
        (("current_u", "current_v", "current_w"), "uvw"),
        (("Strom U", "Strom W", "iq"), "uw"),
        (("IA", "IB"), "uv"),
        (("current_u",), ""),
        (("flow", "iq"), ""),
    ],
)
def test_phases_by_name(names: tuple[str, ...], phases: str) -> None:
    channels = made(*({"source": name, "quantity": "current"} for name in names)).channels
    assert "".join(channel.phase for channel in channels) == phases


def test_a_torque_in_percent_is_relative() -> None:
    assert made(TORQUE | {"unit": "%"}).channels[0].quantity == "relative torque"
    assert to_si("%", "relative torque") == (0.01, 0.0)
    with pytest.raises(InputError, match="is not %"):
        to_si("deg", "relative torque")


def test_names_are_unique() -> None:
    rows = [{"source": name, "quantity": "acceleration", "location": "nut", "axis": "x"} for name in "abc"]
    names = [channel.name for channel in made(*rows).channels]
    assert names == ["acceleration:nut:x", "acceleration:nut:x#2", "acceleration:nut:x#3"]


def test_direction_is_another_word_for_axis() -> None:
    row = {"source": "a", "quantity": "acceleration"}
    assert made(row | {"direction": "x"}).channels == made(row | {"axis": "x"}).channels
    with pytest.raises(InputError, match=r"channel\[0\]\.direction"):
        made(row | {"direction": "x", "axis": "x"})


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "has no channel"),
        ([{"source": "a", "quantity": "torq"}], "channel[0].quantity is 'torq'; it must be one of torque"),
        ([{"source": "a", "quantity": "torque", "unti": "Nm"}], "channel[0].unti is not a known field"),
        ([{"quantity": "torque"}], "channel[0].source is missing"),
        ([{"source": 3, "quantity": "torque"}], "channel[0].source is 3"),
        ([{"source": "TODO", "quantity": "torque"}], "filled in: the name of the torque in the files"),
        ([TORQUE | {"scale": "TODO"}], f"a number, the Nm per unit of {TORQUE['source']!r}"),
        ([TORQUE | {"unit": "kg"}], "channel[0].unit is 'kg'; it must be a unit of torque"),
        ([TORQUE | {"unit": "TODO"}], "channel[0].unit is 'TODO'; it must be a unit of torque"),
        ([TORQUE | {"unit": 3}], "channel[0].unit is 3"),
        ([POSITION | {"unit": "deg"}], "it must be a length"),
        ([TORQUE | {"scale": 0}], "channel[0].scale is 0"),
        ([TORQUE | {"phase": "u"}], "only a current has one"),
        (
            [TORQUE | {"filtered_by": [{"type": "loop"}]}],
            "filtered_by[0].type is 'loop'; it must be one of low",
        ),
        ([TORQUE | {"filtered_by": [{"type": "low pass"}]}], "filtered_by[0].frequency is missing"),
        ([TORQUE | {"filtered_by": [{"type": "low pass", "frequency": 9, "order": 9}]}], "order is 9"),
        ([TORQUE | {"filtered_by": [{"type": "delay", "frequency": 9}]}], "frequency is not a known field"),
        ([POSITION | {"followed_by": [{"type": "delay", "time": 1}]}], "only a torque, a force or a q-axis"),
        (
            [{"source": "t", "quantity": "time", "filtered_by": [{"type": "delay", "time": 1}]}],
            "left out for a",
        ),
        ([TORQUE | {"scale": float("nan")}], "channel[0].scale is nan"),
        ([TORQUE | {"scale": 1e308}], "channel[0].scale is 1e+308"),
        ([TORQUE | {"scale": 1e-20}], "channel[0].scale is 1e-20"),
        ([TORQUE | {"offset": -1e20}], "channel[0].offset is -1e+20"),
        ([TORQUE | {"sample_rate": "0 Hz"}], "channel[0].sample_rate is '0 Hz'"),
        ([TORQUE | {"sample_rate": 1e300}], "channel[0].sample_rate is 1e+300"),
        ([TORQUE | {"sample_rate": -1}], "channel[0].sample_rate is -1"),
        ([TORQUE | {"sample_rate": "1e-9 Hz"}], "channel[0].sample_rate is '1e-9 Hz'"),
        ([TORQUE | {"filtered_by": [{"type": "low pass", "frequency": 1e-20}]}], "frequency is 1e-20"),
        ([TORQUE | {"filtered_by": [{"type": "delay", "time": "1e30 s"}]}], "time is '1e30 s'"),
        ([TORQUE, TORQUE | {"unit": "kNm"}], "channel[1] maps 'trq' to torque again"),
        ([{"source": "n", "quantity": "speed", "unit": "1/min"}], "give the travel per revolution as scale"),
        ([TORQUE | {"derive": "second-derivative"}], "only an acceleration can be derived"),
        (
            [POSITION | {"quantity": "acceleration", "unit": "g", "derive": "integral"}],
            "one of second-derivative",
        ),
        (
            [{"source": "p", "quantity": "acceleration", "derive": "second-derivative"}],
            "must be mapped as a position",
        ),
        (
            [
                POSITION,
                {"source": "pos", "quantity": "acceleration", "derive": "second-derivative", "unit": "g"},
            ],
            "what is derived is in SI",
        ),
        (
            [
                POSITION,
                {"source": "pos", "quantity": "acceleration", "derive": "second-derivative", "scale": 2},
            ],
            "channel[1].scale is 2",
        ),
        (
            [{"source": name, "quantity": "time"} for name in "ab"],
            "more than one channel of the quantity time",
        ),
        ([3], "channel[0]"),
    ],
)
def test_what_is_refused(rows: list[Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        made(*rows)
    assert message in str(caught.value)
    assert str(caught.value).startswith("channels.toml: ")


def test_top_fields() -> None:
    with pytest.raises(InputError, match="rate is not a known field"):
        made(TORQUE, rate=3)
    with pytest.raises(InputError, match="sample_rate is 'TODO'"):
        made(TORQUE, sample_rate="TODO")


@pytest.mark.parametrize(
    ("unit", "quantity", "slope", "offset"),
    [
        ("g", "acceleration", 9.80665, 0),
        ("gn", "acceleration", 9.80665, 0),
        ("g0", "acceleration", 9.80665, 0),
        ("mg", "acceleration", 9.80665e-3, 0),
        ("m/s2", "acceleration", 1, 0),
        ("m s⁻²", "acceleration", 1, 0),
        ("mm/s²", "acceleration", 1e-3, 0),
        ("Nm", "torque", 1, 0),
        ("Ncm", "torque", 1e-2, 0),
        ("mNm", "torque", 1e-3, 0),
        ("N·m", "torque", 1, 0),
        ("mm", "position", 1e-3, 0),
        ("inch", "position", 0.0254, 0),
        ("µm", "position", 1e-6, 0),
        ("μm", "position", 1e-6, 0),
        ("deg C", "temperature", 1, 273.15),
        ("°C", "temperature", 1, 273.15),
        ("C", "temperature", 1, 273.15),
        ("mm/s", "speed", 1e-3, 0),
        ("milliseconds since 2026-01-31", "time", 1e-3, 0),
        ("", "force", 1, 0),
    ],
)
def test_units_as_people_write_them(unit: str, quantity: str, slope: float, offset: float) -> None:
    assert to_si(unit, quantity) == pytest.approx((slope, offset))


@pytest.mark.parametrize("quantity", SI_UNITS)
def test_the_si_unit_changes_nothing_and_mass_is_of_no_kind(quantity: str) -> None:
    assert to_si(SI_UNITS[quantity], quantity) == (1.0, 0.0)
    with pytest.raises(InputError, match="'kg'"):
        to_si("kg", quantity)


def test_the_channels_of_the_bench(bench: Path) -> None:
    assert [channel.name for channel in read_channels(bench / "channels.toml").channels] == [
        "torque",
        "position",
        "acceleration:nut-1:x",
        "acceleration:nut-2:x",
    ]
