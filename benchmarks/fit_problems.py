"""Problems of parameter estimation whose answer is known: models, the truth, and logs made by a bare loop of MuJoCo."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

LENGTH, ANGLE = 1e-3, 1e-3  # standard deviations of the noise [m, rad]

PENDULUM = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body>
    <joint name="hinge" axis="0 1 0" damping=".3" armature=".01" frictionloss=".1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="1"/>
  </body></worldbody>
</mujoco>"""

CART_POLE = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body>
    <joint name="cart" type="slide" axis="1 0 0" damping=".5"/>
    <geom name="cart" type="box" size=".1 .05 .05" mass="1"/>
    <body>
      <joint name="pole" axis="0 1 0" damping=".01"/>
      <geom name="pole" type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass=".3"/>
    </body>
  </body></worldbody>
  <actuator><motor name="push" joint="cart"/></actuator>
</mujoco>"""

ARM = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping=".5"/></default>
  <worldbody><body pos="0 0 1">
    <joint name="pan" axis="0 0 1"/>
    <joint name="lift" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
    <body pos=".3 0 0">
      <joint name="tilt" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".5"/>
      <geom name="load" type="sphere" pos=".28 0 0" size=".03" mass=".1"/>
    </body>
  </body></worldbody>
  <actuator>
    <position name="pan" joint="pan" kp="40" kv="2"/>
    <position name="lift" joint="lift" kp="40" kv="2"/>
    <position name="tilt" joint="tilt" kp="15" kv="1"/>
  </actuator>
</mujoco>"""

SERVO = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body>
    <joint name="hinge" axis="0 1 0" damping=".1" armature=".02"/>
    <geom name="rod" type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1"/>
  </body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="10" kv=".3"/></actuator>
</mujoco>"""

SLIDING_BOX = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1" friction=".1"/>
    <body pos="0 0 .05">
      <freejoint name="box"/>
      <geom name="box" type="box" size=".1 .08 .05" mass="1" friction=".5"/>
    </body>
  </worldbody>
</mujoco>"""

SPRING = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body>
    <joint name="slide" type="slide" axis="1 0 0" stiffness="40" damping="1"/>
    <geom type="box" size=".1 .1 .1" mass="1"/>
  </body></worldbody>
  <actuator><motor name="motor" joint="slide" gear="10"/></actuator>
</mujoco>"""

TENDON = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <site name="anchor" pos=".3 0 1.2"/>
    <geom name="pulley" type="cylinder" pos=".12 0 1" zaxis="0 1 0" size=".04 .02" contype="0" conaffinity="0"/>
    <body pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".5"/>
      <body pos="0 0 -.3">
        <joint name="elbow" axis="0 1 0" damping=".02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02" mass=".3"/>
        <site name="hand" pos="0 0 -.2"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cable" springlength=".3" stiffness="20" damping="1">
      <site site="anchor"/><geom geom="pulley"/><site site="hand"/>
    </spatial>
  </tendon>
</mujoco>"""

LEG = """<body name="{0}" pos="{1} {2} 0">
      <joint name="{0}_hip" axis="0 1 0" ref="0"/>
      <geom type="capsule" fromto="0 0 0 -.08 0 -.12" size=".015" mass=".15"/>
      <body pos="-.08 0 -.12">
        <joint name="{0}_knee" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .08 0 -.12" size=".015" mass=".1" friction="1"/>
      </body>
    </body>"""
LEGS = ("front_left", "front_right", "back_left", "back_right")
PLACES = ((0.2, 0.12), (0.2, -0.12), (-0.2, 0.12), (-0.2, -0.12))
QUADRUPED = f"""<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping=".1" armature=".02"/><position kp="25" kv=".5"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="trunk" pos="0 0 .26">
      <joint name="root" type="free" damping="0" armature="0"/>
      <geom type="box" size=".22 .1 .04" mass="3"/>
      {"".join(LEG.format(name, *place) for name, place in zip(LEGS, PLACES, strict=True))}
    </body>
  </worldbody>
  <actuator>
    {"".join(f'<position name="{n}_{j}" joint="{n}_{j}"/>' for n in LEGS for j in ("hip", "knee"))}
  </actuator>
</mujoco>"""


def _nothing(time: float) -> np.ndarray:
    return np.zeros(0)


@dataclass(frozen=True)
class Problem:
    """A model, and another one that makes its logs.

    Attributes:
      xml: the original model.
      free: paths and bounds of the free parameters.
      truth: their true values, in order.
      change: function that makes the model of the logs from the specification of `xml`.
      controls: commands as a function of time, `(nu,)`.
      qpos, qvel: initial state of the logs, except for small random deviations.
      seconds: length of a log.
      every: steps from one row to the next.
      late: number of steps by which commands act late.
      is_exact: whether the model can explain the logs; otherwise it lacks something.
      is_rough: whether contacts make the motion rough.
    """

    xml: str
    free: Sequence[tuple[str, str]]
    truth: Sequence[float]
    change: Callable[[mujoco.MjSpec], None]
    controls: Callable[[float], np.ndarray] = _nothing
    qpos: Sequence[float] = ()
    qvel: Sequence[float] = ()
    seconds: float = 3.0
    every: int = 5
    late: int = 0
    is_exact: bool = True
    is_rough: bool = False

    def model(self) -> mujoco.MjModel:
        """Returns the model that makes the logs."""
        spec = mujoco.MjSpec.from_string(self.xml)
        self.change(spec)
        return spec.compile()

    def log(self, seed: int) -> tuple[list[str], np.ndarray]:
        """Returns columns and rows of a log: times, positions with noise, commands."""
        generator = np.random.default_rng(seed)
        model = self.model()
        data = mujoco.MjData(model)
        data.qpos[: len(self.qpos)], data.qvel[: len(self.qvel)] = self.qpos, self.qvel
        mujoco.mj_integratePos(model, data.qpos, generator.normal(0, 0.01, model.nv) * self._is_free(model), 1.0)
        data.qvel += generator.normal(0, 0.01, model.nv) * self._is_free(model)
        waiting = [self.controls(0.0)] * self.late
        rows: list[np.ndarray] = []
        for step in range(round(self.seconds / model.opt.timestep)):
            command = self.controls(step // self.every * self.every * model.opt.timestep)
            waiting.append(command)
            if step % self.every == 0:
                rows.append(np.concatenate([[data.time], self._measured(model, data, generator), command]))
            data.ctrl[:] = waiting.pop(0)
            mujoco.mj_step(model, data)
        controls = [f"ctrl/{model.actuator(i).name}" for i in range(model.nu)]
        return ["time", *positions(model), *controls], np.array(rows)

    def write(self, folder: Path, seed: int) -> tuple[Path, Path]:
        """Writes the model and a log, and returns their paths."""
        names, rows = self.log(seed)
        model, log = folder / "model.xml", folder / f"log{seed}.csv"
        model.write_text(self.xml)
        lines = [",".join(names), *(",".join(f"{value:.10g}" for value in row) for row in rows)]
        log.write_text("\n".join(lines) + "\n")
        return model, log

    def _is_free(self, model: mujoco.MjModel) -> np.ndarray:
        """Returns 1 for velocities of hinges and slides, 0 for those of free joints."""
        return np.array([float(model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE) for j in model.dof_jntid])

    def _measured(self, model: mujoco.MjModel, data: mujoco.MjData, generator: np.random.Generator) -> np.ndarray:
        moved = data.qpos.copy()
        noise = generator.normal(0, 1, model.nv)
        for joint in range(model.njnt):
            first, count = model.jnt_dofadr[joint], 6 if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE else 1
            noise[first : first + min(count, 3)] *= LENGTH
            noise[first + 3 : first + count] *= ANGLE
        mujoco.mj_integratePos(model, moved, noise, 1.0)
        return moved


def positions(model: mujoco.MjModel) -> list[str]:
    """Returns the columns of all positions."""
    names: list[str] = []
    for joint in range(model.njnt):
        name = model.joint(joint).name
        is_free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        names += (
            [f"qpos/{name}/{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")] if is_free else [f"qpos/{name}"]
        )
    return names


def _waves(amplitude: float, count: int) -> Callable[[float], np.ndarray]:
    """Returns sines of 0.4 Hz and more with a smooth beginning."""
    frequencies, phases = 0.4 + 0.23 * np.arange(count), 1.7 * np.arange(count)

    def controls(time: float) -> np.ndarray:
        return amplitude * min(time / 0.5, 1.0) * np.sin(2 * np.pi * frequencies * time + phases)

    return controls


def _pendulum(spec: mujoco.MjSpec) -> None:
    spec.joint("hinge").damping, spec.joint("hinge").frictionloss = [0.05, 0, 0], 0.02


def _cart_pole(spec: mujoco.MjSpec) -> None:
    spec.geom("cart").mass, spec.geom("pole").mass = 1.6, 0.5


def _arm(spec: mujoco.MjSpec) -> None:
    spec.geom("load").mass = 0.8


def _servo(spec: mujoco.MjSpec) -> None:
    servo = spec.actuator("servo")
    servo.gainprm[0], servo.biasprm[1], servo.biasprm[2] = 20.0, -20.0, -0.6
    spec.geom("rod").mass = 1.2  # which the model does not know


def _box(spec: mujoco.MjSpec) -> None:
    spec.geom("box").friction[0] = 0.33


def _spring(spec: mujoco.MjSpec) -> None:
    joint = spec.joint("slide")
    joint.stiffness, joint.damping = [60.0, 0, 0], [0.5, 0, 0]


def _tendon(spec: mujoco.MjSpec) -> None:
    cable = spec.tendon("cable")
    cable.stiffness, cable.damping = [45.0, 0, 0], [0.3, 0, 0]


def _quadruped(spec: mujoco.MjSpec) -> None:
    for joint in spec.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_FREE:
            joint.armature = 0.055


BOX_SLIDES = (0.0, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0)
PROBLEMS = {
    "pendulum friction": Problem(
        PENDULUM,
        [("joint/hinge.damping", "log:1e-3..1"), ("joint/hinge.frictionloss", "log:1e-3..1")],
        (0.05, 0.02),
        _pendulum,
        qpos=[2.5],
        seconds=5.0,
    ),
    "cart-pole masses": Problem(
        CART_POLE,
        [("geom/cart.mass", "0.2..5"), ("geom/pole.mass", "0.05..2")],
        (1.6, 0.5),
        _cart_pole,
        lambda time: 5 * _waves(1, 1)(2 * time),
    ),
    "arm payload": Problem(ARM, [("geom/load.mass", "0.01..3")], (0.8,), _arm, _waves(0.6, 3)),
    "servo gains, mismatch": Problem(
        SERVO,
        [("actuator/servo.kp", "1..100"), ("actuator/servo.kv", "0.05..5")],
        (20.0, 0.6),
        _servo,
        lambda time: 0.8 * np.sign(np.sin(2 * np.pi * 0.7 * np.array([time]))),
        is_exact=False,
    ),
    "sliding box": Problem(
        SLIDING_BOX,
        [("geom/box.friction[0]", "0.1..1")],
        (0.33,),
        _box,
        qpos=BOX_SLIDES,
        qvel=[1.5, 0.3, 0, 0, 0, 2.0],
        seconds=0.6,
        every=2,
        is_rough=True,
    ),
    "spring with delay": Problem(
        SPRING,
        [
            ("joint/slide.stiffness", "log:5..500"),
            ("joint/slide.damping", "log:0.05..10"),
            ("delay:ctrl/motor", "0..0.05"),
        ],
        (60.0, 0.5, 0.016),
        _spring,
        lambda time: np.sin(2 * np.pi * 0.9 * np.array([time])) + 0.5 * np.sign(np.sin(4.1 * np.array([time]))),
        late=8,
    ),
    "spatial tendon": Problem(
        TENDON,
        [("tendon/cable.stiffness", "2..200"), ("tendon/cable.damping", "log:0.05..10")],
        (45.0, 0.3),
        _tendon,
        qpos=[0.6, -0.9],
    ),
    "quadruped armature": Problem(
        QUADRUPED,
        [("joint/*_*.armature", "log:0.005..0.5")],
        (0.055,),
        _quadruped,
        _waves(0.25, 8),
        qpos=[0, 0, 0.26, 1, 0, 0, 0],
        seconds=3.0,
        is_rough=True,
    ),
}
