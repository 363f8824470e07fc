"""Compile the translations: ``python tests/translations.py`` writes each ``.mo`` from its ``.po``."""

from __future__ import annotations

import ast
import re
import struct
from pathlib import Path

LOCALE = Path(__file__).parent.parent / "src" / "ballscrew" / "locale"
_LINE = re.compile(r'(?:(msgctxt|msgid|msgid_plural|msgstr(?:\[\d\])?) )?(".*")')


def read_po(path: Path) -> dict[str, str]:
    """Translation of each message; keys and plural forms as in a ``.mo``."""
    messages: dict[str, str] = {}
    for number, entry in enumerate(path.read_text(encoding="utf-8").split("\n\n"), start=1):
        fields: dict[str, str] = {}
        field = ""
        for line in entry.splitlines():
            if not line or line.startswith("#"):
                continue
            match = _LINE.fullmatch(line)
            if match is None:
                raise ValueError(f"{path.name}, entry {number}: {line!r} is no line of a message.")
            field = match[1] or field
            fields[field] = fields.get(field, "") + ast.literal_eval(match[2])
        if not fields:
            continue
        key = fields["msgid"]
        if "msgctxt" in fields:
            key = f"{fields['msgctxt']}\4{key}"
        if "msgid_plural" in fields:
            key += "\0" + fields["msgid_plural"]
        if key in messages:
            raise ValueError(f"{path.name}: {key!r} occurs twice.")
        messages[key] = "\0".join(text for name, text in fields.items() if name.startswith("msgstr"))
    return messages


def compile_mo(messages: dict[str, str]) -> bytes:
    """Content of the ``.mo``: sorted, without messages that have no translation."""
    rows = sorted((key.encode(), text.encode()) for key, text in messages.items() if text.strip("\0"))
    place = 28 + 16 * len(rows)
    tables, texts = [], b""
    for column in (0, 1):
        for row in rows:
            tables.append(struct.pack("<II", len(row[column]), place + len(texts)))
            texts += row[column] + b"\0"
    head = struct.pack("<7I", 0x950412DE, 0, len(rows), 28, 28 + 8 * len(rows), 0, place)
    return head + b"".join(tables) + texts


def main() -> None:
    """Write all."""
    for path in sorted(LOCALE.rglob("*.po")):
        path.with_suffix(".mo").write_bytes(compile_mo(read_po(path)))


if __name__ == "__main__":
    main()
