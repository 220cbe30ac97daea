"""Theorems about the XML of models."""

from pathlib import Path

import pytest

from mjrun.model.xml_source import Element, read_xml


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
