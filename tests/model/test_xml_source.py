"""Theorems about the XML of models."""

from pathlib import Path

import mujoco
import pytest

from mjrun.model.xml_source import Element, read_xml, scan


def test_an_included_circle_is_read_once() -> None:
    Path("a.xml").write_text('<mujoco><include file="b.xml"/></mujoco>')
    Path("b.xml").write_text('<mujoco><include file="a.xml"/><include file="b.xml"/><size/></mujoco>')
    assert [element.tag for element in read_xml(Path("a.xml")).elements()].count("size") == 1


@pytest.mark.parametrize(
    ("attaches", "circular"),
    [
        ({"a": "bc", "b": "c", "c": ""}, False),
        ({"a": "bc", "b": "d", "c": "d", "d": ""}, False),
        ({"a": "bc", "b": "c", "c": "b"}, True),
        ({"a": "b", "b": "c", "c": "b"}, True),
        ({"a": "a"}, True),
    ],
)
def test_models_that_attach_each_other_in_a_circle_are_read_once(attaches: dict[str, str], circular: bool) -> None:
    for name, others in attaches.items():
        models = "".join(f'<model name="{other}" file="{other}.xml"/>' for other in others)
        Path(f"{name}.xml").write_text(f"<mujoco><asset>{models}</asset></mujoco>")
    source = read_xml(Path("a.xml"))
    assert source.circular == circular
    assert sorted(root.file.stem for root in source.attached) == sorted(set(attaches) - {"a"})


def test_elements_know_what_they_stand_in() -> None:
    outer = Element("default", {}, Path("a.xml"), 1)
    inner = Element("geom", {}, Path("a.xml"), 2, Element("default", {}, Path("a.xml"), 1, outer))
    assert inner.within("default")
    assert not inner.within("geom")


@pytest.mark.parametrize("comment", ["<!-- a -- b -->", "<!--------->", "<!-- a --- b --->", "<!-- a\n--\nb - -->"])
def test_comments_that_mujoco_accepts_are_read_with_all_that_follows(comment: str) -> None:
    text = f'{comment}\n<mujoco>{comment}<worldbody><geom name="g" size="1"/></worldbody></mujoco>'
    Path("a.xml").write_text(text)
    assert mujoco.MjModel.from_xml_string(text).ngeom == 1
    source = read_xml(Path("a.xml"))
    (geom,) = (element for element in source.elements() if element.tag == "geom")
    assert not source.errors
    assert text[geom.offset :].startswith("<geom")
    assert (geom.line, len(source.comments)) == (text[: geom.offset].count("\n") + 1, 2)
    tags = list[str]()
    scan(text.encode(), lambda tag, attributes, line: tags.append(tag))
    assert tags == ["mujoco", "worldbody", "geom"]
