"""MuJoCo Playground's conventions as a task document, against a loop that is written as its joystick environments are.

Source: `mujoco_playground/_src/mjx_env.py` and `_src/locomotion/go1/joystick.py`: `ctrl = default + action * scale`
is held for `n_substeps`; observations are read as `mj_step` leaves them; the phase of the gait as sines and cosines.
"""

import re
from pathlib import Path

import mujoco
import numpy as np
import onnxruntime
import pytest
from onnx import helper

from mjrun.document.task import read_task
from mjrun.formats.table_reader import read_table
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from tests.cases import mjcf
from tests.documentation import TEXT
from tests.policy.networks import value, write

MODEL = mjcf("two_legs")
(TASK,) = re.findall(r"This task follows its conventions:\n\n```yaml\n(.*?)```", TEXT, re.DOTALL)
SIZE, PERIODS, SUBSTEPS, DT = 20, 100, 5, 0.02


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "robot.xml").write_text(MODEL)
    (tmp_path / "task.yaml").write_text(TASK)
    weights = np.random.default_rng(1).normal(scale=0.3, size=(SIZE, 2)).astype(np.float32)
    nodes = [helper.make_node("MatMul", ["obs", "w"], ["x"]), helper.make_node("Tanh", ["x"], ["continuous_actions"])]
    outputs = [value("continuous_actions", [1, 2])]
    write(tmp_path / "joystick.onnx", nodes, [value("obs", [1, SIZE])], outputs, {"w": weights})
    return tmp_path


def bare_episode(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Observations, actions and positions at each control instant, by MuJoCo and onnxruntime alone."""
    model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    data, session = mujoco.MjData(model), onnxruntime.InferenceSession(str(folder / "joystick.onnx"))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    default, last, rows = model.key_qpos[0, 7:], np.zeros(2), []
    for period in range(PERIODS):
        command = [0.5, 0, 0] if period * DT < 1 else [0, 0, 1]
        phase = 2 * np.pi * period * DT / 0.8
        observation = np.concatenate([
            data.sensor("local_linvel").data, data.sensor("gyro").data,
            data.body("trunk").xmat.reshape(3, 3).T @ [0, 0, -1],
            data.qpos[7:] - default, data.qvel[6:], last, command, [np.sin(phase), np.cos(phase)],
        ])  # fmt: skip
        (action,) = session.run(["continuous_actions"], {"obs": observation.astype(np.float32)[None]})
        last = np.asarray(action)[0].astype(float)
        rows.append((observation, last, data.qpos.copy()))
        data.ctrl = last * 0.5 + default
        for _ in range(SUBSTEPS):
            mujoco.mj_step(model, data)
    return tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]


def test_the_task_document_plays_as_playgrounds_loop(folder: Path) -> None:
    simulation = Simulation(read_task(folder / "task.yaml"), policy=str(folder / "joystick.onnx"))
    Trace(simulation, str(folder / "t.csv"), every=SUBSTEPS, probe=["obs", "action", "qpos"]).run()
    table = np.column_stack([*read_table(folder / "t.csv").columns.values()])[:PERIODS]
    observations, actions, positions = bare_episode(folder)
    assert np.ptp(positions[:, 7:]) > 0.1
    np.testing.assert_allclose(table[:, 1 : 1 + SIZE], observations, atol=1e-9)
    np.testing.assert_allclose(table[:, 1 + SIZE : 3 + SIZE], actions, atol=1e-6)  # float32
    np.testing.assert_allclose(table[:, 3 + SIZE :], positions, atol=1e-9)
