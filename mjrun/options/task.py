"""Options of a task: what a policy observes and does, what it is rewarded for, and when an episode ends."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import ClassVar, cast

from mjrun.options.kinds import (
    NUMBERS,
    Choice,
    ExactNumber,
    ExpectedError,
    File,
    Integer,
    Key,
    Kind,
    Numbers,
    NumberVector,
    Optional,
    Reader,
    Real,
    Several,
    Text,
    Values,
)
from mjrun.options.model import ModelOptions
from mjrun.options.option import Exclusion, Options, option, options, required
from mjrun.options.schema import NUMBER, TEXT, Schema
from mjrun.options.simulation import INTERPOLATIONS, NO_VALUES
from mjrun.options.variations import DISTRIBUTION, Variations, distribution_text

# Extras of policies and tasks: the library that each installs, and what needs it.
EXTRAS = {
    "policy": (("onnxruntime",), "policies in ONNX"),
    "gym": (("gymnasium",), "Gymnasium's environments and mjrun.gym"),
}

CURRENT, LAGGED = DERIVED = ("current", "lagged")
JOINT_FIELDS = ("qpos", "qvel")
WORLD = "world"
PREVIOUS = "previous"
SQUASHES = ("none", "tanh")
CONTROL, POSITION, VELOCITY, TORQUE = TARGETS = ("control", "position", "velocity", "torque")
SUCCESS, FAILURE, TIMEOUT = ENDINGS = ("success", "failure", "timeout")
# What an observation is taken from, and what a command comes from: exactly one each.
OBSERVED = ("probe", "joints", "action", "command", "phase", "value")
COMMANDED = ("constant", "table", "schedule", "random")


class RandomValue(Kind["str | float | Mapping[str, object]", str]):
    """A distribution, such as `uniform(-0.1, 0.1)`, or a number."""

    metavar = "DISTRIBUTION"

    @property
    def form(self) -> Schema:
        return {"anyOf": [NUMBER, TEXT, DISTRIBUTION]}

    def __call__(self, value: "str | float | Mapping[str, object]") -> str:
        return distribution_text(value)

    def read(self, value: object, reader: Reader) -> object:
        return distribution_text(value)


class Limits(Kind[Sequence[float | Sequence[float]], tuple[Numbers, Numbers]]):
    """The lowest and the highest value: a number each, or one for each component."""

    metavar = "[LOW, HIGH]"
    expected = "two numbers, or two lists of numbers, the lower first"

    @property
    def form(self) -> Schema:
        return {"type": "array", "items": NUMBERS, "minItems": 2, "maxItems": 2}

    def __call__(self, value: Sequence[float | Sequence[float]]) -> tuple[Numbers, Numbers]:
        try:
            low, high = (NumberVector()(bound) for bound in value)
        except (TypeError, ValueError):
            raise ExpectedError(self.expected) from None
        fits = len(low) == len(high) or 1 in (len(low), len(high))
        count = max(len(low), len(high))
        if not fits or not all(a < b for a, b in zip(_spread(low, count), _spread(high, count), strict=True)):
            raise ExpectedError(self.expected)
        return low, high

    def plain(self, value: tuple[Numbers, Numbers]) -> object:
        return [NumberVector().plain(bound) for bound in value]


class VectorOrKey(Kind["float | str | Sequence[float]", "Numbers | str"]):
    """A number, one for each component, or the name of a keyframe that holds them."""

    metavar = "NUMBERS|KEY"

    @property
    def form(self) -> Schema:
        numbers = {"type": "array", "items": NUMBER, "minItems": 1}
        return {"anyOf": [NUMBER, numbers, TEXT], "forms": "a number, a list of numbers, or the name of a keyframe"}

    def __call__(self, value: "float | str | Sequence[float]") -> "Numbers | str":
        if isinstance(value, str) and value:
            return value
        try:
            return NumberVector()(cast("float | Sequence[float]", value))
        except ExpectedError:
            raise ExpectedError("a number, a list of numbers, or the name of a keyframe") from None

    def plain(self, value: "Numbers | str") -> object:
        return value if isinstance(value, str) else NumberVector().plain(value)


class Schedule(Kind[Sequence[Sequence[object]], "tuple[tuple[Fraction, Numbers], ...]"]):
    """Values from times on [s], the first from 0: `[[0, [1, 0]], [2, [0, 1]]]`."""

    metavar = "[[TIME, VALUES], …]"
    expected = "a list of [time, values], the times rising from 0 on, each with as many values"

    @property
    def form(self) -> Schema:
        entry = {"type": "array", "prefixItems": [ExactNumber(zero=True).form, NUMBERS], "minItems": 2, "maxItems": 2}
        return {"type": "array", "items": {**entry, "counted": "entries: a time and values"}}

    def __call__(self, value: Sequence[Sequence[object]]) -> "tuple[tuple[Fraction, Numbers], ...]":
        try:
            entries = [(ExactNumber(zero=True)(cast("float", time)), _vector(values)) for time, values in value]
        except (TypeError, ValueError):
            raise ExpectedError(self.expected) from None
        times, sizes = [time for time, _ in entries], {len(values) for _, values in entries}
        if len(sizes) != 1 or times[0] != 0 or times != sorted(set(times)):
            raise ExpectedError(self.expected, ", ".join(f"[{', '.join(map(str, entry))}]" for entry in value))
        return tuple(entries)

    def plain(self, value: "tuple[tuple[Fraction, Numbers], ...]") -> object:
        return [[float(time), NumberVector().plain(values)] for time, values in value]


def _vector(value: object) -> Numbers:
    return NumberVector()(cast("float | Sequence[float]", value))


def _spread(numbers: Numbers, count: int) -> Numbers:
    return numbers * count if len(numbers) == 1 else numbers


@options
class TaskOptions(ModelOptions):
    """A task, but for its model and its terms."""

    section: ClassVar[str] = "Task"

    control_dt: Fraction = required(
        converter=ExactNumber("SECONDS"),
        help="The control period [s]: time between two actions of the policy, a whole number of timesteps.",
    )
    duration: Fraction = required(
        converter=ExactNumber("SECONDS"), help="Length of an episode [s]; its end is the termination timeout."
    )
    derived: str = option(
        converter=Choice(DERIVED),
        default=CURRENT,
        help="What is observed of quantities that MuJoCo derives from the state, such as xpos: current, computed for "
        "the state that is observed; or lagged, as the last step left them, one step behind, as in Gymnasium.",
    )


@options
class ResetOptions(Options):
    """The state at which an episode starts, and what is random in it."""

    section: ClassVar[str] = "Reset"

    key: str | None = option(
        converter=Optional(Key()), default=None, help="The keyframe to start from, by name or index."
    )
    qpos: Mapping[str, Numbers] = option(
        converter=Values(), default=NO_VALUES, help="Initial joint positions by name [m, rad]: hip, root/z, root."
    )
    qvel: Mapping[str, Numbers] = option(
        converter=Values(), default=NO_VALUES, help="Initial joint velocities by name [m/s, rad/s]."
    )
    ctrl: Mapping[str, Numbers] = option(
        converter=Values(), default=NO_VALUES, help="Initial controls by actuator name or wildcard."
    )
    noise: tuple[tuple[str, str], ...] = option(
        converter=Variations(),
        default=(),
        help="What is added to the start, by columns: 'qpos/*' as in uniform(-0.1, 0.1), 'qvel/*' as in "
        "normal(0, 0.1). Quaternions are normalized afterwards.",
    )
    set: tuple[tuple[str, str], ...] = option(
        converter=Variations(),
        default=(),
        help="What is drawn instead of added, by columns: qpos/slider as in uniform(-1, 1).",
    )
    vary: tuple[tuple[str, str], ...] = option(
        converter=Variations(),
        default=(),
        help="What is drawn of the model for each episode: geom/floor.friction[0] as in uniform(0.3, 1).",
    )


@options
class ObservationOptions(Options):
    """A term of the observation: where it is taken from, and what is done to it, in the order of these keys."""

    section: ClassVar[str] = "Observation"

    name: str = required(converter=Text("NAME"), help="The name of the term.")
    probe: tuple[str, ...] | None = option(
        converter=Optional(Several(Text("COLUMN"), commas=True)),
        default=None,
        help="Columns of a trace, by name, group or wildcard, in the model's order: xpos/car, qvel[left_*].",
    )
    joints: tuple[str, ...] | None = option(
        converter=Optional(Several(Text("JOINT"))),
        default=None,
        help="Joints by name or wildcard, in this order.",
    )
    of: str = option(converter=Choice(JOINT_FIELDS), default="qpos", help="What of the joints.")
    action: str | None = option(
        converter=Optional(Choice((PREVIOUS,))),
        default=None,
        help="The last action of the policy, as the policy gave it; zeros at the start.",
    )
    command: str | None = option(converter=Optional(Text("COMMAND")), default=None, help="A command of the task.")
    phase: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        help="A period [s]: the sine and the cosine of 2π t/period.",
    )
    value: str | None = option(
        converter=Optional(Text("EXPR")), default=None, help="An expression over columns: qpos/root/z - 1.2."
    )
    frame: str = option(
        converter=Text("world|BODY"),
        default=WORLD,
        help="The body into whose axes vectors of three are turned; or world, which leaves them.",
    )
    noise: str | None = option(
        converter=Optional(RandomValue()), default=None, help="What is added: normal(0, 0.01), anew for each number."
    )
    offset: Numbers = option(
        converter=NumberVector(), default=(0.0,), help="What is subtracted: a number, or one for each component."
    )
    scale: Numbers = option(
        converter=NumberVector(), default=(1.0,), help="What it is multiplied by: a number, or one for each component."
    )
    clip: tuple[Numbers, Numbers] | None = option(
        converter=Optional(Limits()), default=None, help="The lowest and the highest value."
    )
    delay: int = option(converter=Integer(), default=0, help="Control periods until it is observed.")
    history: int = option(
        converter=Integer(1), default=1, help="How many of the latest values are observed, the oldest first."
    )


@options
class ActionOptions(Options):
    """Numbers of the action: what they drive, and what is done to them, in the order of these keys."""

    section: ClassVar[str] = "Action"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Exclusion(("actuators", "joints"), "an action drives one of the two"),
    )

    actuators: tuple[str, ...] | None = option(
        converter=Optional(Several(Text("ACTUATOR"))),
        default=None,
        help="Actuators by name or wildcard, in this order.",
    )
    joints: tuple[str, ...] | None = option(
        converter=Optional(Several(Text("JOINT"))),
        default=None,
        help="Joints by name or wildcard, in this order, each with one actuator.",
    )
    target: str | None = option(
        converter=Optional(Choice(TARGETS)),
        default=None,
        usual="control with actuators",
        help="What the action is: a control of the actuator; a position or a velocity of the joint, which a torque "
        "kp (q* - q) - kd q̇ or kd (q̇* - q̇) holds, computed at every step of the physics; or that torque.",
    )
    kp: Numbers | None = option(
        converter=Optional(NumberVector()), default=None, help="Stiffness of a position target [N·m/rad, N/m]."
    )
    kd: Numbers | None = option(
        converter=Optional(NumberVector()), default=None, help="Damping of a target [N·m·s/rad, N·s/m]."
    )
    squash: str = option(
        converter=Choice(SQUASHES),
        default="none",
        help="What the action goes through first; tanh keeps it between -1 and 1.",
    )
    clip: tuple[Numbers, Numbers] | None = option(
        converter=Optional(Limits()), default=None, help="The lowest and the highest value, before scale and offset."
    )
    scale: Numbers = option(
        converter=NumberVector(), default=(1.0,), help="What it is multiplied by: a number, or one for each component."
    )
    offset: "Numbers | str" = option(
        converter=VectorOrKey(),
        default=(0.0,),
        help="What is added at last: a number, one for each component, or the keyframe that holds the targets.",
    )


@options
class CommandOptions(Options):
    """What the policy is told to do, over the time of an episode."""

    section: ClassVar[str] = "Command"

    constant: Numbers | None = option(
        converter=Optional(NumberVector()), default=None, help="Values that stay the same."
    )
    table: str | None = option(
        converter=Optional(File()), default=None, help="A table with a column time [s], and one for each value."
    )
    interpolation: str = option(
        converter=Choice(INTERPOLATIONS), default="hold", help="How values go on between the rows of that table."
    )
    schedule: "tuple[tuple[Fraction, Numbers], ...] | None" = option(
        converter=Optional(Schedule()), default=None, help="Values from times on [s]: [[0, [1, 0]], [2, [0, 1]]]."
    )
    random: tuple[str, ...] | None = option(
        converter=Optional(Several(RandomValue())),
        default=None,
        help="The distribution of each value, or that of all: uniform(-1, 1).",
    )
    size: int | None = option(
        converter=Optional(Integer(1)), default=None, usual="one for each distribution", help="How many random values."
    )
    every: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        usual="once in an episode",
        help="Time after which random values are drawn anew [s], a whole number of control periods.",
    )


@options
class RewardOptions(Options):
    """A term of the reward of each control period."""

    section: ClassVar[str] = "Reward"

    value: str = required(
        converter=Text("EXPR"), help="An expression over columns after the period: exp(-norm(xpos/car/x, xpos/car/y))."
    )
    weight: float = option(converter=Real(least=None), default=1.0, help="What it is multiplied by in the sum.")


@options
class TerminationOptions(Options):
    """What ends an episode."""

    section: ClassVar[str] = "Termination"

    when: str = required(
        converter=Text("EXPR"),
        help="A condition on columns, asked after each period, not at the start: qpos/root/z < 0.8.",
    )
    as_: str = required(converter=Choice(ENDINGS), help="What such an end is.")


# The parts of a task by their keys in documents: how an entry of one is found there, and its options.
PARTS: dict[str, tuple[str, type[Options]]] = {
    "reset": ("", ResetOptions),
    "observations": ("[]", ObservationOptions),
    "actions": ("[]", ActionOptions),
    "commands": (".NAME", CommandOptions),
    "rewards": (".NAME", RewardOptions),
    "terminations": (".NAME", TerminationOptions),
}
