"""Whatever a model does to the process that checks it is a finding like any other."""

import os
from pathlib import Path

import pytest

from tests.check.models import PASSIVE, checked, codes, write
from tests.processes import PATIENCE
from tests.study.models import DEADLY


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
