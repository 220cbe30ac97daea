"""Theorems about exports: their frames, contacts, instants and errors, against a bare MuJoCo loop."""

import json
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.camera.rigs.free_camera import FreeRig
from mjrun.camera.script import CameraScript, ConditionEvent, Shot
from mjrun.cli.console import Console
from mjrun.errors import MjrunError, SimulationError, clean
from mjrun.outputs.export import BLOCK, ContactRecorder, Export
from mjrun.outputs.exports import FORMATS, export_format
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from tests.cases import cases
from tests.gltf_files import animated, read_gltf


def document(path: Path) -> dict[str, Any]:
    """Returns the JSON of a binary glTF file."""
    content = path.read_bytes()
    return json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])


def moved(path: Path, name: str) -> np.ndarray:
    """Returns the translations of a node `(frames, 3)`."""
    return animated(read_gltf(path.read_bytes()), name)["translation"]


def test_each_frame_is_that_of_a_bare_loop(swing: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(swing, duration=0.5)
    result = Export(simulation, str(tmp_path / "a.glb"), fps=50, speed=0.5).run()
    assert (result.frames, result.duration, result.format) == (50, 1.0, "glb")
    assert result.size == (tmp_path / "a.glb").stat().st_size

    model = mujoco.MjModel.from_xml_path(str(swing))
    data, positions = mujoco.MjData(model), list[np.ndarray]()
    for step in range(250):
        if step % 5 == 0:  # frame k shows k·speed/fps = k·0.01 s, and a step has 0.002 s
            mujoco.mj_kinematics(model, data)
            positions.append(data.body("ball").xpos.copy())
        mujoco.mj_step(model, data)
    assert np.abs(moved(tmp_path / "a.glb", "ball") - positions).max() < 1e-6


def test_a_single_frame_has_no_motion(swing: Path, tmp_path: Path) -> None:
    result = Export(mjrun.Simulation(swing, steps=1), str(tmp_path / "a.glb")).run()
    assert result.frames == 1
    assert "animations" not in document(tmp_path / "a.glb")


def test_a_requested_camera_is_added_and_moves(swing: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(swing, duration=0.2)
    Export(simulation, str(tmp_path / "a.glb"), camera="track:ball", size=(300, 200)).run()
    found = document(tmp_path / "a.glb")
    assert [camera["name"] for camera in found["cameras"]] == ["side", "track:ball"]
    assert found["cameras"][1]["perspective"]["aspectRatio"] == 1.5
    assert len(moved(tmp_path / "a.glb", "track:ball")) == 6


def test_an_unstable_simulation_leaves_nothing_unless_asked(exploding: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(exploding, key="fast", duration=5)
    with pytest.raises(SimulationError):
        Export(simulation, str(tmp_path / "a.glb")).run()
    assert not (tmp_path / "a.glb").exists()
    with pytest.raises(SimulationError):
        Export(simulation, str(tmp_path / "a.glb"), keep_partial=True).run()
    assert document(tmp_path / "a.glb")["asset"]["extras"]["mjrun"]["steps"] == 167


def test_as_much_is_kept_of_an_export_that_waits_for_an_event(exploding: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(exploding, key="fast", duration=5)
    later = CameraScript("later", [Shot(FreeRig(), until=ConditionEvent("time > 0.05")), Shot(FreeRig())])
    frames = list[int]()
    for camera in ([], [later]):
        with pytest.raises(SimulationError) as caught:
            Export(simulation, str(tmp_path / "a.glb"), camera=camera, keep_partial=True).run()
        frames += [result.frames for result in caught.value.results]
    assert len(frames) == 2
    assert frames[0] == frames[1] > 2


def test_flags_of_images_are_reported(swing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulation = mjrun.Simulation(swing, steps=1)
    Export(simulation, str(tmp_path / "a.glb"), show="wireframe", hide="shadow").run(Console())
    assert "wireframe, shadow: ignored" in capsys.readouterr().err


def test_hostile_names_stay_names(tmp_path: Path) -> None:
    name = '"},{"x\\\n\u2028</script>'
    attribute = quoteattr(name, {"\n": "&#10;"})
    xml = f"<mujoco><worldbody><body name={attribute}><geom name={attribute} size='.1'/></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    Export(mjrun.Simulation(model, steps=1), str(tmp_path / "a.glb"), stage="none").run()
    names = {node["name"] for node in document(tmp_path / "a.glb")["nodes"]}
    assert names == {"world", clean(name), "free"}


@cases("output, options, message")
def test_faulty_requests_fail_before_the_simulation(
    swing: Path, tmp_path: Path, output: str, options: dict[str, object], message: str
) -> None:
    with pytest.raises(MjrunError, match=message):
        Export(mjrun.Simulation(swing, steps=10**9), str(tmp_path / output), **options).run()  # type: ignore[arg-type]
    assert not (tmp_path / output).exists()


def test_formats_are_found_by_suffix_and_by_name() -> None:
    assert export_format("A.GLB") is FORMATS["glb"]
    assert export_format("anything", "glb") is FORMATS["glb"]


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_names_its_writer_or_the_output_that_makes_its_folder(name: str) -> None:
    assert bool(FORMATS[name].write) != bool(FORMATS[name].product)
    assert callable(resolve_name(FORMATS[name].write or FORMATS[name].product))


MODEL = """
<mujoco>
  <option cone="{cone}"/>
  <worldbody>
    <geom type="plane" size="1 1 .1" euler="0 10 0"/>
    <body pos="0 0 .2"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
    <body pos="0 0 .4"><freejoint/><geom size=".05" condim="1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_positions_normals_and_forces_are_those_of_mujoco(cone: str) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(cone=cone))
    frames = range(0, 3 * BLOCK + 10, 2)
    recorder = ContactRecorder(model)
    run_with_taps(PhysicsStepper(model, mujoco.MjData(model)), [Tap(frames, recorder.record)], frames[-1])
    found = recorder.contacts(len(frames) - 1)
    recorder.close()

    data, counts, rows = mujoco.MjData(model), list[int](), list[np.ndarray]()
    for step in range(frames[-1]):
        mujoco.mj_forward(model, data)
        if step in frames:
            counts.append(data.ncon)
            for index, contact in enumerate(data.contact):
                wrench, axes = np.zeros(6), contact.frame.reshape(3, 3)
                mujoco.mj_contactForce(model, data, index, wrench)
                rows.append(np.concatenate([contact.pos, axes[0], wrench[:3] @ axes]))
        mujoco.mj_step(model, data)
    assert found.counts.tolist() == counts
    assert sum(counts) > 100
    np.testing.assert_allclose(found.values, np.array(rows), atol=2e-4)
