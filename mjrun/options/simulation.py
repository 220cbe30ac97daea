"""Options of the simulation: its initial state, controls, disturbances and duration."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import ClassVar, cast

from mjrun.dataclass import dataclass
from mjrun.options.kinds import (
    ChoiceKind,
    FlagKind,
    NameOrIndexKind,
    OneOrMoreKind,
    PathKind,
    PythonFunctionKind,
    ReadingContext,
    TextKind,
    optional,
)
from mjrun.options.model import ServoOptions
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, Numbers, PointKind, RealKind
from mjrun.options.option import FrontEnd, OptionExclusion, OptionRequirement, Options, option, options, required
from mjrun.options.policy import NORMALIZE_REQUIREMENT, PolicyOptions, TrustOptions
from mjrun.options.schema_validation import InvalidValueError, Path, check
from mjrun.options.setting_kinds import ColumnDefinitionsKind, JointNumbersKind, NamedNumbersKind
from mjrun.options.structured_kinds import OneOfKind, OptionsMappingKind
from mjrun.timeline import rational

Force = tuple[float, float, float]
KEYS = ("body", "site", "force", "at", "duration")
EXPECTED = (
    "BODY=FX/FY/FZ@T+DURATION: a force [N], its start, 0 or later, and its duration [s], as in torso=0/100/0@1+0.2"
)
# Exponents may have a sign, and exact times may be fractions: 1e-3, 1/3.
_TIME = r"[0-9.]+(?:[eE][-+]?[0-9]+|/[0-9]+)?"
_PUSH = rf"(?s)(?P<target>.+)=(?P<force>[^=@]+)@(?P<at>{_TIME})\+(?P<duration>{_TIME})"  # compiled when it is used
INTERPOLATIONS = ("hold", "linear")
NO_VALUES: dict[str, Numbers] = {}
STATES, CONTROLS = REPLAY_MODES = ("states", "controls")
# Options that a replay excludes: other drivers; disturbances, which need physics; and the initial state, except of
# joints that a table lacks.
DRIVERS = ("ctrl_from", "controller", "perturb")
PHYSICS = ("ctrl_noise", "push")
START = ("key", "qpos", "qvel", "ctrl")
TASK_START = ("key", "qpos", "qvel", "perturb")
TABLE_READING = ("map", "quat", "replay_rate", "replay_interpolation", "replay_unwrap")  # by --replay or by a ghost
# Checked when a simulation or an episode starts, since a study may vary the noise, and a task may contain it.
NOISE_REQUIREMENT = OptionRequirement("ctrl_noise_time", "ctrl_noise", "whose correlation it sets")
# Checked when a simulation starts, since a study may vary the partners.
RUN_REQUIREMENTS = (
    OptionRequirement("ctrl_interpolation", "ctrl_from", "between whose rows it interpolates"),
    NOISE_REQUIREMENT,
    OptionRequirement("replay_mode", "replay", "which it plays back or simulates again"),
)


@dataclass(frozen=True)
class Push:
    """A force that is constant in world coordinates for a limited time.

    Attributes:
      target: the body whose centre of mass the force acts on, or else the site; the prefixes `body:` and `site:`
        resolve ambiguity.
      force: force in world coordinates [N].
      at: start [s].
      duration: duration [s].
    """

    target: str
    force: Force
    at: Fraction
    duration: Fraction

    def __str__(self) -> str:
        force = "/".join(f"{component!r}".removesuffix(".0") for component in self.force)
        return f"{self.target}={force}@{_exact(self.at)}+{_exact(self.duration)}"


@options
class PushMapping(Options):
    """A force on a body at its centre of mass, or at a site, for a limited time."""

    body: str | None = option(converter=optional(TextKind()), default=None, help="Body to push at its centre of mass.")
    site: str | None = option(converter=optional(TextKind()), default=None, help="Site at which to push its body.")
    force: Force = required(converter=PointKind(), help="Force in world coordinates [N].")
    at: Fraction = required(converter=ExactNumberKind(zero=True), help="Start of the push [s].")
    duration: Fraction = required(converter=ExactNumberKind(), help="Duration of the push [s].")

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        if ("body" in values) == ("site" in values):
            yield ("site",) if "site" in values else (), "give either body or site"


class PushKind(OneOfKind["Push | str | Mapping[str, object]", Push]):
    """A push as text, or as a mapping with body or site, force, at and duration."""

    metavar = "BODY=FX/FY/FZ@T+DURATION"

    def __init__(self) -> None:
        def push(**values: object) -> Push:
            return _from_mapping(values)

        forms = "text as in torso=0/100/0@1+0.2 or {body or site, force, at, duration}"
        super().__init__(forms, string=_PushTextKind(), object=OptionsMappingKind(PushMapping, push))

    def __call__(self, value: "Push | str | Mapping[str, object]") -> Push:
        match value:
            case Push():
                return _push(value.target, value.force, value.at, value.duration)
            case str():
                return self.parse(value)
            case Mapping():
                return _from_mapping(value)
            case _:
                raise InvalidValueError(EXPECTED)

    def parse(self, text: str) -> Push:
        match = re.fullmatch(_PUSH, text.strip())
        if not match:
            raise InvalidValueError(EXPECTED)
        return _push(match["target"], match["force"].split("/"), match["at"], match["duration"])

    def plain(self, value: Push) -> str:
        return str(value)


class _PushTextKind(TextKind):
    """A push as text."""

    def read(self, value: object, reader: ReadingContext) -> object:
        check(value, self.form)
        return PushKind().parse(str(value))


def _from_mapping(value: Mapping[str, object]) -> Push:
    target = [f"{kind}:{value[kind]}" for kind in ("body", "site") if kind in value]
    if len(target) != 1 or set(value) - set(KEYS) or not {"force", "at", "duration"} <= set(value):
        raise InvalidValueError("a push: {body or site, force: [FX, FY, FZ], at, duration}")
    return _push(target[0], value["force"], value["at"], value["duration"])


def _push(target: str, force: object, at: object, duration: object) -> Push:
    try:
        x, y, z = map(float, cast("Sequence[float | str]", force))
    except (TypeError, ValueError):
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise InvalidValueError("a push with a force of three finite numbers, FX/FY/FZ [N]")
    try:
        begin = ExactNumberKind(zero=True)(cast("float | str", at))
    except InvalidValueError:
        raise InvalidValueError("a push that begins at 0 or later [s]") from None
    try:
        length = ExactNumberKind()(cast("float | str", duration))
    except InvalidValueError:
        raise InvalidValueError("a push of a duration above 0 [s]") from None
    return Push(target, (x, y, z), begin, length)


def _exact(value: Fraction) -> str:
    """Formats `value` as a decimal number if that is exact, or else as a fraction."""
    near = float(value)
    return f"{near!r}".removesuffix(".0") if rational(near) == value else str(value)


PUSHES = OneOrMoreKind(PushKind())


@dataclass(frozen=True)
class Disturbances:
    """Disturbances of a simulation.

    Attributes:
      push: forces on bodies.
      ctrl_noise: standard deviation of the noise on the controls; None if it is not specified.
      ctrl_noise_time: correlation time of the noise [s]; None if it is not specified.
    """

    push: tuple[Push, ...] = ()
    ctrl_noise: float | None = None
    ctrl_noise_time: float | None = None


NO_DISTURBANCES = Disturbances()


@options
class DisturbanceOptions(Options):
    """Noise on the controls, and pushes."""

    ctrl_noise: float | None = option(
        converter=optional(RealKind(metavar="STD")),
        default=None,
        usual="0, or that of the task",
        help="Standard deviation of Gaussian noise on every control, in the actuators' units.",
    )
    ctrl_noise_time: float | None = option(
        converter=optional(RealKind(metavar="SECONDS")),
        default=None,
        usual="0, or that of the task",
        help="Correlation time of the control noise [s]; 0 makes it independent at every step.",
    )
    push: tuple[Push, ...] = option(
        converter=PUSHES,
        default=(),
        help="Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start and its "
        "duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up; --show pertforce draws "
        "them in videos and images.",
    )

    @property
    def disturbances(self) -> Disturbances:
        """The disturbances alone."""
        return Disturbances(self.push, self.ctrl_noise, self.ctrl_noise_time)


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
        converter=ChoiceKind(("wxyz", "xyzw")),
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
