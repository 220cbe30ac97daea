"""Comments that suppress findings: the element on their line or the next one, with everything inside, or a file."""

from pathlib import Path

import pytest

from tests.check.models import checked, codes, write

REVERSED = '<joint name="{}" type="slide" range="{} 1"/>'  # each its own range, as equal findings are merged


def model(*lines: str, after: str = "") -> str:
    """A model whose world holds `lines` from line 3 on: bodies `a` and `b`, each with a reversed range."""
    return "\n".join(["<mujoco>", "<worldbody>", *lines, "</worldbody>", after, "</mujoco>"])


def body(name: str, comment: str = "") -> str:
    """Four lines: a body, its joint with a reversed range and a comment, and its geom."""
    position = 9 * ord(name)
    joint = REVERSED.format(name, position)
    return f'<body name="{name}" pos="{position} 0 0">\n{joint} {comment}\n<geom name="{name}" size="1"/>\n</body>'


IGNORE = "<!-- mjrun: ignore MJ302 the range is a label -->"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


CASES = [
    ([body("a"), body("b")], ["MJ302:4", "MJ302:8"], 0),
    ([body("a", IGNORE), body("b")], ["MJ302:8"], 1),
    ([IGNORE, body("a"), body("b")], ["MJ302:9"], 1),
    ([body("a"), IGNORE, body("b")], ["MJ302:4"], 1),
    ([body("a", "<!-- mjrun: ignore mj1,MJ3 -->"), body("b")], ["MJ302:8"], 1),
    ([body("a", "<!-- mjrun: ignore-file MJ302 -->"), body("b")], [], 2),
    ([body("a", "<!-- another comment -->"), body("b")], ["MJ302:4", "MJ302:8"], 0),
    ([body("a", IGNORE.replace("302", "503")), body("b")], ["MJ302:4", "MJ302:8", "MJ006:4"], 0),
    ([body("a", "<!-- mjrun: ignore -->"), body("b", IGNORE)], ["MJ302:4", "MJ006:4"], 1),
    ([body("a", "<!-- mjrun: ignore MJ999 -->"), body("b", IGNORE)], ["MJ302:4", "MJ006:4"], 1),
    ([body("a"), body("b"), IGNORE], ["MJ302:4", "MJ302:8", "MJ006:11"], 0),
]


def test_a_comment_suppresses_the_findings_that_it_concerns() -> None:
    models = [write(f"{index}.xml", model(*lines)) for index, (lines, _, _) in enumerate(CASES)]
    results = checked(*models, steps=0, ignore="MJ1").models
    for result, (lines, expected, suppressed) in zip(results, CASES, strict=True):
        assert [f"{finding.code}:{finding.line}" for finding in result.findings] == expected, lines
        assert result.suppressed == suppressed, lines


def test_a_comment_is_not_called_unused_by_a_check_that_omits_its_rules() -> None:
    text = model('<geom name="g" size="1"/>', after="<!-- mjrun: ignore-file MJ7 -->")
    assert [
        codes(checked(write("model.xml", text), **options).models[0]) for options in ({"steps": 0}, {"select": "MJ3"})
    ] == [[], []]
    assert codes(checked("model.xml", steps=1).models[0]) == ["MJ006"]


def test_comments_of_an_included_file_concern_that_file() -> None:
    write("part.xml", f"<mujocoinclude>\n{body('a', '<!-- mjrun: ignore-file MJ302 -->')}\n</mujocoinclude>")
    (result,) = checked(write("model.xml", model('<include file="part.xml"/>', body("b"))), steps=0).models
    assert [(finding.code, finding.file, finding.line) for finding in result.findings] == [("MJ302", "model.xml", 5)]


def test_every_finding_counts_for_a_comment_even_beyond_those_that_are_shown() -> None:
    """Of many findings of a rule, only the first are shown one by one."""
    bodies = [body(chr(ord("A") + index), IGNORE if index > 20 else "") for index in range(26)]
    (result,) = checked(write("model.xml", model(*bodies)), steps=0).models
    assert result.suppressed == 5
    assert "MJ006" not in codes(result)


def test_errors_that_prevent_a_model_from_loading_are_not_suppressed() -> None:
    text = model("<!-- mjrun: ignore-file MJ104 -->", '<geom siez="1"/>')
    assert codes(checked(write("model.xml", text)).models[0]) == ["MJ104"]
