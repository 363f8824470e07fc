"""Compare every number that the commands print with a stored baseline.

Run ``python tests/frozen.py write FILE`` before a change that should move no result, and
``python tests/frozen.py compare FILE`` after it; with ``--quick`` both take about a minute and a half. The
recordings are those of the folder that ``BALLSCREW_DATA`` names, default ``../shared/data``. A baseline holds
results of these recordings and therefore stays outside the repository.

``write`` stores the documents of all commands, and as inputs RUN.json and MODEL.json documents of the
demonstration and of the bench. ``compare`` runs calibrate, preload and monitor on the stored inputs, so that
the last digit of a frequency does not move a forecast. Where the commands refuse them because the layout has
changed, ``write`` makes the whole baseline anew.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
DATA = Path(os.environ.get("BALLSCREW_DATA", ROOT.parent / "shared" / "data"))

SAME = 1e-9
"""Largest relative difference of equal numbers: documents have nine significant digits, and beyond
it the ninth differs."""

RENAMED = {
    "ml": "joint",
    "left": "residual",
    "held_floor": "rotor_held_floor",
    "tolerated": "tolerances",
    "tolerated/found": "estimate",
    "cells_out": "outliers",
    "unseen_kg": "undetectable_kg",
    "along": "profile",
    "apart": "separation",
    "loud": "load_odds",
    "optimized/worth": "chosen",
}
"""Keys, alone or below another key, and names among the values: in the baseline, and now."""

SCHEMA = 2
"""Of the documents that the commands read now."""

EXCLUDED = {
    "made": "settings, versions and digests of inputs: how a result was made, not the result",
    "schema": "layout of the document",
    "id": "a hash of the inputs",
}
HASH = re.compile(r"[0-9a-f]{64}")  # of a file or a run, wherever one is referred to

VERDICTS = {
    "verdict", "quality", "state", "condition", "cause", "decision", "confidence", "mode", "holds", "method",
    "kind", "field", "alarm_at", "measured_at", "begins", "ends",
}  # fmt: skip
"""Texts that must be identical; the wording of all others may change, and only their number is reported."""

Document = dict[str, Any]


def call(*arguments: object) -> Document:
    """What a command prints with ``--json``, and its exit status."""
    from ballscrew.__main__ import main

    out, complaints = io.StringIO(), io.StringIO()
    sys.argv = ["ballscrew", *map(str, arguments), "--json"]
    status: Any = 0
    with redirect_stdout(out), redirect_stderr(complaints):
        try:
            main()
        except SystemExit as leave:
            status = leave.code
    text = out.getvalue()
    if status == 2 or not text:
        print(f"  status {status}: {complaints.getvalue().strip()[:500]}", file=sys.stderr)
    document: Document = json.loads(text) if text else {}
    return {**document, "exit_status": status}


def bench(percent: int, *options: object, command: str = "analyze") -> Document:
    folder = DATA / "bench"
    files = [folder / f"preload-{percent}-percent-trip{trip}.h5" for trip in (1, 2, 3)]
    about = [part for name in ("axis", "plan", "channels") for part in (f"--{name}", folder / f"{name}.toml")]
    return call(command, *files, *about, "--mass", "100 kg", *options)


def demonstration(folder: Path) -> dict[str, Document]:
    """The demonstration's own document, model and runs."""
    found = {"demo": call("demo", "--out", folder)}
    for path in (folder / "model.json", *sorted((folder / "runs").glob("*.json"))):
        found[f"demo/{path.stem}"] = json.loads(path.read_text(encoding="utf-8"))
    return found


def make_inputs(folder: Path) -> dict[str, Document]:
    """RUN.json and MODEL.json documents of the demonstration and of the bench."""
    inputs = demonstration(folder / "demo") | {f"bench-{percent}": bench(percent) for percent in (4, 2)}
    store(folder, inputs)
    known = [f"--known-preload={folder}/bench-{percent}.json={150 * percent}N" for percent in (4, 2)]
    runs = [folder / f"bench-{percent}.json" for percent in (4, 2)]
    model = folder / "bench-model.json"
    call("calibrate", *runs, *known, "--axis", DATA / "bench" / "axis.toml", "--out", model)
    inputs["bench-model"] = json.loads(model.read_text(encoding="utf-8"))
    return inputs


def store(folder: Path, inputs: dict[str, Document]) -> None:
    for name, document in inputs.items():
        path = folder / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document), encoding="utf-8")


def jobs(folder: Path, quick: bool) -> dict[str, Callable[[], Document]]:
    """The commands by name; the inputs lie in the folder."""
    axis, plan = (DATA / "bench" / f"{name}.toml" for name in ("axis", "plan"))
    emps = [DATA / "emps" / "DATA_EMPS.mat", "--channels", DATA / "emps" / "channels.toml"]
    runs = sorted((folder / "demo").glob("day-*.json"))
    model, of_bench = (["--model", folder / f"{name}.json"] for name in ("demo/model", "bench-model"))
    new, worn = folder / "bench-4.json", folder / "bench-2.json"
    known = [f"--known-preload={new}=600N", f"--known-preload={worn}=300N"]
    out = ["--out", folder / "written.json"]
    found: dict[str, Callable[[], Document]] = {
        "analyze 4 %": lambda: bench(4),
        "analyze 2 %": lambda: bench(2),
        "analyze 4 % paper": lambda: bench(4, "--method", "paper"),
        "analyze 2 % paper": lambda: bench(2, "--method", "paper"),
        "analyze 4 % motor": lambda: bench(4, "--response", "motor"),
        "analyze 2 % nut": lambda: bench(2, "--response", "nut"),
        "analyze EMPS": lambda: call("analyze", *emps),
        "calibrate sheet": lambda: call("calibrate", new, "--axis", axis, *out),
        "calibrate known": lambda: call("calibrate", new, worn, *known, "--axis", axis, *out),
        "preload demo": lambda: call("preload", *runs[-6:], *model, "--baseline", runs[0]),
        "preload bench": lambda: call("preload", worn, *of_bench, "--baseline", new),
        "monitor": lambda: call("monitor", *runs, *model),
        "monitor early": lambda: call("monitor", *runs[:8], *model, "--duty", "12 km"),
        "plan": lambda: call("plan", plan, "--axis", axis),
    }
    if quick:
        return found
    return found | {
        "analyze 2 % motor": lambda: bench(2, "--response", "motor"),
        "analyze 4 % nut": lambda: bench(4, "--response", "nut"),
        "analyze EMPS paper": lambda: call("analyze", *emps, "--method", "paper"),
        "explain": lambda: bench(2, "--explain", "270mm:PD"),
        "quality": lambda: bench(4, command="quality"),
        "preload model": lambda: call("preload", *runs, *model),
        "monitor load": lambda: call("monitor", *runs, *model, "--largest-load", "3 kN"),
        "plan optimize": lambda: call("plan", plan, "--axis", axis, "--optimize"),
        "plan capability": lambda: call("plan", plan, "--axis", axis, "--capability"),
        "reproduce": lambda: call("reproduce", "--quick", "--out", folder / "paper"),
    }


def measured(inputs: dict[str, Document], quick: bool) -> dict[str, Document]:
    """Documents of all jobs, made on stored inputs with today's names."""
    found = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        store(folder, {name: renamed(one) | {"schema": SCHEMA} for name, one in inputs.items()})
        for name, job in jobs(folder, quick).items():
            begin = time.process_time()
            found[name] = job()
            print(f"{name:<20} {time.process_time() - begin:6.1f} s", file=sys.stderr)
        if not quick:
            found |= demonstration(folder / "again")
    return found


def renamed(node: Any, above: str = "") -> Any:
    if isinstance(node, dict):
        return {
            RENAMED.get(f"{above}/{key}", RENAMED.get(key, key)): renamed(value, key)
            for key, value in node.items()
        }
    if isinstance(node, list):
        return [renamed(value, above) for value in node]
    return RENAMED.get(node, node) if isinstance(node, str) else node


def flat(node: Any, path: str = "", spread: float | None = None) -> Iterator[tuple[str, Any, float | None]]:
    """Every leaf with its path and the standard uncertainty beside it, where there is one."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key not in EXCLUDED:
                yield from flat(value, f"{path}/{key}", beside(node, key))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from flat(value, f"{path}/{index}", spread)
    elif not (isinstance(node, str) and HASH.fullmatch(node)):
        yield path, node, spread


def beside(node: Document, key: str) -> float | None:
    """Standard uncertainty of an entry: of the same name, of the same object, or of the quantiles' width."""
    low, high = node.get("0.05"), node.get("0.95")
    if low is not None and high is not None:
        return float(high - low) / 3.29
    *stem, unit = key.split("_")
    names = [
        f"{key}_uncertainty", f"{key}_standard_uncertainty",
        "_".join([*stem, "standard_uncertainty", unit]), "_".join([*stem[:-1], "standard_uncertainty", unit]),
        "standard_uncertainty",
    ]  # fmt: skip
    for name in names:
        found = node.get(name)
        found = found.get(key) if isinstance(found, dict) else found
        if isinstance(found, (int, float)) and found > 0:
            return float(found)
    return None


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def compare(old: Document, new: Document) -> tuple[list[tuple[float, float, str]], list[str], int]:
    """Numbers that moved (in u, relative, as text), other differences, and how many texts were reworded."""
    moved, others, words = [], [], 0
    before = {path: (value, spread) for path, value, spread in flat(old)}
    after = {path: value for path, value, _ in flat(new)}
    others += [f"gone: {path} = {before[path][0]!r}" for path in before if path not in after]
    others += [f"new: {path} = {after[path]!r}" for path in after if path not in before]
    for path in before.keys() & after.keys():
        (value, spread), now = before[path], after[path]
        if is_number(value) and is_number(now):
            step = abs(now - value)
            relative = step / max(abs(value), abs(now)) if step else 0.0
            if not relative <= SAME:
                in_u = step / spread if spread else math.nan
                moved.append((in_u, relative, f"{path}: {value} -> {now}"))
        elif value != now:
            names = set(path.split("/")[-2:])
            wording = isinstance(value, str) and isinstance(now, str) and not names & VERDICTS
            words += wording
            others += [] if wording else [f"other: {path}: {value!r} -> {now!r}"]
    return moved, sorted(others), words


def report(old: dict[str, Document], new: dict[str, Document], most: int) -> bool:
    """Print what moved, the most in standard uncertainties first, and whether nothing did."""
    same = True
    for name, document in old.items():
        if name not in new:
            continue
        moved, others, words = compare(renamed(document), new[name])
        moved.sort(key=lambda row: (-1.0 if math.isnan(row[0]) else row[0], row[1]), reverse=True)
        same = same and not moved and not others
        worst = max((row[1] for row in moved), default=0.0)
        of_u = max((row[0] for row in moved if not math.isnan(row[0])), default=0.0)
        numbers = sum(is_number(value) for _, value, _ in flat(document))
        extent = f"{worst:.1e} relative, {of_u:.1e} u" if moved else "none"
        print(
            f"{name:<20} {numbers:6d} numbers, {len(moved)} moved ({extent}), "
            f"{len(others)} other differences, {words} texts reworded"
        )
        for line in others[:most]:
            print(f"    {line}")
        for in_u, relative, line in moved[:most]:
            print(f"    {in_u:8.1e} u {relative:8.1e} {line}")
    return same


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("action", choices=["write", "compare"])
    parser.add_argument("file", type=Path)
    parser.add_argument("--quick", action="store_true", help="leave out what takes minutes")
    parser.add_argument("--most", type=int, default=20, help="lines of each document [default: 20]")
    asked = parser.parse_args()
    if asked.action == "write":
        with tempfile.TemporaryDirectory() as folder:
            inputs = make_inputs(Path(folder))
        baseline = {"inputs": inputs, "documents": measured(inputs, asked.quick)}
        asked.file.write_text(json.dumps(baseline), encoding="utf-8")
        return 0
    baseline = json.loads(asked.file.read_text(encoding="utf-8"))
    found = measured(baseline["inputs"], asked.quick)
    return int(not report(baseline["documents"], found, asked.most))


if __name__ == "__main__":
    sys.exit(main())
