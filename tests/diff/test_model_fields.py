"""Every array of a compiled model is of one sort, and every id is known to refer to something."""

import mujoco
import numpy as np

from mjrun.diff.model_fields import (
    COMPUTED,
    OBJECTS,
    REFERENCES,
    STRETCHES,
    array,
    is_layout,
    model_fields,
    referred_kinds,
    stretch,
)
from tests.diff.models import spec

NAMES = [field.name for field in model_fields()]


def test_every_array_of_mujoco_is_compared_or_is_layout() -> None:
    model = spec().compile()
    arrays = [name for name in dir(model) if isinstance(getattr(model, name), np.ndarray) and name[0] != "_"]
    assert set(arrays) - set(NAMES) == {name for name in arrays if is_layout(name)}
    assert {*COMPUTED, *REFERENCES} <= set(NAMES)


def test_every_id_refers_to_something() -> None:
    others = {"body_mocapid", "geom_fluid", "skin_bonevertid", "flex_rigid", "flexedge_rigid"}
    assert {name for name in NAMES if name.endswith("id")} - others <= set(REFERENCES)


def test_rows_belong_to_objects_or_parts_of_these_unless_they_are_computed() -> None:
    parts = {"nq", "nv", "nu", "nout", "na", "ntree"}
    elsewhere = [f.name for f in model_fields() if f.rows not in {*OBJECTS, *STRETCHES, *parts} and not f.computed]
    assert elsewhere == []


def test_ids_are_those_of_the_type_that_another_field_says() -> None:
    model = spec().compile()
    joint, site = int(mujoco.mjtObj.mjOBJ_JOINT), int(mujoco.mjtObj.mjOBJ_SITE)
    assert np.asarray(referred_kinds(model, "sensor_objid")).tolist() == [site, joint, joint]
    assert np.asarray(referred_kinds(model, "actuator_trnid"))[:, 0].tolist() == [joint, joint]
    assert np.asarray(referred_kinds(model, "eq_obj1id")).tolist() == [joint]
    assert np.asarray(referred_kinds(model, "wrap_prm")).tolist() == [0, 0]  # coefficients
    assert referred_kinds(model, "geom_size") is None
    torso, ball = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("torso", "ball"))
    assert sorted(array(model, "exclude_signature")[0].tolist()) == sorted([torso, ball])


def test_a_stretch_is_what_belongs_to_one_object() -> None:
    mesh = '<mesh name="{}" vertex="0 0 0  1 0 0  0 1 0  0 0 1 {}"/>'
    assets = mesh.format("a", "") + mesh.format("b", "2 2 2")
    geoms = '<geom type="mesh" mesh="a"/><geom type="mesh" mesh="b"/>'
    xml = f"<mujoco><asset>{assets}</asset><worldbody>{geoms}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    for i in range(2):
        start, count = int(model.mesh_vertadr[i]), int(model.mesh_vertnum[i])
        assert stretch(model, "nmeshvert", i) == slice(start, start + count)
        assert stretch(model, "nmeshtexcoord", i) == slice(0, 0)
