"""Ids and legends, against the model's own tables of what belongs to what."""

import mujoco
import numpy as np
import pytest

from mjrun.rendering.visual import DRAWN, SegmentationIds, groupings
from tests.cases import mjcf

MODEL = mujoco.MjModel.from_xml_string(mjcf("arm_and_cloth"))
FLAGS = ("mjVIS_JOINT", "mjVIS_ACTUATOR", "mjVIS_CAMERA", "mjVIS_LIGHT", "mjVIS_INERTIA")


@pytest.fixture(scope="module")
def scene() -> mujoco.MjvScene:
    """Everything that MuJoCo can be made to draw of the model."""
    data, options, scene = mujoco.MjData(MODEL), mujoco.MjvOption(), mujoco.MjvScene(MODEL, 500)
    mujoco.mj_forward(MODEL, data)
    for flag in FLAGS:
        options.flags[getattr(mujoco.mjtVisFlag, flag)] = 1
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(MODEL, data, options, None, mujoco.MjvCamera(), every, scene)
    return scene


def kind_of(geom: mujoco.MjvGeom) -> str:
    """What a geom of a scene shows: `geom`, `site`, …; empty for what belongs to nothing in the model."""
    return mujoco.mju_type2Str(geom.objtype) or ""


def owner(geom: mujoco.MjvGeom) -> int | None:
    """The body that what a geom of a scene shows belongs to, by the tables of the compiled model."""
    tables = {
        "body": np.arange(MODEL.nbody),
        "geom": MODEL.geom_bodyid,
        "site": MODEL.site_bodyid,
        "joint": MODEL.jnt_bodyid,
        "camera": MODEL.cam_bodyid,
        "light": MODEL.light_bodyid,
        "flex": MODEL.flex_vertbodyid[MODEL.flex_vertadr],
    }
    return int(tables[kind_of(geom)][geom.objid]) if kind_of(geom) in tables else None


def test_every_object_of_a_scene_is_reported_apart_by_its_type_and_id(scene: mujoco.MjvScene) -> None:
    segmentation = SegmentationIds(MODEL)
    ids = segmentation.ids(scene)
    assert ids.shape == (scene.ngeom + 1,)
    assert ids[0] == -1
    kinds = set()
    for geom in scene.geoms[: scene.ngeom]:
        number = ids[geom.segid + 1]
        if kind_of(geom) not in DRAWN:
            assert number == -1
            continue
        segment = segmentation.legend[number]
        assert (segment.type, segment.id) == (kind_of(geom), geom.objid)
        assert segment.name in (mujoco.mj_id2name(MODEL, geom.objtype, geom.objid), f"{segment.type}:{segment.id}")
        body = owner(geom)
        assert segment.body == ("" if body is None or segment.type == "flex" else MODEL.body(body).name)
        kinds.add(segment.type)
    assert kinds >= {"geom", "site", "tendon", "flex", "joint", "actuator", "camera", "light", "body"}


@pytest.mark.parametrize("by", ["geom", "site", "tendon", "flex", "joint", "actuator"])
def test_of_one_kind_all_others_are_nothing(scene: mujoco.MjvScene, by: str) -> None:
    segmentation = SegmentationIds(MODEL, by)
    ids = segmentation.ids(scene)
    assert [segment.type for segment in segmentation.legend] == [by] * len(segmentation.legend)
    for geom in scene.geoms[: scene.ngeom]:
        assert ids[geom.segid + 1] == (geom.objid if kind_of(geom) == by else -1)


@pytest.mark.parametrize("by", ["body", "root-body"])
def test_by_bodies_everything_that_has_one_belongs_to_it_or_to_the_root_of_its_tree(
    scene: mujoco.MjvScene, by: str
) -> None:
    segmentation = SegmentationIds(MODEL, by)
    ids = segmentation.ids(scene)
    for geom in scene.geoms[: scene.ngeom]:
        body, number = owner(geom), ids[geom.segid + 1]
        if body is None:
            assert number == -1
        else:
            expected = body if by == "body" else MODEL.body_rootid[body]
            assert (segmentation.legend[number].type, segmentation.legend[number].id) == (by, expected)
    roots = set(range(MODEL.nbody)) if by == "body" else set(MODEL.body_rootid.tolist())
    assert {segment.id for segment in segmentation.legend} == roots


def test_an_interpolated_flex_belongs_to_the_body_of_a_node() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><flexcomp name="bulk" type="grid" dim="3" count="2 2 2" spacing=".1 .1 .1" dof="trilinear"
        radius=".01" mass="1"><elasticity young="1e4" poisson=".2"/></flexcomp>
        <body name="last"><geom size=".1"/></body></worldbody></mujoco>"""
    )
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, 10)
    mujoco.mj_forward(model, data)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), every, scene)
    segmentation = SegmentationIds(model, "body")
    ids = segmentation.ids(scene)
    shown = {kind_of(geom): segmentation.legend[ids[geom.segid + 1]].id for geom in scene.geoms[: scene.ngeom]}
    assert shown == {"flex": model.flex_nodebodyid[0], "geom": model.body("last").id}


def test_what_is_added_to_a_scene_is_nothing(scene: mujoco.MjvScene) -> None:
    segmentation = SegmentationIds(MODEL)
    decorated = mujoco.MjvScene(MODEL, 10)
    for segment_id, objtype, objid in ((-1, "geom", 0), (0, "unknown", -1), (0, "geom", MODEL.ngeom), (7, "geom", 0)):
        decorated.ngeom = 1
        geom = decorated.geoms[0]
        geom.segid, geom.objid = segment_id, objid
        geom.objtype = mujoco.mju_str2Type(objtype) if objtype != "unknown" else 0
        assert segmentation.ids(decorated).tolist() == [-1, -1]


def test_every_grouping_has_a_legend_and_its_name_for_types() -> None:
    assert set(groupings()) == {"object", "root-body", *DRAWN}
    for by in groupings():
        types = {segment.type for segment in SegmentationIds(MODEL, by).legend}
        assert types <= ({*DRAWN} if by == "object" else {by})
