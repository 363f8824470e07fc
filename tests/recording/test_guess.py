from __future__ import annotations

import pytest

from ballscrew.recording.guess import ChannelGuess, guess_channels
from ballscrew.recording.header import Header, RawChannel


def guessed(*channels: tuple[str, str | None]) -> dict[str, ChannelGuess]:
    guesses = guess_channels(Header(tuple(RawChannel(name, 100, unit) for name, unit in channels)))
    return {guess.channel: guess for guess in guesses if not guess.derive}


@pytest.mark.parametrize(
    ("name", "unit", "quantity", "sure"),
    [
        ("torque", "N m", "torque", True),
        ("Drehmoment [Nm]", "Nm", "torque", True),
        ("ActTrq", "Nm", "torque", True),
        ("Drehmoment", None, "torque", False),
        ("iq", "A", "current", True),
        ("Strom U", "A", "current", True),
        ("Kraft", "kN", "force", True),
        ("x_act", "mm", "position", True),
        ("Encoder1", "µm", "position", True),
        ("pos_mm", None, "position", True),
        ("Weg", "in", "position", True),
        ("velocity", "mm/s", "speed", False),
        ("acc1_x", "g", "acceleration", True),
        ("a_x", "m/s^2", "acceleration", True),
        ("vib", "m/s²", "acceleration", False),
        ("temp nut", "°C", "temperature", True),
        ("Temp", None, "temperature", False),
        ("t", "s", "time", True),
        ("Zeit", None, "time", False),
        ("X_Value", None, "time", False),
        ("temp motor", "°C", "temperature", False),
        ("backlash", "um", "backlash", False),
        ("ch 3", "Nm", "torque", False),
        ("/Nck/!SD/nckServoDataActCurr64 [u1, 1]", "A", "current", True),
        ("/Nck/!SD/nckServoDataActPos1stEnc64 [u1, 1]", "mm", "position", True),
        ("/Nck/!SD/nckServoDataCtrlDev64 [u1, 1]", "mm", "", False),
        ("/Nck/!SD/nckServoDataDrvLoad64 [u1, 1]", "%", "", False),
        ("s actual X", "mm", "position", True),
        ("s dif X", "mm", "", False),
        ("following error", "mm", "", False),
        ("Schleppabstand", None, "", False),
        ("torque current", "A", "current", True),
        ("IL.FB", "A", "current", True),
        ("VL.FB", None, "speed", False),
        ("n_ist", None, "speed", False),
        ("Motordrehzahl [1/min]", None, "speed", False),
        ("Drehzahl", "U/min", "speed", False),
        ("speed (rpm)", None, "speed", False),
        ("omega [rad/s]", None, "speed", False),
        ("n", "min-1", "speed", False),
        ("Istdrehmoment", "Nm", "torque", True),
        ("Motorstrom", "A", "current", True),
        ("Istposition [mm]", None, "position", True),
        ("Drehzahl in U/min", None, "speed", False),
        ("Momentenistwert [%]", None, "relative torque", True),
        ("Motormoment [% Mnenn]", None, "relative torque", True),
        ("Zeitstempel [s]", None, "time", True),
        ("isthmus", None, "", False),
        ("torque", "kg", "", False),
        ("foo", None, "", False),
        ("foo", "bar", "", False),
        ("", None, "", False),
    ],
)
def test_one_channel(name: str, unit: str | None, quantity: str, sure: bool) -> None:
    guess = guessed((name, unit))[name]
    assert (guess.quantity, guess.sure) == (quantity, sure)
    assert guess.why


def test_what_is_used() -> None:
    guesses = guessed(
        ("t", "s"), ("x_soll", "mm"), ("x_ist", "mm"), ("iq", "A"), ("torque", "Nm"), ("acc1_x", "g"),
        ("acc1_y", "g"), ("acc2_x", "g"), ("junk", None),
    )  # fmt: skip
    assert {name for name, guess in guesses.items() if guess.used} == {
        "t",
        "x_ist",
        "torque",
        "acc1_x",
        "acc2_x",
    }
    assert (guesses["acc2_x"].location, guesses["acc2_x"].direction) == ("acc2", "x")
    assert guesses["acc1_y"].direction == "y"


def test_what_the_analysis_does_not_use_is_not_sure() -> None:
    guesses = guessed(
        ("x_soll", "mm"), ("x_ist", "mm"), ("Temp Motor", "°C"), ("Temp Lager", "°C"), ("v", "mm/s")
    )
    assert {name for name, guess in guesses.items() if guess.sure} == {"x_ist", "Temp Lager"}
    assert {name for name, guess in guesses.items() if guess.used} == {"x_ist", "Temp Lager"}
    assert "'x_ist' is used" in guesses["x_soll"].why
    assert "motor" in guesses["Temp Motor"].why
    assert "does not use it" in guesses["v"].why


def test_a_german_set_point_comes_after_the_actual_value() -> None:
    guesses = guessed(("Sollposition", "mm"), ("Istposition", "mm"), ("Drehmoment", "%"))
    assert {name for name, guess in guesses.items() if guess.used} == {"Istposition", "Drehmoment"}
    assert guesses["Drehmoment"].quantity == "relative torque"


def test_counts_without_names_of_quantities_are_all_used() -> None:
    channels = tuple(RawChannel(f"channel {number}", 100, scaled=False) for number in (1, 2))
    guesses = guess_channels(Header(channels, 12800.0))
    assert [(guess.quantity, guess.unit, guess.used, guess.sure) for guess in guesses] == [
        ("", "TODO", True, False)
    ] * 2


def test_currents_of_phases_are_used_without_a_torque() -> None:
    currents = [(f"current_{phase}", "A") for phase in "uvw"]
    guesses = guessed(*currents, ("pos", "mm"))
    assert {name: guess.phase for name, guess in guesses.items() if guess.used and guess.phase} == {
        "current_u": "u",
        "current_v": "v",
        "current_w": "w",
    }
    assert not guessed(*currents, ("torque", "Nm"))["current_u"].used
    assert [name for name, guess in guessed(*currents, ("iq", "A")).items() if guess.used] == ["iq"]


def test_only_a_torque_is_in_percent() -> None:
    guesses = guessed(("override", "%"), ("torque [%]", None))
    assert (guesses["override"].quantity, guesses["torque [%]"].quantity) == ("", "relative torque")


def test_an_acceleration_is_derived_where_none_is_measured() -> None:
    header = Header((RawChannel("torque", 100, "Nm"), RawChannel("pos", 100, "mm")))
    last = guess_channels(header)[-1]
    assert (last.channel, last.quantity, last.derive, last.used) == (
        "pos",
        "acceleration",
        "second-derivative",
        True,
    )
    assert not any(guess.derive for guess in guess_channels(Header((RawChannel("torque", 100),))))


def test_a_speed_replaces_the_position_where_it_is_faster() -> None:
    torque, slow = RawChannel("torque", 800, "Nm", 8000.0), RawChannel("pos", 25, "mm", 250.0)
    for name, unit, rate, origin in (
        ("ActVelo", "mm/s", 8000.0, "ActVelo"),
        ("ActVelo", "mm/s", 250.0, "pos"),
        ("SetVelo", "mm/s", 8000.0, "pos"),
        ("ActVelo", None, 8000.0, "pos"),
        ("ActVelo", "rpm", 8000.0, "ActVelo"),
    ):
        guesses = guess_channels(Header((torque, slow, RawChannel(name, 800, unit, rate))))
        derive = "derivative" if origin == "ActVelo" else "second-derivative"
        assert (guesses[-1].channel, guesses[-1].derive) == (origin, derive)
        assert guesses[2].used == (origin == "ActVelo")
