"""List of the server's dependencies, from the lock file."""

from __future__ import annotations

from tests.sbom import ROOT, normal, read_lock, sbom


def test_the_list_has_what_the_server_needs_with_hashes_and_nothing_of_the_tests() -> None:
    document = sbom()
    names = {each["name"] for each in document["components"]}
    assert {"fastapi", "starlette", "sqlalchemy", "numpy", "argon2-cffi-bindings", "h11"} <= names
    assert names.isdisjoint({"pytest", "sphinx", "ruff", "playwright"})
    assert all(each["hashes"] and each["version"] for each in document["components"])
    references = {each["bom-ref"] for each in document["components"]} | {"ballscrew"}
    assert {each["ref"] for each in document["dependencies"]} == references
    for each in document["dependencies"]:
        assert set(each["dependsOn"]) <= references
    assert sbom() == document


def test_every_pin_of_the_lock_is_read() -> None:
    text = (ROOT / "requirements" / "dev.txt").read_text(encoding="utf-8")
    lock = read_lock(text)
    pins = [line.split("==")[0] for line in text.splitlines() if "==" in line and not line.startswith(" ")]
    assert set(lock) == set(map(normal, pins))  # some have another version for another Python
    assert all(pin["hashes"] for pin in lock.values())
