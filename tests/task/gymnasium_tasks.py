"""Environments of Gymnasium written as tasks, by hand from their sources."""

import warnings
from pathlib import Path

import gymnasium
import mujoco

from mjrun.probe.select import selected_columns
from mjrun.task.task import Action, Observation, Reset, Reward, Task, Termination

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
MOTORS = [Action(actuators="*")]
SMALL_NOISE = {"qpos/*": "uniform(-0.005, 0.005)", "qvel/*": "uniform(-0.005, 0.005)"}


def _task(file: str, control_dt: float, **values: object) -> Task:
    given = {"control_dt": control_dt, "duration": control_dt * 1000, "actions": MOTORS, "derived": "lagged", **values}
    return Task(ASSETS / file, **given)  # type: ignore[arg-type]


def half_cheetah() -> Task:
    return _task(
        "half_cheetah.xml",
        0.05,
        observations=[
            Observation(name="position", probe=["qpos/rootz", "qpos/rooty", "qpos[b*]", "qpos[f*]"]),
            Observation(name="velocity", probe="qvel"),
        ],
        rewards={"forward": "rate(qpos/rootx)", "control": Reward(value='sum("action/*"^2)', weight=-0.1)},
        reset=Reset(noise={"qpos/*": "uniform(-0.1, 0.1)", "qvel/*": "normal(0, 0.1)"}),
    )


def hopper() -> Task:
    healthy = 'qpos/rootz > 0.7 and abs(qpos/rooty) < 0.2 and max(abs("qvel/*"), abs(qpos/rooty)) < 100'
    healthy += " and max(abs(qpos/thigh_joint), abs(qpos/leg_joint), abs(qpos/foot_joint)) < 100"
    return _walker("hopper.xml", healthy)


def walker2d() -> Task:
    return _walker("walker2d_v5.xml", "qpos/rootz > 0.8 and qpos/rootz < 2 and abs(qpos/rooty) < 1")


def _walker(file: str, healthy: str) -> Task:
    return _task(
        file,
        0.008,
        observations=[
            Observation(name="position", probe=["qpos/rootz", "qpos/rooty", "qpos[*_joint]"]),
            Observation(name="velocity", probe="qvel", clip=[-10, 10]),
        ],
        rewards={
            "forward": "rate(qpos/rootx)",
            "healthy": f"where({healthy}, 1, 0)",
            "control": Reward(value='sum("action/*"^2)', weight=-1e-3),
        },
        terminations={"fallen": Termination(when=f"not ({healthy})", as_="failure")},
        reset=Reset(noise=SMALL_NOISE),
    )


def inverted_double_pendulum() -> Task:
    hinges = ("hinge", "hinge2")
    return _task(
        "inverted_double_pendulum.xml",
        0.05,
        observations=[
            Observation(name="cart", joints="slider"),
            *(Observation(name=f"sin_{joint}", value=f"sin(qpos/{joint})") for joint in hinges),
            *(Observation(name=f"cos_{joint}", value=f"cos(qpos/{joint})") for joint in hinges),
            Observation(name="velocity", probe="qvel", clip=[-10, 10]),
            Observation(name="force", probe="qfrc_constraint/slider", clip=[-10, 10]),
        ],
        rewards={
            "alive": "where(site_xpos/tip/z > 1, 10, 0)",
            "distance": "-(0.01*site_xpos/tip/x^2 + (site_xpos/tip/z - 2)^2)",
            "velocity": "-(1e-3*qvel/hinge^2 + 5e-3*qvel/hinge2^2)",
        },
        terminations={"fallen": Termination(when="site_xpos/tip/z <= 1", as_="failure")},
        reset=Reset(noise={"qpos/*": "uniform(-0.1, 0.1)", "qvel/*": "normal(0, 0.1)"}),
    )


def ant() -> Task:
    healthy = "isfinite(\"qpos/*\") and isfinite('qvel/*') and qpos/root/z >= 0.2 and qpos/root/z <= 1"
    return _task(
        "ant.xml",
        0.05,
        observations=[
            Observation(name="position", probe=_columns("ant.xml", "qpos")[2:]),
            Observation(name="velocity", probe="qvel"),
            Observation(name="contact", probe=_columns("ant.xml", "cfrc_ext")[6:], clip=[-1, 1]),
        ],
        rewards={
            "forward": "rate(xpos/torso/x)",
            "healthy": f"where({healthy}, 1, 0)",
            "control": Reward(value='sum("action/*"^2)', weight=-0.5),
            "contact": Reward(value='sum(clip("cfrc_ext/*", -1, 1)^2)', weight=-5e-4),
        },
        terminations={"fallen": Termination(when=f"not ({healthy})", as_="failure")},
        reset=Reset(noise={"qpos/*": "uniform(-0.1, 0.1)", "qvel/*": "normal(0, 0.1)"}),
    )


def humanoid() -> Task:
    file = "humanoid.xml"
    healthy = "qpos/root/z > 1 and qpos/root/z < 2"
    return _task(
        file,
        0.015,
        observations=[
            Observation(name="position", probe=_columns(file, "qpos")[2:]),
            Observation(name="velocity", probe="qvel"),
            Observation(name="inertia", probe=_columns(file, "cinert")[10:]),
            Observation(name="twist", probe=_columns(file, "cvel")[6:]),
            Observation(name="actuator", probe=_columns(file, "qfrc_actuator")[6:]),
            Observation(name="contact", probe=_columns(file, "cfrc_ext")[6:]),
        ],
        rewards={
            "forward": Reward(value="rate(com/x)", weight=1.25),
            "healthy": f"where({healthy}, 5, 0)",
            "control": Reward(value='sum("ctrl/*"^2)', weight=-0.1),
            "contact": '-min(5e-7*sum("cfrc_ext/*"^2), 10)',
        },
        terminations={"fallen": Termination(when=f"not ({healthy})", as_="failure")},
        reset=Reset(noise={"qpos/*": "uniform(-0.01, 0.01)", "qvel/*": "uniform(-0.01, 0.01)"}),
    )


def humanoid_standup() -> Task:
    file = "humanoidstandup.xml"
    return _task(
        file,
        0.015,
        observations=humanoid().observations,  # joints and bodies have the same names
        rewards={
            "up": "qpos/root/z / 0.003",
            "alive": "1",
            "control": Reward(value='sum("ctrl/*"^2)', weight=-0.1),
            "impact": '-min(5e-7*sum("cfrc_ext/*"^2), 10)',
        },
        reset=Reset(noise={"qpos/*": "uniform(-0.01, 0.01)", "qvel/*": "uniform(-0.01, 0.01)"}),
    )


def inverted_pendulum() -> Task:
    fallen = 'not (isfinite("qpos/*") and isfinite("qvel/*") and abs(qpos/hinge) <= 0.2)'
    return _task(
        "inverted_pendulum.xml",
        0.04,
        observations=[Observation(name="position", probe="qpos"), Observation(name="velocity", probe="qvel")],
        rewards={"survive": f"where({fallen}, 0, 1)"},
        terminations={"fallen": Termination(when=fallen, as_="failure")},
        reset=Reset(noise={"qpos/*": "uniform(-0.01, 0.01)", "qvel/*": "uniform(-0.01, 0.01)"}),
    )


def swimmer() -> Task:
    return _task(
        "swimmer.xml",
        0.04,
        observations=[
            Observation(name="position", probe=_columns("swimmer.xml", "qpos")[2:]),
            Observation(name="velocity", probe="qvel"),
        ],
        rewards={"forward": "rate(qpos/slider1)", "control": Reward(value='sum("action/*"^2)', weight=-1e-4)},
        reset=Reset(noise={"qpos/*": "uniform(-0.1, 0.1)", "qvel/*": "uniform(-0.1, 0.1)"}),
    )


def reacher() -> Task:
    def difference(axis: str) -> str:
        return f"xpos/fingertip/{axis} - xpos/target/{axis}"

    return _task(
        "reacher.xml",
        0.02,
        observations=[
            *(Observation(name=f"cos{i}", value=f"cos(qpos/joint{i})") for i in (0, 1)),
            *(Observation(name=f"sin{i}", value=f"sin(qpos/joint{i})") for i in (0, 1)),
            Observation(name="goal", joints=["target_x", "target_y"]),
            Observation(name="velocity", joints=["joint0", "joint1"], of="qvel"),
            *(Observation(name=f"to_{axis}", value=difference(axis)) for axis in "xy"),
        ],
        rewards={
            "distance": f"-norm({', '.join(map(difference, 'xyz'))})",
            "control": Reward(value='sum("action/*"^2)', weight=-1),
        },
        reset=Reset(noise={"qpos/*": "uniform(-0.1, 0.1)", "qvel/joint?": "uniform(-0.005, 0.005)"}),
    )


def pusher() -> Task:
    def distance(one: str, other: str) -> str:
        return f"norm({', '.join(f'xpos/{one}/{axis} - xpos/{other}/{axis}' for axis in 'xyz')})"

    file = "pusher_v5.xml"
    return _task(
        file,
        0.05,
        observations=[
            Observation(name="position", probe=_columns(file, "qpos")[:7]),
            Observation(name="velocity", probe=_columns(file, "qvel")[:7]),
            *(Observation(name=body, probe=f"xpos/{body}") for body in ("tips_arm", "object", "goal")),
        ],
        rewards={
            "distance": f"-{distance('object', 'goal')}",
            "control": Reward(value='sum("action/*"^2)', weight=-0.1),
            "near": Reward(value=distance("object", "tips_arm"), weight=-0.5),
        },
        reset=Reset(noise={"qvel/*": "uniform(-0.005, 0.005)"}),
    )


def _columns(file: str, group: str) -> list[str]:
    """The names of all columns of a group."""
    with warnings.catch_warnings(action="ignore"):
        model = mujoco.MjModel.from_xml_path(str(ASSETS / file))
    return [column.name for column in selected_columns(model, [group])]


TASKS = {
    "HalfCheetah-v5": half_cheetah,
    "Hopper-v5": hopper,
    "Walker2d-v5": walker2d,
    "InvertedDoublePendulum-v5": inverted_double_pendulum,
    "Ant-v5": ant,
    "Humanoid-v5": humanoid,
    "HumanoidStandup-v5": humanoid_standup,
    "InvertedPendulum-v5": inverted_pendulum,
    "Swimmer-v5": swimmer,
    "Reacher-v5": reacher,
    "Pusher-v5": pusher,
}
