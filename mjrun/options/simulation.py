"""Options of the simulation: where it starts, what drives it, and how long it lasts."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    Choice,
    ColumnMap,
    ExactNumber,
    File,
    Flag,
    Integer,
    Key,
    Numbers,
    Optional,
    PythonFunction,
    Real,
    Several,
    Values,
)
from mjrun.options.model import ModelOptions
from mjrun.options.option import Exclusion, FrontEnd, Options, option, options
from mjrun.options.policy import PolicyOptions, TrustOptions
from mjrun.options.push import Push, PushKind

INTERPOLATIONS = ("hold", "linear")
NO_VALUES: dict[str, Numbers] = {}
STATES, CONTROLS = REPLAY_MODES = ("states", "controls")
QUATERNION_ORDERS = ("wxyz", "xyzw")
# What a replay excludes: what drives a simulation otherwise; what acts on physics alone, where there is none; and the
# start, but of what a table lacks.
DRIVERS = ("ctrl_from", "controller", "perturb")
PHYSICS = ("ctrl_noise", "push")
START = ("key", "qpos", "qvel", "ctrl")
TASK_START = ("key", "qpos", "qvel", "perturb")
TABLE_READING = ("map", "quat", "replay_rate", "replay_interpolation", "replay_unwrap")  # by --replay or by a ghost


@options
class ControllerOptions(Options):
    """Code that drives a simulation; no document holds it."""

    section: ClassVar[str] = "Simulation"

    controller: Callable[..., object] | None = option(
        converter=PythonFunction(),
        default=None,
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Python that sets the controls: policy.py:act or package.module:Policy, called with (model, data). "
        "It writes data.ctrl or returns the controls; a class may have a method reset.",
    )
    control_dt: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        usual="every step",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Time between two calls of the controller, or of a policy that plays on a model alone [s].",
    )


@options
class CodeOptions(ControllerOptions, TrustOptions):
    """Code that drives a simulation, and code in files; no document holds either."""


@options
class SimulationOptions(PolicyOptions, ControllerOptions, ModelOptions):
    """A simulation, but for its model."""

    section: ClassVar[str] = "Simulation"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Exclusion(("duration", "steps"), "both say how long"),
        Exclusion(("controller", "ctrl_from"), "both drive the actuators"),
        Exclusion(("policy", "replay"), "a replay is driven by what is replayed"),
        *(Exclusion(("policy", name), "both drive the actuators") for name in ("controller", "ctrl_from", "ctrl")),
        *(Exclusion(("policy", name), "the task of a policy says how an episode starts") for name in TASK_START),
        Exclusion(("policy", "ctrl_noise"), "the task of a policy says what noise there is"),
        *(Exclusion(("replay", name), "a replay is driven by what is replayed") for name in DRIVERS),
        *(
            Exclusion(("replay", name), "a replay of states goes without physics", when=("replay_mode", STATES))
            for name in PHYSICS
        ),
    )

    key: str | None = option(
        converter=Optional(Key()), default=None, help="The keyframe to start from, by name or index."
    )
    qpos: Mapping[str, Numbers] = option(
        converter=Values(),
        default=NO_VALUES,
        help="Initial joint positions by name [m, rad]: hip=0.3, root/z=1, root=0,0,1,1,0,0,0.",
    )
    qvel: Mapping[str, Numbers] = option(
        converter=Values(), default=NO_VALUES, help="Initial joint velocities by name [m/s, rad/s]: hip=2, root/wx=1."
    )
    ctrl: Mapping[str, Numbers] = option(
        converter=Values(),
        default=NO_VALUES,
        help="Constant controls by actuator name or wildcard, in the actuator's units: motor=20, left_*=0.5.",
    )
    ctrl_from: str | None = option(
        converter=Optional(File()),
        default=None,
        help="A table of controls over time, with columns time [s] and ctrl/ACTUATOR; a trace will do.",
    )
    ctrl_interpolation: str = option(
        converter=Choice(INTERPOLATIONS), default="hold", help="How controls go on between the rows of that table."
    )
    ctrl_noise: float = option(
        converter=Real(metavar="STD"),
        default=0.0,
        help="Standard deviation of Gaussian noise on every control, in the actuators' units.",
    )
    ctrl_noise_time: float = option(
        converter=Real(metavar="SECONDS"),
        default=0.0,
        help="Correlation time of that noise [s]; 0 draws it anew at every step.",
    )
    push: tuple[Push, ...] = option(
        converter=Several(PushKind()),
        default=(),
        help="A force on a body at its centre of mass, or at a site, in the world [N], from a time on for a while [s]: "
        "torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Those that overlap add up; the flag pertforce shows them.",
    )
    replay: str | None = option(
        converter=Optional(File()),
        default=None,
        help="A recording (.npz) whose states are replayed instead of simulated, or a table of joint positions over "
        "time, with columns such as qpos/hip: motion capture, a log, another simulator's output.",
    )
    replay_mode: str = option(
        converter=Choice(REPLAY_MODES),
        default=STATES,
        help="Replay the states; or step the physics from the first of them, under the recorded controls and forces.",
    )
    replay_rate: Fraction | None = option(
        converter=Optional(ExactNumber("HZ")),
        default=None,
        usual="by its column time",
        help="Rows per second of a table without times [Hz].",
    )
    replay_interpolation: str = option(
        converter=Choice(INTERPOLATIONS),
        default="linear",
        help="How positions go on between the rows of a table and over gaps in it; quaternions along an arc.",
    )
    replay_unwrap: bool = option(
        converter=Flag(),
        default=False,
        help="Take hinge angles that jump by more than half a turn from row to row to go on turning.",
    )
    map: tuple[str, ...] = option(
        converter=ColumnMap(),
        default=(),
        help="What the columns of a table mean that is replayed or that a ghost follows: our column, and an expression "
        "over the table's: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all that fit "
        "'qpos/{}={}_deg*pi/180'. @FILE is a file of such lines.",
    )
    quat: str = option(
        converter=Choice(QUATERNION_ORDERS),
        default="wxyz",
        help="The order of quaternions whose components such a table numbers instead of naming them qw … qz.",
    )
    perturb: float = option(
        converter=Real(metavar="STD"),
        default=0.0,
        help="Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].",
    )
    seed: int = option(converter=Integer(), default=0, help="Seed of all noise; with a policy, of the episode.")
    duration: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        usual="5, or that of the recording or of the policy's episode; a view has no end",
        help="Simulated time [s].",
    )
    steps: int | None = option(
        converter=Optional(Integer(1)), default=None, help="Number of steps, instead of a duration."
    )
