"""The help of every name of the API explains every option that it takes."""

import inspect
import re

import pytest

import mjrun
from mjrun.options.option import FrontEnd, Options, options_of
from mjrun.python_help import FUNCTIONS, OF_FILES, options_of_name

CLASSES = [name for name in mjrun._HOMES if name[0].isupper() and issubclass(getattr(mjrun, name), Options)]


def explained(name: str) -> list[str]:
    """Returns the names of the options that a docstring explains."""
    text = inspect.getdoc(getattr(mjrun, name)) or ""
    return re.findall(r"^  (\w+): \S", text.partition("\nOptions:\n")[2], re.MULTILINE)


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_explains_each_of_its_options_once(name: str) -> None:
    options = options_of(getattr(mjrun, name))
    wanted = sorted(each.attribute for each in options if FrontEnd.PYTHON in each.places)
    assert sorted(explained(name)) == wanted
    accepted = inspect.signature(getattr(mjrun, name)).parameters
    assert {*wanted} <= {*accepted}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_explains_each_of_its_options_once(name: str) -> None:
    assert sorted(explained(name)) == sorted(each.attribute for each in options_of_name(name))
    assert explained(name)


def test_units_defaults_and_choices_are_told_as_python_writes_them() -> None:
    text = " ".join((inspect.getdoc(mjrun.Video) or "").split())
    assert "speed: Simulated seconds per second of video; 0.25 is slow motion. [default: 1]" in text
    assert "layout: Arrangement of several views in one frame. One of row, column, grid. [default: 'row']" in text
    assert "output: mp4, mov, mkv, webm" in text
    assert "--" not in text
    assert {"duration", "probe"} <= {*explained("trace")}
    assert {*OF_FILES}.isdisjoint(explained("frames"))
    assert "Options:" not in (inspect.getdoc(mjrun.TraceResult) or "")
