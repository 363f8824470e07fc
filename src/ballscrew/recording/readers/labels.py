"""Units in the labels of columns: ``Torque [Nm]``, ``Torque (Nm)``, ``torque / N m``."""

from __future__ import annotations

import re

# Only what drives and data loggers write: a general parser of units reads "t" as tonne and "a" as year.
_UNIT = re.compile(
    r"""(?: s|sec|seconds?|ms|us|µs|ns|min|h
      | [kmµu]?m|nm|cm|micron|in|inch
      | [kmµu]?m\s?[/\s*·.]\s?(?:s|min)\s?(?:\^|\*\*)?\s?-?[12²]? | m/\(s\^?2\)
      | m\s?s(?:\^?-[12]|⁻[¹²])
      | g|gn|g0|g_n|g_0|mg
      | [kmc]?N\s?[*·.]?\s?[cm]?m|[kmM]?N|lbf
      | [kmµu]?A(?:rms|eff)?|[kmµu]?V|[kM]?W
      | K|kelvin|°\s?[CFK]|deg\s?[CF]|degC|celsius|C
      | rpm|r/min|rev/min|1/min|U/min|min-1|rad|rad/s|deg|°|deg/s|rev|turns?
      | [kM]?Hz|counts?|inc|incr|bar|%(?:\s?M_?[Nn](?:enn)?)?|-|1 )\Z""",
    re.VERBOSE,
)
_LONGEST = 300  # characters; the time of the patterns increases with the square of it
_BRACKET = re.compile(r"(.*?)\s*\[\s*([^\[\]]*?)\s*\]\s*\Z", re.DOTALL)
_PARENTHESIS = re.compile(r"(.*?)\s*\(\s*([^()]*?(?:\([^()]*\))?)\s*\)\s*\Z", re.DOTALL)
_SLASH = re.compile(r"([^/]*?)\s*/\s*(.+?)\s*\Z", re.DOTALL)
_IN = re.compile(r"(.+?)\s+in\s+(\S.*?)\s*\Z", re.DOTALL)


def is_unit(text: str) -> bool:
    """True if a text is a unit that recordings of drives use, in its usual spellings."""
    return _UNIT.match(text.strip().replace("μ", "µ")) is not None


def split_label(label: str) -> tuple[str, str | None]:
    """Split the stem and the unit of a label.

    Parameters
    ----------
    label : str
        A column's header.

    Returns
    -------
    stem : str
        The label without its unit.
    unit : str or None
        The unit as written; None where there is none.
    """
    if len(label) > _LONGEST:
        return label.strip(), None
    for pattern in (_BRACKET, _PARENTHESIS, _IN, _SLASH):
        match = pattern.match(label)
        if match is None or not match[1] or not is_unit(match[2]):
            continue
        if pattern is _SLASH and _ends_with_unit(label, match[1]):
            continue
        return match[1].strip(), match[2].strip()
    return label.strip(), None


def _ends_with_unit(label: str, stem: str) -> bool:
    # "v m/s" is a speed in metres per second, not a length over seconds; with blanks, "s / mm" is clear.
    return not re.search(r"\s/|/\s", label) and is_unit(stem.split()[-1])
