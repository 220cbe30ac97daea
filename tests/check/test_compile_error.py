"""Theorems about the element that an error of MuJoCo's is about."""

from pathlib import Path

import mujoco
import pytest

from mjrun.check.compile_error import CompileError
from mjrun.check.rule import Rule
from mjrun.errors import BrokenModelError, option
from mjrun.model.sources import load
from mjrun.model.xml_source import XmlSource, read_xml
from tests.check.models import PARENT, attached_arm, mjcf, write

PLAIN = Rule("MJ999", "error", "a title")


def failing(text: str) -> CompileError:
    """The error of the model `text`."""
    path = Path(write("model.xml", text))
    with pytest.raises(BrokenModelError) as error:
        load(path)
    return CompileError.of(error.value, read_xml(path))


def test_the_message_is_that_of_mujoco_on_one_line() -> None:
    text = mjcf('<geom name="g" size="-1"/>')
    error = failing(text)
    with pytest.raises(ValueError) as raised:  # noqa: PT011
        mujoco.MjModel.from_xml_string(text)
    assert "\n" not in error.message
    assert error.text in str(raised.value)


@pytest.mark.parametrize(
    ("body", "line"),
    [
        ('<geom size="1"/>\n<geom name="g" size="-1"/>', 5),
        ('<geom size="1"/><geom name="g" type="box" size="1 -1 1"/>', 4),
        ('<geom size="1"/>\n<geom size="1" material="m"/>', 5),
    ],
)
def test_the_element_is_the_one_on_its_line(body: str, line: int) -> None:
    element = failing(mjcf(body)).element()
    assert element is not None
    assert (element.tag, element.line) == ("geom", line)


def test_in_an_included_file_whose_lines_mujoco_forgets_the_element_is_found_by_its_name() -> None:
    write("part.xml", '<mujocoinclude>\n<geom name="g" size="-1"/></mujocoinclude>')
    element = failing(mjcf('<include file="part.xml"/>')).element("g")
    assert element is not None
    assert (element.file, element.line) == (Path("part.xml"), 2)


def test_the_line_is_given_only_if_it_cannot_be_one_of_an_attached_model() -> None:
    assert failing(mjcf('<geom size="1" siez="1"/>')).place.line == 4
    Path("sub").mkdir()
    write("sub/arm.xml", attached_arm())
    assert failing(PARENT.replace('<geom size="1"/><site/>', '<geom size="1" siez="1"/><site/>')).place.line is None


def test_the_pattern_of_an_error_is_the_same_in_the_model_and_in_one_that_attaches_it() -> None:
    Path("sub").mkdir()
    arm = write("sub/arm.xml", attached_arm('mass="-1"'))
    with pytest.raises(BrokenModelError) as error:
        load(Path(arm))
    own = CompileError.of(error.value, read_xml(Path(arm)))
    assert own.pattern in failing(PARENT).pattern


def test_a_finding_is_in_the_element_and_without_one_at_the_place() -> None:
    error = failing(mjcf('<geom name="g" size="-1"/>'))
    assert error.finding(PLAIN, "m", "r").object == '<geom name="g">'
    unknown = error._replace(line=None)
    finding = unknown.finding(PLAIN, "m", "r", "no such value")
    assert (finding.object, finding.file, finding.line) == ("", "model.xml", None)


def test_advice_that_names_options_is_no_part_of_the_message() -> None:
    path = Path("model.xml")
    hint = f"{option('root')} chooses a folder"
    error = CompileError.of(BrokenModelError(path, "'x.stl' lies outside", 1, hint), XmlSource(path))
    assert (error.message, error.hint) == ("'x.stl' lies outside", hint)
