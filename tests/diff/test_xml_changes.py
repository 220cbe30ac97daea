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


OPTION, TWO = '  <option timestep="0.002"/>\n', '      <geom size=".2"/>\n'
COMMENTED = BASE.replace("<worldbody>", "<!-- a\nb -->\n<worldbody>")
BODY = '<body name="a">'


@pytest.mark.parametrize(
    ("edited", "changes"),
    [
        (BASE, []),
        (
            COMMENTED.replace('pos="-1 0 0"', 'pos="-2 0 0" mocap="true"'),
            [(BODY, "pos", "-1 0 0", "-2 0 0", 5, 7), (BODY, "mocap", None, "true", 5, 7)],
        ),
        (BASE.replace("0.002", "2e-3").replace("1 1 .1", "1.0 1   0.1"), []),
        (
            BASE.replace('<geom size=".1"/>', '<site name="s"/>\n<geom size=".1"/>').replace(TWO, ""),
            [('<geom size=".2">', "", None, None, 7, None), ('<site name="s">', "", None, None, None, 6)],
        ),
        (
            BASE.replace('<geom size=".1"/>', '<geom size=".1" rgba="1 0 0 1"/>'),
            [('<geom size=".1">', "rgba", None, "1 0 0 1", 6, 6)],
        ),
        (BASE.replace('type="plane"/>', 'type="plane"/></worldbody>\n<worldbody>'), []),
        (BASE.replace(OPTION, "").replace("</mujoco>", f"{OPTION}</mujoco>"), []),
    ],
    ids=["same", "attributes", "numbers", "elements", "around equal ones", "section opened twice", "section moved"],
)
def test_changes_are_found_with_their_lines(tmp_path: Path, edited: str, changes: list[object]) -> None:
    assert told(tmp_path, BASE, edited) == changes


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
