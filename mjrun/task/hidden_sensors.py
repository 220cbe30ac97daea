"""Sensors that a model gets behind its own, so that MuJoCo computes in C what a step leaves out without them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from mjrun.model.source import Source
from mjrun.probe.fields import LAZY

# What computes a field that a step leaves out, and a sensor that needs it.
SENSORS: dict[Callable[[mujoco.MjModel, mujoco.MjData], None], mujoco.mjtSensor] = {
    mujoco.mj_rnePostConstraint: mujoco.mjtSensor.mjSENS_FRAMELINACC,
    mujoco.mj_subtreeVel: mujoco.mjtSensor.mjSENS_SUBTREELINVEL,
}
SENSED = tuple(field for field, computation in LAZY.items() if computation in SENSORS)
NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)


@dataclass(frozen=True)
class SensingSource(Source):
    """A model with a sensor of the world for each way of computing `fields`, behind all others.

    Args:
      source: of the model, with overrides of its own.
      fields: of MjData, of those in `SENSED`.
    """

    source: Source
    fields: tuple[str, ...]

    @property
    def text(self) -> str:
        return self.source.text

    @property
    def stem(self) -> str:
        return self.source.stem

    @property
    def files(self) -> tuple[Path, ...]:
        return self.source.files

    def stored_at(self, place: Callable[[Path], Path]) -> Source:
        return replace(self, source=self.source.stored_at(place))

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        spec, _ = self.source.with_overrides(self.overrides).compile()
        assert spec, "a compiled model cannot get sensors"
        for computation in dict.fromkeys(LAZY[field] for field in self.fields):
            spec.add_sensor(type=SENSORS[computation], objtype=mujoco.mjtObj.mjOBJ_BODY, objname="world")
        return spec, spec.compile()


def can_sense(spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> bool:
    """Whether a model can get sensors, and MuJoCo computes them."""
    return spec is not None and not model.opt.disableflags & NO_SENSORS
