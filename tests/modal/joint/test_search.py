"""Start of a fit: with a new nut, or with one that the test unloads."""

from __future__ import annotations

from typing import Any

import pytest

from ballscrew.modal.joint import search
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.profile import Profile

NEW = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)


@pytest.mark.parametrize(("gain", "worn"), [(0.5, True), (0.1, False), (-1.0, False)])
def test_a_worn_nut_is_chosen_if_its_residual_is_clearly_smaller(
    monkeypatch: pytest.MonkeyPatch, gain: float, worn: bool
) -> None:
    def fitted(_blocks: Any, modes: tuple[AxialMode, ...], *_: Any) -> Any:
        return modes, -gain if modes[0].mass_over_preload > NEW.mass_over_preload else 0.0

    monkeypatch.setattr(search, "fit_modes", fitted)
    (chosen,) = search._new_or_worn([], (NEW,), Profile(False, NEW.mass_over_preload))
    assert (chosen.mass_over_preload > NEW.mass_over_preload) == worn


def test_without_a_sheet_there_is_one_start() -> None:
    assert search._new_or_worn([], (NEW,), Profile(False, 0.0)) == (NEW,)
