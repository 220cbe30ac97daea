"""Theorems about scenes that move: each frame is that of MuJoCo, whatever comes and goes or changes its shape."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
import pytest

from mjrun.model.mujoco_globals import collected_warnings
from mjrun.scene_graph.graph import Material, SceneGraph, SceneMotion, Track
from mjrun.scene_graph.recorder import FLAGS, SceneContentSettings, compute_poses, record_scene
from mjrun.scene_graph.visualizer_geoms import MOST
from tests.cases import mjcf

ROPE = mjcf("rope")
DROP = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="ball" pos="0 0 .3"><freejoint/><geom size=".1" solref="-1000 0"/></body>
  </worldbody>
</mujoco>
"""
CLOTH = mjcf("cloth")
MATTE = Material("matte", (1.0, 1.0, 1.0, 1.0), 0.0, 1.0)


def recorded(
    xml: str, steps: Sequence[int], show: Sequence[str] = (), see: Callable[[mujoco.MjData], object] = lambda data: None
) -> tuple[mujoco.MjModel, SceneGraph, SceneMotion]:
    """Records the scene at some steps, with `see` called for the data of each."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, options = mujoco.MjData(model), mujoco.MjvOption()
    for name in show:
        options.flags[FLAGS[name]] = 1

    def instants():
        for step, following in zip(steps, [*steps[1:], steps[-1]], strict=True):
            mujoco.mj_forward(model, data)
            see(data)
            yield data
            mujoco.mj_step(model, data, nstep=following - step)

    graph, motion = record_scene(model, instants(), np.array(steps) * model.opt.timestep, SceneContentSettings(options))
    return model, graph, motion


def at(track: Track, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns position and scale of a track at a frame, which holds those of the frame before."""
    row = int(np.searchsorted(track.frames, frame, side="right")) - 1
    return track.positions[row], track.scales[row]


def test_bodies_cameras_and_lights_move_as_in_mujoco() -> None:
    seen = list[dict[str, np.ndarray]]()
    look = lambda data: seen.append(  # noqa: E731
        {"ball": data.xpos[1].copy(), "follower": data.cam_xpos[0].copy(), "sun": data.light_xpos[0].copy()}
    )
    _, graph, motion = recorded(ROPE, [0, 40, 90], see=look)
    names = [graph.nodes[index].name for index in motion.nodes]
    assert sorted(names) == ["ball", "follower", "sun"]
    for frame, expected in enumerate(seen):
        for name, position in expected.items():
            assert np.allclose(motion.positions[frame, names.index(name)], position, atol=1e-12)


def test_a_tendon_is_a_cylinder_between_its_sites_at_every_frame() -> None:
    ends = list[np.ndarray]()
    _, graph, motion = recorded(ROPE, range(0, 200, 50), see=lambda data: ends.append(data.site_xpos.copy()))
    tracks = {graph.nodes[track.node].name: track for track in motion.tracks}
    (rope,) = (track for name, track in tracks.items() if name.startswith("rope") and not name.endswith(".1"))
    assert rope.smooth
    for frame, (hook, eye) in enumerate(ends):
        position, scale = at(rope, frame)
        assert np.allclose(position, (hook + eye) / 2, atol=1e-6)
        assert scale[2] == pytest.approx(np.linalg.norm(hook - eye) / 2, abs=1e-6)


def test_contacts_come_and_go() -> None:
    counts = list[int]()
    _, graph, motion = recorded(DROP, range(0, 400, 25), ["contactpoint"], lambda data: counts.append(data.ncon))
    assert {*counts} == {0, 1}
    (track,) = (track for track in motion.tracks if graph.nodes[track.node].layer == "contactpoint")
    assert [int(at(track, frame)[1].any()) for frame in range(len(counts))] == counts
    assert graph.nodes[track.node].scale == (0.0, 0.0, 0.0)


def test_the_vertices_of_a_cloth_are_those_that_mujoco_draws() -> None:
    drawn = list[np.ndarray]()

    def see(data: mujoco.MjData) -> None:
        scene = mujoco.MjvScene(data.model, 1000)
        options = mujoco.MjvOption()
        mujoco.mjv_updateScene(data.model, data, options, None, mujoco.MjvCamera(), 7, scene)
        drawn.append(scene.flexface.reshape(-1, 3, 3)[: scene.flexfaceused[0]].copy())

    _, graph, motion = recorded(CLOTH, [0, 30, 60], see=see)
    (shapes,) = motion.deformations
    mesh = graph.nodes[shapes.node].mesh
    assert mesh
    assert len(mesh.positions) < 3 * len(mesh.faces)
    for frame, triangles in enumerate(drawn):
        assert np.array_equal(shapes.positions[frame][mesh.faces], triangles)
    assert np.allclose(np.linalg.norm(shapes.normals, axis=2), 1, atol=1e-5)


def test_a_cord_is_cylinders_between_its_vertices() -> None:
    points = list[np.ndarray]()
    _, graph, motion = recorded(CLOTH, [0, 30], see=lambda data: points.append(data.flexvert_xpos[16:].copy()))
    tracks = [track for track in motion.tracks if graph.nodes[track.node].name.startswith("cord")]
    assert len(tracks) == 3
    for frame, vertices in enumerate(points):
        middles = sorted(at(track, frame)[0].tolist() for track in tracks)
        assert np.allclose(middles, sorted(((vertices[1:] + vertices[:-1]) / 2).tolist()), atol=1e-6)


def test_a_scene_grows_until_everything_is_in_it_and_nobody_is_told_to_increase_it() -> None:
    many = '<replicate count="700" offset=".3 0 0"><body><joint/><geom size=".1"/></body></replicate>'
    xml = f"<mujoco><worldbody>{many}</worldbody></mujoco>"
    with collected_warnings() as texts:
        _, graph, motion = recorded(xml, [0], ["com", "inertia", "joint"])
    assert (len(motion.tracks), graph.remarks, texts) == (2100, [], [])


def test_the_pyramid_of_a_camera_has_the_corners_that_mujoco_draws() -> None:
    xml = """<mujoco><worldbody><body><freejoint/><geom size=".1"/><camera pos="0 -1 .5" euler="80 10 0" fovy="50"
    resolution="320 200"/></body></worldbody></mujoco>"""
    drawn = list[np.ndarray]()

    def see(data: mujoco.MjData) -> None:
        scene, options = mujoco.MjvScene(data.model, 1000), mujoco.MjvOption()
        options.flags[FLAGS["camera"]] = 1
        mujoco.mjv_updateScene(data.model, data, options, None, mujoco.MjvCamera(), 7, scene)
        triangles = [geom for geom in scene.geoms[: scene.ngeom] if geom.type == mujoco.mjtGeom.mjGEOM_TRIANGLE]
        corners = [(0 * geom.pos, geom.size[0] * geom.mat[:, 0], geom.size[1] * geom.mat[:, 1]) for geom in triangles]
        drawn.append(np.array(corners) + np.array([geom.pos for geom in triangles])[:, None])

    _, graph, motion = recorded(xml, [0, 40], ["camera"], see)
    nodes = {track.node: graph.nodes[track.node] for track in motion.tracks}
    tracks = [track for track in motion.tracks if (nodes[track.node].material or MATTE).two_sided]
    assert len(tracks) == len(drawn[0]) > 3
    for frame, expected in enumerate(drawn):
        for track, corners in zip(tracks, expected, strict=True):
            rotation = np.empty(9)
            mujoco.mju_quat2Mat(rotation, track.quaternions[frame])
            mesh = nodes[track.node].mesh
            assert mesh
            shape = mesh.positions * track.scales[frame]
            assert np.allclose(shape @ rotation.reshape(3, 3).T + track.positions[frame], corners, atol=1e-4)


def test_names_cannot_be_drawn_and_the_user_is_told() -> None:
    model = mujoco.MjModel.from_xml_string(ROPE)
    data, options = mujoco.MjData(model), mujoco.MjvOption()
    options.label = int(mujoco.mjtLabel.mjLABEL_BODY)
    compute_poses(model, data)
    graph, _ = record_scene(model, [data], [0.0], SceneContentSettings(options))
    assert [remark for remark in graph.remarks if "names" in remark]


def test_decorations_are_nodes_of_their_own() -> None:
    model = mujoco.MjModel.from_xml_string(ROPE)
    data = mujoco.MjData(model)
    compute_poses(model, data)

    def add(scene: mujoco.MjvScene, frame: int) -> None:
        for number in range(frame):  # none in the first frame, two in the last
            geom = scene.geoms[scene.ngeom]
            box = int(mujoco.mjtGeom.mjGEOM_BOX)
            mujoco.mjv_initGeom(geom, box, np.ones(3), np.array([frame, number, 0.0]), np.eye(3).ravel(), np.ones(4))
            scene.ngeom += 1

    request = SceneContentSettings(mujoco.MjvOption(), [("trail", add)], room=5)
    graph, motion = record_scene(model, [data] * 3, [0, 1, 2], request)
    tracks = [track for track in motion.tracks if graph.nodes[track.node].name.startswith("trail")]
    shown = [[int(at(track, frame)[1].any()) for track in tracks] for frame in range(3)]
    assert shown == [[0, 0], [1, 0], [1, 1]]
    assert not any(track.smooth for track in tracks)


def test_what_depends_on_forces_is_known() -> None:
    model, options = mujoco.MjModel.from_xml_string(ROPE), mujoco.MjvOption()
    assert not SceneContentSettings(options).needs_forces(model)
    options.flags[FLAGS["contactforce"]] = 1
    assert SceneContentSettings(options).needs_forces(model)


def test_there_is_a_limit_to_items(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.scene_graph.visualizer_geoms.MOST", 1)
    _, graph, motion = recorded(ROPE, [0, 10], ["joint", "com"])
    assert len(motion.tracks) == 1 < MOST
    assert [remark for remark in graph.remarks if "too many" in remark]


def test_poses_that_need_much_memory_are_on_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = recorded(ROPE, [0, 40, 90])[2]
    monkeypatch.setattr("mjrun.scene_graph.recorder.SPILL", 0)
    motion = recorded(ROPE, [0, 40, 90])[2]
    assert isinstance(motion.positions, np.memmap)
    assert np.array_equal(motion.positions, expected.positions)
    assert np.array_equal(motion.quaternions, expected.quaternions)


def test_an_empty_scene_is_reported() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1' group='5'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    compute_poses(model, data)
    graph, _ = record_scene(model, [data], [0.0], SceneContentSettings(mujoco.MjvOption()))
    assert [remark for remark in graph.remarks if "empty" in remark]
