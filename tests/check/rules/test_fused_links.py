"""Bodies that consist of several links of a URDF."""

from pathlib import Path

import pytest

from mjrun.check.context import LintContext
from mjrun.model.xml_source import read_xml
from tests.check.models import lint_file

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = """<robot name="r"><link name="base"/><link name="arm">{}</link><link name="tip">{}</link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="weld" type="fixed"><parent link="arm"/><child link="tip"/></joint></robot>"""
SPHERE = '<{0}><geometry><sphere radius="0.1"/></geometry></{0}>'


@pytest.mark.parametrize(
    ("arm", "tip", "reported"),
    [("collision", "collision", True), ("visual", "collision", False), ("collision", "visual", False)],
)
def test_links_that_are_fixed_to_each_other_are_one_body_with_all_their_shapes(
    arm: str, tip: str, reported: bool
) -> None:
    path = Path("r.urdf")
    path.write_text(URDF.format(*(SPHERE.format(shape) + INERTIAL for shape in (arm, tip))))
    remedies = [finding.remedy for finding in lint_file(path, ["MJ206"])]
    assert len(remedies) == reported
    assert all("the links fixed to it (tip)" in remedy for remedy in remedies)


def test_a_shape_of_a_link_that_is_fused_into_the_world_is_placed_at_this_link() -> None:
    path = Path("r.urdf")
    shape = SPHERE.format("collision")
    path.write_text(URDF.replace('"base"/>', f'"base">\n{shape}</link>', 1).format(shape + INERTIAL, shape + INERTIAL))
    context = LintContext.load(path, read_xml(path))
    assert int(context.model.geom_bodyid[0]) == 0
    assert context.place("geom", 0) == (path, 1, None)
