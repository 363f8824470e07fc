"""Every setting that a natural frequency by the paper's method depends on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from ballscrew.base.errors import InputError, shown
from ballscrew.base.settings import check_setting
from ballscrew.modal.paper.window import AFTER, BEFORE

Estimator = Literal["H1", "H2", "Hv"]
Average = Literal["spectra", "ratios"]
ESTIMATORS: tuple[Estimator, ...] = ("H1", "H2", "Hv")
AVERAGES: tuple[Average, ...] = ("spectra", "ratios")


@dataclass(frozen=True, slots=True)
class PaperSettings:
    """Settings of the paper's method.

    Parameters
    ----------
    estimator : {"H1", "H2", "Hv"}
        How the FRF is made of the averaged spectra.
    average : {"spectra", "ratios"}
        What is averaged over repetitions: auto- and cross-spectra, or each record's own ratio.
    band : tuple of float, optional
        Where to look for the mode, Hz; by default the data sheet's prediction ± ``band_half_width``.
    band_half_width : float
        As a part of the predicted frequency.
    window_before, window_after : float
        The Hann window around the blow next to standstill, in periods of the expected mode.
    line_spacing : float
        Of the zero-padded spectra, Hz.
    least_coherence : float
        At the peak, below which a cell is refused; never below what chance alone gives.
    least_excitation : float
        Input power at the peak as a part of the band's median, below which a cell is refused.
    least_amplification : float
        Height of the peak over the level at which the axis moves as one mass, below which a cell is refused.
        A mode with 10 % damping has 5.
    most_uncertainty : float
        Standard uncertainty as a part of the frequency, above which a cell is refused.
    """

    estimator: Estimator = "H1"
    average: Average = "spectra"
    band: tuple[float, float] | None = None
    band_half_width: float = 0.25
    window_before: float = BEFORE
    window_after: float = AFTER
    line_spacing: float = 0.2
    least_coherence: float = 0.6
    least_excitation: float = 1e-3
    least_amplification: float = 3.0
    most_uncertainty: float = 0.03

    def __post_init__(self) -> None:
        """Refuse unknown choices, and bands, widths and periods that are not positive."""
        choices = {"estimator": ESTIMATORS, "average": AVERAGES}
        for name, allowed in choices.items():
            value = getattr(self, name)
            if value not in allowed:
                raise InputError(f"the {name} is {value!r}; it must be one of {', '.join(allowed)}.")
        for name in ("band_half_width", "window_before", "window_after", "line_spacing"):
            check_setting(name, getattr(self, name), above=0.0)
        if not self.band_half_width < 1:
            raise InputError(f"band_half_width is {self.band_half_width:g}; it must be less than 1.")
        if self.band is not None:
            self._check_band()

    def _check_band(self) -> None:
        try:
            low, high = self.band  # type: ignore[misc]  # checked before
        except (TypeError, ValueError):
            raise InputError(f"the band is {shown(self.band)}; it must be two frequencies in Hz.") from None
        check_setting("the lower end of the band", low, above=0.0)
        check_setting("the upper end of the band", high, above=low)

    def to_settings(self) -> dict[str, Any]:
        """All of them, as a plain dict."""
        return asdict(self)
