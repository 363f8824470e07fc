from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, read_plan, validate_plan

POSITIONS = 'positions = { start = "0 mm", stop = "450 mm", step = "45 mm" }'


def positions(text):
    return (POSITIONS, f"positions = {text}")


def span(stop, step):
    return positions(f'{{ start = "0 mm", stop = "{stop}", step = "{step}" }}')


def test_a_plan_in_si(read):
    plan = read()
    assert plan.positions == (0.0, 0.045, 0.09, 0.135, 0.18, 0.225, 0.27, 0.315, 0.36, 0.405, 0.45)
    assert (plan.repetitions, plan.masses, plan.source) == (3, (100.0,), "plan.toml")
    (motion,) = plan.motions
    assert (motion.speed, motion.acceleration, motion.jerk) == (pytest.approx(0.15), 2.5, 1500)
    assert motion.dwell == pytest.approx(0.35)


def test_a_trapezoid_needs_no_jerk(read):
    (motion,) = read(('jerk = "1500 m/s^3"', "")).motions
    assert motion.jerk_time == pytest.approx(1e-3)
    assert motion.peak_acceleration == 2.5


def test_the_bench(bench):
    validate_plan(read_plan(bench / "plan.toml"), read_axis(bench / "axis.toml"))


def test_positions_as_a_list(read):
    assert read(positions('["-10 mm", 0, 0.2]')).positions == (-0.01, 0.0, 0.2)


def test_positions_below_zero(read):
    plan = read(positions('{ start = "-50 mm", stop = "50 mm", step = "25 mm" }'))
    assert plan.positions == (-0.05, -0.025, 0.0, 0.025, 0.05)


@given(start=st.integers(-500, 500), steps=st.integers(1, 300), step=st.integers(1, 100))
def test_a_range_has_the_stops_that_it_says(start, steps, step):
    from ballscrew.base.tomlfile import Fields
    from ballscrew.fcft.plan import _positions

    table = {"start": f"{start} mm", "stop": f"{start + steps * step} mm", "step": f"{step} mm"}
    got = _positions(Fields({"positions": table}, "plan.toml"))
    np.testing.assert_allclose(got, [(start + step * i) / 1000 for i in range(steps + 1)], rtol=0, atol=1e-9)


def test_several_motions(read):
    second = "[[motion]]\nspeed = 0.1\nacceleration = 1\njerk = 500\ndwell = 0\n"
    plan = read(("[motion]", second + "[[motion]]"))
    assert [motion.acceleration for motion in plan.motions] == [1.0, 2.5]


def test_settings_are_plain(read):
    settings = read().to_settings()
    assert json.loads(json.dumps(settings)) == settings
    assert settings["positions"][1] == 0.045
    assert settings["motions"][0]["jerk"] == 1500
    assert "source" not in settings


WRONG = [
    (
        span("450 mm", "40 mm"),
        "positions.step is '40 mm'; it must be a whole",
    ),
    (
        span("0 mm", "45 mm"),
        "positions.stop is '0 mm'; it must be more than",
    ),
    (
        positions('{ start = "450 mm", stop = "0 mm", step = "45 mm" }'),
        "positions.stop is '0 mm'; it must be more",
    ),
    (span("450 mm", "0 mm"), "positions.step is '0 mm'; it must be"),
    (
        span("450 mm", "-45 mm"),
        "positions.step is '-45 mm'; it must be",
    ),
    (
        span("450 mm", "900 mm"),
        "positions.step is '900 mm'; it must be",
    ),
    (
        span("450 mm", "1 nm"),
        "positions.step is '1 nm'; it must be so large",
    ),
    (
        span("450 kg", "45 mm"),
        "positions.stop is '450 kg'; it must be",
    ),
    (positions('{ start = "0 mm", stop = "450 mm" }'), "positions.step is missing"),
    (positions("{ start = 0, stop = 1, steps = 3 }"), "positions.steps is not a known field"),
    (positions('["TODO"]'), "positions is .*TODO"),
    (positions('"TODO"'), "positions is 'TODO'; it must be a list"),
    (positions("[0]"), r"positions is \[0\]; it must be a list of two stops or more"),
    (positions("[]"), r"positions is \[\]; it must be a list"),
    (
        positions("[0, 0]"),
        r"positions is \[0, 0\]; it must be a list of two stops or more in ascending order",
    ),
    (
        positions("[1, 0]"),
        r"positions is \[1, 0\]; it must be a list of two stops or more in ascending order",
    ),
    (positions("[0, nan]"), "positions is nan; it must be"),
    (positions("3"), "positions is 3; it must be a list"),
    ((POSITIONS, ""), "positions is missing; it must be a list"),
    (("repetitions = 3", "repetitions = 0"), "repetitions is 0; it must be a whole number, 1 or more"),
    (("repetitions = 3", "repetitions = 2.5"), "repetitions is 2.5; it must be"),
    (("repetitions = 3", ""), "repetitions is missing"),
    (('masses = ["100 kg"]', "masses = []"), r"masses is \[\]; it must be a list"),
    (('masses = ["100 kg"]', "masses = [5, 5]"), r"masses is \[5, 5\]; it must be a list in which each mass"),
    (('masses = ["100 kg"]', "masses = [-5]"), r"masses is \[-5\]; it must be .*0 or more"),
    (('masses = ["100 kg"]', 'masses = "100 kg"'), "masses is '100 kg'; it must be a list"),
    (('speed = "150 mm/s"', 'speed = "150 mm"'), "motion.speed is '150 mm'; it must be"),
    (('speed = "150 mm/s"', "speed = 0"), "motion.speed is 0; it must be"),
    (('jerk = "1500 m/s^3"', "jerk = inf"), "motion.jerk is inf; it must be"),
    (('dwell = "350 ms"', 'dwell = "-1 s"'), "motion.dwell is '-1 s'; it must be"),
    (('dwell = "350 ms"', ""), "motion.dwell is missing"),
    (('dwell = "350 ms"', "pause = 1"), "motion.pause is not a known field; known are speed, acceleration"),
    (("[motion]", "[motions]"), "motions is not a known field"),
    (("[motion]", "[[motion]]\n[[motion]]"), r"motion\[0\].speed is missing"),
]


@pytest.mark.parametrize(("change", "message"), WRONG)
def test_an_impossible_field_is_one_sentence(read, change, message):
    with pytest.raises(InputError, match=rf"^plan\.toml: {message}") as error:
        read(change)
    assert str(error.value).endswith(".")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[0, 0.58]",
            "positions has 0.58 m, which is not on .* axis.toml; it must be .* 0.57 m or less",
        ),
        ("[-0.09, 0.1]", "positions has -0.09 m, .* it must be more than -0.08 m"),
        ("[-0.08, 0.1]", "positions has -0.08 m"),
    ],
)
def test_a_plan_outside_the_screw_names_both_files(read, sheet, text, message):
    with pytest.raises(InputError, match=rf"^plan\.toml: {message}"):
        validate_plan(read(positions(text)), sheet)


def test_a_plan_up_to_both_ends_is_allowed(read, sheet):
    validate_plan(read(positions("[-0.079, 0.57]")), sheet)


def test_stops_too_close_to_reach_the_speed(read, sheet):
    with pytest.raises(
        InputError, match=r"^plan\.toml: motion\.speed is 0\.15 m/s, .*axis\.toml needs 0\.00925 m"
    ):
        validate_plan(read(positions("[0, 0.1, 0.109]")), sheet)
    validate_plan(read(positions("[0, 0.1, 0.10925]")), sheet)


def test_the_motion_that_is_too_fast_is_named(read, sheet):
    plan = read(positions("[0, 0.1, 0.11]"))
    fast = replace(plan.motions[0], speed=0.3)
    with pytest.raises(InputError, match=r"motion\[1\]\.speed is 0\.3 m/s"):
        validate_plan(replace(plan, motions=(*plan.motions, fast)), sheet)


def integrated(motion):
    """Speed and way of one acceleration phase, by integrating its jerk."""
    step = motion.acceleration_time / 200_000
    t = (np.arange(200_000) + 0.5) * step
    jerk = np.where(t < motion.jerk_time, motion.jerk, 0.0)
    jerk = np.where(t > motion.acceleration_time - motion.jerk_time, -motion.jerk, jerk)
    acceleration = np.cumsum(jerk) * step
    speed = np.cumsum(acceleration) * step
    return float(acceleration.max()), float(speed[-1]), float(speed.sum() * step)


@pytest.mark.parametrize(
    ("motion", "time", "jerk_time"),
    [
        (Motion(0.15, 2.5, 1500.0, 0.35), 0.06 + 1 / 600, 1 / 600),
        (Motion(0.1, 10.0, 100.0, 0.0), 2 * 0.001**0.5, 0.001**0.5),  # 10 m/s² is never reached
        (Motion(1.0, 10.0, 100.0, 0.0), 0.2, 0.1),  # just reached
    ],
)
def test_times_of_an_acceleration_phase(motion, time, jerk_time):
    assert motion.acceleration_time == pytest.approx(time)
    assert motion.jerk_time == pytest.approx(jerk_time)
    peak, speed, way = integrated(motion)
    assert peak == pytest.approx(motion.peak_acceleration, rel=1e-3)
    assert peak <= motion.acceleration * 1.001
    assert speed == pytest.approx(motion.speed, rel=1e-3)
    assert way == pytest.approx(motion.acceleration_distance, rel=1e-3)


@given(st.floats(1e-6, 100), st.floats(1e-4, 1e4), st.floats(1e-3, 1e9))
def test_times_are_finite_for_all_that_a_plan_may_hold(speed, acceleration, jerk):
    motion = Motion(speed, acceleration, jerk, 0.0)
    assert 0 < 2 * motion.jerk_time <= motion.acceleration_time * (1 + 1e-12) < np.inf
    assert motion.peak_acceleration <= acceleration * (1 + 1e-12)


def test_what_may_be_asked_for(read):
    plan = read(
        ("repetitions = 3", "repetitions = 3\nwarm_up = 2\ntemperature = true"),
        ('dwell = "350 ms"', 'dwell = "350 ms"\njerk_spread = "20 %"\nstart_spread = "50 ms"'),
    )
    assert (plan.warm_up, plan.temperature) == (2, True)
    assert plan.motions[0].jerk_spread == pytest.approx(0.2)
    assert plan.motions[0].start_spread == pytest.approx(0.05)
    settings = plan.to_settings()
    assert (settings["warm_up"], settings["temperature"]) == (2, True)
    assert settings["motions"][0]["jerk_spread"] == pytest.approx(0.2)
    assert json.loads(json.dumps(settings)) == settings


def test_what_is_not_asked_for_leaves_the_settings_as_they_were(read):
    plan = read()
    assert (plan.warm_up, plan.temperature) == (0, False)
    assert (plan.motions[0].jerk_spread, plan.motions[0].start_spread) == (0.0, 0.0)
    assert set(plan.to_settings()) == {"positions", "repetitions", "masses", "motions"}
    assert set(plan.to_settings()["motions"][0]) == {"speed", "acceleration", "jerk", "dwell"}
    asked = read(("repetitions = 3", "repetitions = 3\nwarm_up = 0\ntemperature = false"))
    assert asked.to_settings() == plan.to_settings()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("warm_up = -1", "warm_up is -1; it must be a whole number, 0 or more"),
        ("warm_up = 1.5", "warm_up is 1.5; it must be a whole number"),
        ("warm_up = true", "warm_up is True; it must be a whole number"),
        ("temperature = 1", "temperature is 1; it must be true or false"),
        ('temperature = "yes"', "temperature is 'yes'; it must be true or false"),
    ],
)
def test_an_impossible_wish(read, line, message):
    with pytest.raises(InputError, match=rf"^plan\.toml: {message}"):
        read(("repetitions = 3", f"repetitions = 3\n{line}"))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "jerk_spread = -0.1",
            "motion.jerk_spread is -0.1; it must be a plain number, 0 or more and 1 or less",
        ),
        ("jerk_spread = 1.5", "motion.jerk_spread is 1.5; it must be"),
        ('jerk_spread = "100 m/s^3"', "motion.jerk_spread is '100 m/s.3'; it must be a plain number"),
        ("jerk_spread = nan", "motion.jerk_spread is nan; it must be"),
        ('start_spread = "-1 ms"', "motion.start_spread is '-1 ms'; it must be"),
        ('start_spread = "20 %"', "motion.start_spread is '20 %'; it must be"),
        ("start_spread = 61", "motion.start_spread is 61; it must be .*60 or less"),
    ],
)
def test_an_impossible_spread(read, line, message):
    with pytest.raises(InputError, match=rf"^plan\.toml: {message}"):
        read(('dwell = "350 ms"', f'dwell = "350 ms"\n{line}'))


def test_preloads_and_motions_stand_once(read):
    preloads = ("[motion]", 'preloads = ["600 N", "300 N"]\n[motion]')
    assert read(preloads).preloads == (600.0, 300.0)
    text = r"preloads is \['600 N', 600\]; it must be a list in which each preload stands once"
    with pytest.raises(InputError, match=text):
        read(("[motion]", 'preloads = ["600 N", 600]\n[motion]'))
    motion = 'speed = "150 mm/s"\nacceleration = "2.5 m/s^2"\njerk = "1500 m/s^3"\ndwell = "350 ms"\n'
    with pytest.raises(InputError, match="it must be a list in which each motion stands once"):
        read(("[motion]", f"[[motion]]\n{motion}[[motion]]"))


def test_an_empty_list_is_no_motion(tmp_path):
    path = tmp_path / "plan.toml"
    text = 'positions = [0, 0.1]\nrepetitions = 3\nmasses = ["1 kg"]\nmotion = []\n'
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"motion is \[\]; it must be one table \[motion\], or several"):
        read_plan(path)


def test_stops_closer_than_a_nanometre_are_none(read):
    with pytest.raises(InputError, match="neighbouring stops are 1 nm apart or more"):
        read(positions("{ start = 0, stop = 1e-9, step = 5e-10 }"))
