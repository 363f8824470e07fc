"""The result of ``preload``, and its JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballscrew.base import json_fields
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain, read_json
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity, quantity_json
from ballscrew.base.result import PlottedResult, first_sentences, quantity_rows, with_interval
from ballscrew.estimation.causes import PossibleCause
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.fusion import FusedChange
from ballscrew.estimation.local_wear import PreloadProfile
from ballscrew.estimation.mass_check import MassCheck
from ballscrew.estimation.nut import NutOrBearing

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True)
class UncertaintyPart:
    """Contribution of one error to the standard uncertainty of P/P₀, or of P/P_ref without a baseline.

    Parameters
    ----------
    name : str
        Printed name of the error.
    standard_uncertainty : float
        Of the ratio, by this error alone.
    random : bool
        Whether the error differs from run to run.
    """

    name: str
    standard_uncertainty: float
    random: bool


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PreloadEstimate(PlottedResult):
    """Preload of a run; quantities are None where the estimate is refused, except an upper limit of P/P₀.

    Parameters
    ----------
    run : str
        Id of the run.
    baseline : str or None
        Id of the baseline; None where the model is the reference.
    axis : str or None
        Name of the run's axis.
    measured_at : str or None
        Time of the run, ISO 8601.
    verdict : str
        Verdict on the axial stiffness: good, suspect or refused.
    reasons : tuple of str
        Why the stiffness is not good.
    nut_verdict : str
        Verdict on the nut's preload, which depends on the stiffness and on the support bearing: good, suspect
        or refused.
    nut_reasons : tuple of str
        Why the nut's preload is not good: the reasons of the stiffness, and those of the nut alone.
    notes : tuple of str
        Further remarks, which do not affect the verdict.
    stiffness_relative_to_baseline : Quantity or None
        Axial stiffness as P/P₀: the ratio of preloads by which the nut alone would give the observed change
        of the axial compliance (:func:`~ballscrew.axis.compliance.equivalent_preload_ratio`). None without a
        baseline.
    preload_N : Quantity or None
        P of the nut, N; None also where its interval has no upper end although that of the ratio has one.
    preload_ratio : Quantity or None
        P/Ca, the preload over the dynamic load rating.
    relative_to_baseline : Quantity or None
        P/P₀ of the nut; its uncertainty contains the support bearing's change. None without a baseline, or
        where its interval has no upper end.
    relative_to_model : Quantity or None
        P/P_ref of the nut, its preload over the model's reference preload.
    random_N, systematic_N : float or None
        Parts of the standard uncertainty of P by errors that differ from run to run, and by those that do
        not, N.
    random_ratio, systematic_ratio : float or None
        The same parts of the standard uncertainty of the stiffness as P/P₀, or of P/P_ref without a baseline.
    terms : tuple of UncertaintyPart
        Contributions to the standard uncertainty of that ratio, the largest first.
    chi2, degrees, probability : float or None
        χ² of the cells, its expected value, and the probability of a χ² as large or larger.
    causes : tuple of PossibleCause
        All causes that were compared, possible or not, before the load is corrected; the most probable first.
    nut_or_bearing : NutOrBearing or None
        Whether nut or support bearing has changed the stiffness, with the load corrected.
    mass : MassCheck or None
        Check of the declared load by the equivalent masses of run and baseline.
    corrections : tuple of str
        Corrections that were made, with their sizes.
    profile : PreloadProfile or None
        P(x), the preload along the axis.
    change : ComplianceChange or None
        Change of the compliance in the cells; not part of the JSON.
    fused : FusedChange or None
        One change of the nut by these cells; not part of the JSON.
    made : Made
        Version, settings, inputs.
    """

    run: str
    baseline: str | None
    axis: str | None
    measured_at: str | None
    verdict: str
    reasons: tuple[str, ...]
    made: Made
    nut_verdict: str = "refused"
    nut_reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    stiffness_relative_to_baseline: Quantity | None = None
    preload_N: Quantity | None = None  # noqa: N815
    preload_ratio: Quantity | None = None
    relative_to_baseline: Quantity | None = None
    relative_to_model: Quantity | None = None
    random_N: float | None = None  # noqa: N815
    systematic_N: float | None = None  # noqa: N815
    random_ratio: float | None = None
    systematic_ratio: float | None = None
    terms: tuple[UncertaintyPart, ...] = ()
    chi2: float | None = None
    degrees: float | None = None
    probability: float | None = None
    causes: tuple[PossibleCause, ...] = ()
    nut_or_bearing: NutOrBearing | None = None
    mass: MassCheck | None = None
    corrections: tuple[str, ...] = ()
    profile: PreloadProfile | None = None
    change: ComplianceChange | None = None
    fused: FusedChange | None = None

    _drawing = "preload_figure:draw_change"

    def _quantities(self) -> list[tuple[str, Quantity | None]]:
        """Quantities of the estimate, by their names in words."""
        return [
            ("axial stiffness as P/P₀", self.stiffness_relative_to_baseline),
            ("preload of the nut over the baseline's", self.relative_to_baseline),
            ("preload of the nut over the model's", self.relative_to_model),
            ("preload of the nut", self.preload_N),
            ("preload of the nut over Ca", self.preload_ratio),
        ]

    def _lines(self) -> list[str]:
        """Verdicts, quantities and reasons, a line each, as ``print`` shows them."""
        title = self.axis or "axis without a name"
        if self.measured_at:
            title += f", {self.measured_at}"
        lines = [f"{title}: stiffness {self.verdict}, preload of the nut {self.nut_verdict}"]
        for name, quantity in self._quantities():
            if quantity is not None:
                lines.append(f"{name}: {with_interval(quantity)}")
        return lines + first_sentences(self.nut_reasons or self.reasons)

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the quantities that are known, with their 95 % intervals."""
        return quantity_rows(self._quantities())

    @property
    def relative_interval(self) -> tuple[float, float]:
        """95 % interval of the stiffness as P/P₀, or of P over the model's; 0 to infinity if refused."""
        relative = self.stiffness_relative_to_baseline or self.relative_to_model
        if relative is None:
            return 0.0, math.inf
        return relative.interval

    def to_json(self) -> dict[str, Any]:
        """The document that ``preload --json`` prints."""
        document = {
            "schema": SCHEMA,
            "run": {"id": self.run, "axis": self.axis, "measured_at": self.measured_at},
            "baseline": self.baseline,
            "stiffness_relative_to_baseline": quantity_json(self.stiffness_relative_to_baseline),
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "relative_to_baseline": quantity_json(self.relative_to_baseline),
            "nut_verdict": self.nut_verdict,
            "nut_reasons": list(self.nut_reasons),
            "preload_N": quantity_json(self.preload_N),
            "preload_ratio": quantity_json(self.preload_ratio),
            "relative_to_model": quantity_json(self.relative_to_model),
            "parts": {
                "preload_N": {"random": self.random_N, "systematic": self.systematic_N},
                "relative": {"random": self.random_ratio, "systematic": self.systematic_ratio},
                "terms": [asdict(term) for term in self.terms],
            },
            "notes": list(self.notes),
            "fit": {"chi2": self.chi2, "degrees_of_freedom": self.degrees, "probability": self.probability},
            "causes": [cause.to_json() for cause in self.causes],
            "nut_or_bearing": _json(self.nut_or_bearing),
            "mass": _json(self.mass),
            "corrections": list(self.corrections),
            "profile": _json(self.profile),
            "made": asdict(self.made),
        }
        result: dict[str, Any] = plain(document)
        return result

    @classmethod
    def from_json(cls, document: Mapping[str, Any], source: str = "PRELOAD.json") -> PreloadEstimate:
        """Read the document back.

        Parameters
        ----------
        document : mapping
            As :meth:`to_json` makes it; other keys are ignored.
        source : str
            Its name, for messages.

        Returns
        -------
        PreloadEstimate
            Without ``change`` and ``fused``.

        Raises
        ------
        InputError
            If a key is missing or of another kind.
        """
        try:
            return _read_estimate(document)
        except InputError as error:
            raise InputError(f"{source}: is not a preload of ballscrew: {error}") from None

    @classmethod
    def read(cls, path: str | Path) -> PreloadEstimate:
        """Read what ``preload --json`` printed of one run."""
        return cls.from_json(read_json(path), Path(path).name)


def _json(part: MassCheck | PreloadProfile | NutOrBearing | None) -> dict[str, Any] | None:
    """Object of a part in the document; None, which is null in JSON, where the part is missing."""
    if part is None:
        return None
    return part.to_json()


# Fields of PRELOAD.json, as :meth:`PreloadEstimate.to_json` writes them.
_NUMBER, _NUMBER_OR_NULL = json_fields.number(), json_fields.number(optional=True)
_TEXT, _TEXT_OR_NULL = json_fields.text(), json_fields.text(optional=True)
_TEXTS = json_fields.listed(_TEXT)
_VERDICT = json_fields.choice("good", "suspect", "refused")
_QUANTITY = json_fields.quantity()
_PARTS = json_fields.record({"random": _NUMBER_OR_NULL, "systematic": _NUMBER_OR_NULL})


def _labelled_quantity(key: str, label: json_fields.Field) -> json_fields.Field:
    """Field of an object with a quantity and, under ``key``, a label; its value is (label, quantity)."""
    labels = json_fields.record({key: label})
    return lambda row, where: (labels(row, where)[key], _QUANTITY(row, where))


_PROFILE = json_fields.record(
    {
        "stops": json_fields.listed(_labelled_quantity("position_m", _NUMBER)),
        "local": json_fields.record(
            {
                "found": json_fields.flag,
                "start_m": _NUMBER_OR_NULL,
                "stop_m": _NUMBER_OR_NULL,
                "loss": _QUANTITY,
                "statistic": _NUMBER,
                "limit": _NUMBER,
            }
        ),
        "groups": json_fields.listed(_labelled_quantity("cells", _TEXT)),
        "text": _TEXT,
    }
)
_MASS = json_fields.record(
    {
        "decision": json_fields.choice("declared", "corrected", "torque", "undecided", "unknown"),
        "change_kg": json_fields.quantity(unit="kg"),
        "correction_kg": _NUMBER,
        "standard_uncertainty_kg": _NUMBER,
        "undetectable_kg": _NUMBER,
        "refused": json_fields.flag,
        "text": _TEXT,
    }
)
_CAUSE = json_fields.record(
    {
        "cause": _TEXT,
        "probability": _NUMBER,
        "chi2": _NUMBER,
        "amount": json_fields.record({"value": _NUMBER, "standard_uncertainty": _NUMBER, "unit": _TEXT}),
        "fit": _NUMBER,
        "possible": json_fields.flag,
        "text": _TEXT,
    }
)


def _cause(value: Any, where: str) -> PossibleCause:
    """Possible cause from a row of ``causes``."""
    row = _CAUSE(value, where)
    amount = row["amount"]
    return PossibleCause(
        name=row["cause"],
        probability=row["probability"],
        chi2=row["chi2"],
        amount=amount["value"],
        standard_uncertainty=amount["standard_uncertainty"],
        unit=amount["unit"],
        possible=row["possible"],
        text=row["text"],
        fit=row["fit"],
    )


def _mass(value: Any, where: str) -> MassCheck:
    """Mass check from the object ``mass``."""
    row = _MASS(value, where)
    return MassCheck(
        decision=row["decision"],
        change=row["change_kg"],
        correction=row["correction_kg"],
        standard_uncertainty=row["standard_uncertainty_kg"],
        text=row["text"],
        undetectable=row["undetectable_kg"],
        refused=row["refused"],
    )


def _profile(value: Any, where: str) -> PreloadProfile:
    """Preload along the axis from the object ``profile``."""
    row = _PROFILE(value, where)
    stops = row["stops"]
    local = row["local"]
    return PreloadProfile(
        position=tuple(position for position, _ in stops),
        ratio=tuple(ratio for _, ratio in stops),
        found=local["found"],
        start=local["start_m"],
        stop=local["stop_m"],
        loss=local["loss"],
        statistic=local["statistic"],
        limit=local["limit"],
        groups=row["groups"],
        text=row["text"],
    )


_DOCUMENT = json_fields.record(
    {
        "run": json_fields.record({"id": _TEXT, "axis": _TEXT_OR_NULL, "measured_at": _TEXT_OR_NULL}),
        "baseline": _TEXT_OR_NULL,
        "stiffness_relative_to_baseline": _QUANTITY,
        "verdict": _VERDICT,
        "reasons": _TEXTS,
        "relative_to_baseline": _QUANTITY,
        "nut_verdict": _VERDICT,
        "nut_reasons": _TEXTS,
        "preload_N": json_fields.quantity(unit="N"),
        "preload_ratio": _QUANTITY,
        "relative_to_model": _QUANTITY,
        "parts": json_fields.record(
            {
                "preload_N": _PARTS,
                "relative": _PARTS,
                "terms": json_fields.listed(
                    json_fields.instance(UncertaintyPart, standard_uncertainty=_NUMBER)
                ),
            }
        ),
        "notes": _TEXTS,
        "fit": json_fields.record(
            {"chi2": _NUMBER_OR_NULL, "degrees_of_freedom": _NUMBER_OR_NULL, "probability": _NUMBER_OR_NULL}
        ),
        "causes": json_fields.listed(_cause),
        "nut_or_bearing": json_fields.optional(
            json_fields.instance(
                NutOrBearing, nut=_NUMBER_OR_NULL, bearing=_NUMBER_OR_NULL, both=_NUMBER_OR_NULL
            )
        ),
        "mass": json_fields.optional(_mass),
        "corrections": _TEXTS,
        "profile": json_fields.optional(_profile),
        "made": json_fields.instance(Made),
    }
)


def _read_estimate(document: Any) -> PreloadEstimate:
    """The estimate from a document; keys that are not fields of it are popped, and the others passed on."""
    values = _DOCUMENT(document, "")
    run = values.pop("run")
    parts = values.pop("parts")
    fit = values.pop("fit")
    return PreloadEstimate(
        run=run["id"],
        axis=run["axis"],
        measured_at=run["measured_at"],
        random_N=parts["preload_N"]["random"],
        systematic_N=parts["preload_N"]["systematic"],
        random_ratio=parts["relative"]["random"],
        systematic_ratio=parts["relative"]["systematic"],
        terms=parts["terms"],
        chi2=fit["chi2"],
        degrees=fit["degrees_of_freedom"],
        probability=fit["probability"],
        **values,
    )
