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

from mjrun.diff.models import compare_models, xml_changes
from mjrun.diff.result import ArrayDifference, FieldDifference, ModelComparison, UnmatchedObject
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.model.fields import COMPUTED, ModelField, is_layout, model_fields
from mjrun.model.override import Override
from mjrun.model.sources import CompiledSource, parse_source
from tests.cases import mjcf
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


@settings(max_examples=12, deadline=None)
@given(edits=st.sets(st.sampled_from(sorted(EDITS)), max_size=4))
def test_exactly_the_edited_fields_are_reported_whatever_is_inserted(edits: set[tuple[str, str]]) -> None:
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
    assert result.only_b == [
        UnmatchedObject("body", "crate"),
        UnmatchedObject("joint", "crate"),
        UnmatchedObject("geom", "lid"),
    ]
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


def test_what_the_compiler_computes_is_reported_where_nothing_else_differs() -> None:
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


def test_another_order_is_reported() -> None:
    body = '<body name="{}"><geom size="1"/></body>'
    texts = [f"<mujoco><worldbody>{body.format(a)}{body.format(b)}</worldbody></mujoco>" for a, b in ("ab", "ba")]
    result = compared(*(mujoco.MjSpec.from_string(text).compile() for text in texts))
    assert result.fields == [FieldDifference("order", "bodies of world", (), ("a", "b"), ("b", "a"))]


def test_pairs_and_excludes_have_no_order() -> None:
    bodies = {name: f'<body name="{name}"><freejoint/><geom name="{name}" size=".1"/></body>' for name in "abc"}

    def model(order: str, contact: str) -> mujoco.MjModel:
        text = f"<mujoco><worldbody>{''.join(map(bodies.get, order))}</worldbody><contact>{contact}</contact></mujoco>"
        return mujoco.MjModel.from_xml_string(text)

    same = '<pair geom1="a" geom2="b"/><pair geom1="b" geom2="c" gap="1"/><exclude name="x" body1="a" body2="b"/>'
    (order,) = compared(model("abc", same), model("cba", same)).fields
    assert (order.field, order.object) == ("order", "bodies of world")

    moved = same.replace('body1="a"', 'body1="c"').replace('geom2="c" gap', 'geom2="a" gap')
    a, b = model("abc", same), model("cba", moved)
    for one, other, names in ((a, b, ("a", "c")), (b, a, ("c", "a"))):
        _, *fields = compared(one, other).fields
        values = {(each.field, each.object): (each.a, each.b) for each in fields if each.field != "order"}
        exclude, pair = [(name,) for name in names], [(name,) for name in reversed(names)]
        assert values.pop(("exclude_signature", "x")) == tuple(exclude)
        assert [*values.values()] == [tuple(pair)], values


def test_numbers_of_different_units_have_none() -> None:
    a, b = (
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><compiler angle="radian"/><worldbody>
            <body><joint name="j" type="{kind}" range="-1 {high}"/><geom size="1"/></body></worldbody></mujoco>"""
        )
        for kind, high in (("hinge", 1), ("slide", 2))
    )
    for one, other in ((a, b), (b, a)):
        units = {each.field: each.unit for each in compared(one, other).fields}
        assert units == {"jnt_type": "", "jnt_range": ""}


def test_sizes_of_activations_and_of_memory_are_compared() -> None:
    def model(size: int, memory: str) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(
            f"""<mujoco><size memory="{memory}"/>
            <worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>
            <actuator><general name="g" joint="j" dyntype="user" actdim="{size}"/></actuator></mujoco>"""
        )

    kinds = [(2, "1M"), (3, "1M"), (2, "3M")]
    a, larger, more = (model(*kind) for kind in kinds)
    assert compared(a, larger).fields == [FieldDifference("actuator_actnum", "g", (), (2,), (3,))]
    assert compared(a, more).fields == [FieldDifference("narena", "", (), (2**20,), (3 * 2**20,), "bytes")]


@pytest.mark.parametrize("count", [3, 12])
def test_another_point_of_a_tendon_is_reported_by_its_name(count: int) -> None:
    def model(last: str) -> mujoco.MjModel:
        sites = "".join(f'<site name="s{i}" pos="{i} 0 0"/>' for i in range(count))
        path = "".join(f'<site site="s{i}"/>' for i in range(count - 1)) + f'<site site="{last}"/>'
        return mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody><geom size="1"/>{sites}<site name="other" pos="{count - 1} 0 0"/></worldbody>
            <tendon><spatial name="t">{path}</spatial></tendon></mujoco>"""
        )

    result = compared(model(f"s{count - 1}"), model("other"))
    assert result.fields == [FieldDifference("wrap_objid", "t", (str(count - 1),), (f"s{count - 1}",), ("other",))]
    assert not result.arrays


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


RICH = mjcf("rich")


@pytest.fixture(scope="module")
def rich() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(RICH)


@pytest.mark.parametrize("seed", range(4))
def test_any_number_of_any_field_that_changes_is_reported(rich: mujoco.MjModel, seed: int) -> None:
    generator, other = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(RICH)
    assert compared(rich, other).equal
    changed = set()
    for field in model_fields():
        values = getattr(other, field.name)
        if isinstance(values, np.ndarray) and values.size and changeable(field, values):
            place = tuple(generator.integers(size) for size in values.shape)
            values[place] = not values[place] if field.boolean else values[place] + 1
            changed.add(field.name)
    result = compared(rich, other)
    assert {each.field for each in (*result.fields, *result.arrays, *result.computed)} == changed
    assert len(changed) > 150
    assert sum(len(each.a) for each in result.fields) == len(result.fields)  # one number of each


def changeable(field: ModelField, values: np.ndarray) -> bool:
    """Whether a number of the field can be another and still mean something."""
    return field.boolean or (np.issubdtype(values.dtype, np.floating) and field.name != "wrap_prm")


def test_values_are_reported_in_mujocos_words() -> None:
    a, b = spec().compile(), spec()
    b.geom("chest").friction = [0.5, 0.005, 0.1]
    b.joint("knee").type = mujoco.mjtJoint.mjJNT_SLIDE
    b.geom("chest").material = ""
    b.joint("hip").limited = 0
    result = {each.field: each for each in compared(a, b.compile()).fields}
    assert result["geom_friction"] == FieldDifference(
        "geom_friction", "chest", ("slide", "roll"), (1.0, 0.0001), (0.5, 0.1)
    )
    assert (result["jnt_type"].a, result["jnt_type"].b) == (("hinge",), ("slide",))
    assert (result["geom_matid"].a, result["geom_matid"].b) == (("steel",), ("none",))
    assert (result["jnt_limited"].a, result["jnt_limited"].b) == ((True,), (False,))


# The name of each component, by its field and index, as the header of MuJoCo documents them.
COMPONENTS = {
    ("body_pos", 1): "y",
    ("body_quat", 0): "qw",
    ("body_quat", 1): "qx",
    ("body_quat", 2): "qy",
    ("body_quat", 3): "qz",
    ("site_quat", 3): "qz",
    ("geom_rgba", 3): "a",
    ("light_diffuse", 2): "b",
    ("jnt_axis", 0): "x",
    ("jnt_range", 0): "lower",
    ("actuator_ctrlrange", 1): "upper",
    ("geom_friction", 1): "spin",
    ("cam_resolution", 1): "height",
    ("light_dir", 0): "x",
}


@pytest.mark.parametrize(("field", "index"), COMPONENTS)
def test_a_component_has_the_name_that_mujoco_documents(field: str, index: int) -> None:
    a, b = spec().compile(), spec().compile()
    values = getattr(b, field)
    values[-1][index] += 0.25 if values.dtype.kind == "f" else 1
    (difference,) = (each for each in compared(a, b).fields if each.field == field)
    assert difference.components == (COMPONENTS[field, index],)


def test_texts_numbers_and_tuples_of_the_user(rich: mujoco.MjModel) -> None:
    text = RICH.replace("7 8 9", "7 5 9").replace("hello", "good bye").replace('objname="a" prm', 'objname="b" prm')
    result = compared(rich, mujoco.MjModel.from_xml_string(text))
    assert [(each.field, each.object, each.components, each.a, each.b) for each in result.fields] == [
        ("numeric_data", "gains", ("1",), (8.0,), (5.0,)),
        ("text_data", "note", (), ("hello",), ("good bye",)),
        ("tuple_objid", "both", (), ("a",), ("b",)),
    ]
    other = mujoco.MjModel.from_xml_string(
        RICH.replace('objtype="body" objname="a" prm', 'objtype="joint" objname="hinge" prm')
    )
    types = [(each.a, each.b) for each in compared(rich, other).fields if each.field == "tuple_objtype"]
    assert types == [(("body",), ("joint",))]


def test_assets_are_reported_by_their_hash_and_largest_difference(rich: mujoco.MjModel) -> None:
    other = mujoco.MjModel.from_xml_string(RICH.replace("9 10 11", "9 5 11"))
    (array,) = compared(rich, other).arrays
    assert isinstance(array, ArrayDifference)
    assert (array.field, array.object, array.shape_a, array.count) == ("hfield_data", "hill", (12, 1), 1)
    assert array.largest == pytest.approx(5 / 11)
    assert array.sha256_a != array.sha256_b

    wider = mujoco.MjModel.from_xml_string(RICH.replace('"checker" width="8"', '"checker" width="16"'))
    result = compared(rich, wider)
    (array,) = result.arrays
    assert (array.field, array.object, array.count, array.largest) == ("tex_data", "chequer", None, None)
    assert [(each.field, each.a, each.b) for each in result.fields] == [("tex_width", (8,), (16,))]


def test_an_asset_before_another_shifts_nothing(rich: mujoco.MjModel) -> None:
    first = '<mesh name="first" vertex="0 0 0  2 0 0  0 2 0  0 0 2"/><mesh name="wedge"'
    other = mujoco.MjModel.from_xml_string(RICH.replace('<mesh name="wedge"', first))
    result = compared(rich, other)
    assert not [*result.fields, *result.arrays]
    assert [(each.kind, each.name) for each in result.only_b] == [("mesh", "first")]


def test_numbers_within_the_tolerance_agree() -> None:
    a, b = spec().compile(), spec().compile()
    b.body_mass[1] *= 1 + 1e-6
    assert not compared(a, b, rtol=1e-7).equal
    assert compared(a, b, rtol=1e-5).equal
    assert compared(a, b, atol=1e-4).equal
    assert [compared(a, b, **tolerance).exact for tolerance in ({}, {"atol": 1e-4}, {"rtol": 1e-5})] == [1, 0, 0]
    of_masses = Tolerances(Tolerance(), {"body_mass": (1e-4,)})
    assert not compare_models(CompiledSource(a), CompiledSource(b), of_masses).exact


def test_integers_and_ids_have_no_tolerance() -> None:
    a, b = spec().compile(), spec().compile()
    b.geom_condim[0] += 1
    b.sensor_objid[1] = b.sensor_objid[2]
    assert [each.field for each in compared(a, b, rtol=9, atol=9).fields] == ["geom_condim", "sensor_objid"]


def test_the_largest_difference_is_that_of_numbers() -> None:
    assert FieldDifference("body_pos", "b", (), (1.0, 2.0), (1.5, 0.0)).largest == 2
    assert FieldDifference("geom_matid", "g", (), ("steel",), ("none",)).largest is None
    assert FieldDifference("jnt_limited", "j", (), (True,), (False,)).largest is None


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


def xml_changes_told(
    folder: Path, a: str, b: str
) -> list[tuple[str, str, str | None, str | None, int | None, int | None]]:
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
    assert xml_changes_told(tmp_path, BASE, edited) == changes


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
