"""Size and complexity of the package: ``python tests/code_counts.py`` prints what the tests limit."""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from radon.complexity import cc_visit
from radon.visitors import Class

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "ballscrew"
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
PACKED = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp, ast.IfExp)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def module_name(path: Path) -> str:
    name = ".".join(("ballscrew", *path.relative_to(PACKAGE).with_suffix("").parts))
    return name.removesuffix(".__init__")


@cache
def modules() -> dict[str, Path]:
    return {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def docstring_lines(path: Path) -> set[int]:
    lines: set[int] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            text = node.body[0]
            lines.update(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return lines


def code_lines(path: Path) -> int:
    """Lines with code: no docstring, comment or blank line."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
        if token.type not in LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstring_lines(path))


def packed_per_100_statements() -> float:
    """Comprehensions and conditional expressions per 100 statements."""
    nodes = [node for path in modules().values() for node in ast.walk(tree(path))]
    statements = sum(isinstance(node, ast.stmt) for node in nodes)
    return 100 * sum(isinstance(node, PACKED) for node in nodes) / statements


def complexities() -> Iterator[tuple[int, str]]:
    """Cyclomatic complexity by radon, and place, of every function and method."""
    for path in modules().values():
        blocks = cc_visit(path.read_text(encoding="utf-8"))
        for block in blocks:
            if not isinstance(block, Class):
                yield block.complexity, f"{path.relative_to(PACKAGE).as_posix()}: {block.name}"


@cache
def imports() -> dict[str, set[str]]:
    """Modules of the package that each module imports, anywhere in the file."""
    known = modules()
    found: dict[str, set[str]] = {name: set() for name in known}
    for name, path in known.items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ballscrew"):
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    found[name].add(inner if inner in known else str(node.module))
        found[name].discard(name)
    return found


def single_importer_modules() -> list[str]:
    """Modules with exactly one importer, which lies in the same folder."""
    importers: dict[str, set[str]] = defaultdict(set)
    for name, imported in imports().items():
        for other in imported:
            importers[other].add(name)
    public = set(re.findall(r'": "([\w.]+)"', (PACKAGE / "__init__.py").read_text(encoding="utf-8")))
    found = []
    for name, path in modules().items():
        if path.name == "__init__.py" or name.removeprefix("ballscrew.") in public:
            continue
        if len(importers[name]) == 1:
            (importer,) = importers[name]
            if importer != "ballscrew" and modules()[importer].parent == path.parent:
                found.append(name)
    return found


def repeated_class_names() -> list[str]:
    nodes = [node for path in modules().values() for node in ast.walk(tree(path))]
    counts = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    return [name for name, count in counts.items() if count > 1]


def prose_words() -> int:
    """Words of the documentation outside tables, fenced blocks and generated pages."""
    count = 0
    for path in (ROOT / "docs").rglob("*.md"):
        if "_build" in path.parts or "api" in path.parts:
            continue
        fence = ""
        for line in path.read_text(encoding="utf-8").splitlines():
            text = line.strip()
            if fence:
                if text.startswith(fence) and set(text) <= set("`~:"):
                    fence = ""
            elif match := re.match(r"`{3,}|~{3,}", text):
                fence = match.group()
            elif not text.startswith("|"):
                count += len(text.split())
    return count


def main() -> None:
    found = list(complexities())
    rows = {
        "files": len(modules()),
        "lines": sum(len(path.read_text(encoding="utf-8").splitlines()) for path in modules().values()),
        "code lines": sum(map(code_lines, modules().values())),
        "functions with radon >= 11": sum(value >= 11 for value, _ in found),
        "highest radon": max(found),
        "comprehensions and ternaries per 100 statements": round(packed_per_100_statements(), 2),
        "modules with one importer in the same folder": len(single_importer_modules()),
        "class names used twice": repeated_class_names() or "none",
        "words of prose in docs": prose_words(),
    }
    for name, value in rows.items():
        sys.stdout.write(f"{name:<50} {value}\n")


if __name__ == "__main__":
    main()
