"""Whether the samples came when they should have: the time column and the rates that are stated."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.percent import percent
from ballscrew.recording.quality.finding import Finding

__all__ = ["check_rates", "check_time", "time_rate"]


# 0.1 % of the rate is 0.1 % of the frequency, and 1 to 4 % of the preload: more than a test can spare.
_RATE = 1e-3
_RATE_BAD = 5e-3
_GAP = 1.5  # sample intervals: more than this, and one sample or more is missing
_COARSE = 0.01  # share of equal times above which the clock is coarser than the samples
_JITTER = 0.5  # sample intervals off a straight line
_JITTER_BAD = 5.0
_MANY_GAPS = 10  # a few gaps spoil a few transients, many spoil all


def time_rate(time: Array) -> float | None:
    """Sample rate that a time column has between its gaps, Hz; None where it tells none."""
    step = max(1, (len(time) - 1) // 16)
    spans = time[step:] - time[:-step]
    span = float(np.median(spans[np.isfinite(spans)])) if np.isfinite(spans).any() else 0.0
    return step / span if span > 0 else None


def check_rates(file: str, used: float, stated: dict[str, float | None]) -> list[Finding]:
    """Compare all rates that are stated with the one that is used.

    Parameters
    ----------
    file : str
        For the message.
    used : float
        Rate of the recording, Hz.
    stated : dict
        Who states it, in words, to the rate in Hz or None.

    Returns
    -------
    list of Finding
        One where any two differ by more than 0.1 %.
    """
    rates = {who: rate for who, rate in stated.items() if rate is not None and np.isfinite(rate) and rate > 0}
    if not rates:
        return []
    known = [*rates.values(), used]
    apart = max(known) / min(known) - 1
    if apart <= _RATE:
        return []
    said = ", ".join(f"{who} {rate:.7g} Hz" for who, rate in rates.items())
    return [
        Finding(
            "bad" if apart > _RATE_BAD else "suspect",
            "rate",
            f"{file}: the sample rate is stated twice and differently: {said}; "
            f"one of them makes every frequency wrong by {percent(apart)}",
        )
    ]


def check_time(file: str, time: Array) -> list[Finding]:
    """Check that the times increase evenly.

    Parameters
    ----------
    file : str
        For the messages.
    time : ndarray, shape (n,)
        Times of the samples, s.

    Returns
    -------
    list of Finding
        Not finite, not increasing, gaps (dropped samples) or uneven.
    """
    wrong = int(np.count_nonzero(~np.isfinite(time)))
    if wrong:
        return [Finding("bad", "time", f"{file}: the time column has {wrong} samples that are no time")]
    rate = time_rate(time)
    steps = np.diff(time)
    back = int(np.count_nonzero(steps < 0))
    if rate is None or back:
        where = f" and goes back {back} times, first at {time[np.argmax(steps < 0)]:.4g} s" if back else ""
        return [Finding("bad", "time", f"{file}: the time column does not increase{where}")]
    tick = _tick(steps)
    gaps = np.flatnonzero(steps > _GAP / rate + tick)
    if len(gaps):
        lost = round(float(np.sum(steps[gaps] * rate - 1)))
        return [
            Finding(
                "bad" if len(gaps) > _MANY_GAPS else "suspect",
                "dropped",
                f"{file}: about {lost} samples are missing in {len(gaps)} gaps of the time column, "
                f"the first at {time[gaps[0]]:.4g} s",
            )
        ]
    return _jitter(file, time, rate, tick)


def _tick(steps: Array) -> float:
    """Resolution of a clock that is coarser than the samples; 0 for a fine one."""
    if np.count_nonzero(steps == 0) <= _COARSE * len(steps):
        return 0.0
    return float(steps[steps > 0].min())


def _jitter(file: str, time: Array, rate: float, tick: float) -> list[Finding]:
    index = np.arange(len(time), dtype=np.float64)
    left = time - np.polynomial.Polynomial.fit(index, time, 1)(index)
    off = (float(np.abs(left).max()) - tick) * rate
    if off <= _JITTER:
        return []
    return [
        Finding(
            "bad" if off > _JITTER_BAD else "suspect",
            "time",
            f"{file}: the time column is not uniform: up to {1e3 * off / rate:.3g} ms, "
            f"{off:.2g} sample intervals, off a straight line",
        )
    ]
