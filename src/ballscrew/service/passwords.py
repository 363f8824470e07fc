"""Passwords: argon2id hashes, computed few at a time, and which passwords are accepted."""

from __future__ import annotations

import secrets
import threading
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from ballscrew.base.errors import InputError
from ballscrew.service.serving import UNAVAILABLE, RefusedError

SHORTEST = 12
"""Characters that a password has at least."""

_LONGEST = 1024  # bytes
_AT_ONCE = 2  # hashes, of 64 MiB each
_PATIENCE = 5.0  # s for a turn
_turns = threading.BoundedSemaphore(_AT_ONCE)

hasher = PasswordHasher()
"""With the parameters that argon2-cffi recommends."""


def hash_password(password: str) -> str:
    """Hash of a new password, with its salt and parameters.

    Raises
    ------
    InputError
        If the password is too short or too long.
    """
    text = _normal(password)
    if len(text) < SHORTEST:
        raise InputError(f"The password must have {SHORTEST} characters or more.")
    if _is_too_long(text):
        raise InputError(f"The password must have {_LONGEST} bytes or fewer.")
    with _turn():
        return hasher.hash(text)


def is_password(password: str, stored: str | None) -> bool:
    """Whether a password is the one of a hash; it takes as long if there is no hash.

    Raises
    ------
    RefusedError
        503 if too many are being verified.
    """
    text = _normal(password)
    if _is_too_long(text):
        text, stored = "", None
    with _turn():
        verified = stored
        if verified is None:
            verified = _other_hash(hasher)  # the first one takes the memory of a hash too
        try:
            hasher.verify(verified, text)
        except (VerificationError, InvalidHashError):
            return False
    return stored is not None


def is_outdated(stored: str) -> bool:
    """Whether a hash has other parameters than new ones."""
    return hasher.check_needs_rehash(stored)


def _normal(password: str) -> str:
    """A password with each letter in one form: keyboards send accents in several.

    One that is too long stays too long when it is cut: four characters become one at most. Whole, it would
    take a time that grows with the square of its length, during which nothing else runs.
    """
    return unicodedata.normalize("NFC", password[: 4 * _LONGEST + 1])


def _is_too_long(text: str) -> bool:
    return len(text.encode("utf-8", "replace")) > _LONGEST


@lru_cache(maxsize=1)
def _other_hash(of: PasswordHasher) -> str:
    """Hash of a password that nobody has."""
    return of.hash(secrets.token_urlsafe())


@contextmanager
def _turn() -> Iterator[None]:
    """Wait until fewer hashes are being computed."""
    if not _turns.acquire(timeout=_PATIENCE):
        raise RefusedError(UNAVAILABLE, "too many people sign in at once; try again.", {"Retry-After": "5"})
    try:
        yield
    finally:
        _turns.release()
