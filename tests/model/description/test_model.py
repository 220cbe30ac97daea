"""Theorems about descriptions: what they say of a model is what MuJoCo, its source and its files say."""

import math
import os
import shutil
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.model.description.model_description import SECTIONS, ModelDescription
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.override import Setting, apply

SCENES = sorted((Path(__file__).parents[3] / "scenes").glob("*.xml"))

MIXED = """<mujoco model="mixed"><compiler angle="radian"/>
<worldbody><site name="ref"/><geom type="plane" size="1 1 1"/>
  <body name="ball"><joint name="ball" type="ball" range="0 1" limited="true"/><geom size=".1"/><site name="s"/>
    <body name="tip"><geom name="tip" type="capsule" size=".1 .2" mass="2"/></body></body>
  <body name="car" pos="1 0 0"><joint name="slide" type="slide" axis="0 1 0" damping="2" stiffness="3"/>
    <joint name="hinge" range="-1 2" limited="true" armature=".5" frictionloss=".25" pos="0 0 .5"/><geom name="car"
    size=".1"/></body>
  <body pos="2 0 0"><freejoint/><geom type="box" size=".1 .2 .3"/></body><body name="goal" mocap="true"/></worldbody>
<tendon><fixed name="sum" range="0 1" limited="true"><joint joint="hinge" coef="2"/></fixed>
  <fixed name="both"><joint joint="hinge" coef="1"/><joint joint="slide" coef="-.5"/></fixed>
  <spatial name="rope" stiffness="5"><site site="s"/><geom geom="car" sidesite="ref"/><site site="ref"/>
    <pulley divisor="2"/><site site="s"/><site site="ref"/></spatial></tendon>
<contact><pair geom1="tip" geom2="car" friction="1 2 3 4 5"/><exclude body1="car" body2="goal"/></contact>
<equality><connect body1="car" anchor="1 2 3"/><weld site1="s" site2="ref" active="false"/>
  <joint joint1="hinge" joint2="slide"/><tendon tendon1="rope"/></equality>
<actuator><motor name="m" joint="hinge" gear="3" forcerange="-4 5" ctrlrange="-1 1"/><muscle tendon="rope"
  lengthrange="0 1"/><orientation name="o" joint="ball" kp="3"/><intvelocity joint="hinge" actrange="-1 1" kp="2"/>
  <motor site="s" gear="0 0 0 1 0 0"/></actuator>
<keyframe><key name="fine"/><key name="far" time="2" qpos="0 1 0 0 9 3 0 0 0 1 0 0 0" act="0 -2" ctrl="5"/></keyframe>
</mujoco>"""


def described(text: str, assets: dict[str, bytes] | None = None) -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(text, assets or {}))


@pytest.fixture(scope="module")
def mixed() -> ModelDescription:
    return described(MIXED.replace('ctrl="5"', 'ctrl="5 0 0 0 0 0 0"'))


@pytest.fixture(params=SCENES, ids=lambda path: path.stem)
def scene(request: pytest.FixtureRequest) -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_path(str(request.param)), request.param)


# --- the whole ---------------------------------------------------------------------------------------


def test_the_summary_is_what_mujoco_says(scene: ModelDescription) -> None:
    model, found = scene.model, scene.summary
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert found.mass == mujoco.mj_getTotalmass(model)
    weights = model.body_mass / model.body_mass.sum()
    assert found.centre_of_mass == pytest.approx(weights @ data.xipos, abs=1e-12)
    assert (found.memory.model, found.memory.data, found.memory.arena) == (model.nbuffer, data.nbuffer, model.narena)
    assert found.sizes == {name: getattr(model, name) for name in found.sizes}
    assert (found.extent, found.timestep) == (model.stat.extent, model.opt.timestep)
    assert found.name == ET.parse(scene.path or "").getroot().get("model", "MuJoCo Model")
    assert found.jacobian == ("sparse" if mujoco.mj_isSparse(model) else "dense")


def test_nothing_has_no_centre_of_mass_and_no_settings() -> None:
    empty = described("<mujoco/>")
    assert (empty.summary.mass, empty.summary.centre_of_mass, empty.summary.file) == (0, None, None)
    assert [name for name in SECTIONS if getattr(empty, name)] == ["summary", "bodies", "statistics"]
    assert [(body.name, body.parent, body.depth) for body in empty.bodies] == [("world", -1, 0)]


def leaves(value: Any) -> Iterator[Any]:
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, dict | tuple):
        for item in value.values() if isinstance(value, dict) else value:
            yield from leaves(item)
    else:
        yield value


def test_every_value_is_plain(scene: ModelDescription, mixed: ModelDescription) -> None:
    for description in (scene, mixed):
        for name in SECTIONS:
            assert {type(leaf) for leaf in leaves(getattr(description, name))} <= {str, int, float, bool, type(None)}


def tiles(blocks: list[tuple[int | None, int]], total: int) -> bool:
    """Whether blocks of (start, size) lie one after the other, from 0 to `total`."""
    taken = [i for start, size in blocks if start is not None for i in range(start, start + size)]
    return taken == [*range(total)]


def test_addresses_tile_every_vector(scene: ModelDescription, mixed: ModelDescription) -> None:
    for found in (scene, mixed):
        model = found.model
        assert tiles([(joint.qpos, joint.qpos_size) for joint in found.joints], model.nq)
        assert tiles([(joint.dof, joint.dof_size) for joint in found.joints], model.nv)
        assert tiles([(actuator.ctrl, actuator.ctrl_size) for actuator in found.actuators], model.nu)
        assert tiles([(actuator.act, actuator.act_size) for actuator in found.actuators], model.na)
        assert tiles([(sensor.address, sensor.dim) for sensor in found.sensors], model.nsensordata)


# --- bodies and what is fixed to them -----------------------------------------------------------------


def test_the_tree_of_bodies_is_that_of_the_source(scene: ModelDescription) -> None:
    def nested(element: ET.Element, depth: int) -> Iterator[tuple[str | None, int]]:
        for child in element.findall("body"):
            yield child.get("name"), depth
            yield from nested(child, depth + 1)

    world = ET.parse(scene.path or "").getroot().find("worldbody")
    assert world is not None
    written = [("world", 0), *nested(world, 1)]
    if len(written) != len(scene.bodies):
        pytest.skip("the source replicates bodies")
    assert [(body.name, body.depth) for body in scene.bodies] == [
        (name or f"body:{i}", depth) for i, (name, depth) in enumerate(written)
    ]


def test_bodies_hold_every_joint_geom_and_site_once_and_masses_add_up(scene: ModelDescription) -> None:
    for what in ("joints", "geoms", "sites"):
        held = [name for body in scene.bodies for name in getattr(body, what)]
        assert sorted(held) == sorted(thing.name for thing in getattr(scene, what))
        for thing in getattr(scene, what):
            assert thing.name in next(getattr(body, what) for body in scene.bodies if body.name == thing.body)
    for body in scene.bodies:
        children = [other for other in scene.bodies if other.parent == body.id]
        assert body.subtree_mass == pytest.approx(body.mass + sum(child.subtree_mass for child in children))
        assert all(child.depth == body.depth + 1 for child in children)


def test_joints_say_what_the_source_says(mixed: ModelDescription) -> None:
    ball, slide, hinge, free = mixed.joints
    assert [joint.name for joint in mixed.joints] == ["ball", "slide", "hinge", "joint:3"]
    assert [joint.type for joint in mixed.joints] == ["ball", "slide", "hinge", "free"]
    assert [joint.unit for joint in mixed.joints] == ["rad", "m", "rad", ""]
    assert [joint.body for joint in mixed.joints] == ["ball", "car", "car", "body:4"]
    assert [joint.range for joint in mixed.joints] == [(0, 1), None, (-1, 2), None]
    assert [joint.axis for joint in mixed.joints] == [None, (0, 1, 0), (0, 0, 1), None]
    assert (slide.damping, slide.stiffness, hinge.armature, hinge.frictionloss) == (2, 3, 0.5, 0.25)
    assert (hinge.anchor, hinge.qpos0, hinge.spring_reference) == ((0, 0, 0.5), (0,), 0)
    assert (ball.qpos0, free.qpos0) == ((1, 0, 0, 0), (2, 0, 0, 1, 0, 0, 0))


def test_a_geom_has_as_many_sizes_as_its_type(mixed: ModelDescription) -> None:
    sizes = [(geom.type, len(geom.size)) for geom in mixed.geoms]
    assert sizes == [("plane", 3), ("sphere", 1), ("capsule", 2), ("sphere", 1), ("box", 3)]
    assert mixed.bodies[2].geom_types == ("capsule",)
    assert mixed.bodies[-1].mocap


# --- tendons, equalities, contacts --------------------------------------------------------------------


def test_a_tendon_passes_what_the_source_lists(mixed: ModelDescription) -> None:
    total, both, rope = mixed.tendons
    assert [tuple(vars(point).values()) for point in total.path] == [("joint", "hinge", 2)]
    assert [tuple(vars(point).values()) for point in both.path] == [("joint", "hinge", 1), ("joint", "slide", -0.5)]
    assert [(point.kind, point.name) for point in rope.path] == [
        ("site", "s"), ("sphere", "car"), ("site", "ref"), ("pulley", None), ("site", "s"), ("site", "ref"),
    ]  # fmt: skip
    assert rope.path[3].coefficient == 2
    assert [tendon.unit for tendon in mixed.tendons] == ["rad", "", "m"]
    assert [tendon.range for tendon in mixed.tendons] == [(0, 1), None, None]
    assert rope.stiffness == 5


def test_equalities_pairs_and_excludes_name_what_they_bind(mixed: ModelDescription) -> None:
    bound = [(e.type, e.object_kind, e.object1, e.object2, e.active) for e in mixed.equalities]
    assert bound == [
        ("connect", "body", "car", "world", True),
        ("weld", "site", "s", "ref", False),
        ("joint", "joint", "hinge", "slide", True),
        ("tendon", "tendon", "rope", None, True),
    ]
    assert mixed.equalities[0].data[:3] == (1, 2, 3)
    assert [(p.name, p.geom1, p.geom2, p.friction) for p in mixed.pairs] == [("pair:0", "tip", "car", (1, 2, 3, 4, 5))]
    assert [(e.name, e.body1, e.body2) for e in mixed.excludes] == [("exclude:0", "car", "goal")]


# --- actuators -----------------------------------------------------------------------------------------

DEVICE = """<mujoco><worldbody><site name="a"/><body name="b"><joint name="hinge"/><geom size="1"/><site name="s"/>
</body><body name="c"><joint name="ball" type="ball"/><geom size="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    "element",
    [
        '<general joint="hinge" gainprm="5"/>',
        '<motor joint="hinge" gear="7"/>',
        '<position joint="hinge" kp="7"/>',
        '<position joint="hinge" kp="7" kv="2" timeconst=".1"/>',
        '<velocity joint="hinge" kv="3"/>',
        '<intvelocity joint="hinge" kp="2" actrange="-1 1"/>',
        '<damper joint="hinge" kv="2" ctrlrange="0 1"/>',
        '<cylinder joint="hinge" area="2"/>',
        '<muscle joint="hinge" lengthrange="0 1"/>',
        '<adhesion body="b" gain="3" ctrlrange="0 1"/>',
        '<pid joint="hinge" kp="1" ki="2" kv=".1"/>',
        '<orientation joint="ball" kp="3"/>',
        '<dcmotor joint="hinge" motorconst="1 1" resistance="1"/>',
    ],
)
def test_an_actuator_is_of_the_kind_that_it_was_written_as(element: str) -> None:
    (actuator,) = described(DEVICE.format(element)).actuators
    written = ET.fromstring(element)
    assert actuator.kind == written.tag
    assert (actuator.target_kind, actuator.target) == next(
        (kind, written.get(kind)) for kind in ("joint", "body") if written.get(kind)
    )


def test_actuators_say_what_the_source_says(mixed: ModelDescription) -> None:
    motor, muscle, servo, integrator, jet = mixed.actuators
    assert [actuator.name for actuator in mixed.actuators] == ["m", "actuator:1", "o", "actuator:3", "actuator:4"]
    assert (motor.gear, motor.force_range, motor.ctrl_range, motor.gain_parameters) == (
        ((3,),),
        (-4, 5),
        ((-1, 1),),
        (1,),
    )
    assert [(actuator.unit, actuator.force_unit) for actuator in mixed.actuators] == [
        ("rad", "N·m"), ("m", "N"), ("rad", "N·m"), ("rad", "N·m"), ("rad", "N·m"),
    ]  # fmt: skip
    assert (muscle.transmission, muscle.target, muscle.act_size) == ("tendon", "rope", 1)
    assert (servo.ctrl_size, servo.gear, servo.act) == (3, ((1,),) * 3, None)
    assert (integrator.act_range, jet.target_kind, jet.reference) == ((-1, 1), "site", None)


def test_a_slider_crank_names_both_sites() -> None:
    element = '<position cranksite="s" slidersite="a" cranklength="1"/>'
    (actuator,) = described(DEVICE.format(element)).actuators
    assert (actuator.transmission, actuator.target, actuator.reference) == ("slidercrank", "s", "a")


# --- sensors -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("element", "kind", "name", "dim", "unit"),
    [
        ('<jointpos joint="hinge"/>', "joint", "hinge", 1, "rad"),
        ('<jointvel joint="slide"/>', "joint", "slide", 1, "m/s"),
        ('<jointactuatorfrc joint="slide"/>', "joint", "slide", 1, "N"),
        ('<tendonpos tendon="sum"/>', "tendon", "sum", 1, "rad"),
        ('<tendonvel tendon="rope"/>', "tendon", "rope", 1, "m/s"),
        ('<tendonpos tendon="both"/>', "tendon", "both", 1, ""),
        ('<actuatorfrc actuator="m"/>', "actuator", "m", 1, "N·m"),
        ('<ballquat joint="ball"/>', "joint", "ball", 4, ""),
        ('<framepos objtype="xbody" objname="car"/>', "xbody", "car", 3, "m"),
        ('<framelinacc objtype="site" objname="s"/>', "site", "s", 3, "m/s²"),
        ('<rangefinder site="s"/>', "site", "s", 1, "m"),
        ('<rangefinder site="s" data="dist normal"/>', "site", "s", 4, ""),
        ('<contact geom1="tip" data="force"/>', "geom", "tip", 3, "N"),
        ('<contact geom1="tip" data="found"/>', "geom", "tip", 1, ""),
        ("<clock/>", None, None, 1, "s"),
        ('<user dim="3"/>', None, None, 3, ""),
    ],
)
def test_a_sensor_says_of_what_how_much_and_in_which_unit(
    element: str, kind: str | None, name: str | None, dim: int, unit: str
) -> None:
    keyless = MIXED[: MIXED.index("<keyframe>")]
    (sensor,) = described(f"{keyless}<sensor>{element}</sensor></mujoco>").sensors
    assert (sensor.object_kind, sensor.object, sensor.dim, sensor.unit) == (kind, name, dim, unit)
    assert sensor.name == "sensor:0"


def test_cutoff_noise_and_the_frame_of_a_sensor_are_told() -> None:
    keyless = MIXED[: MIXED.index("<keyframe>")]
    element = '<framepos objtype="geom" objname="tip" reftype="site" refname="ref" cutoff="3" noise=".5"/>'
    (sensor,) = described(f"{keyless}<sensor>{element}</sensor></mujoco>").sensors
    assert (sensor.reference_kind, sensor.reference, sensor.cutoff, sensor.noise) == ("site", "ref", 3, 0.5)


# --- cameras -------------------------------------------------------------------------------------------


def test_a_camera_has_an_angle_a_height_or_a_sensor() -> None:
    usual, flat, lens, follower = described("""<mujoco><worldbody><camera fovy="30"/>
        <camera name="flat" projection="orthographic" fovy="2"/><camera sensorsize=".04 .03" focal=".05 .06"
        principal=".001 0" resolution="640 480" output="rgb depth"/><body name="b"><geom size="1"/></body>
        <camera mode="targetbody" target="b"/></worldbody></mujoco>""").cameras
    assert (usual.name, usual.fovy, usual.height, usual.sensor_size) == ("camera:0", 30, None, None)
    assert (flat.fovy, flat.height, flat.projection) == (None, 2, "orthographic")
    assert (lens.fovy, lens.sensor_size, lens.focal_length) == (None, (0.04, 0.03), (0.05, 0.06))
    assert (lens.principal_point, lens.resolution, lens.outputs) == ((0.001, 0), (640, 480), ("rgb", "depth"))
    assert (follower.mode, follower.target, follower.body) == ("targetbody", "b", "world")


# --- keyframes -----------------------------------------------------------------------------------------


def test_keyframes_name_what_is_outside_its_range(mixed: ModelDescription) -> None:
    fine, far = mixed.keyframes
    assert (fine.name, fine.time, fine.finite, fine.outside) == ("fine", 0, True, ())
    assert (far.name, far.time, far.finite) == ("far", 2, True)
    assert far.outside == ("qpos/ball", "qpos/hinge", "ctrl/m", "act/actuator:3")


BALL = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/><worldbody><body><joint type="ball"
    range="0 1" limited="true"/><geom size="1"/></body></worldbody><keyframe><key/></keyframe></mujoco>""")


@given(angle=st.floats(-6, 6), axis=st.sampled_from([(1, 0, 0), (0, 0.6, 0.8)]))
def test_a_ball_is_outside_where_mujoco_limits_it(angle: float, axis: tuple[float, ...]) -> None:
    mujoco.mju_axisAngle2Quat(BALL.key_qpos[0], np.array(axis, float), angle)
    data = mujoco.MjData(BALL)
    mujoco.mj_resetDataKeyframe(BALL, data, 0)
    mujoco.mj_forward(BALL, data)
    distance = 1 - abs(math.remainder(angle, 2 * math.pi))
    if abs(distance) > 1e-6:
        assert bool(ModelDescription(BALL).keyframes[0].outside) == bool(data.nefc) == (distance < 0)


@pytest.mark.parametrize("field", ["key_qpos", "key_qvel", "key_ctrl", "key_act", "key_mpos"])
def test_a_number_that_is_not_finite_is_found_in_any_part_of_a_keyframe(field: str) -> None:
    model = mujoco.MjModel.from_xml_string(MIXED.replace('ctrl="5"', ""))
    getattr(model, field)[1, 0] = math.nan
    assert [key.finite for key in ModelDescription(model).keyframes] == [True, False]


# --- settings ------------------------------------------------------------------------------------------


def as_text(value: Any) -> str:
    return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)


def state(model: mujoco.MjModel) -> dict[str, Any]:
    """All options and all settings of what is drawn."""
    owners = {"opt": model.opt, **{name: getattr(model.vis, name) for name in ("global_", "quality", "headlight")}}
    owners |= {name: getattr(model.vis, name) for name in ("map", "scale", "rgba")}
    return {
        f"{owner}.{name}": np.array(getattr(value, name)).tolist()
        for owner, value in owners.items()
        for name in dir(type(value))
        if not name.startswith("_")
    }


def test_the_settings_told_are_all_that_makes_the_model_differ(scene: ModelDescription) -> None:
    spec = mujoco.MjSpec()
    for setting in (*scene.options, *scene.visual):
        apply(spec, Setting(setting.path, as_text(setting.value)))
    assert state(spec.compile()) == state(scene.model)
    for setting in (*scene.options, *scene.visual):
        apply(spec, Setting(setting.path, as_text(setting.default)))
    assert state(spec.compile()) == state(mujoco.MjSpec().compile())


def test_settings_are_told_in_mujocos_own_words() -> None:
    found = described("""<mujoco><option cone="elliptic" gravity="0 0 -1.62"><flag contact="disable" energy="enable"/>
        </option><visual><map znear=".3"/><quality shadowsize="512"/></visual></mujoco>""")
    assert [(s.path, s.value, s.default, s.unit) for s in (*found.options, *found.visual)] == [
        ("opt.cone", "elliptic", "pyramidal", ""),
        ("opt.gravity", (0, 0, -1.62), (0, 0, -9.81), "m/s²"),
        ("opt.flag.contact", "disable", "enable", ""),
        ("opt.flag.energy", "enable", "disable", ""),
        ("vis.quality.shadowsize", 512, 4096, ""),
        ("vis.map.znear", 0.3, 0.01, ""),
    ]


# --- files ---------------------------------------------------------------------------------------------

CUBE = """<texture name="box" type="cube" fileright="{0}" fileleft="{0}" fileup="{0}" filedown="{0}" filefront="{0}"
    fileback="{1}"/>"""


def picture(path: Path, size: int) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (size, size)).save(path)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A model of many files: an include in an include, an attached model with a texture, a mesh, faces of a cube."""
    faces = CUBE.format("a.png", "b.png")
    (tmp_path / "part").mkdir()
    texts = {
        "main.xml": f"""<mujoco><compiler texturedir="tex" meshdir="shapes"/><include file="part/one.xml"/><asset>
            <mesh file="tetra.obj"/><texture name="plain" type="2d" builtin="flat" width="8" height="4"/>{faces}
            <model name="child" file="part/child.xml"/></asset><worldbody><geom type="mesh" mesh="tetra"/>
            <attach model="child" body="b" prefix="c_"/></worldbody></mujoco>""",
        "part/one.xml": '<mujocoinclude><include file="two.xml"/></mujocoinclude>',
        "part/two.xml": '<mujocoinclude><worldbody><geom size="1"/></worldbody></mujocoinclude>',
        "part/child.xml": """<mujoco><asset><texture name="t" type="2d" file="c.png"/></asset><worldbody>
            <body name="b"><geom size="1"/></body></worldbody></mujoco>""",
        "part/shapes.txt": "not a part of the model",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    for name, size in {"tex/a.png": 8, "tex/b.png": 8, "part/c.png": 16}.items():
        picture(tmp_path / name, size)
    (tmp_path / "shapes").mkdir()
    vertices = "\n".join(f"v {x}" for x in ("0 0 0", "1 0 0", "0 1 0", "0 0 1"))
    (tmp_path / "shapes/tetra.obj").write_text(f"{vertices}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    return tmp_path


EXPECTED = {
    ("model", "main.xml"),
    ("include", "part/one.xml"),
    ("include", "part/two.xml"),
    ("attached model", "part/child.xml"),
    ("mesh", "shapes/tetra.obj"),
    ("texture", "tex/a.png"),
    ("texture", "tex/b.png"),
    ("texture", "part/c.png"),
}


def test_every_file_of_a_model_is_found_with_its_size_on_disk(project: Path) -> None:
    path = project / "main.xml"
    found = ModelDescription(mujoco.MjModel.from_xml_path(str(path)), path).assets
    files = [asset for asset in found if asset.path]
    assert {(asset.kind, os.path.relpath(asset.path or "", project)) for asset in files} == EXPECTED
    assert all(asset.bytes == Path(asset.path or "").stat().st_size for asset in files)
    mesh = next(asset for asset in found if asset.kind == "mesh")
    assert mesh.content == {"vertices": 4, "faces": 4}
    (built,) = (asset for asset in found if asset.path is None)
    assert (built.name, built.bytes, built.content) == ("plain", None, {"width": 8, "height": 4, "channels": 3})


def test_files_are_found_from_another_working_directory_and_from_the_models_own(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in (project, project.parent):
        monkeypatch.chdir(folder)
        path = (project / "main.xml").relative_to(folder)
        found = ModelDescription(mujoco.MjModel.from_xml_path(str(path)), path).assets
        assert {
            (asset.kind, os.path.relpath(asset.path, project.relative_to(folder))) for asset in found if asset.path
        } == EXPECTED


def test_files_in_an_archive_are_found_with_their_sizes(tmp_path: Path) -> None:
    picture(tmp_path / "red.png", 8)
    text = """<mujoco><include file="more.xml"/><asset><texture name="t" type="2d" file="red.png"/></asset></mujoco>"""
    more = "<mujocoinclude><worldbody><geom size='1'/></worldbody></mujocoinclude>"
    path = tmp_path / "robot.mjz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("robot.xml", text)
        archive.writestr("more.xml", more)
        archive.write(tmp_path / "red.png", "red.png")
    found = ModelDescription(mujoco.MjSpec.from_file(str(path)).compile(), path).assets
    assert [(asset.kind, asset.path and os.path.relpath(asset.path, path), asset.bytes) for asset in found] == [
        ("model", ".", path.stat().st_size),
        ("include", "more.xml", len(more)),
        ("texture", "red.png", (tmp_path / "red.png").stat().st_size),
    ]


def test_a_compiled_model_remembers_its_files_and_says_when_they_are_gone(project: Path) -> None:
    path = project / "main.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_path(str(project / "main.xml")), str(path))
    shutil.rmtree(project / "shapes")
    found = {asset.kind: asset for asset in ModelDescription(mujoco.MjModel.from_binary_path(str(path)), path).assets}
    assert (found["model"].path, found["model"].bytes) == (str(path), path.stat().st_size)
    assert (found["mesh"].path, found["mesh"].bytes) == (str(project / "shapes/tetra.obj"), None)


def test_a_source_that_is_not_xml_or_gone_names_nothing(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    broken = tmp_path / "broken.xml"
    broken.write_text('<mujoco><include file="broken.xml"/><asset></mujoco>')
    assert [asset.kind for asset in ModelDescription(model, broken).assets] == ["model", "include"]
    (asset,) = ModelDescription(model, tmp_path / "gone.xml").assets
    assert (asset.kind, asset.bytes) == ("model", None)


# --- real models ---------------------------------------------------------------------------------------


def test_plugins_are_told_by_name_with_what_the_source_sets(shared_models: Path) -> None:
    path = shared_models / "plugin/actuator/pid.xml"
    written = {
        instance.get("name"): {config.get("key"): config.get("value") for config in instance.findall("config")}
        for instance in ET.parse(path).getroot().iter("instance")
    }
    found = ModelDescription(mujoco.MjModel.from_xml_path(str(path))).plugins
    assert {plugin.name: plugin.settings for plugin in found} == written
    assert {plugin.plugin for plugin in found} == {"mujoco.pid"}
    assert [plugin.users for plugin in found] == [(f"actuator/actuator:{i}",) for i in range(4)]


def test_a_flex_is_counted_and_its_equality_names_it(shared_models: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(shared_models / "flex/pancake.xml"))
    found = ModelDescription(model)
    (flex,) = found.flexes
    assert (flex.name, flex.elements_are, flex.edge_equality) == ("plate", "triangles", "edges")
    assert (flex.vertices, flex.elements, flex.edges) == (model.nflexvert, model.nflexelem, model.nflexedge)
    assert [(e.type, e.object_kind, e.object1) for e in found.equalities] == [("flex", "flex", "plate")]


def test_every_real_model_is_described_whole(shared_models: Path) -> None:
    described_ones = 0
    for path in sorted(shared_models.rglob("*.xml")):
        with collected_warnings():
            try:
                model = mujoco.MjModel.from_xml_path(str(path))
            except ValueError:
                assert "malformed" in path.parts
                continue
            found = ModelDescription(model, path)
            assert all(getattr(found, name) is not None for name in SECTIONS)
        assert found.summary.mass == mujoco.mj_getTotalmass(model)
        assert all(asset.bytes for asset in found.assets if asset.path)
        described_ones += 1
    assert described_ones > 20
