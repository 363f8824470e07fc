"""What a run tells of the preload, as it is printed and kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain, read_json
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.estimation.cause import Cause
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.fusion import FusedChange
from ballscrew.estimation.local_wear import Along
from ballscrew.estimation.mass_check import MassCheck

__all__ = ["PreloadEstimate", "Share"]


@dataclass(frozen=True, slots=True)
class Share:
    """One part of the standard uncertainty of the ratio that is told.

    Parameters
    ----------
    name : str
        In words.
    standard_uncertainty : float
        Of P over its reference.
    random : bool
        Whether another run would draw it anew.
    """

    name: str
    standard_uncertainty: float
    random: bool


@dataclass(frozen=True, eq=False)
class PreloadEstimate:
    """What a run tells of the preload.

    Parameters
    ----------
    run, baseline : str or None
        Ids.
    axis, measured_at : str or None
        Of the run.
    preload_N : Quantity or None
        P, N; None where refused, or where newtons alone have no upper end.
    preload_ratio : Quantity or None
        P/Ca.
    relative_to_baseline : Quantity or None
        P/P₀; None without a baseline.
    relative_to_model : Quantity or None
        P over the model's reference preload.
    random_N, systematic_N : float or None
        The two parts of the standard uncertainty of P: what another run
        would draw anew, and what it would not.
    random_ratio, systematic_ratio : float or None
        The same of P/P₀, or of P over the model's where there is no baseline.
    terms : tuple of Share
        Parts of that.
    verdict : str
        good, suspect or refused.
    reasons : tuple of str
        Why it is not good.
    notes : tuple of str
        What must be known with the number.
    chi2, degrees, probability : float or None
        Misfit of the cells, what is expected of it, and how probable one as large is.
    causes : tuple of Cause
        What else may have changed the frequencies.
    mass : MassCheck or None
        The load against the baseline's.
    corrections : tuple of str
        What was corrected.
    along : Along or None
        P(x).
    change : Change or None
        The cells that were fused; not part of the JSON.
    fused : FusedChange or None
        How; not part of the JSON.
    made : Made
        Version, settings, inputs.
    relative_if_bearing_changed : Quantity or None
        P/P₀ where the bearing may have changed by more than is taken for granted (``bearing_change``): how
        little frequencies alone tell. None without a baseline, or where it has no upper end.
    """

    run: str
    baseline: str | None
    axis: str | None
    measured_at: str | None
    preload_N: Quantity | None  # noqa: N815
    preload_ratio: Quantity | None
    relative_to_baseline: Quantity | None
    relative_to_model: Quantity | None
    random_N: float | None  # noqa: N815
    systematic_N: float | None  # noqa: N815
    random_ratio: float | None
    systematic_ratio: float | None
    terms: tuple[Share, ...]
    verdict: str
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    chi2: float | None
    degrees: float | None
    probability: float | None
    causes: tuple[Cause, ...]
    mass: MassCheck | None
    corrections: tuple[str, ...]
    along: Along | None
    change: ComplianceChange | None
    fused: FusedChange | None
    made: Made
    relative_if_bearing_changed: Quantity | None = None

    def to_json(self) -> dict[str, Any]:
        """The document that ``preload --json`` prints."""
        document = {
            "schema": SCHEMA,
            "run": {"id": self.run, "axis": self.axis, "measured_at": self.measured_at},
            "baseline": self.baseline,
            "preload_N": _told(self.preload_N),
            "preload_ratio": _told(self.preload_ratio),
            "relative_to_baseline": _told(self.relative_to_baseline),
            "relative_if_bearing_changed": _told(self.relative_if_bearing_changed),
            "relative_to_model": _told(self.relative_to_model),
            "parts": {
                "preload_N": {"random": self.random_N, "systematic": self.systematic_N},
                "relative": {"random": self.random_ratio, "systematic": self.systematic_ratio},
                "terms": [asdict(term) for term in self.terms],
            },
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "fit": {"chi2": self.chi2, "degrees_of_freedom": self.degrees, "probability": self.probability},
            "causes": [cause.to_json() for cause in self.causes],
            "mass": None if self.mass is None else self.mass.to_json(),
            "corrections": list(self.corrections),
            "along": None if self.along is None else self.along.to_json(),
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
            As :meth:`to_json` makes it; keys that a later version added are passed over, and those that an
            earlier version did not have are as if nothing was told.
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
            return _read(document)
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InputError(
                f"{source}: is not a preload of ballscrew: {error!r} is missing or of another kind."
            ) from None

    @classmethod
    def read(cls, path: str | Path) -> PreloadEstimate:
        """Read what ``preload --json`` printed of one run."""
        return cls.from_json(read_json(path), Path(path).name)


def _read(document: Mapping[str, Any]) -> PreloadEstimate:
    head, parts, fit, mass = document["run"], document["parts"], document["fit"], document["mass"]
    if document["verdict"] not in ("good", "suspect", "refused"):
        raise ValueError("verdict")
    return PreloadEstimate(
        run=str(head["id"]),
        baseline=document["baseline"],
        axis=head["axis"],
        measured_at=head["measured_at"],
        preload_N=_quantity(document["preload_N"], "N"),
        preload_ratio=_quantity(document["preload_ratio"]),
        relative_to_baseline=_quantity(document["relative_to_baseline"]),
        relative_to_model=_quantity(document["relative_to_model"]),
        random_N=parts["preload_N"]["random"],
        systematic_N=parts["preload_N"]["systematic"],
        random_ratio=parts["relative"]["random"],
        systematic_ratio=parts["relative"]["systematic"],
        terms=tuple(_known(Share, row) for row in parts["terms"]),
        verdict=document["verdict"],
        reasons=tuple(document["reasons"]),
        notes=tuple(document["notes"]),
        chi2=fit["chi2"],
        degrees=fit["degrees_of_freedom"],
        probability=fit["probability"],
        causes=tuple(
            _known(Cause, {**row, **row["amount"], "name": row["cause"], "amount": row["amount"]["value"]})
            for row in document["causes"]
        ),
        mass=None
        if mass is None
        else MassCheck(
            decision=mass["decision"],
            change=_quantity(mass["change_kg"], "kg"),
            correction=mass["correction_kg"],
            standard_uncertainty=mass.get("standard_uncertainty_kg", 0.0),
            text=mass["text"],
            unseen=mass.get("unseen_kg", 0.0),
            refused=mass.get("refused", False),
        ),
        corrections=tuple(document["corrections"]),
        along=None if document["along"] is None else _along(document["along"]),
        change=None,
        fused=None,
        made=_known(Made, document["made"]),
        relative_if_bearing_changed=_quantity(document.get("relative_if_bearing_changed")),
    )


def _along(row: Mapping[str, Any]) -> Along:
    local = row["local"]
    return Along(
        position=tuple(stop["position_m"] for stop in row["stops"]),
        ratio=tuple(_sure(stop) for stop in row["stops"]),
        found=local["found"],
        start=local["start_m"],
        stop=local["stop_m"],
        loss=_quantity(local["loss"]),
        statistic=local["statistic"],
        limit=local["limit"],
        groups=tuple((group["cells"], _sure(group)) for group in row["groups"]),
        text=row["text"],
    )


def _known(kind: type[Any], row: Mapping[str, Any]) -> Any:
    return kind(**{key: value for key, value in row.items() if key in kind.__dataclass_fields__})


def _sure(row: Mapping[str, Any], unit: str = "") -> Quantity:
    low, high = row["interval95"]
    return Quantity(float(row["value"]), float(row["standard_uncertainty"]), unit, (float(low), float(high)))


def _quantity(row: Mapping[str, Any] | None, unit: str = "") -> Quantity | None:
    return None if row is None else _sure(row, unit)


def _told(quantity: Quantity | None) -> dict[str, Any] | None:
    return None if quantity is None else quantity.to_json()
