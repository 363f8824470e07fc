from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from ballscrew.fcft.plan import Motion, Plan, read_plan
from ballscrew.fcft.planfile import plan_toml

MOTIONS = (Motion(0.15, 2.5, 1500, 0.35), Motion(0.1, 2.0, 900, 0.35, 0.2, 0.01))
PLAN = Plan((0.0, 0.045, 0.0975), 3, (0.0, 12.5), MOTIONS, warm_up=2, temperature=True)


def back(plan, folder):
    (folder / "plan.toml").write_text(plan_toml(plan), encoding="utf-8")
    return replace(read_plan(folder / "plan.toml"), source=plan.source)


def test_what_is_written_is_read_back(tmp_path):
    got = back(PLAN, tmp_path)
    assert got == PLAN


@given(
    speed=st.floats(1e-5, 99), acceleration=st.floats(1e-3, 9e3), jerk=st.floats(1e-2, 9e8),
    dwell=st.floats(0, 3599), spread=st.floats(0, 1),
)  # fmt: skip
def test_every_digit_comes_back(tmp_path_factory, speed, acceleration, jerk, dwell, spread):
    plan = replace(PLAN, motions=(Motion(speed, acceleration, jerk, dwell, spread),))
    got = back(plan, tmp_path_factory.mktemp("plan")).motions[0]
    for name in ("speed", "acceleration", "jerk", "dwell", "jerk_spread"):
        assert getattr(got, name) == getattr(plan.motions[0], name)


def test_it_can_be_read_by_people():
    text = plan_toml(PLAN)
    assert 'positions = ["0 mm", "45 mm", "97.5 mm"]' in text
    assert 'speed = "150 mm/s"' in text
    assert "temperature = true" in text


def test_preloads_come_back(tmp_path):
    plan = replace(PLAN, preloads=(600.0, 299.5))
    assert 'preloads = ["600 N", "299.5 N"]' in plan_toml(plan)
    assert back(plan, tmp_path) == plan
    assert "preloads" not in plan_toml(PLAN)
