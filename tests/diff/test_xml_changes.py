"""What differs between two XML files, with the lines in both."""

from pathlib import Path

import pytest

from mjrun.diff.xml_changes import xml_changes
from mjrun.model.sources import parse_source

BASE = """<mujoco model="m">
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" size="1 1 .1" type="plane"/>
    <body name="a" pos="-1 0 0">
      <geom size=".1"/>
      <geom size=".2"/>
    </body>
  </worldbody>
</mujoco>"""


def told(folder: Path, a: str, b: str) -> list[tuple[str, str, str | None, str | None, int | None, int | None]]:
    (folder / "a.xml").write_text(a)
    (folder / "b.xml").write_text(b)
    changes = xml_changes(parse_source(str(folder / "a.xml")), parse_source(str(folder / "b.xml")))
    return [
        (c.element, c.attribute, c.a, c.b, c.place_a and c.place_a.line, c.place_b and c.place_b.line) for c in changes
    ]


def test_the_same_file_has_no_changes(tmp_path: Path) -> None:
    assert told(tmp_path, BASE, BASE) == []


def test_attributes_with_their_lines(tmp_path: Path) -> None:
    edited = BASE.replace("<worldbody>", "<!-- a\nb -->\n<worldbody>").replace(
        'pos="-1 0 0"', 'pos="-2 0 0" mocap="true"'
    )
    assert told(tmp_path, BASE, edited) == [
        ('<body name="a">', "pos", "-1 0 0", "-2 0 0", 5, 7),
        ('<body name="a">', "mocap", None, "true", 5, 7),
    ]


def test_numbers_that_are_written_in_another_way_are_the_same(tmp_path: Path) -> None:
    assert told(tmp_path, BASE, BASE.replace("0.002", "2e-3").replace("1 1 .1", "1.0 1   0.1")) == []


def test_elements_that_come_and_go(tmp_path: Path) -> None:
    edited = BASE.replace('<geom size=".1"/>', '<site name="s"/>\n<geom size=".1"/>').replace(
        '      <geom size=".2"/>\n', ""
    )
    assert told(tmp_path, BASE, edited) == [
        ('<geom size=".2">', "", None, None, 7, None),
        ('<site name="s">', "", None, None, None, 6),
    ]


def test_unnamed_elements_are_matched_around_those_that_are_equal(tmp_path: Path) -> None:
    edited = BASE.replace('<geom size=".1"/>', '<geom size=".1" rgba="1 0 0 1"/>')
    assert told(tmp_path, BASE, edited) == [('<geom size=".1">', "rgba", None, "1 0 0 1", 6, 6)]


def test_sections_may_be_opened_twice_and_moved(tmp_path: Path) -> None:
    twice = BASE.replace('type="plane"/>', 'type="plane"/></worldbody>\n<worldbody>')
    assert told(tmp_path, BASE, twice) == []
    option = '  <option timestep="0.002"/>\n'
    moved = BASE.replace(option, "").replace("</mujoco>", f"{option}</mujoco>")
    assert told(tmp_path, BASE, moved) == []


def test_lines_are_those_of_included_files(tmp_path: Path) -> None:
    for name, size in (("one", ".1"), ("two", ".3")):
        (tmp_path / f"{name}.xml").write_text(f"<mujoco>\n\n<geom name='g' size='{size}'/></mujoco>")
    text = '<mujoco><worldbody><include file="{}.xml"/></worldbody></mujoco>'
    (tmp_path / "a.xml").write_text(text.format("one"))
    (tmp_path / "b.xml").write_text(text.format("two"))
    (change,) = xml_changes(*(parse_source(str(tmp_path / f"{name}.xml")) for name in "ab"))
    assert [str(place) for place in (change.place_a, change.place_b)] == [
        f"{tmp_path}/one.xml:3",
        f"{tmp_path}/two.xml:3",
    ]


@pytest.mark.parametrize("other", ["-", "b.mjb", "b.mjz", "nothing.xml"])
def test_what_is_no_xml_has_no_changes(tmp_path: Path, other: str) -> None:
    (tmp_path / "a.xml").write_text(BASE)
    assert xml_changes(parse_source(str(tmp_path / "a.xml")), parse_source(other)) == []
