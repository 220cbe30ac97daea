"""Options of the simulation: its initial state, controls, disturbances and duration."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import ClassVar

from mjrun.options.disturbance import NOISE_REQUIREMENT, DisturbanceOptions
from mjrun.options.kinds import ChoiceKind, FlagKind, NameOrIndexKind, PathKind, PythonFunctionKind, TextKind, optional
from mjrun.options.model import ServoOptions
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, Numbers, RealKind
from mjrun.options.option import FrontEnd, OptionExclusion, OptionRequirement, Options, option, options
from mjrun.options.policy import NORMALIZE_REQUIREMENT, PolicyOptions, TrustOptions
from mjrun.options.setting_kinds import ColumnDefinitionsKind, JointNumbersKind, NamedNumbersKind

INTERPOLATIONS = ("hold", "linear")
NO_VALUES: dict[str, Numbers] = {}
STATES, CONTROLS = REPLAY_MODES = ("states", "controls")
QUATERNION_ORDERS = ("wxyz", "xyzw")
# Options that a replay excludes: other drivers; disturbances, which need physics; and the initial state, except of
# joints that a table lacks.
DRIVERS = ("ctrl_from", "controller", "perturb")
PHYSICS = ("ctrl_noise", "push")
START = ("key", "qpos", "qvel", "ctrl")
TASK_START = ("key", "qpos", "qvel", "perturb")
TABLE_READING = ("map", "quat", "replay_rate", "replay_interpolation", "replay_unwrap")  # by --replay or by a ghost
# Checked when a simulation starts, since a study may vary the partners.
RUN_REQUIREMENTS = (
    OptionRequirement("ctrl_interpolation", "ctrl_from", "between whose rows it interpolates"),
    NOISE_REQUIREMENT,
    OptionRequirement("replay_mode", "replay", "which it plays back or simulates again"),
)


@options
class ControllerOptions(Options):
    """Code that controls a simulation; documents cannot contain it."""

    section: ClassVar[str] = "Simulation"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND | FrontEnd.PYTHON

    controller: Callable[..., object] | None = option(
        converter=PythonFunctionKind(),
        default=None,
        help="Python code that sets the controls: a function or class such as policy.py:act or "
        "package.module:Policy, called with (model, data). It writes data.ctrl or returns the controls; a "
        "class may have a method reset.",
    )
    control_dt: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="every step",
        help="Time between two calls of the controller, or of a policy that has no task document [s].",
    )


@options
class CodeOptions(ControllerOptions, TrustOptions):
    """Code that controls a simulation, and trust in code in files; documents cannot contain either."""


@options
class SimulationOptions(PolicyOptions, DisturbanceOptions, ControllerOptions, ServoOptions):
    """All options of a simulation but its model."""

    section: ClassVar[str] = "Simulation"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("duration", "steps"), "both set the length"),
        OptionExclusion(("controller", "ctrl_from"), "both drive the actuators"),
        OptionExclusion(("policy", "replay"), "the replayed file drives the simulation"),
        *(
            OptionExclusion(("policy", name), "both drive the actuators")
            for name in ("controller", "ctrl_from", "ctrl")
        ),
        *(
            OptionExclusion(("policy", name), "the task of the policy sets the start of an episode")
            for name in TASK_START
        ),
        OptionExclusion(("policy", "position_control"), "the task of the policy says what its actions control"),
        *(OptionExclusion(("replay", name), "the replayed file drives the simulation") for name in DRIVERS),
        *(
            OptionExclusion(
                ("replay", name), "a replay of states does not compute physics", when=("replay_mode", STATES)
            )
            for name in PHYSICS
        ),
    )

    requirements: ClassVar[tuple[OptionRequirement, ...]] = (NORMALIZE_REQUIREMENT,)

    key: str | None = option(
        converter=optional(NameOrIndexKind()), default=None, help="Keyframe to start from, by name or index."
    )
    qpos: Mapping[str, Numbers] = option(
        converter=JointNumbersKind(),
        default=NO_VALUES,
        help="Initial joint positions by name [m, rad]: hip=0.3, hip=20deg, root/z=1, root=0,0,1,1,0,0,0.",
    )
    qvel: Mapping[str, Numbers] = option(
        converter=JointNumbersKind(rate=True),
        default=NO_VALUES,
        help="Initial joint velocities by name [m/s, rad/s]: hip=2, hip=90deg/s, root/wx=1.",
    )
    ctrl: Mapping[str, Numbers] = option(
        converter=NamedNumbersKind(),
        default=NO_VALUES,
        help="Constant controls by actuator name or wildcard, in the actuator's units: motor=20, left_*=0.5.",
    )
    ctrl_from: str | None = option(
        converter=optional(PathKind()),
        default=None,
        help="Table of controls over time, with a column time [s] and one for each actuator, which is named "
        "ctrl/ACTUATOR as in a trace, ACTUATOR or JOINT; one named hip [deg] contains degrees.",
    )
    ctrl_interpolation: str = option(
        converter=ChoiceKind(INTERPOLATIONS),
        default="hold",
        help="Interpolation between the rows of the table of controls.",
    )
    replay: str | None = option(
        converter=optional(PathKind()),
        default=None,
        help="Recording (.npz) whose states are replayed instead of simulated, a demonstration in HDF5 such as "
        "demo.hdf5:demo_3, or a table of joint positions over time, with columns such as qpos/hip: motion capture, a "
        "log, the output of another simulator.",
    )
    replay_mode: str = option(
        converter=ChoiceKind(REPLAY_MODES),
        default=STATES,
        help="Replay mode: states plays back the recorded states; controls simulates again from the first state, "
        "with the recorded controls and forces.",
    )
    replay_rate: Fraction | None = option(
        converter=optional(ExactNumberKind("HZ")),
        default=None,
        usual="from the column time",
        help="Rows per second of a table without a column time [Hz].",
    )
    replay_interpolation: str = option(
        converter=ChoiceKind(INTERPOLATIONS),
        default="linear",
        help="Interpolation between the rows of a replayed table and across gaps in it; linear interpolates "
        "quaternions along an arc.",
    )
    replay_unwrap: bool = option(
        converter=FlagKind(),
        default=False,
        help="Unwrap hinge angles: treat a jump of more than half a turn between rows as a continued rotation.",
    )
    map: tuple[str, ...] = option(
        converter=ColumnDefinitionsKind(),
        default=(),
        help="Column of mjrun and its value, an expression over the columns of a table that is replayed or that a "
        "ghost follows: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all matching columns "
        "'qpos/{}={}_deg*pi/180'. @FILE reads such lines from a file.",
    )
    quat: str = option(
        converter=ChoiceKind(QUATERNION_ORDERS),
        default="wxyz",
        help="Order of quaternion components in a replayed table whose columns number them instead of naming them "
        "qw … qz.",
    )
    perturb: float = option(
        converter=RealKind(metavar="STD"),
        default=0.0,
        help="Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].",
    )
    seed: int = option(
        converter=IntegerKind(), default=0, help="Seed of all noise; with a policy, seed of the episode."
    )
    duration: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="5, or that of the recording or episode; unlimited in a view",
        help="Simulated time [s].",
    )
    steps: int | None = option(
        converter=optional(IntegerKind(1)), default=None, help="Number of steps, instead of a duration."
    )
    until: str | None = option(
        converter=optional(TextKind("EXPR")),
        default=None,
        help="End the simulation at the first step at which this condition on its columns holds, if that is before its "
        "duration: qpos/root/z < 0.3, contact(ball, floor).",
    )
