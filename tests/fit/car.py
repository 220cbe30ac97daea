"""The car of the gallery, driven by a bare loop of MuJoCo, of which the wheels alone are measured."""

from pathlib import Path

import mujoco
import numpy as np

CAR = str(Path(__file__).parents[2] / "scenes/car.xml")
SIGNALS = ["qpos/left", "qpos/right"]


def drive(gear: float, steps: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Angles of the wheels `(n, 2)` and commands `(n, 2)`, every fifth step, with `gear` times the model's gears."""
    spec = mujoco.MjSpec.from_file(CAR)
    for actuator in spec.actuators:
        actuator.gear = np.array(actuator.gear) * gear
    model = spec.compile()
    data = mujoco.MjData(model)
    angles: list[np.ndarray] = []
    controls: list[np.ndarray] = []
    for step in range(steps):
        if step % 5 == 0:
            data.ctrl[:] = 0.5 * np.sin(2 * np.pi * np.array([0.4, 0.7]) * data.time)
            angles.append(data.qpos[-2:].copy())
            controls.append(data.ctrl.copy())
        mujoco.mj_step(model, data)
    return np.array(angles), np.array(controls)
