"""Public names as a type checker finds them from outside the package: checked by mypy, not run."""

from __future__ import annotations

from typing import assert_type

import numpy as np
import pandas as pd

import ballscrew


def analysis(torque: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    recording = ballscrew.Recording.from_arrays(torque=torque, position=torque, sample_rate=12800.0)
    run = ballscrew.analyze(recording, axis="axis.toml", mass="100 kg")
    assert_type(run, ballscrew.Run)
    assert_type(run.cells[0].frequency_Hz, float | None)
    assert_type(run.to_dataframe(), pd.DataFrame)
    assert_type(ballscrew.frf(torque, torque, 12800.0), ballscrew.FrequencyResponse)
    assert_type(ballscrew.natural_frequency(torque, torque, 12800.0), ballscrew.NaturalFrequency)


def health(runs: list[ballscrew.Run]) -> None:
    model = ballscrew.read_model("model.json")
    assert_type(model, ballscrew.CalibratedAxis)
    estimate = ballscrew.preload(runs[0], model)
    assert_type(estimate, ballscrew.PreloadEstimate)
    assert_type(estimate.preload_N, ballscrew.Quantity | None)
    assert_type(ballscrew.monitor(runs, model), ballscrew.Monitored)
    assert_type(ballscrew.watch("runs", model="model.json"), ballscrew.WatchedAxis)
    ballscrew.analyze("run.toml", mas="100 kg")  # type: ignore[call-arg]
    ballscrew.analyse("run.toml")  # type: ignore[attr-defined]
