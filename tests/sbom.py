"""Dependencies of the server as CycloneDX, from the lock file: ``python tests/sbom.py`` prints it."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
EXTRAS = ("server", "store", "postgresql")
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)")
_PARENT = re.compile(r"^    #(?: via)?\s+(?!via$|-)([A-Za-z0-9._-]+)")
_NAME = re.compile(r"^[A-Za-z0-9._-]+")


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def read_lock(text: str) -> dict[str, dict[str, Any]]:
    """Version, hashes and parents of each pinned package."""
    found: dict[str, dict[str, Any]] = {}
    current: dict[str, Any] = {}
    for line in text.splitlines():
        if pin := _PIN.match(line):
            current = {"version": pin[2], "hashes": [], "parents": set()}
            found[normal(pin[1])] = current
        elif hashed := re.search(r"--hash=sha256:([0-9a-f]{64})", line):
            current["hashes"].append(hashed[1])
        elif parent := _PARENT.match(line):
            current["parents"].add(normal(parent[1]))
    return found


def direct_dependencies(project: dict[str, Any]) -> set[str]:
    """Names of the packages that the server states."""
    stated = list(project["dependencies"])
    for extra in EXTRAS:
        stated += project["optional-dependencies"][extra]
    names = [_NAME.match(each) for each in stated]
    return {normal(name[0]) for name in names if name} - {"ballscrew"}


def reference_of(name: str, lock: dict[str, dict[str, Any]]) -> str:
    return f"{name}=={lock[name]['version']}"


def sbom() -> dict[str, Any]:
    """The document, without a time or a random number: equal locks give equal bytes."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lock = read_lock((ROOT / "requirements" / "dev.txt").read_text(encoding="utf-8"))
    direct = direct_dependencies(project)
    needed, before = set(direct), set()
    while needed != before:
        before = set(needed)
        needed |= {name for name, pin in lock.items() if pin["parents"] & before}
    version = re.search(r'"(.+)"', (ROOT / "src/ballscrew/_version.py").read_text(encoding="utf-8"))
    components, edges = [], []
    for name in sorted(needed):
        pin, reference = lock[name], reference_of(name, lock)
        hashes = [{"alg": "SHA-256", "content": each} for each in pin["hashes"]]
        components.append(
            {"type": "library", "bom-ref": reference, "name": name, "version": pin["version"]}
            | {"hashes": hashes}
        )
        children = sorted(each for each in needed if name in lock[each]["parents"])
        edges.append({"ref": reference, "dependsOn": [reference_of(each, lock) for each in children]})
    root = {"type": "application", "bom-ref": "ballscrew", "name": "ballscrew"}
    root["version"] = version[1] if version else "unknown"
    first = [reference_of(name, lock) for name in sorted(direct)]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": root},
        "components": components,
        "dependencies": [{"ref": "ballscrew", "dependsOn": first}, *edges],
    }


if __name__ == "__main__":
    sys.stdout.write(json.dumps(sbom(), indent=1) + "\n")
