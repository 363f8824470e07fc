"""Where a fit starts: with a new nut, or with one that the test unloads."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from ballscrew.modal.joint import search
from ballscrew.modal.joint.course import Course
from ballscrew.modal.joint.shape import Shape

NEW = Shape(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)


@pytest.mark.parametrize(("gain", "worn"), [(0.5, True), (0.1, False), (-1.0, False)])
def test_a_worn_nut_is_started_from_where_it_leaves_clearly_less(
    monkeypatch: pytest.MonkeyPatch, gain: float, worn: bool
) -> None:
    def fitted(_blocks: Any, shapes: tuple[Shape, ...], *_: Any) -> Any:
        return SimpleNamespace(shapes=shapes, left=-gain if shapes[0].load > NEW.load else 0.0)

    monkeypatch.setattr(search, "fit", fitted)
    (chosen,) = search._worn_or_not([], (NEW,), Course(False, NEW.load))
    assert (chosen.load > NEW.load) == worn


def test_without_a_sheet_there_is_one_start() -> None:
    assert search._worn_or_not([], (NEW,), Course(False, 0.0)) == (NEW,)
