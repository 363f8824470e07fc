from __future__ import annotations

import pytest

from ballscrew.base.errors import InputError
from ballscrew.base.tomlfile import Fields, read_toml


def fields(text: str, tmp_path) -> Fields:
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    return read_toml(tmp_path / "a.toml")


def test_a_table(tmp_path):
    top = fields('name = "x"\nn = 3\n[part]\nlead = "10 mm"\n[[row]]\na = 1\n[[row]]\na = 2\n', tmp_path)
    assert top.text("name") == "x"
    assert top.whole("n") == 3
    assert top.sub("part").quantity("lead", "m") == pytest.approx(0.01)
    assert [row.whole("a") for row in top.subs("row")] == [1, 2]
    assert "name" in top
    assert "none" not in top


def test_a_flag(tmp_path):
    top = fields("yes = true\nno = false\n", tmp_path)
    assert top.flag("yes") is True
    assert top.flag("no") is False
    assert top.flag("no", True) is False
    assert top.flag("yes", None) is True


def test_defaults(tmp_path):
    top = fields("", tmp_path)
    assert top.text("a", "d") == "d"
    assert top.text("a", None) is None
    assert top.whole("a", 7) == 7
    assert top.quantity("a", "m", 0.5, least=1) == 0.5
    assert top.quantities("a", "m", None) is None
    assert top.sub("a", required=False).table == {}
    assert list(top.subs("a")) == []
    assert top.flag("a", False) is False
    assert top.flag("a", None) is None


MESSAGES = [
    ("", lambda t: t.text("name"), "a.toml: name is missing; it must be a text."),
    ("name = 3", lambda t: t.text("name"), "a.toml: name is 3; it must be a text."),
    ('name = " "', lambda t: t.text("name"), "a.toml: name is ' '; it must be a text."),
    ('s = "x"', lambda t: t.text("s", choices=("a", "b")), "a.toml: s is 'x'; it must be one of a, b."),
    ("n = true", lambda t: t.whole("n"), "a.toml: n is True; it must be a whole number, 0 or more."),
    ("n = 1.0", lambda t: t.whole("n"), "a.toml: n is 1.0; it must be a whole number, 0 or more."),
    ("n = 0", lambda t: t.whole("n", least=1), "a.toml: n is 0; it must be a whole number, 1 or more."),
    ("", lambda t: t.flag("f"), "a.toml: f is missing; it must be true or false."),
    ("f = 1", lambda t: t.flag("f"), "a.toml: f is 1; it must be true or false."),
    ('f = "true"', lambda t: t.flag("f", False), "a.toml: f is 'true'; it must be true or false."),
    ("[p]", lambda t: t.sub("p").text("q"), "a.toml: p.q is missing; it must be a text."),
    ("", lambda t: t.sub("p"), "a.toml: [p] is missing; it must be a table."),
    ("p = 3", lambda t: t.sub("p"), "a.toml: p is 3; it must be a table."),
    ("p = 3", lambda t: t.subs("p"), "a.toml: p is 3; it must be a list of tables, each headed [[p]]."),
    ("p = [3]", lambda t: t.subs("p"), "a.toml: p[0] is 3; it must be a table."),
    (
        "x = -1",
        lambda t: t.quantity("x", "m", above=0, most=2),
        "a.toml: x is -1; it must be a number with a unit that converts to m, more than 0 and 2 or less.",
    ),
    (
        "x = 0",
        lambda t: t.quantity("x", "", above=0),
        "a.toml: x is 0; it must be a plain number, more than 0.",
    ),
    (
        'x = "3 kg"',
        lambda t: t.quantity("x", "m", least=0),
        (
            "a.toml: x is '3 kg'; it must be a number with a unit that converts to m, 0 or more "
            "(the unit 'kg' is not one that can be turned into m)."
        ),
    ),
    (
        "x = nan",
        lambda t: t.quantity("x", "m"),
        "a.toml: x is nan; it must be a number with a unit that converts to m (nan is not a finite number).",
    ),
    (
        "x = true",
        lambda t: t.quantity("x", "m"),
        (
            "a.toml: x is True; it must be a number with a unit that converts to m "
            "(True is not a number with a unit, such as '10 m')."
        ),
    ),
    (
        "x = []",
        lambda t: t.quantities("x", "kg"),
        "a.toml: x is []; it must be a list, each a number with a unit that converts to kg.",
    ),
    (
        'x = ["1 kg", "-1 kg"]',
        lambda t: t.quantities("x", "kg", least=0),
        (
            "a.toml: x is ['1 kg', '-1 kg']; it must be a list, "
            "each a number with a unit that converts to kg, 0 or more."
        ),
    ),
    (
        "nmae = 3",
        lambda t: t.only(("name", "n")),
        "a.toml: nmae is not a known field; known are name, n.",
    ),
]


@pytest.mark.parametrize(("text", "read", "message"), MESSAGES)
def test_every_error_names_file_field_given_and_allowed(tmp_path, text, read, message):
    with pytest.raises(InputError) as error:
        read(fields(text, tmp_path))
    assert str(error.value) == message


HOSTILE = {
    "not toml": b"screw lead 3",
    "utf-16 without a mark": "name = 'x'".encode("utf-16-le"),
    "binary": bytes(range(256)),
    "nested": b"a=" + b"[" * 100_000,
    "many digits": b"a=" + b"9" * 100_000,
    "twice": b"a = 1\na = 2\n",
    "large": b"#" * (1 << 20) + b"\n",
}


@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_files(tmp_path, content):
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.toml") as error:
        read_toml(tmp_path / "a.toml")
    assert len(str(error.value)) < 500


@pytest.mark.parametrize("name", ["none.toml", ".", "a\x00b"])
def test_a_path_that_cannot_be_read(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        read_toml(tmp_path / name)


def test_a_byte_order_mark_is_not_in_the_way(tmp_path):
    (tmp_path / "a.toml").write_text('name = "x"', encoding="utf-8-sig")
    assert read_toml(tmp_path / "a.toml").text("name") == "x"


def test_a_path_of_windows_in_double_quotes_is_explained(tmp_path):
    (tmp_path / "a.toml").write_text('axis = "C:\\Users\\x"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"A path with \\ needs single quotes, or / in its place\."):
        read_toml(tmp_path / "a.toml")
