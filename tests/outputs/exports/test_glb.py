"""Theorems about exported glTF files: they are valid, and objects are where MuJoCo puts them."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import MjrunError
from mjrun.outputs.export import Export
from mjrun.outputs.exports import FORMATS
from tests.gltf_files import ROOT, animated, issues, needs_validator, read_gltf

SCENES = sorted((ROOT / "scenes").glob("*.xml"))
MODELS = ROOT.parent / "shared" / "models"
SHOWN = ("contactpoint", "contactforce", "joint", "com", "inertia", "actuator", "light", "camera", "constraint")
# One for each kind of object: flexes of two and three dimensions, meshes with textures, tendons, sliders and cranks.
EXPORTED = ("balloons", "cube_3x3x3", "flag", "pancake", "mug", "tendon", "slider_crank", "tactile", "humanoid")


def exported(models: Sequence[Path], folder: Path, **options: object) -> list[Path]:
    """Exports two frames of each model that compiles."""
    files = list[Path]()
    for number, model in enumerate(models):
        file = folder / f"{number}_{model.stem}.glb"
        try:
            Export(mjrun.Simulation(model, duration=0.05), str(file), **options).run()  # type: ignore[arg-type]
        except MjrunError:
            continue
        files.append(file)
    return files


@pytest.mark.slow
@needs_validator
@pytest.mark.filterwarnings("ignore")
def test_scenes_are_valid_with_everything_shown(tmp_path: Path) -> None:
    files = exported(SCENES, tmp_path, show=SHOWN, frame_axes="body", trail="world", ghost="offset=0/1/0")
    assert len(files) == len(SCENES)
    assert issues(files) == {}


@pytest.mark.slow
@needs_validator
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(not MODELS.is_dir(), reason="the models are not here")
def test_models_of_mujoco_are_valid(tmp_path: Path) -> None:
    files = exported([model for model in sorted(MODELS.rglob("*.xml")) if model.stem in EXPORTED], tmp_path)
    assert len(files) == len(EXPORTED)
    assert issues(files) == {}


@pytest.mark.parametrize("scene", ["humanoid", "arm"])
def test_geoms_are_where_mujoco_puts_them(tmp_path: Path, scene: str) -> None:
    import trimesh

    Export(mjrun.Simulation(f"scene:{scene}", steps=1), str(tmp_path / "a.glb"), geomgroup="all").run()
    model = mujoco.MjModel.from_xml_path(str(ROOT / "scenes" / f"{scene}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turned = np.array([(1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)])  # z up becomes y up
    graph = trimesh.load_scene(tmp_path / "a.glb").graph
    counts = Counter(node.name for node in read_gltf((tmp_path / "a.glb").read_bytes()).nodes)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or f"geom:{geom}" for geom in range(model.ngeom)]
    unique = [geom for geom in range(model.ngeom) if counts[names[geom]] == 1]
    assert len(unique) > 5
    for geom in unique:
        pose = turned.T @ graph.get(names[geom])[0]
        rotation = pose[:3, :3] / np.linalg.norm(pose[:3, :3], axis=0)
        assert np.abs(pose[:3, 3] - data.geom_xpos[geom]).max() < 1e-6
        assert np.abs(rotation - data.geom_xmat[geom].reshape(3, 3)).max() < 1e-6


def test_every_body_moves_as_in_mujoco(tmp_path: Path) -> None:
    Export(mjrun.Simulation("scene:humanoid", key="jump", duration=0.5), str(tmp_path / "a.glb")).run()
    model = mujoco.MjModel.from_xml_path(str(ROOT / "scenes" / "humanoid.xml"))
    data, gltf = mujoco.MjData(model), read_gltf((tmp_path / "a.glb").read_bytes())
    mujoco.mj_resetDataKeyframe(model, data, model.key("jump").id)
    moving = [body for body in range(1, model.nbody) if model.body_dofnum[body]]
    motions = {body: animated(gltf, model.body(body).name) for body in moving}
    for frame in range(15):
        mujoco.mj_step(
            model, data, nstep=round(frame / 30 / model.opt.timestep) - round(data.time / model.opt.timestep)
        )
        mujoco.mj_kinematics(model, data)
        for body, motion in motions.items():
            assert np.abs(motion["translation"][frame] - data.xpos[body]).max() < 1e-6
            alike = motion["rotation"][frame] @ data.xquat[body][[1, 2, 3, 0]]
            assert abs(alike) == pytest.approx(1, abs=1e-6)


def test_the_file_states_its_origin_and_the_scene(tmp_path: Path) -> None:
    Export(mjrun.Simulation("scene:pendulum", steps=1), str(tmp_path / "a.glb"), command="mjrun export").run()
    gltf = read_gltf((tmp_path / "a.glb").read_bytes())
    facts = gltf.asset.extras["mjrun"]
    assert (facts["command"], facts["model"]["path"]) == ("mjrun export", "scene:pendulum")
    assert gltf.asset.generator.startswith("mjrun ")
    assert gltf.scenes[0].extras["extent"] > 0
    assert FORMATS["glb"].suffixes == (".glb",)
    assert FORMATS["glb"].write == "mjrun.outputs.export:write_glb_file"
