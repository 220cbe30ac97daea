"""What is read from a document is what YAML 1.2 says, and what is wrong with one is told all at once, at its place."""

import json
import math
import os
import re
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, Field

from mjrun.document import variables, yaml_parser
from mjrun.document.document_model import DocumentModel, Maybe, Name, Positive
from mjrun.document.reader import LARGEST, read
from mjrun.errors import DocumentError, FileError, clean


class Anything(BaseModel):
    """A document that says one thing, whatever it is."""

    a: Any


class Film(DocumentModel):
    """A part of a document."""

    fps: Positive = 60.0
    """Frames per second."""
    title: Maybe[str] = None
    """A text."""


class Run(DocumentModel):
    """A document as the ones to come will be."""

    duration: Positive = 1.0
    """How long [s]."""
    steps: Maybe[int] = None
    """How many."""
    model: Name = "m.xml"
    """A file."""
    films: list[Film] = Field([])
    """Films."""
    start: dict[str, float] = Field({})
    """Numbers by name."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that relative paths mean."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(text: str | bytes, name: str = "d.yaml") -> Path:
    path = Path(name)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def problems(action: Callable[[], object]) -> list[str]:
    """The lines of the error that `action` ends in."""
    with pytest.raises(DocumentError) as caught:
        action()
    return str(caught.value).splitlines()


def outcome(action: Callable[[], object]) -> object:
    """What `action` gives, or the error that it may end in."""
    try:
        return action()
    except (DocumentError, FileError) as error:
        return error


# --- what words mean ---------------------------------------------------------------------------------

SCALARS = [
    ("", None), ("~", None), ("null", None), ("Null", None), ("NULL", None), ("nuLL", "nuLL"),
    ("true", True), ("True", True), ("TRUE", True), ("false", False), ("False", False), ("FALSE", False),
    ("tRue", "tRue"), ("yes", "yes"), ("no", "no"), ("on", "on"), ("off", "off"), ("y", "y"), ("No", "No"),
    ("0", 0), ("010", 10), ("-7", -7), ("+7", 7), ("0o17", 15), ("0x1F", 31), ("0xfg", "0xfg"), ("0o8", "0o8"),
    ("-0x1F", "-0x1F"), ("0b11", "0b11"), ("1_000", "1_000"), ("1,000", "1,000"), ("09", 9), ("１", "１"),
    ("1.5", 1.5), ("1.", 1.0), (".5", 0.5), ("-.5", -0.5), ("1e-3", 1e-3), ("1E3", 1000.0), ("1e+3", 1000.0),
    ("+1.e2", 100.0), ("1e", "1e"), ("e3", "e3"), (".", "."), ("1.5.2", "1.5.2"), ("1_0.5", "1_0.5"),
    (".inf", math.inf), ("-.inf", -math.inf), ("+.INF", math.inf), (".Inf", math.inf), ("inf", "inf"),
    ("-inf", "-inf"), ("nan", "nan"), ("infinity", "infinity"), ("-.nan", "-.nan"), ("1e400", math.inf),
    ("12:30:00", "12:30:00"), ("1:30", "1:30"), ("190:20:30.15", "190:20:30.15"), ("2001-12-14", "2001-12-14"),
    ("2001-12-14t21:59:43.10-05:00", "2001-12-14t21:59:43.10-05:00"), ("=", "="), ("<<", "<<"),
    ("'5'", "5"), ('"true"', "true"), ("''", ""), ("'~'", "~"), ("'it''s'", "it's"), (r'"\x41\u00e9\n\0"', "Aé\n\0"),
    ("speed(box) > 0.02", "speed(box) > 0.02"), ("a#b", "a#b"), ("a # b", "a"), ("a:b", "a:b"), ("C:/x", "C:/x"),
    ("${x}", "${x}"), ("日本 🚗", "日本 🚗"), ("|\n  a\n  b", "a\nb\n"), (">-\n  a\n  b", "a b"),
    ("[1, .5, no, 010]", [1, 0.5, "no", 10]), ("{b: 1, 'c': [], d: }", {"b": 1, "c": [], "d": None}),
    ('{"b": 1,"c":[true,null]}', {"b": 1, "c": [True, None]}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "value"), SCALARS)
def test_a_word_means_what_the_core_schema_of_yaml_1_2_says(text: str, value: object) -> None:
    found = read(put(f"a: {text}\n"), Anything).a
    assert found == value
    assert type(found) is type(value)


def test_nan_is_written_with_a_dot() -> None:
    assert math.isnan(read(put("a: .nan"), Anything).a)


def test_an_integer_of_more_digits_than_any_float_is_infinite() -> None:
    assert read(put("a: " + "9" * 5000), Anything).a == math.inf
    assert read(put("a: 0x" + "f" * 5000), Anything).a == math.inf
    assert read(put("a: -" + "9" * 300), Anything).a == -int("9" * 300)


@given(st.floats(allow_nan=False) | st.integers(-(10**300), 10**300))
@settings(max_examples=200, deadline=None)
def test_a_number_comes_back_as_it_was_printed(value: float) -> None:
    text = {"inf": ".inf", "-inf": "-.inf"}.get(repr(value), repr(value))
    found = read(put(f"a: {text}"), Anything).a
    assert (found, type(found)) == (value, type(value))
    assert math.copysign(1, found) == math.copysign(1, value)


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False)
    | st.text("aé 0.-:#'\"\n\t\\"),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("abc0 :-", max_size=3), inner, max_size=4),
    max_leaves=12,
)


@given(values)
@settings(max_examples=200, deadline=None)
def test_json_is_read_as_json(value: object) -> None:
    text = json.dumps({"a": value}, ensure_ascii=False).replace("Infinity", ".inf")
    assert read(put(text), Anything).a == value


def block(value: object, indent: str = "") -> str:
    """`value` in YAML's block style, with its single values as in JSON."""
    if isinstance(value, dict) and value:
        return "".join(f"\n{indent}{json.dumps(key)}:{block(inner, indent + '  ')}" for key, inner in value.items())
    if isinstance(value, list) and value:
        return "".join(f"\n{indent}-{block(inner, indent + ' ')}" for inner in value)
    return " " + json.dumps(value, ensure_ascii=False).replace("Infinity", ".inf")


@given(values)
@settings(max_examples=200, deadline=None)
def test_lines_that_are_indented_are_read_as_what_is_in_brackets(value: object) -> None:
    assert read(put(block({"a": value})), Anything).a == value


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_line_ends_as_on_any_system_and_a_mark_of_byte_order_is_no_text(end: str) -> None:
    text = "\ufeff# a comment\nduration: 2\nfilms:\n- fps: -1\n".replace("\n", end)
    assert problems(lambda: read(put(text), Run)) == ["d.yaml:4:8: films[0].fps: expected a positive number, got -1"]


def test_a_document_may_begin_by_saying_that_it_is_yaml_1_2() -> None:
    assert read(put("%YAML 1.2\n---\na: no\n...\n"), Anything).a == "no"


# --- what is no document -----------------------------------------------------------------------------

QUOTES = "text that holds ': ' goes in quotes"
INDENT = f"a key cannot stand here; is it indented as its neighbours? {QUOTES}"
COLON = f"expected 'key: value'; is a colon missing, or an indentation? {QUOTES}"
ANCHOR = "anchors (&) and aliases (*) are not taken; text that begins so goes in quotes"
TAG = "tags (!) are not taken; a value's form says what it is"
DIRECTIVE = "a line that begins with % is a directive, and documents have none"
HEADER = "after | or > may stand +, - and an indentation from 1 to 9, no more"

WRONG = [
    ("", ["d.yaml: the document is empty"]),
    ("# nothing\n", ["d.yaml: the document is empty"]),
    ("---\n...\n", ["d.yaml:2:1: expected a mapping, got nothing"]),
    ("- a: 1\n", ["d.yaml:1:1: expected a mapping, got a list"]),
    ("a text\n", ["d.yaml:1:1: expected a mapping, got 'a text'"]),
    ("a: 1\na: 2\n", ["d.yaml:2:1: 'a' is given twice; first in line 1"]),
    ("a: 1\n'a': 2\n", ["d.yaml:2:1: 'a' is given twice; first in line 1"]),
    ("a: {b: 1, b: 2, b: 3}", ["d.yaml:1:11: a: 'b' is given twice; first in line 1",
                               "d.yaml:1:17: a: 'b' is given twice; first in line 1"]),
    ("a: &x 1\n", [f"d.yaml:1:4: a: {ANCHOR}"]),
    ("a: *x\n", [f"d.yaml:1:4: a: {ANCHOR}"]),
    ("a: [&x 1, *x]\n", [f"d.yaml:1:5: a[0]: {ANCHOR}", f"d.yaml:1:11: a[1]: {ANCHOR}"]),
    ("a: &\n", [f"d.yaml:1:4: {ANCHOR}"]),
    ("a: *\n", [f"d.yaml:1:4: {ANCHOR}"]),
    ("a: !!str 5\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: ! 5\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: !x 5\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: !!python/object/apply:os.system [ls]\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: !y!x 5\n", [f"d.yaml:1:4: {TAG}"]),
    ("a: !<x\n", [f"d.yaml:1:4: {TAG}"]),
    ("a: {<<: {b: 1}}\n", ["d.yaml:1:5: a: merge keys (<<) are not taken"]),
    ("a: 1\n1: 2\n", ["d.yaml:2:1: a key is text; 1 as text goes in quotes"]),
    ("a: {true: 2, ~: 3}\n", ["d.yaml:1:5: a: a key is text; true as text goes in quotes",
                              "d.yaml:1:14: a: a key is text; ~ as text goes in quotes"]),
    ("a: 1\n? [b]\n: 2\n", ["d.yaml:2:3: a key is text, not a list"]),
    ("a: 1\n? {b: 1, b: 2}\n: 2\n", ["d.yaml:2:3: a key is text, not a mapping",
                                     "d.yaml:2:10: 'b' is given twice; first in line 2"]),
    ('a: {"b\\0": 1}\n', [r"d.yaml:1:5: a: a key with control characters, 'b\x00'"]),
    ("a: 1\n---\na: 2\n", ["d.yaml:2:1: a second document begins here, and a file holds one"]),
    ("a: 1\n...\nb\n", ["d.yaml:3:1: the document ends before this"]),
    ("{a: 1} b\n", ["d.yaml:1:8: the document ends before this"]),
    ("%YAML 1.1\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("%YAML 3.0\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("%TAG ! x\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("%YAML x\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("a:\n\tb: 1\n", ["d.yaml:2:1: a tab; YAML is indented and spaced by spaces"]),
    ("a:\tb\n", ["d.yaml:1:3: a tab; YAML is indented and spaced by spaces"]),
    ("a: b: c\n", [f"d.yaml:1:5: {INDENT}"]),
    ("a: 1\n  b: 2\n", [f"d.yaml:2:4: {INDENT}"]),
    ("a:\n  b: 1\n c: 2\n", ["d.yaml:3:2: this line is indented like no other of its mapping"]),
    ("a:\n  - b\n c: 2\n", ["d.yaml:3:2: this line is indented like no other of its mapping"]),
    ("a:\n  - b:\n   c: 2\n", ["d.yaml:3:4: this line is indented like no other of its list"]),
    ("a: 1\nb\nc: 2\n", [f"d.yaml:2:1: {COLON}"]),
    ("a: - b\n", ["d.yaml:1:4: a list cannot begin here; write '- …' on lines of its own"]),
    ("a: ? b\n", ["d.yaml:1:4: a key cannot stand here"]),
    ("a: @b\n", ["d.yaml:1:4: text that begins with '@' goes in quotes"]),
    ("a: `b\n", ["d.yaml:1:4: text that begins with '`' goes in quotes"]),
    ("a: %b\n", ["d.yaml:1:4: text that begins with '%' goes in quotes"]),
    ("a: [1, 2\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: {b: [1]\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: [\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: [1\nb: 2\n", ["d.yaml:2:2: expected ',' or ']'; the bracket opens in line 1"]),
    ("a: {b: 1} }\n", ["d.yaml:1:11: this line is indented like no other of its mapping"]),
    ("a: ]\n", ["d.yaml:1:4: a value is missing before this"]),
    ("a: [1, , 2]\n", ["d.yaml:1:8: a value is missing before this"]),
    ("a: {b: ${c}}\n", ["d.yaml:1:9: within [ ] and { } text with ${ goes in quotes"]),
    ("a: 'b\n", ["d.yaml:1:4: this quote is not closed"]),
    ('a: "b\n---\n', ["d.yaml:1:4: this quote is not closed"]),
    ('a: "\\q"\n', ["d.yaml:1:6: no escape \\q in double quotes; in single quotes \\ is itself"]),
    ('a: "it\\\'s"\n', ["d.yaml:1:8: no escape \\' in double quotes; in single quotes \\ is itself"]),
    ("%TAG !e! {\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ('a: "\\xg"\n', ["d.yaml:1:7: this escape needs 2 hexadecimal digits"]),
    ('a: "\\U00110000"\n', ["d.yaml:1:7: this escape means no character"]),
    ('a: "\\ud800"\n', [r"d.yaml:1:4: a: the escape '\ud800' is half a character"]),
    ("a: |0\n  b\n", [f"d.yaml:1:5: {HEADER}"]),
    ("a: > b\n", [f"d.yaml:1:6: {HEADER}"]),
    (b"a: \xff\n", ["d.yaml:1:4: not UTF-8: the byte 0xff"]),
    (b"\xef\xbb\xbfb: 1\na: \xc3\xa9 \xe9\n", ["d.yaml:2:6: not UTF-8: the byte 0xe9"]),
    ("a: 1".encode("utf-16"), ["d.yaml:1:1: not UTF-8: the byte 0xff"]),
    ("a: b\0c\n", [r"d.yaml:1:5: '\x00' (U+0000) cannot stand in a document, but as an escape in double quotes"]),
    ("a: \x1b[2J", [r"d.yaml:1:4: '\x1b' (U+001B) cannot stand in a document, but as an escape in double quotes"]),
    ("a: b\u2028c", [r"d.yaml:1:5: '\u2028' (U+2028) cannot stand in a document, but as an escape in double quotes"]),
    ("a: b\ufeff", [r"d.yaml:1:5: '\ufeff' (U+FEFF) cannot stand in a document, but as an escape in double quotes"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), WRONG)
def test_what_is_no_document_is_told_at_its_line_and_column(text: str | bytes, lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Anything)) == lines


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("duration: 0\n", ["d.yaml:1:11: duration: expected a positive number, got 0"]),
        ("duration: '2'\n", ["d.yaml:1:11: duration: expected a number, got '2'"]),
        ("duration: yes\n", ["d.yaml:1:11: duration: expected a number, got 'yes'"]),
        ("duration: true\n", ["d.yaml:1:11: duration: expected a number, got true"]),
        ("duration:\n", ["d.yaml:1:10: duration: expected a number, got nothing"]),
        ("duration: [1]\n", ["d.yaml:1:11: duration: expected a number, got a list"]),
        ("duration: {}\n", ["d.yaml:1:11: duration: expected a number, got a mapping"]),
        ("duration: .nan\n", ["d.yaml:1:11: duration: expected a finite number, got .nan"]),
        ("duration: 1e999\n", ["d.yaml:1:11: duration: expected a finite number, got 1e999"]),
        ("steps: 2.0\n", ["d.yaml:1:8: steps: expected a whole number, got 2.0"]),
        ("model: 2\n", ["d.yaml:1:8: model: expected text, got 2; as text it goes in quotes, '2'"]),
        ("model: null\n", ["d.yaml:1:8: model: expected text, got null; as text it goes in quotes, 'null'"]),
        ("model: ''\n", ["d.yaml:1:8: model: expected text that is not empty, got ''"]),
        ("films: {}\n", ["d.yaml:1:8: films: expected a list, got a mapping"]),
        ("films:\n  - 5\n", ["d.yaml:2:5: films[0]: expected a mapping with fps, title, got 5"]),
        ("start: 5\n", ["d.yaml:1:8: start: expected a mapping, got 5"]),
        ("start: {knee: up}\n", ["d.yaml:1:15: start.knee: expected a number, got 'up'"]),
        (
            "durations: 2\n",
            ["d.yaml:1:1: unknown key 'durations' (did you mean 'duration'?); "
             "keys: duration, steps, model, films, start"],
        ),
        ("films: [{fsp: 2}]\n", ["d.yaml:1:10: films[0]: unknown key 'fsp' (did you mean 'fps'?); keys: fps, title"]),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_is_told_with_what_is_expected(text: str, lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Run)) == lines


def test_every_error_is_told_at_once_in_the_order_of_the_document() -> None:
    text = "steps: [1]\nfilms:\n  - fps: -1\n    fps: 2\n    1: 3\n  - *a\n  - titel: x\nduration: 0\n"
    assert problems(lambda: read(put(text), Run)) == [
        "d.yaml:1:8: steps: expected a whole number, got a list",
        "d.yaml:3:10: films[0].fps: expected a positive number, got -1",
        "d.yaml:4:5: films[0]: 'fps' is given twice; first in line 3",
        "d.yaml:5:5: films[0]: a key is text; 1 as text goes in quotes",
        f"d.yaml:6:5: films[1]: {ANCHOR}",
        "d.yaml:7:5: films[2]: unknown key 'titel' (did you mean 'title'?); keys: fps, title",
        "d.yaml:8:11: duration: expected a positive number, got 0",
    ]


def test_of_a_plain_pydantic_model_the_same_is_told_but_for_the_keys() -> None:
    class Inner(BaseModel, extra="forbid"):
        b: int

    class Outer(BaseModel, extra="forbid"):
        a: Inner

    assert problems(lambda: read(put("a: {c: 1}\n"), Outer)) == [
        "d.yaml:1:4: a: 'b' is missing",
        "d.yaml:1:5: a: unknown key 'c'",
    ]
    assert problems(lambda: read(put("a: 5\n"), Outer)) == ["d.yaml:1:4: a: expected a mapping, got 5"]


def test_very_many_errors_are_counted() -> None:
    lines = problems(lambda: read(put("".join(f"k{i}: 1\n" for i in range(70))), Run))
    assert len(lines) == 51
    assert lines[-1] == "… and 20 more problems"


def test_long_and_hostile_text_is_cut_and_cleaned() -> None:
    text = f'model: "{"x" * 100}\\e[2J"\n"\u202ekey": 1\nsteps: "\\u202e"\nduration: {"y" * 100}\n'
    found = problems(lambda: read(put(text), Run))
    assert [clean(line) for line in found] == found
    assert found[-1] == f"d.yaml:4:11: duration: expected a number, got '{'y' * 39}…'"
    assert "'\\u202ekey'" in found[0]


# --- files -------------------------------------------------------------------------------------------


def test_a_file_that_is_not_there_is_told_with_its_neighbours() -> None:
    put("a: 1", "shots.yaml")
    with pytest.raises(FileError, match=r"^shot\.yaml: no such file \(did you mean 'shots\.yaml'\?\)$"):
        read("shot.yaml", Anything)
    with pytest.raises(FileError, match=r"^shots\.yaml/x: no such file$"):
        read("shots.yaml/x", Anything)
    with pytest.raises(FileError, match=r"^a\\x00b: cannot be read: embedded null byte$"):
        read("a\0b", Anything)


def test_what_is_no_regular_file_is_refused_and_never_waited_for() -> None:
    Path("folder").mkdir()
    with pytest.raises(FileError, match=r"^folder: is a folder, not a document$"):
        read("folder", Anything)
    os.mkfifo("pipe")
    with pytest.raises(FileError, match=r"^pipe: is not a regular file$"):
        read("pipe", Anything)
    with pytest.raises(FileError, match=r"^/dev/zero: is not a regular file$"):
        read("/dev/zero", Anything)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        with pytest.raises(FileError, match=r"^socket: cannot be read: "):
            read("socket", Anything)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read anything")
def test_a_file_that_may_not_be_read_is_told() -> None:
    put("a: 1").chmod(0)
    with pytest.raises(FileError, match=r"^d\.yaml: cannot be read: Permission denied$"):
        read("d.yaml", Anything)


def test_a_file_that_fails_while_it_is_read_is_told() -> None:
    with pytest.raises(FileError, match=r"^/proc/self/mem: cannot be read: Input/output error$"):
        read("/proc/self/mem", Anything)


def test_refused_files_are_closed() -> None:
    Path("folder").mkdir()
    before = sorted(Path("/proc/self/fd").iterdir())
    for path in ("folder", "/dev/zero"):
        with pytest.raises(FileError):
            read(path, Anything)
    assert sorted(Path("/proc/self/fd").iterdir()) == before


def test_a_document_may_be_as_large_as_the_limits_and_no_larger(monkeypatch: pytest.MonkeyPatch) -> None:
    assert read(put("a: ".ljust(LARGEST, "x")), Anything).a == "x" * (LARGEST - 3)
    too_large = put("a: ".ljust(LARGEST + 1, "x"))
    assert problems(lambda: read(too_large, Anything)) == ["d.yaml: more than 1 MiB are no document for mjrun"]

    monkeypatch.setattr(yaml_parser, "NODES", 6)
    assert read(put("a: [1, 2, 3]"), Anything).a == [1, 2, 3]  # with the mapping, its key and the list
    assert problems(lambda: read(put("a: [1, 2, 3,\n 4]"), Anything)) == [
        "d.yaml:2:2: more than 6 values are no document for mjrun"
    ]


@pytest.mark.parametrize("opening", ["[", "{b: ", "? ", "- ", "{? ", "[b: "])
def test_values_within_each_other_have_a_limit_however_they_are_nested(opening: str) -> None:
    depth = 49
    assert read(put("a: " + "[" * depth + "]" * depth), Anything)
    (line,) = problems(lambda: read(put("a:\n  " + opening * 100_000), Anything))
    assert line.startswith("d.yaml:2:")
    assert line.endswith(": more than 50 lists and mappings within each other are no document for mjrun")


# --- key=value ---------------------------------------------------------------------------------------

WRITTEN = "duration: 2\nfilms:\n  - fps: 30\n  - {title: b}\nstart:\n"


@pytest.mark.parametrize(
    ("assignments", "expected"),
    [
        ([], {"duration": 2}),
        (["duration=3"], {"duration": 3}),
        (["duration=3", "duration=4"], {"duration": 4}),
        (["duration=1e-3"], {"duration": 1e-3}),
        (["steps=010"], {"steps": 10}),
        (["model=no"], {"model": "no"}),
        (["model='5'"], {"model": "5"}),
        (["model=a=b"], {"model": "a=b"}),
        (["films[0].fps=60"], {"films": [{"fps": 60}, {"title": "b"}]}),
        (["films[1].fps=60", "films[0]={title: a}"], {"films": [{"title": "a"}, {"fps": 60, "title": "b"}]}),
        (["films=[{fps: 1}, {fps: 2}]", "films[1].fps=3"], {"films": [{"fps": 1}, {"fps": 3}]}),
        (["start.knee=.5", "start.left hip=-1"], {"start": {"knee": 0.5, "left hip": -1}}),
        (["start={}"], {"start": {}}),
    ],
)
def test_a_setting_stands_over_what_is_written(assignments: list[str], expected: dict[str, Any]) -> None:
    written = {"duration": 2, "films": [{"fps": 30}, {"title": "b"}], "start": {}}
    path = put(WRITTEN.replace("start:", "start: {}") if not any("start" in a for a in assignments) else WRITTEN)
    assert read(path, Run, assignments) == Run.model_validate(written | expected)


PLACES = "is no place; write it as in duration, films[0].fps"


@pytest.mark.parametrize(
    ("assignment", "lines"),
    [
        ("duration", ["duration: write key=value"]),
        ("=5", [f"=5: '' {PLACES}"]),
        ("[0]=5", [f"[0]=5: '[0]' {PLACES}"]),
        ("a..b=5", [f"a..b=5: 'a..b' {PLACES}"]),
        ("films[-1].fps=5", [f"films[-1].fps=5: 'films[-1].fps' {PLACES}"]),
        ("films[0]fps=5", [f"films[0]fps=5: 'films[0]fps' {PLACES}"]),
        ("films[2].fps=5", ["films[2].fps=5: films has 2 items, counted from 0"]),
        ("filns[0].fps=5", ["filns[0].fps=5: there is no list 'filns' (did you mean 'films'?)"]),
        ("start[0]=5", ["start[0]=5: start is a mapping, not a list"]),
        ("films.fps=5", ["films.fps=5: films is a list and has no keys"]),
        ("duration.s=5", ["duration.s=5: duration is 2 and has no keys"]),
        ("films[0].fps.x=5", ["films[0].fps.x=5: films[0].fps is 30 and has no keys"]),
        ("duration=-1", ["duration=-1: expected a positive number, got -1"]),
        ("duration=", ["duration=: expected a number, got nothing"]),
        ("films[1].fps=x", ["films[1].fps=x: expected a number, got 'x'"]),
        ("films[1]={fps: x}", ["films[1]={fps: x}: films[1].fps: expected a number, got 'x'"]),
        (
            "durations=1",
            [
                "durations=1: unknown key 'durations' (did you mean 'duration'?); "
                "keys: duration, steps, model, films, start"
            ],
        ),
        ("duration=[1", ["duration=[1: this bracket is not closed"]),
        ("duration=a: 1", ["duration=a: 1: expected one value, [a list] or {a: mapping}"]),
        ("duration=- 1", ["duration=- 1: expected one value, [a list] or {a: mapping}"]),
        ("duration=&a 1", [f"duration=&a 1: {ANCHOR}"]),
        ("duration=1\n---\n2", [r"duration=1\n---\n2: a second document begins here, and a file holds one"]),
        (
            "model=\udcff",
            [r"model=\udcff: '\udcff' (U+DCFF) cannot stand in a document, but as an escape in double quotes"],
        ),
    ],
)
def test_a_setting_that_does_not_fit_is_told_as_it_was_given(assignment: str, lines: list[str]) -> None:
    path = put(WRITTEN.replace("start:", "start: {}"))
    assert problems(lambda: read(path, Run, [assignment])) == lines


def test_faults_of_the_document_come_before_those_of_settings_and_a_good_setting_mends_a_bad_value() -> None:
    path = put("duration: -1\nsteps: x\n")
    assert problems(lambda: read(path, Run, ["model=5", "nothing", "duration=2"])) == [
        "d.yaml:2:8: steps: expected a whole number, got 'x'",
        "model=5: expected text, got 5; as text it goes in quotes, '5'",
        "nothing: write key=value",
    ]


# --- vars and defaults -------------------------------------------------------------------------------


def resolved(text: str, *assignments: str) -> Any:
    return read(put(text), Anything, assignments, preamble=True).a


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a: ${x}", 0.5),
        ("a: '${x}'", 0.5),
        ("a: ${n}", "box"),
        ("a: ${t}", True),
        ("a: ${e}", None),
        ("a: v=${x}", "v=0.50"),
        ("a: ${x} ", 0.5),
        ("a: '${x} '", "0.50 "),
        ("a: ${n}${n}/${x}", "boxbox/0.50"),
        ("a: $${x}", "${x}"),
        ("a: $${x} is ${x}", "${x} is 0.50"),
        ("a: $x $ {x} $$ }", "$x $ {x} $$ }"),
        ("a: $$${x}", "$${x}"),
        ("a: ${d}", "${n}"),
        ("a: {b: [1, '${x}'], '${x}': 2}", {"b": [1, 0.5], "${x}": 2}),
        ("a: [5, '${n}x']", [5, "boxx"]),
    ],
)
def test_variables_stand_for_their_values(text: str, value: object) -> None:
    found = resolved(f"vars: {{x: 0.50, n: box, t: true, e: ~, d: '$${{n}}'}}\n{text}\n")
    assert found == value
    assert type(found) is type(value)


def test_a_setting_may_change_a_variable_use_one_and_make_the_first() -> None:
    assert resolved("vars: {x: 1}\na: ${x}", "vars.x=2") == 2
    assert resolved("vars: {x: 1}\na: 5", "a=[0, '${x}']") == [0, 1]
    assert resolved("a: ${x}", "vars.x=3") == 3


LETTERS = "is no name of letters, digits and _"


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        (
            "vars: {speed: 1}\na: ${sped}",
            ["d.yaml:2:4: a: no variable 'sped' (did you mean 'speed'?); vars: speed"],
        ),
        ("a: ['x ${y}']", ["d.yaml:1:5: a[0]: no variable 'y'; there are no vars"]),
        ("a: ${", ["d.yaml:1:4: a: ${ begins a variable, ${name}; ${ itself is written $${"]),
        ("a: ${x${y}}", ["d.yaml:1:4: a: ${ begins a variable, ${name}; ${ itself is written $${"]),
        ("vars: {x: 1, y: '${x}'}\na: ${y}", ["d.yaml:1:17: vars.y: variables do not refer to variables; "
                                              "${ itself is written $${"]),
        ("vars: {x: [1]}\na: ${x}", ["d.yaml:1:11: vars.x: expected a single value, got a list"]),
        ("vars: 5\na: 1", ["d.yaml:1:7: vars: expected a mapping of names to values, got 5"]),
        ("vars: {x y: 5}\na: 1", [f"d.yaml:1:8: vars: 'x y' {LETTERS}"]),
    ],
)  # fmt: skip
def test_a_variable_that_cannot_be_is_told_where_it_is_used(text: str, lines: list[str]) -> None:
    assert problems(lambda: resolved(text)) == lines


def test_what_a_variable_says_is_told_where_it_does_not_fit() -> None:
    path = put("vars: {d: long}\nduration: ${d}\nfilms: [{fps: '${e}'}]\n")
    assert problems(lambda: read(path, Run, preamble=True)) == [
        "d.yaml:2:11: duration: expected a number, got 'long' from ${d}",
        "d.yaml:3:15: films[0].fps: no variable 'e'; vars: d",
    ]


def test_variables_cannot_make_a_document_explode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variables, "LARGEST", 10)
    assert resolved("vars: {x: abcde}\na: '${x}${x}'") == "abcde" * 2
    (line,) = problems(lambda: resolved("vars: {x: abcde}\na: ['${x}${x}', '${x}!']"))
    assert line == "d.yaml:2:17: a[1]: variables make more than 10 characters"


def test_defaults_count_where_the_document_says_nothing() -> None:
    Path("below").mkdir()
    put(
        "duration: 5\nmodel: ${m}\nfilms: [{fps: 1}, {fps: 2}]\nstart: {knee: 1, hip: 2}\nvars: {m: a, n: b}\n",
        "below/d.yaml",
    )
    above = put(
        "defaults: d.yaml\nsteps: 3\nfilms: [{fps: 4}]\nstart: {hip: 3, toe: 4}\nvars: {m: c}\n", "below/e.yaml"
    )
    assert read(above, Run, ["start.toe=6"], preamble=True) == Run(
        duration=5, steps=3, model="c", films=[Film(fps=4)], start={"knee": 1, "hip": 3, "toe": 6}
    )  # fmt: skip


def test_what_is_wrong_in_defaults_is_told_in_their_own_lines_after_the_document() -> None:
    put("duration: -1\nmodel: ${m}\ndefaults: x.yaml\nstart: {knee: up, hip: up}\nfoo: 1\nstart: {}\n", "below.yaml")
    path = put("defaults: below.yaml\nsteps: x\nstart: {hip: 1}\n")
    keys = "keys: duration, steps, model, films, start, vars, defaults"
    assert problems(lambda: read(path, Run, preamble=True)) == [
        "d.yaml:2:8: steps: expected a whole number, got 'x'",
        "below.yaml:1:11: duration: expected a positive number, got -1",
        "below.yaml:2:8: model: no variable 'm'; there are no vars",
        "below.yaml:3:1: defaults have no defaults of their own",
        "below.yaml:4:15: start.knee: expected a number, got 'up'",
        f"below.yaml:5:1: unknown key 'foo'; {keys}",
        "below.yaml:6:1: 'start' is given twice; first in line 4",
    ]


def test_defaults_that_cannot_be_read_are_told_with_who_names_them() -> None:
    path = put("defaults: below.yaml\n")
    with pytest.raises(FileError) as caught:
        read(path, Run, preamble=True)
    assert str(caught.value) == "below.yaml: no such file\nd.yaml:1:11 names it as defaults"
    put("- 1\n", "below.yaml")
    assert problems(lambda: read(path, Run, preamble=True)) == ["below.yaml:1:1: expected a mapping, got a list"]


@pytest.mark.parametrize(
    ("text", "assignments", "lines"),
    [
        ("defaults: 5\n", [], ["d.yaml:1:11: defaults: expected the path of a document, got 5"]),
        ("defaults:\n", [], ["d.yaml:1:10: defaults: expected the path of a document, got nothing"]),
        ("defaults: ''\n", [], ["d.yaml:1:11: defaults: expected the path of a document, got ''"]),
        ("defaults: *a\n", [], [f"d.yaml:1:11: defaults: {ANCHOR}"]),
        ("steps: 1\n", ["defaults=x.yaml"], ["defaults=x.yaml: defaults is set in the document only"]),
    ],
)
def test_defaults_that_are_no_path_are_told(text: str, assignments: list[str], lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Run, assignments, preamble=True)) == lines


def test_a_document_without_a_preamble_has_neither_and_takes_texts_as_they_are() -> None:
    keys = "keys: duration, steps, model, films, start"
    assert read(put("model: ${x} $${\n"), Run).model == "${x} $${"
    assert problems(lambda: read(put("vars: {}\ndefaults: x\n"), Run)) == [
        f"d.yaml:1:1: unknown key 'vars'; {keys}",
        f"d.yaml:2:1: unknown key 'defaults'; {keys}",
    ]


# --- any text ----------------------------------------------------------------------------------------

WORDS = ["a", "b", "films", "fps", "vars", "defaults", "1", "-.5", ".nan", "1e999", "0x1F", "true", "~", "<<", "é", "="]
MARKS = [": ", ":", "- ", "\n", "\n  ", "\n    ", "[", "]", "{", "}", ", ", "? ", "&x", "*x", "!!str ", "!", "|", ">"]
ODD = [
    "'",
    '"',
    "\\",
    "\\ud800",
    "${a}",
    "${",
    "$${",
    "#",
    "%",
    "@",
    "---\n",
    "...",
    "\t",
    "\0",
    "\u2028",
    "\x85",
    "\r",
]
pieces = st.sampled_from([*WORDS, *MARKS, *ODD])


@given(st.text() | st.lists(pieces, max_size=30).map("".join), st.lists(st.text() | st.lists(pieces).map("".join)))
@example("films: [{fps: 1}]", ["films[99999999999999999999].fps=1"])
@example("films: [{fps: 1}]", ["\0number=1"])
@settings(max_examples=400, deadline=None)
def test_no_text_does_anything_but_be_read_or_be_told_what_is_wrong_with_it(text: str, assignments: list[str]) -> None:
    path = put(text.encode("utf-8", "surrogatepass"))
    for kind in (Run, Anything):
        found = outcome(lambda kind=kind: read(path, kind, assignments, preamble=True))
        if isinstance(found, DocumentError):
            assert found.problems
            assert str(found).splitlines() == [clean(line) for line in str(found).splitlines()]
        else:
            assert isinstance(found, kind) or "defaults" in str(found)


@given(st.binary())
@settings(max_examples=100, deadline=None)
def test_no_bytes_do_either(data: bytes) -> None:
    with pytest.raises(DocumentError):
        read(put(data + b"\xff"), Run)


@given(st.lists(pieces, max_size=20).map("".join))
@settings(max_examples=400, deadline=None)
def test_every_place_that_is_told_is_in_the_text(text: str) -> None:
    found = outcome(lambda: read(put(text), Anything))
    lines = re.split("\r\n|\r|\n", text)
    for problem in found.problems if isinstance(found, DocumentError) else ():
        if problem.place != "d.yaml":
            line, column = map(int, problem.place.split(":")[1:])
            assert 1 <= column <= len(lines[line - 1]) + 1
