"""Cells of a run: stop, condition and motion, with their transients and the frequency of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from itertools import starmap
from typing import TYPE_CHECKING, NamedTuple

from ballscrew.base.tables import table_rows
from ballscrew.modal.reason import Reason

if TYPE_CHECKING:
    import xarray as xr


class CellKey(NamedTuple):
    """Identity of a cell of a run: nominal position of the stop (m), condition, index of the motion."""

    position: float
    condition: str
    motion: int

    @property
    def rounded(self) -> CellKey:
        """The key with its position to a micrometre, to find the same cell in another run."""
        return CellKey(round(self.position, 6), self.condition, self.motion)


@dataclass(frozen=True, slots=True)
class TransientRow:
    """One transient: where it lies in which file, and what it is.

    Parameters
    ----------
    file : int
        Which of the run's files, from 0.
    start_s, stop_s : float
        Of the acceleration phase, from the file's first sample, s.
    position_m : float
        The stop, m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Which motion, from 0.
    repetition : int
        From 1; 0 for a phase that the record cuts.
    """

    file: int
    start_s: float
    stop_s: float
    position_m: float
    condition: str
    motion: int
    repetition: int

    @property
    def key(self) -> CellKey:
        """Its cell."""
        return CellKey(self.position_m, self.condition, self.motion)


def transient_rows(transients: xr.Dataset) -> tuple[TransientRow, ...]:
    """Rows of the table *Transients*, in its order."""
    names = [each.name for each in fields(TransientRow)]
    return tuple(starmap(TransientRow, table_rows(transients, *names)))


@dataclass(frozen=True, slots=True)
class CellResult:
    """The axial natural frequency of one cell.

    Parameters
    ----------
    position_m : float
        Nominal position of the stop, m.
    condition : str
        PA, PD, NA or ND.
    motion, repetitions : int
        Which motion, and how many transients were averaged.
    frequency_Hz, standard_uncertainty_Hz : float or None
        Undamped natural frequency of the first axial mode, rotor free; None where refused.
    damping_ratio : float or None
        None where the method cannot know it.
    method, verdict : str
        Verdict good, suspect or refused.
    reasons : tuple of str
        Why it is not good.
    coherence : float or None
        At the peak.
    band_Hz : tuple of float or None
        Searched band, Hz.
    uncertainty_terms_Hz : dict
        Parts of the standard uncertainty.
    rotor_held_frequency_Hz, rotor_held_standard_uncertainty_Hz : float or None
        The same mode with the rotor held, as Eq. (3) of the paper has it; None where it cannot be known.
    deviation_Hz, deviation_standard_uncertainty_Hz : float or None
        Deviation of the frequency by this cell's own data from the curve through all cells; None where the
        method estimates every cell separately.
    reason_kinds : tuple of str
        Kind of each reason (:data:`~ballscrew.modal.reason.ReasonKind`); empty in documents without.
    nut_load_over_preload : float or None
        Highest load on the nut in the test over its preload, as fitted, also where refused; None by the
        paper's method.
    """

    position_m: float
    condition: str
    motion: int
    repetitions: int
    frequency_Hz: float | None  # noqa: N815
    standard_uncertainty_Hz: float | None  # noqa: N815
    damping_ratio: float | None
    method: str
    verdict: str
    reasons: tuple[str, ...]
    coherence: float | None = None
    band_Hz: tuple[float, float] | None = None  # noqa: N815
    uncertainty_terms_Hz: dict[str, float] = field(default_factory=dict)  # noqa: N815
    rotor_held_frequency_Hz: float | None = None  # noqa: N815
    rotor_held_standard_uncertainty_Hz: float | None = None  # noqa: N815
    deviation_Hz: float | None = None  # noqa: N815
    deviation_standard_uncertainty_Hz: float | None = None  # noqa: N815
    reason_kinds: tuple[str, ...] = ()
    nut_load_over_preload: float | None = None

    @classmethod
    def refused(cls, key: CellKey, repetitions: int, method: str, reasons: Iterable[Reason]) -> CellResult:
        """A cell without frequency, uncertainty and damping ratio."""
        return cls(*key, repetitions, None, None, None, method, "refused", ()).with_reasons(*reasons)

    def with_reasons(self, *reasons: Reason) -> CellResult:
        """The cell with further reasons."""
        return replace(
            self,
            reasons=(*self.reasons, *(reason.text for reason in reasons)),
            reason_kinds=(*self.reason_kinds, *(reason.kind for reason in reasons)),
        )

    def doubts(self) -> tuple[tuple[str, str], ...]:
        """Kind and sentence of each reason; kind ``other`` where the document has none."""
        kinds = self.reason_kinds or ("other",) * len(self.reasons)
        return tuple(zip(kinds, self.reasons, strict=True))

    @property
    def key(self) -> CellKey:
        """Position, condition and motion."""
        return CellKey(self.position_m, self.condition, self.motion)


@dataclass(frozen=True, slots=True)
class SharedError:
    """One cause of error that cells of a run share: a standard normal number times its effect on each.

    Parameters
    ----------
    name : str
        The term of ``uncertainty_terms_Hz`` that it is a part of.
    repeats : bool
        Whether it acts alike in another run of the same plan, so that it cancels in a change.
    effects_Hz : tuple of float
        In the order of the run's cells; 0 where a cell is refused.
    """

    name: str
    repeats: bool
    effects_Hz: tuple[float, ...]  # noqa: N815  the unit's own letters
