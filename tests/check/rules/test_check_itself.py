"""Theorems about failures of the process that checks a model, and about comments that suppress findings."""

import os
from pathlib import Path

import pytest

from tests.check.models import PASSIVE, checked, codes, write
from tests.processes import PATIENCE
from tests.study.models import DEADLY

REVERSED = '<joint name="{}" type="slide" range="{} 1"/>'  # each its own range, as equal findings are merged


def circle() -> list[str]:
    """Two models that attach each other."""
    for own, other in ("ab", "ba"):
        attach = f'<attach model="m" prefix="x" body="{other}"/>'
        asset = f'<asset><model name="m" file="{other}.xml"/></asset>'
        write(f"{own}.xml", f'<mujoco>{asset}<worldbody><body name="{own}">{attach}</body></worldbody></mujoco>')
    return ["a.xml", "b.xml"]


def test_a_crash_is_a_finding_and_the_other_models_are_looked_at() -> None:
    result = checked(write("deadly.xml", DEADLY), write("fine.xml", PASSIVE.format("")))
    assert [model.loads for model in result.models] == [False, True]
    (crash,) = result.models[0].findings
    assert crash.code == "MJ002"
    assert crash.message == "its process was killed by SIGSEGV while loading it"
    assert result.code == 3


@pytest.mark.parametrize(("mistake", "code"), [('<option solver="x"/>', "MJ110"), ("<goem/>", "MJ102")])
@pytest.mark.slow
def test_a_circle_in_a_model_that_is_refused_is_told_first_and_then_why_it_is_refused(mistake: str, code: str) -> None:
    model, other = circle()
    write(model, Path(model).read_text().replace("<mujoco>", f"<mujoco>{mistake}"))
    (finding,) = checked(model).models[0].findings
    assert (finding.code, finding.file) == ("MJ113", other)
    assert "attaches this model again" in finding.message
    write(other, '<mujoco><worldbody><body name="b"/></worldbody></mujoco>')  # the circle is open
    assert codes(checked(model).models[0]) == [code]


def test_a_model_that_attaches_itself_is_told_where_it_does() -> None:
    asset = '<asset>\n<model name="me" file="self.xml"/></asset>'
    attach = '<attach model="me" prefix="x" body="b"/>'
    write("self.xml", f'<mujoco>{asset}<worldbody><body name="b">{attach}</body></worldbody></mujoco>')
    (model,) = checked("self.xml").models
    (finding,) = model.findings
    assert (finding.code, finding.line) == ("MJ113", 2)
    assert not model.loads


def test_a_pipe_among_the_files_is_told_and_nobody_waits_for_it() -> None:
    os.mkfifo("pipe.obj")
    write("model.xml", '<mujoco>\n<asset><mesh file="pipe.obj"/></asset></mujoco>')
    (model,) = checked("model.xml", timeout=PATIENCE).models
    assert not model.loads
    (finding,) = model.findings
    assert (finding.code, finding.line, finding.remedy) == ("MJ107", 2, "name a regular file")
    assert "'pipe.obj' is a named pipe" in finding.message


def test_a_pipe_for_a_model_is_refused_at_once() -> None:
    os.mkfifo("pipe.xml")
    (model,) = checked("pipe.xml").models
    assert codes(model) == ["MJ001"]
    assert model.findings[0].message == "is not a regular file"


def test_a_model_that_takes_too_long_is_a_finding() -> None:
    result = checked(write("fine.xml", PASSIVE.format("")), timeout=0.001)
    assert codes(result.models[0]) == ["MJ003"]
    assert result.code == 3


@pytest.mark.parametrize(
    "text",
    [
        '<asset><texture name="t" type="2d" builtin="flat" width="60000" height="60000"/></asset>',
        '<size memory="900G"/><worldbody><body><freejoint/><geom size="1"/></body></worldbody>',
    ],
    ids=["texture", "arena"],
)
def test_a_model_that_explodes_is_a_finding(text: str) -> None:
    result = checked(write("big.xml", f"<mujoco>{text}</mujoco>"), memory=300)
    assert codes(result.models[0]) == ["MJ004"]
    assert result.code == 3


def test_an_arena_that_is_large_and_not_filled_is_no_memory() -> None:
    text = PASSIVE.format("").replace("<mujoco>", '<mujoco><size memory="1G"/>')
    assert checked(write("wide.xml", text), memory=1200).code == 0


def model(*lines: str, after: str = "") -> str:
    """A model whose world holds `lines` from line 3 on: bodies `a` and `b`, each with a reversed range."""
    return "\n".join(["<mujoco>", "<worldbody>", *lines, "</worldbody>", after, "</mujoco>"])


def body(name: str, comment: str = "") -> str:
    """Four lines: a body, its joint with a reversed range and a comment, and its geom."""
    position = 9 * ord(name)
    joint = REVERSED.format(name, position)
    return f'<body name="{name}" pos="{position} 0 0">\n{joint} {comment}\n<geom name="{name}" size="1"/>\n</body>'


IGNORE = "<!-- mjrun: ignore MJ302 the range is a label -->"


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
