"""Passwords: what is accepted, and that nobody learns from an answer whether there is a user."""

from __future__ import annotations

import threading

import pytest
from argon2 import PasswordHasher, Type

from ballscrew.base.errors import InputError
from ballscrew.service import passwords
from ballscrew.service.passwords import hash_password, is_outdated, is_password
from ballscrew.service.serving import RefusedError

GOOD = "four or five words"


def test_a_password_is_hashed_with_its_own_salt_and_recognised() -> None:
    hashed = hash_password(GOOD)
    assert hashed.startswith("$argon2id$")
    assert hashed != hash_password(GOOD)
    assert is_password(GOOD, hashed)
    for wrong in ("", GOOD[:-1], GOOD + " ", GOOD.upper(), "x" * 2000):
        assert not is_password(wrong, hashed)


def test_the_parameters_are_those_that_argon2_cffi_recommends() -> None:
    hasher = PasswordHasher()
    assert (hasher.type, hasher.memory_cost, hasher.time_cost) == (Type.ID, 1 << 16, 3)  # of RFC 9106


@pytest.mark.parametrize(
    ("text", "is_good"),
    [
        ("x" * 11, False),
        ("x" * 12, True),
        ("é" * 12, True),
        ("x" * 1024, True),
        ("x" * 1025, False),
        ("é" * 513, False),
        ("a\0b c d e f g", True),
    ],
)
def test_a_password_has_twelve_characters_and_at_most_1024_bytes(text: str, is_good: bool) -> None:
    if is_good:
        assert is_password(text, hash_password(text))
    else:
        with pytest.raises(InputError, match="The password must have"):
            hash_password(text)


def test_an_accent_is_the_same_by_every_keyboard() -> None:
    assert is_password("Rene\u0301 and Rene\u0301", hash_password("Ren\u00e9 and Ren\u00e9"))


@pytest.mark.parametrize("stored", [None, "", "no hash", "$argon2id$v=19$m=8,t=1,p=1$x$y"])
def test_without_a_hash_another_one_is_verified(stored: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    verified = []

    class Watched(PasswordHasher):
        def verify(self, hash: str | bytes, password: str | bytes) -> bool:  # noqa: A002
            verified.append(hash)
            return super().verify(hash, password)

    monkeypatch.setattr(passwords, "hasher", Watched(time_cost=1, memory_cost=8, parallelism=1))
    for text in (GOOD, "", "x" * 2000):
        assert not is_password(text, stored)
    assert len(verified) == 3


def test_the_first_hash_of_no_user_waits_for_its_turn_too(monkeypatch: pytest.MonkeyPatch) -> None:
    passwords._other_hash.cache_clear()
    free = []

    class Watched(PasswordHasher):
        def hash(self, password: str | bytes, *, salt: bytes | None = None) -> str:
            free.append(passwords._turns._value)
            return super().hash(password, salt=salt)

    monkeypatch.setattr(passwords, "hasher", Watched(time_cost=1, memory_cost=8, parallelism=1))
    assert not is_password(GOOD, None)
    assert free == [1]


def test_a_hash_with_other_parameters_is_outdated() -> None:
    assert is_outdated(PasswordHasher(time_cost=2, memory_cost=8, parallelism=1).hash(GOOD))
    assert not is_outdated(hash_password(GOOD))


def test_hashes_are_computed_few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passwords, "_turns", threading.BoundedSemaphore(1))
    monkeypatch.setattr(passwords, "_PATIENCE", 0.01)
    with passwords._turn(), pytest.raises(RefusedError) as refused:
        is_password(GOOD, None)
    assert (refused.value.status, refused.value.headers) == (503, {"Retry-After": "5"})
    assert not is_password(GOOD, None)
