"""A body that tumbles in a bare loop, with every kind of joint, and its motion as samples."""

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from mjrun.physics.kinematic_samples import FIELDS, KinematicSamples
from mjrun.probe.fields import field_probe, offered
from tests.cases import mjcf

XML = mjcf("tumbler")


@dataclass(frozen=True)
class Kept:
    """Recorded states, in memory."""

    steps: np.ndarray
    rows: np.ndarray

    @property
    def size(self) -> int:
        return self.rows.shape[1]

    def state(self, index: int) -> np.ndarray:
        return self.rows[index].copy()


@cache
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


@dataclass(frozen=True)
class Run:
    """Every step of a bare loop: `(steps + 1, size)` each."""

    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    ctrl: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray

    def sampled(self, rows: slice | np.ndarray, *names: str, source: str = "t.csv") -> KinematicSamples:
        """Some rows of some fields."""
        values = {name: dict(enumerate(np.array(getattr(self, name)[rows]).T)) for name in names or FIELDS}
        return KinematicSamples(source, self.time[rows].copy(), column_names(), values)


def column_names() -> dict[str, list[str]]:
    known = offered(model())
    return {name: [c.name for c in field_probe(model(), name).columns] if name in known else [] for name in FIELDS}


@cache
def tumble(steps: int = 500) -> Run:
    data = mujoco.MjData(model())
    data.qpos[2] = 1
    data.qvel[:] = [0.5, -0.2, 4.0, 4.0, -6.0, 2.0, 1.5, -9.0, 4.0, 6.0, 0.3]
    rows: dict[str, list[np.ndarray]] = {name: [] for name in Run.__annotations__}
    for step in range(steps + 1):
        data.ctrl[:] = np.sin(5 * data.time), np.cos(3 * data.time)
        data.mocap_pos[0] = data.time, 1, 2
        mujoco.mju_axisAngle2Quat(data.mocap_quat[0], [0, 0, 1], 3 * data.time)
        for name, kept in rows.items():
            kept.append(np.array(getattr(data, name)).ravel().copy() if name != "time" else np.array(step * 0.002))
        mujoco.mj_step(model(), data)
    return Run(**{name: np.stack(kept) for name, kept in rows.items()})
