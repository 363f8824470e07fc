"""A calibrated axis: its model with its covariance, and the runs and anchors that determine it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, to_vector
from ballscrew.axis.sheet import check_on_screw
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import PlottedResult, first_sentences, quantity_rows
from ballscrew.base.words import plural

if TYPE_CHECKING:
    import pandas as pd

UNITS = {
    "centre": "m", "compliance": "m/N", "slope": "1/m", "curve": "1/m^2", "mass": "kg", "rotor": "kg",
    "share": "", "preload": "N",
}  # fmt: skip
"""Units of the parameters in MODEL.json."""

_LINEAR = ("slope", "curve")  # parameters that the working vector contains as they are


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason to doubt a calibration.

    Parameters
    ----------
    name : str
        Its name, by which it can be accepted: a field of the data sheet, or ``"misfit"``, for example.
    text : str
        A sentence without full stop.
    """

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class TemperatureSlope:
    """Change of ln P per kelvin.

    Parameters
    ----------
    value, standard_uncertainty : float
        1/K.
    shared : float
        Error of the slope by a unit error of ln P that is common to all runs it was fitted to, 1/K.
    lowest, highest : float or None
        Lowest and highest temperature of these runs, °C; None for an assumed slope.
    """

    value: float
    standard_uncertainty: float
    shared: float = 0.0
    lowest: float | None = None
    highest: float | None = None


@dataclass(frozen=True, slots=True)
class Anchor:
    """An anchor of the preload's scale: a known preload, or the nut's softening under a known force.

    Parameters
    ----------
    kind : str
        ``"known preload"`` or ``"nut load"``.
    run : str
        Id of the run that it belongs to.
    preload, standard_uncertainty : float
        Preload of that run by the anchor alone, N.
    log_preload_without, log_preload_with : float
        Standard uncertainty of ln P_ref without this anchor, and with it.
    share_without, share_with : float
        The same of the nut's share.
    """

    kind: str
    run: str
    preload: float
    standard_uncertainty: float
    log_preload_without: float = 0.0
    log_preload_with: float = 0.0
    share_without: float = 0.0
    share_with: float = 0.0


@dataclass(frozen=True, slots=True)
class FormEvidence:
    """One form of the model, and its evidence.

    Parameters
    ----------
    name : str
        In words.
    free : tuple of str
        Names of the fitted parameters.
    log_evidence : float
        ln of the evidence by Laplace's approximation, less that of the most probable form.
    chi2 : float
        Of the frequencies.
    chosen : bool
        Whether this form is the model's.
    """

    name: str
    free: tuple[str, ...]
    log_evidence: float
    chi2: float
    chosen: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ToleranceEstimate:
    """Estimate of a number of the data sheet that has a tolerance.

    Its unit is the standard uncertainty by the tolerance, tolerance/√3, of the number's logarithm.

    Parameters
    ----------
    field : str
        Field of the data sheet.
    effects : ndarray, shape (7,)
        Effect of one unit on the working vector (:data:`~ballscrew.axis.axial.PARAMETERS`).
    estimate : float
        Deviation from the sheet's value by the calibration, in this unit; the tolerance ends at ± √3.
    """

    field: str
    effects: Array
    estimate: float


@dataclass(frozen=True, slots=True, eq=False)
class ConventionEvidence:
    """Another convention of the sheet's K, with its evidence by the data.

    Parameters
    ----------
    convention : str
        In words.
    probability : float
        Probability that the sheet's K is stated in this convention.
    ratio : float
        K by the data over the sheet's, if it is stated in this convention.
    change : ndarray, shape (7 + groups,)
        Change of the most probable working vector, and of ln(P/P_ref) of each group of runs, by this
        convention.
    estimates : ndarray, shape (tolerances,)
        Estimates of the sheet's numbers with a tolerance by this convention, as in
        :class:`ToleranceEstimate`.
    """

    convention: str
    probability: float
    ratio: float
    change: Array
    estimates: Array


@dataclass(frozen=True, slots=True)
class CalibrationRun:
    """A run of the calibration.

    Parameters
    ----------
    id : str
        Of the run.
    load : float
        Load on the table, kg.
    measured_at : str or None
        ISO 8601.
    group : int
        Group of its preload: runs of the same number share one; 0 is the reference.
    log_ratio, log_ratio_uncertainty : float
        ln(P/P_ref) and its standard uncertainty; both 0 in the reference group.
    plan : str or None
        Digest of its plan.
    method : str or None
        Method of the analysis.
    cells : int
        Number of its frequencies.
    level : float
        Mean over its cells of ln f less the model's.
    weight : float
        1; less where the run does not fit the others.
    outliers : tuple of str
        Cells that do not fit, in words.
    """

    id: str
    load: float
    measured_at: str | None
    group: int
    cells: int
    log_ratio: float = 0.0
    log_ratio_uncertainty: float = 0.0
    plan: str | None = None
    level: float = 0.0
    weight: float = 1.0
    outliers: tuple[str, ...] = ()
    method: str | None = None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CalibratedAxis(PlottedResult):
    """Result of ``calibrate``, stored as MODEL.json.

    Parameters
    ----------
    axis : str
        Its name.
    model : AxialModel
        With the most probable values.
    covariance : ndarray, shape (7, 7)
        Of the working vector (:data:`~ballscrew.axis.axial.PARAMETERS`); rows of fixed parameters are 0.
    free : tuple of str
        Names of the fitted parameters.
    runs : tuple of CalibrationRun
        In the order given.
    log_ratios : ndarray, shape (groups,)
        ln(P/P_ref) of each group of runs; the first is 0.
    log_ratio_covariance : ndarray, shape (groups, groups)
        Their covariance.
    cross_covariance : ndarray, shape (7, groups)
        Of the working vector with the log ratios.
    prior_covariance : ndarray, shape (7, 7)
        Of the working vector by the data sheet alone.
    chi2, degrees : float
        χ² of the frequencies and its expected value, the effective degrees of freedom: see
        :func:`~ballscrew.calibration.fit.goodness_of_fit`.
    candidates : tuple of FormEvidence
        Forms of the model that were compared, the best first.
    anchors : tuple of Anchor
        Anchors of the preload's scale, besides the sheet.
    load_rating : float
        Ca, N.
    nut_mass : float
        Mass of table and nut by the sheet, kg: with the load, the mass that the nut accelerates.
    bearing_share : float
        The thrust bearing's share of the compliance at the centre: its part, by the sheet, of what is not the
        nut's.
    reasons : tuple of Doubt
        Reasons to doubt it; empty for a good calibration.
    notes : tuple of str
        Remarks that are no reasons for doubt.
    tolerances : tuple of ToleranceEstimate
        Estimates of the sheet's numbers with a tolerance.
    temperature : TemperatureSlope or None
        Change of ln P per kelvin, where the temperatures of the runs determine one.
    conventions : tuple of ConventionEvidence
        Other conventions of the sheet's K that the data do not exclude, the most probable first.
    knowledge : tuple of dict
        Information of the data compared with the sheet's, see :mod:`ballscrew.calibration.identifiability`.
    made : Made
        Version, settings, inputs.
    """

    axis: str
    model: AxialModel
    covariance: Array
    free: tuple[str, ...]
    runs: tuple[CalibrationRun, ...]
    log_ratios: Array
    log_ratio_covariance: Array
    cross_covariance: Array
    prior_covariance: Array
    chi2: float
    degrees: float
    candidates: tuple[FormEvidence, ...]
    anchors: tuple[Anchor, ...]
    load_rating: float
    nut_mass: float
    bearing_share: float
    reasons: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()
    tolerances: tuple[ToleranceEstimate, ...] = ()
    conventions: tuple[ConventionEvidence, ...] = ()
    temperature: TemperatureSlope | None = None
    knowledge: tuple[dict[str, object], ...] = ()
    made: Made = field(default_factory=Made)

    _drawing = "calibration_figure:draw_levels"

    def _lines(self) -> list[str]:
        cells = sum(run.cells for run in self.runs)
        runs, preloads = plural(len(self.runs), "run"), plural(len(self.log_ratios), "preload")
        fit = f"χ² {self.chi2:.0f} for {self.degrees:.0f} degrees of freedom"
        share = f"nut's share of the compliance {self.quantity('share')}"
        return [
            f"{self.axis}: the calibration is {self.verdict}",
            f"{runs}, {cells} frequencies, {preloads}; {fit}",
            f"reference preload {self.quantity('preload')}, {share}",
            *first_sentences([doubt.text for doubt in self.reasons]),
        ]

    def quantity(self, name: str) -> Quantity:
        """Parameter of the model with its standard uncertainty, by its name in ``PARAMETERS``."""
        spread = self.working_scale(name) * self.standard_uncertainty(name)
        return Quantity(float(getattr(self.model, name)), spread, UNITS[name])

    def working_scale(self, name: str) -> float:
        """Derivative of a parameter by its element of the working vector: itself, its logarithm or logit."""
        if name in _LINEAR:
            return 1.0
        value = float(getattr(self.model, name))
        if name == "share":
            return value * (1 - value)
        return value

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the model's parameters; an infinite rotor is left out."""
        known = [name for name in PARAMETERS if np.isfinite(getattr(self.model, name))]
        return quantity_rows([(name, self.quantity(name)) for name in known])

    @property
    def verdict(self) -> str:
        """``"good"``, or ``"suspect"`` where there are reasons."""
        return "suspect" if self.reasons else "good"

    @property
    def vector(self) -> Array:
        """The working vector, shape (7,)."""
        return to_vector(self.model)

    def standard_uncertainty(self, name: str) -> float:
        """Standard uncertainty of an element of the working vector, by its name in ``PARAMETERS``."""
        at = PARAMETERS.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    def check_accepted(self, names: Sequence[str]) -> None:
        """Refuse names that are no reason of this calibration.

        Parameters
        ----------
        names : sequence of str
            Of reasons that are accepted.

        Raises
        ------
        InputError
            If a reason has no such name.
        """
        known = sorted({doubt.name for doubt in self.reasons})
        for name in names:
            if name not in known:
                allowed = "the calibration is good and needs nothing accepted"
                if known:
                    allowed = f"it must be one of {', '.join(shown(name) for name in known)}"
                raise InputError(f"the accepted reason is {shown(name)}; {allowed}.")

    def check_positions(self, positions: Sequence[float], source: object, name: str = "position") -> None:
        """Refuse a position that is not on the screw, where the model states its data sheet.

        Parameters
        ----------
        positions : sequence of float
            Of cells, m.
        source, name
            As for :func:`~ballscrew.axis.sheet.check_on_screw`.

        Raises
        ------
        InputError
            If one is beyond an end of the screw.
        """
        screw = (self.made.settings.get("sheet") or {}).get("screw")
        if screw is None:
            return
        near = -screw["bearing_to_zero"]
        for position in positions:
            check_on_screw(position, (near, near + screw["length"]), source, name)

    def group_of(self, run: str) -> int | None:
        """Group of a run of the calibration by its id; None for other runs."""
        for used in self.runs:
            if used.id == run:
                return used.group
        return None
