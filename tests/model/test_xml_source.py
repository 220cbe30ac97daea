"""Theorems about the XML of models."""

from pathlib import Path

import mujoco
import pytest

from mjrun.model.xml_source import Element, content_digest, read_xml, scan
from tests.cases import cases


def test_an_included_circle_is_read_once() -> None:
    Path("a.xml").write_text('<mujoco><include file="b.xml"/></mujoco>')
    Path("b.xml").write_text('<mujoco><include file="a.xml"/><include file="b.xml"/><size/></mujoco>')
    assert [element.tag for element in read_xml(Path("a.xml")).elements()].count("size") == 1


@cases("attaches, circular")
def test_models_that_attach_each_other_in_a_circle_are_read_once(attaches: dict[str, str], circular: bool) -> None:
    for name, others in attaches.items():
        models = "".join(f'<model name="{other}" file="{other}.xml"/>' for other in others)
        Path(f"{name}.xml").write_text(f"<mujoco><asset>{models}</asset></mujoco>")
    source = read_xml(Path("a.xml"))
    assert source.circular == circular
    assert sorted(root.file.stem for root in source.attached) == sorted(set(attaches) - {"a"})


def test_an_attached_file_is_the_one_that_mujoco_finds_beside_the_model() -> None:
    Path("sub").mkdir()
    arm = '<mujoco><worldbody><body name="{}"/></worldbody></mujoco>'
    Path("arm.xml").write_text(arm.format("other"))
    Path("sub/arm.xml").write_text(arm.format("arm"))
    attach = '<worldbody><attach model="m" body="arm" prefix="l_"/></worldbody>'
    Path("sub/a.xml").write_text(f'<mujoco><asset><model name="m" file="arm.xml"/></asset>{attach}</mujoco>')
    assert mujoco.MjModel.from_xml_path("sub/a.xml").nbody == 2
    assert [root.file for root in read_xml(Path("sub/a.xml")).attached] == [Path("sub/arm.xml")]


def test_an_attached_file_may_be_beside_the_included_file_that_names_it() -> None:
    Path("sub").mkdir()
    Path("sub/arm.xml").write_text('<mujoco><worldbody><body name="arm"/></worldbody></mujoco>')
    Path("sub/b.xml").write_text('<mujoco><asset><model name="m" file="arm.xml"/></asset></mujoco>')
    attach = '<worldbody><attach model="m" body="arm" prefix="l_"/></worldbody>'
    Path("a.xml").write_text(f'<mujoco><include file="sub/b.xml"/>{attach}</mujoco>')
    assert mujoco.MjModel.from_xml_path("a.xml").nbody == 2
    assert [root.file for root in read_xml(Path("a.xml")).attached] == [Path("sub/arm.xml")]


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


MODEL = '<mujoco><worldbody><geom name="a" size=".1" mass="1" density="5"/></worldbody></mujoco>'


@pytest.mark.parametrize(
    "text",
    [
        MODEL.replace("><", ">\n  <!-- a -- b -->\n<"),
        MODEL.replace('name="a" ', "name = 'a'\n\t"),
        MODEL.replace("/>", "></geom>"),
        MODEL.replace('"a"', '"&#97;"'),
    ],
)
def test_comments_and_layout_change_nothing_in_the_content_of_a_model(text: str) -> None:
    assert content_digest(text.encode()) == content_digest(MODEL.encode())
    mujoco.MjModel.from_xml_string(text)


def test_all_else_changes_the_content_of_a_model() -> None:
    others = [
        MODEL.replace("5", "6"),  # which the compiled model lacks
        MODEL.replace("5", "5.0"),
        MODEL.replace("density", "gap"),
        MODEL.replace("/></worldbody>", "/></worldbody><worldbody/>"),
        MODEL.replace("<worldbody>", "<worldbody><body>").replace("</worldbody>", "</body></worldbody>"),
        MODEL.replace("<worldbody>", "<worldbody><body/>"),
        MODEL.replace("<worldbody>", "<worldbody>text"),
        f"<?xml version='1.0' encoding='latin-1'?>{MODEL}",
        f"<?xml version='1.0' encoding='utf-8'?>{MODEL}",
        f"<!DOCTYPE mujoco>{MODEL}",
        f"<!DOCTYPE mujoco>{MODEL} ",
        MODEL[:-1],
        MODEL[:-2],
    ]
    assert len({content_digest(text.encode()) for text in [MODEL, *others]}) == 1 + len(others)
