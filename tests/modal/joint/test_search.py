"""Start of a fit: with a new nut, or with one that the test unloads; and friction of departures."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballscrew.axis.sheet import DataSheet
from ballscrew.modal.joint import search
from ballscrew.modal.joint.blocks import Block, Projection
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit
from ballscrew.modal.joint.initial import InitialValues
from ballscrew.modal.joint.local_wear import UNKNOWN
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.profile import Profile
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.windows import Windows
from ballscrew.testbed.example import AXIS, LOAD

NEW = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)


@pytest.mark.parametrize(("gain", "worn"), [(0.5, True), (0.1, False), (-1.0, False)])
def test_a_worn_nut_is_chosen_if_its_residual_is_clearly_smaller(
    monkeypatch: pytest.MonkeyPatch, gain: float, worn: bool
) -> None:
    def fitted(_blocks: Any, modes: Sequence[AxialMode], *_: Any) -> Any:
        return modes, -gain if modes[0].mass_over_preload > NEW.mass_over_preload else 0.0

    monkeypatch.setattr(search, "fit_modes", fitted)
    (chosen,) = search._fit_new_or_worn([], (NEW,), Profile(False, 0.5), 0.9)
    assert chosen.mass_over_preload == (0.9 if worn else NEW.mass_over_preload)


def test_the_worn_start_is_at_a_tenth_of_the_nominal_preload(monkeypatch: pytest.MonkeyPatch) -> None:
    """And not at a tenth of the fitted or expected one, which may be that of a worn nut."""
    starts: list[float] = []

    def stop(*given: Any) -> None:
        starts.append(given[3])
        raise StopIteration

    monkeypatch.setattr(search, "_unwhitened_blocks", lambda *_: [])
    monkeypatch.setattr(search, "subset", lambda w: w)
    monkeypatch.setattr(search, "_fit_new_or_worn", stop)
    initial = InitialValues(300.0, 200.0, 1.0, mass_over_preload=0.2)
    with pytest.raises(StopIteration):
        search._fit_with_ripple([], (), initial, cast(Windows, None), (NEW,), Profile(False, 0.5))
    assert starts == [pytest.approx(2.0)]


def test_without_a_sheet_there_is_one_start() -> None:
    assert search._fit_new_or_worn([], (NEW,), Profile(False, 0.0), 0.0) == (NEW,)


RATE, LENGTH = 1000.0, 200
SLIP = 40  # sample at which the table begins to slide


def departs_freely(friction: float, noise: float, condition: str = "PA") -> bool:
    """Of one window with a response of rms 1, noise, and friction where the table begins to slide."""
    random = np.random.default_rng(0)
    response = np.sqrt(2) * np.sin(np.arange(LENGTH))
    error = noise * random.standard_normal(LENGTH)
    error[SLIP : SLIP + 15] += friction * np.sqrt(2) * np.cos(np.arange(15))
    in_motion = np.arange(LENGTH) >= SLIP
    windows = SimpleNamespace(
        rate=RATE,
        centred_position=np.zeros(LENGTH),
        spans=[(0, LENGTH)],
        cells=[SimpleNamespace(condition=condition)],
        in_motion=in_motion,
        from_rest=np.ones(LENGTH, bool),
    )
    target = (response + error)[:, None]
    return search._friction_is_negligible(
        cast(Block, SimpleNamespace(windows=windows, target=target)),
        cast(Projection, SimpleNamespace(model=response[:, None])),
    )


@pytest.mark.parametrize("noise", [0.01, 0.03, 0.1, 0.15, 0.3])
def test_noise_does_not_hide_the_friction_of_a_departure(noise: float) -> None:
    assert not departs_freely(0.25, noise)


@pytest.mark.parametrize(("noise", "free"), [(0.01, True), (0.1, True), (0.15, True), (0.3, False)])
def test_departures_without_friction_count_unless_noise_would_hide_it(noise: float, free: bool) -> None:
    assert departs_freely(0.0, noise) == free


def test_a_run_without_departures_does_not_show_their_friction() -> None:
    assert not departs_freely(0.0, 0.01, "PD")


@pytest.mark.parametrize(
    ("expected", "gain", "better"),
    [(0.1, 9.0, False), (1.0, 0.5, True), (1.0, 0.1, False), (0.0, 9.0, False)],
)
def test_a_fit_from_the_expected_nut_replaces_one_that_is_clearly_worse(
    monkeypatch: pytest.MonkeyPatch, expected: float, gain: float, better: bool
) -> None:
    def fitted(_blocks: Any, modes: tuple[AxialMode, ...], *_: Any) -> Any:
        return SimpleNamespace(modes=modes, log_residual=-gain), UNKNOWN

    monkeypatch.setattr(search, "fit_profile", fitted)
    found = cast(JointFit, SimpleNamespace(modes=(NEW,), log_residual=0.0))
    fit, _ = search._refit_with_expected_nut([], found, UNKNOWN, Profile(False, expected))
    assert (fit is not found) == better
    assert fit.modes[0].mass_over_preload == (expected if better else NEW.mass_over_preload)


@pytest.mark.parametrize("curved", [True, False])
@pytest.mark.parametrize("softening", [0.1, 0.0])
def test_fields_of_a_profile_are_those_that_it_states(curved: bool, softening: float) -> None:
    fields = Profile(curved, softening).fields
    assert {"compliance", "damping", "slope", "damping_exponent"} <= set(fields)
    assert ("curve" in fields) == curved
    assert ("mass_over_preload" in fields) == (softening > 0)
    assert "guide_part" not in fields
    with_part = Profile(curved, softening, guide_part=True)
    assert set(with_part.fields) - set(fields) == {"guide_part"}
    inflation = 9 * SAMPLES_PER_INDEPENDENT  # the information of the prior is nine times as large
    (prior,) = (prior for prior in with_part.priors(inflation) if prior.fields == (("guide_part", 1.0),))
    assert (prior.value, prior.deviation) == (0.5, pytest.approx(0.3 / 3))


@pytest.mark.parametrize(
    ("sheet", "viscous", "fitted"), [(AXIS, 2.0, True), (AXIS, 0.0, False), (None, 2.0, False)]
)
def test_the_guides_part_is_fitted_where_friction_loads_a_nut_that_softens(
    sheet: DataSheet | None, viscous: float, fitted: bool
) -> None:
    initial = InitialValues(150.0, 120.0, 1.0, viscous=viscous, sheet=sheet, load=LOAD)
    assert search._profile(initial, 0.15, 150.0).guide_part == fitted


def test_without_a_window_there_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither around the initial frequency nor around the located one."""
    settings, none = JointSettings(), cast(Any, None)
    beginning = SimpleNamespace(rotor_free=150.0)
    monkeypatch.setattr(search, "average_windows", lambda *_: None)
    assert search.search((), (), 1.0, cast(Any, beginning), ("torque-nut",), settings) is None
    assert search._locate((), (), 1.0, cast(Any, beginning), ("torque-nut",), settings) is none
