"""Provenance of a result: inputs by hash, version, settings."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ballscrew._version import __version__
from ballscrew.base.errors import InputError
from ballscrew.base.files import open_regular


@dataclass(frozen=True, slots=True)
class FileRef:
    """A file by its name and content.

    Parameters
    ----------
    name : str
        The file's name, without its folder: a folder is one machine's affair.
    sha256 : str
        Hash of the content, hexadecimal.
    """

    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Made:
    """Provenance of a result.

    Parameters
    ----------
    settings : dict
        Every setting that the numbers depend on.
    version : str
        Version of this package.
    inputs : dict
        Digests of what was read besides the recordings: axis, plan, channel map.
    """

    settings: dict[str, Any] = field(default_factory=dict)
    version: str = __version__
    inputs: dict[str, str] = field(default_factory=dict)


def hash_file(path: str | Path) -> str:
    """SHA-256 of a file's content, read in blocks.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    str
        Hexadecimal digest.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with open_regular(path) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from None


def digest(document: Any) -> str:
    """SHA-256 of a document in canonical JSON: the same content, the same digest.

    Parameters
    ----------
    document : object
        Anything that JSON can hold.

    Returns
    -------
    str
        Hexadecimal digest.
    """
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
