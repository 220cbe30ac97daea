"""Theorems about attributes that are better written in another way."""

from pathlib import Path

import mujoco
import numpy as np

from mjrun.model.mujoco_globals import collected_warnings
from tests.check.fixes import fixed
from tests.check.models import MESH, hinged, mjcf


def test_deprecated_attributes_are_deleted_or_replaced() -> None:
    before = '<size njmax="5" nconmax="5"/><statistic meaninertia="2" extent="3"/>'
    text = mjcf('<light directional="true" diffuse="1 1 1"/>\n<light directional="false"/>', before=before)
    after = mjcf('<light type="directional" diffuse="1 1 1"/>\n<light/>', before='<statistic extent="3"/>')
    assert fixed(text) == after
    with collected_warnings():
        one = mujoco.MjModel.from_xml_string(text)
    other = mujoco.MjModel.from_xml_string(after)
    np.testing.assert_array_equal(one.light_type, other.light_type)


def test_paths_below_the_model_become_relative_to_where_mujoco_looks_for_them() -> None:
    here = Path.cwd()
    for name in ("meshes/a.obj", "b.obj"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(MESH)
    Path("part.xml").write_text("<mujocoinclude><option/></mujocoinclude>")
    meshes = '<asset><mesh file="{}a.obj"/><mesh file="{}b.obj"/></asset>'
    compiler = '<compiler meshdir="{}meshes"/><include file="{}part.xml"/>'
    text = mjcf(before=(compiler + meshes.replace("{}a", "{}meshes/a")).replace("{}", f"{here}/"))
    assert fixed(text) == mjcf(before=compiler.replace("{}", "") + meshes.format("", "../"))
    outside = mjcf(before=f'<asset><mesh file="{here.parent}/c.obj"/></asset>')
    (here.parent / "c.obj").write_text(MESH)
    assert fixed(outside) == outside


def test_directions_are_normalized_where_they_are_set() -> None:
    text = hinged('axis="0 0.7\t0.7"', before='<default><geom quat="0.7 0.7 0 0"/></default>')
    before, after = (mujoco.MjModel.from_xml_string(each) for each in (text, fixed(text)))
    np.testing.assert_allclose(after.jnt_axis, before.jnt_axis, atol=1e-15)
    np.testing.assert_allclose(after.geom_quat, before.geom_quat, atol=1e-15)
    assert "0.7071067812\t0.7071067812" in fixed(text)
    deliberate = hinged('axis="1 1 0"', geom='size=".1" quat="1 0 0 1"')
    assert fixed(deliberate) == deliberate
