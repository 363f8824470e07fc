"""Dialects of G-code where ISO 6983 leaves them open: comments, dwells, units, exact stops."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from textwrap import wrap

from ballscrew.base.errors import InputError, shown

_WIDTH = 76
_NOT_PLAIN = re.compile(r"[^A-Za-z0-9 .,:+*/=_-]")
_UNIT = re.compile(r"(\d) (m/s2|m/s3|mm/s|mm|s|kg|N|Hz)\b", re.IGNORECASE)
_BOND = "~"  # is in no plain text
_LEAST_DWELL = 0.001  # some controllers refuse a dwell of 0, and without any two moves in line are one


@dataclass(frozen=True, slots=True)
class GcodeDialect:
    """One way to write a program.

    Parameters
    ----------
    name : str
        What it is asked for by.
    opening, closing : tuple of str
        Lines before and after all others; ``{number}`` in them is the program's number.
    modes : tuple of str
        Millimetres, absolute positions, feed per minute, exact stop at each position: one block each.
    dwell_unit : str
        Block and unit of a dwell, in words.
    dwell : str
        Block of a dwell, with ``{seconds}`` or ``{milliseconds}`` in it.
    comment : tuple of str
        What stands before and after a comment.
    axis : str
        Pattern of an axis word: of linear axes only. A, B and C turn, and on Fanuc's lathes U and W count
        from where the axis is.
    capitals : bool
        Whether comments are written in capitals only.
    """

    name: str
    opening: tuple[str, ...]
    modes: tuple[str, ...]
    dwell_unit: str
    dwell: str
    comment: tuple[str, str]
    closing: tuple[str, ...]
    axis: str = "[UVWXYZ]"
    capitals: bool = False

    def axis_word(self, word: str) -> str:
        """Check the axis word and give it as it stands before a number.

        Parameters
        ----------
        word : str
            Such as ``"X"``.

        Returns
        -------
        str
            In capitals; with an equal sign where the name ends with a digit.

        Raises
        ------
        InputError
            If it is none.
        """
        if not isinstance(word, str) or not re.fullmatch(self.axis, word.upper(), re.ASCII):
            letters = "X, Y, Z" + (", U, V, W" if "U" in self.axis else "")
            more = ", with a number where it has one (X1)" if "d" in self.axis else ""
            raise InputError(
                f"the axis word is {shown(word)}; in the dialect {self.name!r} it must be one of "
                f"{letters}{more}."
            )
        return word.upper() + ("=" if word[-1].isdigit() else "")

    def dwells(self, seconds: float) -> str:
        """Block of a standstill; one of 0 s becomes 1 ms, so that the axis stops all the same."""
        least = max(seconds, _LEAST_DWELL)
        return self.dwell.format(seconds=f"{least:.3f}", milliseconds=round(1000 * least))

    def remarks(self, text: str) -> Iterator[str]:
        """Write a text as comment lines out of which no character of it can break.

        The text must begin with a word of ours: LinuxCNC obeys comments that begin with MSG, or LOGOPEN,.
        """
        before, after = self.comment
        plain = plain_ascii(text)
        if self.capitals:
            plain = plain.upper()
        # A number and its unit stay on one line: the operator copies them.
        bound = _UNIT.sub(rf"\1{_BOND}\2", plain)
        for line in wrap(bound, _WIDTH, subsequent_indent="... ") or [""]:
            yield f"{before}{line.replace(_BOND, ' ')}{after}"


def plain_ascii(text: str) -> str:
    """Bring a text into letters, digits and marks that mean nothing to a controller; else underscores.

    Parameters
    ----------
    text : str
        Any text.

    Returns
    -------
    str
        One line.
    """
    bare = unicodedata.normalize("NFKD", text.replace("²", "2").replace("³", "3"))
    return _NOT_PLAIN.sub("_", "".join(char for char in bare if not unicodedata.combining(char)))


# G4: P in seconds for NIST's RS274/NGC (3.5.4), LinuxCNC and Grbl; P in milliseconds without a decimal
# point for Fanuc; F in seconds, in a block of its own, for Siemens (Sinumerik, list of instructions). G21 and
# G61 are RS274's (where G61 is the exact path, which each dwell makes a stop) and Fanuc's; Sinumerik's own
# are G710 and G60, and on other makers' controllers G21 and G61 mean other things (Beckhoff: mirroring,
# contouring), so the header says what they are to stand for.
DIALECTS = (
    GcodeDialect(
        name="iso",
        opening=("%",),
        modes=("G21", "G90", "G94", "G61"),
        dwell_unit="a dwell G4 P in seconds",
        dwell="G4 P{seconds}",
        comment=("(", ")"),
        closing=("M30", "%"),
    ),
    GcodeDialect(
        name="fanuc",
        opening=("%", "O{number}"),
        modes=("G21", "G90", "G94", "G61"),
        dwell_unit="a dwell G04 P in milliseconds",
        dwell="G04 P{milliseconds}",
        comment=("(", ")"),
        closing=("M30", "%"),
        axis="[XYZ]",
        capitals=True,
    ),
    GcodeDialect(
        name="siemens",
        opening=(),
        modes=("G710", "G90", "G94", "G60"),
        dwell_unit="a dwell G4 F in seconds",
        dwell="G4 F{seconds}",
        comment=("; ", ""),
        closing=("M30",),
        axis=r"[UVWXYZ]\d{0,2}",
    ),
)


def find_dialect(name: str) -> GcodeDialect:
    """Find a dialect by its name.

    Parameters
    ----------
    name : {"iso", "fanuc", "siemens"}
        The name.

    Returns
    -------
    GcodeDialect
        The dialect.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for dialect in DIALECTS:
        if dialect.name == name:
            return dialect
    names = ", ".join(dialect.name for dialect in DIALECTS)
    raise InputError(f"the dialect is {shown(name)}; it must be one of {names}.")
