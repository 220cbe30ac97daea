"""What is not YAML is reported in plain words, at its line and column."""

import pytest

from tests.document.documents import ANCHOR, Anything, problems, put, read

QUOTES = "put text that contains ': ' in quotes"

INDENT = f"a key cannot appear here; is it indented as its neighbours? {QUOTES}"

COLON = f"expected 'key: value'; is a colon missing, or an indentation? {QUOTES}"

TAG = "tags (!) are not supported; the type of a value follows from its form"

DIRECTIVE = "a line that begins with % is a directive, which documents do not support"

HEADER = "only +, - and an indentation from 1 to 9 may follow | or >"

WRONG = [
    ("", ["d.yaml: the document is empty"]),
    ("# nothing\n", ["d.yaml: the document is empty"]),
    ("---\n...\n", ["d.yaml:2:1: expected a mapping, got nothing"]),
    ("- a: 1\n", ["d.yaml:1:1: expected a mapping, got a list"]),
    ("a text\n", ["d.yaml:1:1: expected a mapping, got text"]),
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
    ("a: {<<: {b: 1}}\n", ["d.yaml:1:5: a: merge keys (<<) are not supported"]),
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
    ("a:\n  b: 1\n c: 2\n", ["d.yaml:3:2: the indentation of this line matches no other line of its mapping"]),
    ("a:\n  - b\n c: 2\n", ["d.yaml:3:2: the indentation of this line matches no other line of its mapping"]),
    ("a:\n  - b:\n   c: 2\n", ["d.yaml:3:4: the indentation of this line matches no other line of its list"]),
    ("a: 1\nb\nc: 2\n", [f"d.yaml:2:1: {COLON}"]),
    ("a: - b\n", ["d.yaml:1:4: a list cannot begin here; write each '- …' on a separate line"]),
    ("a: ? b\n", ["d.yaml:1:4: a key cannot appear here"]),
    ("a: @b\n", ["d.yaml:1:4: put text that begins with '@' in quotes"]),
    ("a: `b\n", ["d.yaml:1:4: put text that begins with '`' in quotes"]),
    ("a: %b\n", ["d.yaml:1:4: put text that begins with '%' in quotes"]),
    ("a: [1, 2\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: {b: [1]\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: [\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: [1\nb: 2\n", ["d.yaml:2:2: expected ',' or ']'; the bracket opens in line 1"]),
    ("a: {b: 1} }\n", ["d.yaml:1:11: the indentation of this line matches no other line of its mapping"]),
    ("a: ]\n", ["d.yaml:1:4: a value is missing before this"]),
    ("a: [1, , 2]\n", ["d.yaml:1:8: a value is missing before this"]),
    ("a: {b: ${c}}\n", ["d.yaml:1:9: within [ ] and { }, put text that contains ${ in quotes"]),
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
    ("a: b\0c\n", [r"d.yaml:1:5: '\x00' (U+0000) is not allowed; write it as an escape in double quotes"]),
    ("a: \x1b[2J", [r"d.yaml:1:4: '\x1b' (U+001B) is not allowed; write it as an escape in double quotes"]),
    ("a: b\u2028c", [r"d.yaml:1:5: '\u2028' (U+2028) is not allowed; write it as an escape in double quotes"]),
    ("a: b\ufeff", [r"d.yaml:1:5: '\ufeff' (U+FEFF) is not allowed; write it as an escape in double quotes"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), WRONG)
def test_what_is_no_document_is_reported_at_its_line_and_column(text: str | bytes, lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Anything)) == lines
