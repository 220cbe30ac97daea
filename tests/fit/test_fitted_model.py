"""The fitted model: the user's text, proved to be what was found."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from mjrun.errors import FileError, UsageError
from mjrun.fit.fitted_model import FittedModel
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.file import FileSource
from tests.fit.logs import write_model

FOUND = [Override("joint/hinge.damping", "0.04999999999999999")]


def test_the_text_keeps_its_comments_and_compiles_to_the_last_bit(tmp_path: Path) -> None:
    source = FileSource(write_model(tmp_path))
    fitted = FittedModel(tmp_path / "fitted.xml", source)
    fitted.check(FOUND)
    with ExitStack() as stack:
        output, (made,) = fitted.write(stack, FOUND)
        output.publish()
    assert made.sentence == "pendulum.xml:6: damping = 0.04999999999999999"
    text = (tmp_path / "fitted.xml").read_text()
    assert text == source.path.read_text().replace('damping="0.3"', 'damping="0.04999999999999999"')
    assert FileSource(tmp_path / "fitted.xml").load().dof_damping[0] == 0.04999999999999999
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fitted.xml", "pendulum.xml"]


def test_a_place_where_it_would_be_another_model_is_refused(tmp_path: Path) -> None:
    write_model(tmp_path)
    (tmp_path / "pendulum.xml").write_text(
        (tmp_path / "pendulum.xml").read_text().replace("<worldbody>", '<include file="more.xml"/><worldbody>', 1)
    )
    more = '<mujoco><worldbody><geom name="more" size="{}"/></worldbody></mujoco>'
    (tmp_path / "more.xml").write_text(more.format(0.1))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "more.xml").write_text(more.format(0.2))
    fitted = FittedModel(tmp_path / "elsewhere" / "fitted.xml", FileSource(tmp_path / "pendulum.xml"))
    with ExitStack() as stack, pytest.raises(FileError, match="would not be the fitted model"):
        fitted.write(stack, FOUND)
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["more.xml"]


def test_what_stands_in_an_included_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "main.xml").write_text('<mujoco><include file="pendulum.xml"/></mujoco>')
    write_model(tmp_path)
    with pytest.raises(UsageError, match=r"stands in pendulum\.xml, which .*main\.xml includes"):
        FittedModel(tmp_path / "fitted.xml", FileSource(tmp_path / "main.xml")).check(FOUND)


def test_it_is_xml_of_a_model_that_has_a_file(tmp_path: Path) -> None:
    source = FileSource(write_model(tmp_path))
    with pytest.raises(UsageError, match=r"a fitted model is an \.xml file"):
        FittedModel(tmp_path / "fitted.mjb", source).check(FOUND)
    model = parse_source(str(source.path)).load()
    from mjrun.model.sources import CompiledSource

    with pytest.raises(UsageError, match=r"has no \.xml file of its own"):
        FittedModel(tmp_path / "fitted.xml", CompiledSource(model)).check(FOUND)
