"""Two models agree, or every field that differs is told, by the object that it belongs to."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.diff.model_differences import FieldDifference, ModelComparison, ModelObject
from mjrun.diff.models import compare_models
from mjrun.model.fields import COMPUTED, is_layout
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from tests.diff.models import CRATE, compared, spec, xml

Edit = Callable[[Any], None]


def assign(kind: str, name: str, field: str, value: object) -> Edit:
    def edit(spec: Any) -> None:
        element = next(e for e in getattr(spec, kind) if e.name == name)
        setattr(element, field, value)

    return edit


def option(field: str, value: object) -> Edit:
    return lambda spec: setattr(spec.option, field, value)


# What is edited → the field of the compiled model that it changes, with its object.
EDITS: dict[tuple[str, str], Edit] = {
    ("opt.timestep", ""): option("timestep", 0.001),
    ("opt.gravity", ""): option("gravity", [0, 0, -1.62]),
    ("opt.cone", ""): option("cone", mujoco.mjtCone.mjCONE_ELLIPTIC),
    ("opt.flag.contact", ""): option("disableflags", int(mujoco.mjtDisableBit.mjDSBL_CONTACT)),
    ("body_mass", "torso"): assign("bodies", "torso", "mass", 8.908),
    ("body_inertia", "torso"): assign("bodies", "torso", "inertia", [0.2, 0.3, 0.45]),
    ("body_pos", "torso"): assign("bodies", "torso", "pos", [0, 0, 1.5]),
    ("body_gravcomp", "torso"): assign("bodies", "torso", "gravcomp", 0.5),
    ("jnt_range", "hip"): assign("joints", "hip", "range", [-2, 1]),
    ("jnt_stiffness", "knee"): assign("joints", "knee", "stiffness", [2, 0, 0]),
    ("dof_damping", "knee"): assign("joints", "knee", "damping", [0.3, 0, 0]),
    ("dof_armature", "hip"): assign("joints", "hip", "armature", 0.01),
    ("dof_frictionloss", "hip"): assign("joints", "hip", "frictionloss", 0.1),
    ("geom_friction", "floor"): assign("geoms", "floor", "friction", [0.5, 0.005, 0.0001]),
    ("geom_rgba", "chest"): assign("geoms", "chest", "rgba", [1, 0, 0, 1]),
    ("geom_matid", "chest"): assign("geoms", "chest", "material", ""),
    ("geom_condim", "ball"): assign("geoms", "ball", "condim", 6),
    ("geom_margin", "ball"): assign("geoms", "ball", "margin", 0.01),
    ("site_pos", "imu"): assign("sites", "imu", "pos", [0, 0.1, 0.1]),
    ("cam_fovy", "front"): assign("cameras", "front", "fovy", 60),
    ("mat_rgba", "steel"): assign("materials", "steel", "rgba", [0.1, 0.2, 0.3, 1]),
    ("tendon_width", "cord"): assign("tendons", "cord", "width", 0.02),
    ("eq_solref", "gears"): assign("equalities", "gears", "solref", [0.01, 1]),
    ("actuator_gear", "motor"): assign("actuators", "motor", "gear", [20, 0, 0, 0, 0, 0]),
    ("sensor_noise", "gyro"): assign("sensors", "gyro", "noise", 0.02),
    ("sensor_objid", "sensor:1"): lambda spec: setattr(spec.sensors[1], "objname", "knee"),
    ("key_time", "start"): assign("keys", "start", "time", 2.0),
    ("light_diffuse", "light:0"): lambda spec: setattr(spec.lights[0], "diffuse", [1, 0, 0]),
    ("geom_size", "geom:3"): lambda spec: setattr(
        next(geom for geom in spec.geoms if geom.pos[2] == 0.4), "size", [0.06, 0, 0]
    ),
}


def raw_differences(a: mujoco.MjModel, b: mujoco.MjModel) -> set[str]:
    """The names of all arrays of two models that differ, as numpy sees them."""
    names = [name for name in dir(a) if name != "_sizes" and isinstance(getattr(a, name), np.ndarray)]
    return {name for name in names if not np.array_equal(getattr(a, name), getattr(b, name))}


def told(result: ModelComparison) -> set[tuple[str, str]]:
    """The fields and objects that differ, as the first model calls them."""
    assert not result.arrays
    return {(each.field, each.object.partition(" → ")[0]) for each in result.fields}


def only(result: ModelComparison) -> list[tuple[str, str]]:
    """The objects that one model has."""
    return [(each.kind, each.name) for each in (*result.only_a, *result.only_b)]


@settings(max_examples=40, deadline=None)
@given(edits=st.sets(st.sampled_from(sorted(EDITS)), max_size=4))
def test_exactly_the_edited_fields_are_told_whatever_is_inserted(edits: set[tuple[str, str]]) -> None:
    plain, edited, beside = spec(), spec(), spec(CRATE)
    for edit in edits:
        EDITS[edit](edited)
        EDITS[edit](beside)
    a, b = plain.compile(), edited.compile()
    result = compared(a, b)
    assert told(result) == edits
    assert not only(result)

    stated = {each.field for each in result.fields if "." not in each.field}
    follow = {each.field for each in result.computed} - {"stat"}
    assert stated | follow == {name for name in raw_differences(a, b) if not is_layout(name)}
    assert follow <= COMPUTED

    with_crate = compared(a, beside.compile())
    assert told(with_crate) == edits
    assert only(with_crate) == [("body", "crate"), ("joint", "crate"), ("geom", "lid")]


def test_an_inserted_body_is_all_that_differs() -> None:
    result = compared(spec().compile(), spec(CRATE).compile())
    assert not told(result)
    assert not result.only_a
    assert result.only_b == [ModelObject("body", "crate"), ModelObject("joint", "crate"), ModelObject("geom", "lid")]
    swapped = compared(spec(CRATE).compile(), spec().compile())
    assert not told(swapped)
    assert swapped.only_a == result.only_b
    assert not swapped.only_b


def test_a_gram_is_found() -> None:
    heavier = spec()
    heavier.body("torso").mass += 0.001
    result = compared(spec().compile(), heavier.compile())
    assert result.fields == [FieldDifference("body_mass", "torso", (), (8.907,), (8.907 + 0.001,), "kg")]
    assert {each.field for each in result.computed} >= {"body_subtreemass", "dof_M0", "dof_invweight0"}
    assert compared(spec().compile(), heavier.compile(), atol=0.002, rtol=1e-3).equal


def test_one_model_in_three_kinds_of_file_is_the_same(tmp_path: Path) -> None:
    (tmp_path / "rig.xml").write_text(xml())
    mujoco.mj_saveModel(spec().compile(), str(tmp_path / "rig.mjb"), None)
    with zipfile.ZipFile(tmp_path / "rig.mjz", "w") as archive:
        archive.writestr("rig.xml", xml())
    sources = [parse_source(str(tmp_path / f"rig.{suffix}")) for suffix in ("xml", "mjb", "mjz")]
    for other in sources[1:]:
        result = compare_models(sources[0], other)
        assert result.equal
        assert not result.computed
    assert not compare_models(
        sources[2], parse_source(str(tmp_path / "rig.xml"), [Override("opt.timestep", "1e-3")])
    ).equal


def test_what_the_compiler_computes_is_told_where_nothing_else_differs() -> None:
    a, b = spec().compile(), spec().compile()
    b.dof_invweight0[0] *= 2
    result = compared(a, b)
    assert [(each.field, each.object) for each in result.fields] == [("dof_invweight0", "hip")]
    assert not result.computed


def test_a_renamed_object_is_the_same_object() -> None:
    a = spec().compile()
    b = mujoco.MjSpec.from_string(xml().replace('"torso"', '"trunk"').replace('name="chest"', "")).compile()
    result = compared(a, b)
    assert [(each.field, each.object, each.a, each.b) for each in result.fields] == [
        ("name", "body torso", ("torso",), ("trunk",)),
        ("name", "geom chest", ("chest",), ("",)),
    ]
    assert not only(result)


def test_another_order_is_told() -> None:
    body = '<body name="{}"><geom size="1"/></body>'
    texts = [f"<mujoco><worldbody>{body.format(a)}{body.format(b)}</worldbody></mujoco>" for a, b in ("ab", "ba")]
    result = compared(*(mujoco.MjSpec.from_string(text).compile() for text in texts))
    assert result.fields == [FieldDifference("order", "bodies of world", (), ("a", "b"), ("b", "a"))]


def test_names_of_models_are_compared_and_nan_agrees_with_itself() -> None:
    a, b = spec(), spec()
    a.modelname, b.modelname = "one", "other"
    assert compared(a.compile(), b.compile()).fields == [FieldDifference("name", "", (), ("one",), ("other",))]
    first, second = spec().compile(), spec().compile()
    first.geom_user = second.geom_user
    first.key_qpos[:], second.key_qpos[:] = np.nan, np.nan
    assert compared(first, second).equal
    second.key_qpos[:] = 0
    assert not compared(first, second, atol=np.inf).equal


@pytest.mark.parametrize("scene", ["pendulum", "dominos", "tippe_top"])
def test_a_scene_is_itself(scene: str) -> None:
    source = parse_source(f"scene:{scene}")
    result = compare_models(source, source)
    assert result.equal
    assert not [*result.computed, *result.xml]


def test_user_data_of_another_width_ends_in_zeros() -> None:
    one, two = (
        f'<mujoco><worldbody><geom name="g" size="1" user="{user}"/></worldbody></mujoco>' for user in ("1", "1 0 3")
    )
    result = compared(*(mujoco.MjSpec.from_string(text).compile() for text in (one, two)))
    assert result.fields == [
        FieldDifference("nuser_geom", "", (), (1,), (3,)),
        FieldDifference("geom_user", "g", ("2",), (0.0,), (3.0,)),
    ]
