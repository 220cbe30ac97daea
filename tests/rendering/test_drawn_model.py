"""The drawn model: a stage that changes nothing else, and the choice between visual and colliding geoms."""

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.errors import BadValueError, BrokenModelError, CompiledOverrideError, FileError
from mjrun.model.fields import arrays
from mjrun.model.sources import source_of
from mjrun.model.state import save, widened
from mjrun.options.rendering import ViewOptions
from mjrun.rendering.drawn_model import drawn_model, ground_remark, place_stage, stage_parts, visual_remark
from tests.cases import mjcf
from tests.demonstration_files import PLAIN, recorded_states, write_demonstrations

ARM = mjcf("arm_on_plinth")
CLOSE = '<body><geom name="a" size=".1"/><geom name="b" type="box" size=".1 .1 .1" contype="0" conaffinity="0"/></body>'
APART = '<body><geom name="a" size=".1"/><geom name="b" size=".1" pos="1 0 0" contype="0" conaffinity="0"/></body>'


def model_file(folder: Path, text: str) -> Path:
    path = folder / "model.xml"
    path.write_text(text)
    return path


def drawn(path: Path, **options: object) -> tuple[mujoco.MjModel, mujoco.MjModel, str]:
    """Returns the simulated model, the drawn one and the remark."""
    source = source_of(path)
    model = source.load()
    staged, remark, _ = drawn_model(ViewOptions(**options), model, source)  # pyright: ignore[reportArgumentType]
    return model, staged, remark


def test_a_stage_leaves_all_ids_numbers_and_accelerations_alone(tmp_path: Path) -> None:
    model, staged, _ = drawn(model_file(tmp_path, ARM), stage=("floor", "light", "sky"))
    for kind, count in (("body", model.nbody), ("geom", model.ngeom), ("jnt", model.njnt)):
        assert getattr(staged, f"n{kind}") == count + (kind != "jnt")
    for name in arrays():
        if name.startswith(("body_", "geom_", "jnt_", "dof_")) and not name.endswith("adr"):
            values = getattr(model, name)
            assert np.array_equal(getattr(staged, name)[: len(values)], values), name

    data, copied = mujoco.MjData(model), mujoco.MjData(staged)
    for _ in range(200):
        mujoco.mj_step(model, data)
        mujoco.mj_step(staged, copied)
    assert data.ncon
    assert np.array_equal(save(staged, copied), widened(staged, save(model, data)))


@pytest.mark.parametrize("compiler", ['fusestatic="true"', 'discardvisual="true"', 'strippath="true"'])
@pytest.mark.parametrize("suffix", ["xml", "urdf"])
def test_a_stage_is_kept_where_the_compiler_fuses_bodies_and_discards_visual_geoms(
    tmp_path: Path, compiler: str, suffix: str
) -> None:
    text = {
        "xml": f"""
            <mujoco>
              <compiler {compiler}/>
              <worldbody>
                <body pos="0 0 1">
                  <geom type="box" size=".1 .1 .1"/>
                  <geom type="box" size=".2 .2 .2" contype="0" conaffinity="0"/>
                  <body><joint axis="0 1 0"/><geom type="capsule" size=".05 .2"/></body>
                </body>
              </worldbody>
            </mujoco>""",
        "urdf": f"""
            <robot name="arm">
              <mujoco><compiler {compiler}/></mujoco>
              <link name="base"><visual><geometry><box size=".4 .4 .4"/></geometry></visual></link>
              <link name="rod">
                <inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
                <collision><geometry><sphere radius=".1"/></geometry></collision>
              </link>
              <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
            </robot>""",
    }
    path = tmp_path / f"model.{suffix}"
    path.write_text(text[suffix])
    model, staged, _ = drawn(path)
    assert (staged.nbody, staged.ngeom, staged.ntex) == (model.nbody + 1, model.ngeom + 1, model.ntex + 2)
    assert np.array_equal(staged.geom_bodyid, [*model.geom_bodyid, model.nbody])
    assert np.array_equal(staged.geom_size[:-1], model.geom_size)
    assert staged.geom_type[-1] == mujoco.mjtGeom.mjGEOM_PLANE


@pytest.mark.parametrize("kept", ["true", "false"])
@pytest.mark.parametrize("shape", ["visual", "collision"])
def test_a_remark_tells_when_mujoco_reads_no_visual_geoms_of_a_urdf(tmp_path: Path, kept: str, shape: str) -> None:
    compiler = f'<mujoco><compiler discardvisual="{kept}" fusestatic="false"/></mujoco>'
    sphere = f'<{shape}><geometry><sphere radius="1"/></geometry></{shape}>'
    path = tmp_path / "a.urdf"
    path.write_text(f'<robot name="r">{compiler}<link name="a">{sphere}</link></robot>')
    source = source_of(path)
    assert bool(visual_remark(source)) == (source.load().ngeom == 0)
    path.unlink()
    with pytest.raises(FileError, match="cannot be read"):
        visual_remark(source)


@pytest.mark.parametrize("angle", [0.0, 0.7, -0.7, math.pi / 2])
def test_the_floor_touches_the_lowest_point_of_a_capsule(tmp_path: Path, angle: float) -> None:
    rod = f'<geom type="capsule" size=".1 .4" pos="0 0 3" euler="0 {math.degrees(angle)} 0"/>'
    model, staged, _ = drawn(model_file(tmp_path, f"<mujoco><worldbody>{rod}</worldbody></mujoco>"))
    for _ in range(2):  # placing it again changes nothing
        place_stage(staged, [save(model, mujoco.MjData(model))])
        assert staged.body("stage floor").pos[2] == pytest.approx(3 - 0.1 - 0.4 * math.cos(angle))


@pytest.mark.parametrize("is_free", [False, True])
def test_the_floor_is_below_the_motion_but_not_below_a_fall(tmp_path: Path, is_free: bool) -> None:
    ball = '<geom name="ball" size=".1" pos=".5 0 0" rgba="1 0 0 1"/>'
    ball += '<geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" rgba="0 1 0 1"/>'
    joint = "<freejoint/>" if is_free else '<joint axis="0 1 0"/>'
    path = model_file(tmp_path, f"<mujoco><worldbody><body>{joint}{ball}</body></worldbody></mujoco>")
    model, staged, _ = drawn(path, stage=("floor",))
    data, states, lowest = mujoco.MjData(model), [], []
    for _ in range(400):
        mujoco.mj_forward(model, data)
        states.append(save(model, data))
        lowest.append(data.geom("ball").xpos[2] - 0.1)
        mujoco.mj_step(model, data)
    place_stage(staged, states)
    assert staged.body("stage floor").pos[2] == pytest.approx(lowest[0] if is_free else min(lowest), abs=1e-9)
    assert min(lowest) < -0.599


def test_every_frame_of_a_video_shows_what_swings_below_its_start(tmp_path: Path) -> None:
    ball = '<geom size=".1" pos=".5 0 0" rgba="1 0 0 1"/>'
    text = f'<mujoco><worldbody><body><joint axis="0 1 0"/>{ball}</body></worldbody></mujoco>'
    simulation = mjrun.Simulation(model_file(tmp_path, text), duration=1)
    mjrun.Video(simulation, str(tmp_path / "swing"), size=(64, 48), fps=8).run()
    frames = [np.asarray(Image.open(file), float) for file in sorted((tmp_path / "swing").glob("*.png"))]
    assert len(frames) == 8
    assert all(np.any(frame[..., 0] > 2 * frame[..., 1] + 30) for frame in frames)


@pytest.mark.parametrize(
    ("world", "options", "parts"),
    [
        ('<geom size=".1"/>', {}, ["floor", "light", "sky", "camera"]),
        ('<geom size=".1"/>', {"camera": ("free",)}, ["floor", "light", "sky"]),
        ('<geom size=".1"/>', {"stage": ("none",)}, []),
        ('<geom size=".1"/><light/>', {}, ["floor", "sky", "camera"]),
        ('<geom size=".1"/><light/>', {"stage": ("light",)}, ["light"]),
        ('<body><freejoint/><geom size=".1"/></body>', {}, ["light", "sky", "camera"]),
        ('<geom type="plane" size="1 1 1"/>', {}, []),
    ],
)
def test_a_bare_model_gets_what_it_lacks(world: str, options: dict[str, tuple[str, ...]], parts: list[str]) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    assert [*stage_parts(replace(ViewOptions(), **options), model)] == parts


@pytest.mark.parametrize("stage", ["auto", "none"])
def test_a_model_of_infinite_extent_is_refused(tmp_path: Path, stage: str) -> None:
    text = '<mujoco><statistic extent="inf"/><worldbody><geom size=".1"/></worldbody></mujoco>'
    with pytest.raises(BrokenModelError, match=r"stat\.extent must be finite for images, not inf"):
        drawn(model_file(tmp_path, text), stage=(stage,))


def test_a_floor_is_below_flexes(tmp_path: Path) -> None:
    cloth = """<flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing=".1 .1 .1" pos="0 0 -2" radius=".01"
      mass="1"><edge equality="true"/></flexcomp>"""
    text = f"<mujoco><worldbody><body><freejoint/><geom size='.1'/></body>{cloth}</worldbody></mujoco>"
    model, staged, _ = drawn(model_file(tmp_path, text), stage=("floor",))
    start = save(model, mujoco.MjData(model))
    place_stage(staged, [start])
    assert staged.body("stage floor").pos[2] == pytest.approx(-2.01)
    assert " -2.01 adds a floor" in ground_remark(model, start)


def test_measured_images_get_the_camera_but_no_floor_unless_requested(tmp_path: Path) -> None:
    simulation = mjrun.Simulation(model_file(tmp_path, ARM))
    colours = mjrun.Image(simulation, output="i.png")
    measured = [replace(colours, view=("rgb", "depth")), replace(colours, pointcloud="i.ply")]
    for image in (colours, *measured):
        parts = stage_parts(image, simulation.load(), is_measured=image.is_measured)
        assert [*parts] == [*(["floor"] if image is colours else []), "light", "sky", "camera"]
        assert [*stage_parts(replace(image, stage=("floor",)), simulation.load(), is_measured=True)] == ["floor"]


def test_a_model_whose_file_has_changed_is_not_drawn(tmp_path: Path) -> None:
    source = source_of(model_file(tmp_path, ARM))
    model = source.load()
    model_file(tmp_path, f"<mujoco><worldbody>{CLOSE}</worldbody></mujoco>")
    with pytest.raises(BrokenModelError, match="it has changed since it was loaded"):
        drawn_model(ViewOptions(), model, source)


def test_a_model_on_a_ground_gets_tiles_light_and_sky(tmp_path: Path) -> None:
    path = model_file(tmp_path, '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>')
    source = mjrun.Simulation(path, ground=-1).source
    model = source.load()
    staged, remark, has_camera = drawn_model(ViewOptions(), model, source)
    assert has_camera
    assert staged.ngeom == model.ngeom == 2
    assert staged.geom("ground").matid >= 0
    assert remark.startswith("a floor, a light, a sky and a camera added, which the model lacks; ")


TETRAHEDRON = '<asset><mesh name="m" vertex="0 0 0 .3 0 0 0 .2 0 0 0 .4"/></asset>'


@pytest.mark.parametrize(
    "geom",
    [
        *('type="sphere" size=".1"', 'type="capsule" size=".1 .2"', 'type="cylinder" size=".1 .2"'),
        *('type="box" size=".1 .2 .3"', 'type="ellipsoid" size=".1 .2 .3"', 'type="mesh" mesh="m"'),
    ],
)
def test_the_floor_that_is_advised_is_below_what_collides_by_less_than_a_millimetre(geom: str) -> None:
    bodies = (
        f'<body pos="0 0 -.4"><freejoint/><geom {geom} euler="20 40 60"/><geom size="9" contype="0" conaffinity="0"/>'
    )
    text = f"<mujoco>{TETRAHEDRON}<worldbody>{{}}{bodies}</body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text.format(""))
    remark = ground_remark(model, save(model, mujoco.MjData(model)))
    height = float(remark.split(" adds a floor")[0].split()[-1])

    model = mujoco.MjModel.from_xml_string(text.format(f'<geom type="plane" size="1 1 1" pos="0 0 {height}"/>'))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert -1e-9 < mujoco.mj_geomDistance(model, data, 0, 1, 9, None) < 0.001 + 1e-9
    assert not ground_remark(model, save(model, data))


def test_a_compiled_model_has_no_stage_unless_one_is_requested() -> None:
    source = source_of(mujoco.MjModel.from_xml_string(ARM))
    model = source.load()
    assert drawn_model(ViewOptions(), model, source) == (model, "", False)
    with pytest.raises(CompiledOverrideError, match="stage"):
        drawn_model(ViewOptions(stage=("sky",)), model, source)


def test_a_stage_shows_changed_numbers_of_the_model(tmp_path: Path) -> None:
    source = source_of(model_file(tmp_path, ARM))
    model = source.load()
    model.geom("rod").size[0] = 0.07
    staged, _, _ = drawn_model(ViewOptions(), model, source)
    assert staged.geom("rod").size[0] == 0.07


def test_a_stage_shows_textures_and_materials_that_are_edited_afterwards_as_they_were(tmp_path: Path) -> None:
    def write(color: str, material: str) -> Path:
        Image.new("RGB", (8, 8), color).save(tmp_path / "t.png")
        texture = '<texture name="t" type="2d" file="t.png"/><material name="a" texture="t"/><material name="b"/>'
        geoms = f'<geom size=".1" material="{material}"/><geom name="bare" size=".2"/>'
        if material == "b":
            geoms = geoms.replace('name="bare"', 'name="bare" material="a"')
        text = f"<mujoco><asset>{texture}</asset><worldbody><body><freejoint/>{geoms}</body></worldbody></mujoco>"
        return model_file(tmp_path, text)

    options = ViewOptions(stage=("floor", "light", "sky"))
    source = source_of(write("red", "a"))
    model = source.load()
    expected, _, _ = drawn_model(options, model, source)
    write("blue", "b")
    staged, _, _ = drawn_model(options, model, source)
    assert staged.ngeom > model.ngeom
    for name in ("tex_data", "geom_matid", "mat_texid", "geom_rgba"):
        np.testing.assert_array_equal(getattr(staged, name), getattr(expected, name))


@pytest.mark.parametrize(
    ("bodies", "geoms", "visible"),
    [
        (CLOSE, None, "b"),
        (APART, None, "ab"),
        (APART, "visual", "b"),
        (CLOSE, "collision", "a"),
        (CLOSE, "both", "ab"),
        ('<body><geom name="a" size=".1"/></body>', "visual", "a"),
        (CLOSE.replace('"a"', '"a" group="3"'), None, "b"),
        (CLOSE.replace('"a"', '"a" group="3"'), "collision", "a"),
        (CLOSE.replace('"a"', '"a" group="3"'), "both", "ab"),
    ],
)
def test_visual_geoms_replace_the_colliding_ones_of_their_body(
    tmp_path: Path, bodies: str, geoms: str | None, visible: str
) -> None:
    text = f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
    _, model, _ = drawn(model_file(tmp_path, text), stage=("none",), geoms=geoms)
    scene = mujoco.MjvScene(model, 20)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mujoco.mjv_updateScene(
        model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL.value, scene
    )
    assert "".join(sorted(model.geom(geom.objid).name for geom in scene.geoms[: scene.ngeom])) == visible


def test_a_stage_is_automatic_or_absent_or_consists_of_parts(tmp_path: Path) -> None:
    with pytest.raises(BadValueError, match="none, floor"):
        mjrun.Image(mjrun.Simulation(model_file(tmp_path, ARM)), output="arm.png", stage=("none", "floor"))


def test_groups_that_are_requested_are_shown_as_they_are(tmp_path: Path) -> None:
    path = model_file(tmp_path, f"<mujoco><worldbody>{CLOSE}</worldbody></mujoco>")
    model, shown, _ = drawn(path, stage=("none",), geomgroup=(0,))
    assert shown is model


def test_a_video_shows_the_stage_and_the_simulation_does_not_notice(tmp_path: Path) -> None:
    path = model_file(tmp_path, ARM)
    simulation = mjrun.Simulation(path, duration=0.2)
    alone = mjrun.Trace(
        simulation,
        output=str(tmp_path / "alone.csv"),
    ).run()
    together = mjrun.Trace(simulation, output=str(tmp_path / "together.csv"))
    image = mjrun.Image(simulation, output=str(tmp_path / "arm.png"), size=(64, 48), time=0)
    plain = replace(image, output=str(tmp_path / "plain.png"), stage=("none",))
    mjrun.perform([together, image, plain])
    assert Path(alone.path).read_bytes() == (tmp_path / "together.csv").read_bytes()

    import imageio.v3 as iio

    assert iio.imread(tmp_path / "plain.png")[0, 0].max() == 0
    assert iio.imread(tmp_path / "arm.png")[0, 0].min() > 50


def test_geoms_that_only_collide_and_sites_of_robosuite_are_omitted_unless_requested(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    collisions = ["arm_collision", "cube"]
    for options, hidden in [({}, collisions), ({"geoms": "both"}, []), ({"geomgroup": (0, 1)}, [])]:
        _, made, _ = drawn(Path(f"{path}:demo_1"), **options)
        assert [name for name in collisions if made.geom(name).group[0] == mujoco.mjNGROUP - 1] == hidden
        assert made.site_group.tolist() == [mujoco.mjNGROUP - 1]
    assert drawn(Path(f"{path}:demo_1"), sitegroup=(0,))[1].site_group.tolist() == [0]
    write_demonstrations(path, attributes={})  # of another program
    model, made, _ = drawn(Path(f"{path}:demo_1"))
    assert np.array_equal(made.geom_group, model.geom_group)


@pytest.mark.gl
@pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")
def test_frames_of_a_demonstration_are_those_of_a_bare_loop_that_hides_the_group(tmp_path: Path) -> None:
    states = recorded_states(3)
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo_1": states})
    (tmp_path / "m.xml").write_text(PLAIN)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    data, visible = mujoco.MjData(model), mujoco.MjvOption()
    visible.geomgroup[0] = 0
    visible.sitegroup[:] = 0

    made = [*mjrun.frames(str(path), camera="agentview", size=(64, 64), fps=20)]
    assert len(made) == 2  # a video ends before the instant of the last state
    with mujoco.Renderer(model, 64, 64) as renderer:
        for state, frame in zip(states, made, strict=False):
            data.qpos[:] = state[1 : 1 + model.nq]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "agentview", visible)
            assert np.array_equal(frame, renderer.render())


@pytest.mark.parametrize(("extent", "tile"), [(0.3, 0.1), (3.0, 1.0), (0.31, 0.1), (14.0, 2.0), (3e-5, 1e-5)])
def test_tiles_of_the_floor_are_round_and_no_larger_than_a_third_of_the_model(
    tmp_path: Path, extent: float, tile: float
) -> None:
    world = '<worldbody><geom size=".1"/></worldbody>'
    path = model_file(tmp_path, f'<mujoco><statistic extent="{extent}"/>{world}</mujoco>')
    _, staged, _ = drawn(path, stage=("floor",))
    place_stage(staged, [])
    assert staged.mat_texrepeat[-1] == pytest.approx(1 / (2 * tile))
