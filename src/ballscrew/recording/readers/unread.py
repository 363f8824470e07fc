"""Formats that are recognised and not read, with what to do instead."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_SHEET = "save the sheet as CSV"
_EXPORT = "export the channels as CSV, MAT or HDF5"
_UNPACK = "unpack it and give the files in it"
_NO_SAMPLES = "give the recording itself, not a picture or a document of it"


@dataclass(frozen=True, slots=True)
class _Format:
    """A format: by its first bytes (a regular expression), or by its name where the content is binary."""

    name: str
    advice: str
    content: str = ""
    suffixes: str = ""


# The first that fits. Content: the published signatures; an XLSX and an ODS are zips.
_FORMATS = (
    _Format("an Excel or other Office document", _SHEET, r"PK\x03\x04.{26}(?:\[Content_T|_rels/|xl/|docPr)"),
    _Format("an OpenDocument sheet", _SHEET, r"PK\x03\x04.{26}mimetypeapplication/vnd\.oasis"),
    _Format("a zip archive", _UNPACK, r"PK(?:\x03\x04|\x05\x06|\x07\x08)"),
    _Format("an old Excel or Word document", _SHEET, r"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"),
    _Format("an Excel workbook as XML", _SHEET, r"(?:\xef\xbb\xbf)?\s*<\?xml.{,400}Excel\.Sheet"),
    _Format("a gzip archive", _UNPACK, r"\x1f\x8b"),
    _Format("a compressed file (bz2, xz)", _UNPACK, r"BZh[1-9]1AY|\xfd7zXZ\0"),
    _Format("a compressed file (7z, rar, zst)", _UNPACK, r"7z\xbc\xaf\x27\x1c|Rar!\x1a|\x28\xb5\x2f\xfd"),
    _Format("a tar archive", _UNPACK, r".{257}ustar"),
    _Format("an SQLite database", "export the table of the recording as CSV", r"SQLite format 3\0"),
    _Format(
        "a network capture (PCAP)",
        "record the drive's signals with the controller's scope or trace, and export that as CSV",
        r"\xd4\xc3\xb2\xa1|\xa1\xb2\xc3\xd4|\x4d\x3c\xb2\xa1|\xa1\xb2\x3c\x4d"
        r"|\x0a\x0d\x0d\x0a.{4}(?:\x4d\x3c\x2b\x1a|\x1a\x2b\x3c\x4d)",
    ),
    _Format("an HDF4 file", "convert it to HDF5 with h4toh5", r"\x0e\x03\x13\x01"),
    _Format("an Arrow or Feather file", "save the table as Parquet or CSV", r"ARROW1|FEA1"),
    _Format("one NumPy array", "save all channels by name with numpy.savez, as NPZ", r"\x93NUMPY"),
    _Format("a Python pickle", "save the channels as NPZ; a pickle can run any program", r"\x80[\x02-\x05]"),
    _Format("an imc FAMOS file", _EXPORT, r"\|C[FK],"),
    _Format("an MDF file before version 4", "save it as MDF 4 where it was written", r"MDF     |UnFinMF "),
    _Format("the index of a TDMS file", "give the .tdms file beside it", r"TDSh"),
    _Format("a DIAdem file", _EXPORT, r"(?:\xef\xbb\xbf)?\s*<\?xml.{,400}<usi:tdm"),
    _Format("XML of an unknown kind", "export the channels as CSV", r"(?:\xef\xbb\xbf)?\s*<\?xml"),
    _Format("a LeCroy oscilloscope file", _EXPORT, r".{,20}WAVEDESC"),
    _Format("a Tektronix oscilloscope file", _EXPORT, r".{2}:WFM#|:WFMP:|:?BYT_NR? "),
    _Format("a PDF document", _NO_SAMPLES, r"%PDF-"),
    _Format("a picture", _NO_SAMPLES, r"\x89PNG|\xff\xd8\xff|GIF8|BM.{4}\0{4}"),
    _Format("a TwinCAT Scope file", "export the recording as CSV in TwinCAT Scope", "", "svdx svb"),
    _Format("a Dewesoft recording", f"{_EXPORT} in Dewesoft", "", "dxd dxz d7d d7z"),
    _Format("a Simcenter Testlab file", f"{_EXPORT}, or as UFF58, in Testlab", "", "ldsf lms"),
    _Format("a HEAD acoustics file", f"{_EXPORT}, or as UFF58, in ArtemiS", r".{,80}start of data *:", "hdf"),
    _Format("a Brüel & Kjær recording", f"{_EXPORT}, or as UFF58, in PULSE or BK Connect", "", "pti bkc plh"),
    _Format("a catman file", f"{_EXPORT} in catman", r"[\x91-\xa0]\x13(?=.{,6}\0)", ""),
    _Format("a Genesis HighSpeed or Perception file", f"{_EXPORT} in Perception", "", "pnrf nrf"),
    _Format("an MTS RPC file", _EXPORT, r"FORMAT\0", "rpc rsp"),
    _Format("an oscilloscope file", _EXPORT, "", "wfm trc isf psdata osc"),
    _Format("a binary .dat file", "in the program that wrote it, " + _EXPORT, "", "dat"),
    _Format("a binary .bin file", "in the program that wrote it, " + _EXPORT, "", "bin"),
)  # fmt: skip


def name_unread(path: Path, head: bytes) -> str:
    """Name a format that no reader of this package reads.

    Parameters
    ----------
    path : Path
        The file.
    head : bytes
        Its first bytes, 4096 or all.

    Returns
    -------
    str
        What the file is and what to do, ``"is an Excel workbook, which is not read: save the sheet as CSV"``;
        empty where it is none of these.
    """
    suffix = path.suffix.casefold().removeprefix(".")
    for format_ in _FORMATS:
        by_name = b"\0" in head and suffix in format_.suffixes.split()
        by_content = format_.content and re.match(format_.content.encode("latin-1"), head, re.DOTALL)
        if by_name or by_content:
            return f"is {format_.name}, which is not read: {format_.advice}"
    return ""
