"""Theorems about references to nothing."""

from pathlib import Path

import pytest

from tests.check.models import FINE, PARENT, Case, attached_arm, hinged, lint, mjcf

CASES = [
    Case("MJ109", hinged(after='<sensor><jointpos joint="jj"/></sensor>'), 10, "(did you mean 'j'?)", FINE),
    Case("MJ109", mjcf('<geom class="c" size="1"/>'), 4, "unknown default class name 'c'", FINE),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()


@pytest.mark.parametrize(
    ("parent", "line", "message", "remedy"),
    [
        (
            PARENT.replace('model="arm"', 'model="arn"'),
            6,
            "could not find model 'arn' (did you mean 'arm'?)",
            "write 'arm'",
        ),
        (
            PARENT.replace('model="arm"', 'model="x"'),
            6,
            "could not find model 'x'",
            "names of kind model: arm",
        ),
        (
            PARENT.replace('body="arm"', 'body="amr"'),
            6,
            "could not find body 'amr' in model asset 'arm' (did you mean 'arm'?)",
            "write 'arm'",
        ),
    ],
)
def test_what_cannot_be_attached_is_told_with_what_can(parent: str, line: int, message: str, remedy: str) -> None:
    Path("sub").mkdir()
    Path("sub/arm.xml").write_text(attached_arm())
    (finding,) = lint(parent)
    assert (finding.code, finding.file, finding.line) == ("MJ109", "model.xml", line)
    assert (finding.message, finding.remedy) == (message, remedy)


@pytest.mark.parametrize(
    ("body", "line", "message", "remedy"),
    [
        (
            '<camera/><body name="q"/>\n<camera mode="targetbody" target="Q"/>',
            5,
            "unknown target body in camera: 'Q' (did you mean 'q'?)",
            "write 'q'",
        ),
        (
            '<body name="q"/>\n<light mode="targetbody" target="none"/>',
            5,
            "unknown target body in light: 'none'",
            "names of kind body: q",
        ),
        (
            '<body name="b">\n<body childclass="smal"/></body>',
            5,
            "unknown default childclass: 'smal' (did you mean 'small'?)",
            "write 'small'",
        ),
    ],
)
def test_a_name_that_mujoco_does_not_tell_is_found(body: str, line: int, message: str, remedy: str) -> None:
    default = '<default><default class="small"/></default>'
    part = Path("part.xml")
    part.write_text(f"<mujocoinclude>\n\n\n{body}\n</mujocoinclude>")
    texts = {"model.xml": mjcf(body, before=default), "part.xml": mjcf('<include file="part.xml"/>', before=default)}
    for file, text in texts.items():
        (finding,) = lint(text)
        assert (finding.code, finding.file, finding.line) == ("MJ109", file, line)
        assert (finding.message, finding.remedy) == (message, remedy)
