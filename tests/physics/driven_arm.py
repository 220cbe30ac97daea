"""An arm that is driven, by mjrun and by bare loops that set `data.ctrl` by hand."""

from collections.abc import Callable, Sequence
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.outputs.trace_rows import blocks
from mjrun.physics.control import Controller, ControlSources, ControlTable, PeriodicController
from mjrun.physics.stepper import PhysicsStepper
from mjrun.physics.timed_rows import TimedRows
from mjrun.timeline import rational

ARM = """
<mujoco>
  <option integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .3"><joint name="a" axis="0 1 0" damping=".1"/><geom size=".05" pos=".3 0 0"/>
      <body pos=".3 0 0"><joint name="b" axis="0 1 0" damping=".1"/><geom size=".05" pos=".3 0 0"/><site name="s"/>
      </body>
    </body>
    <body name="lift" pos="1 0 .2"><freejoint/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor name="m" joint="a"/><general name="g" joint="b" dyntype="filter" dynprm=".1"/></actuator>
  <sensor><accelerometer site="s"/></sensor>
</mujoco>
"""
FIELDS = ("qpos", "qvel", "act", "ctrl", "qacc", "sensordata", "actuator_force")


def arm(integrator: str = "Euler") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM.format(integrator=integrator))


def stepper(model: mujoco.MjModel, **drives: object) -> PhysicsStepper:
    control = ControlSources(rational(model.opt.timestep), np.zeros(model.nu), **drives)  # type: ignore[arg-type]
    return PhysicsStepper(model, mujoco.MjData(model), control)


def periodic(controller: Controller, period: str) -> PeriodicController:
    return PeriodicController(controller, Fraction(period), Fraction("0.002"))


def table(time: Sequence[float], m: Sequence[float], linear: bool = False) -> ControlTable:
    columns = {"ctrl/m": np.array(m, float), "ctrl/g": -np.array(m, float)}
    return ControlTable(TimedRows(np.array(time), columns, "t.csv", linear), [0, 1])


def bare(model: mujoco.MjModel, steps: int, ctrl: Callable[[int, mujoco.MjData], object]) -> dict[str, np.ndarray]:
    """Every instant of a plain loop; `ctrl` sets the inputs of a consistent copy, which the loop takes over."""
    data, shown = mujoco.MjData(model), mujoco.MjData(model)
    found: dict[str, list[np.ndarray]] = {field: [] for field in FIELDS}
    for step in range(steps + 1):
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        ctrl(step, shown)
        data.ctrl[:] = shown.ctrl
        data.xfrc_applied[:] = shown.xfrc_applied
        data.qfrc_applied[:] = shown.qfrc_applied
        mujoco.mj_forward(model, shown)
        for field in FIELDS:
            found[field].append(np.array(getattr(shown, field)))
        mujoco.mj_step(model, data)
    return {field: np.stack(values) for field, values in found.items()}


def stepped_in_c(run: PhysicsStepper, steps: int, fields: Sequence[str] = FIELDS) -> dict[str, np.ndarray]:
    found: dict[str, list[np.ndarray]] = {field: [] for field in fields}
    for _, _, block in blocks(run, fields, steps, 64):
        for field in fields:
            found[field].append(block[field][0])
    return {field: np.concatenate(values) for field, values in found.items()}


def by_instants(run: PhysicsStepper, steps: int, fields: Sequence[str] = FIELDS) -> dict[str, np.ndarray]:
    found: dict[str, list[np.ndarray]] = {field: [] for field in fields}
    for step in range(steps + 1):
        run.advance(step)
        for field in fields:
            found[field].append(np.array(getattr(run.instant(), field)))
    return {field: np.stack(values) for field, values in found.items()}


def same(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(left[field], right[field]) for field in FIELDS)
