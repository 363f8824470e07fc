"""Every setting that a natural frequency by the paper's method depends on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from ballscrew.base.errors import InputError
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
        if self.band is not None and not 0 < self.band[0] < self.band[1] < float("inf"):
            raise InputError(
                f"the band is {self.band[0]:g} to {self.band[1]:g} Hz; it must rise, from above 0 Hz."
            )
        if not 0 < self.band_half_width < 1:
            raise InputError(
                f"the band's half width is {self.band_half_width:g}; it must lie between 0 and 1."
            )
        if not all(
            0 < value < float("inf") for value in (self.window_before, self.window_after, self.line_spacing)
        ):
            raise InputError("the window's periods and the line spacing must be more than 0.")

    def to_settings(self) -> dict[str, Any]:
        """All of them, as a plain dict."""
        return asdict(self)
