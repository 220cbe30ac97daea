"""Options of a task: observations, actions, rewards, and the start and end of an episode."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import ClassVar, cast

from mjrun.options.kinds import (
    ChoiceKind,
    Kind,
    NameOrIndexKind,
    OneOrMoreKind,
    PathKind,
    ReadingContext,
    TextKind,
    optional,
)
from mjrun.options.model import ModelOptions
from mjrun.options.number_kinds import NUMBERS, ExactNumberKind, IntegerKind, Numbers, NumberVectorKind, RealKind
from mjrun.options.option import OptionExclusion, Options, option, options, required
from mjrun.options.schema_validation import NUMBER, TEXT, InvalidValueError, Schema
from mjrun.options.setting_kinds import (
    DISTRIBUTION,
    JointNumbersKind,
    NamedNumbersKind,
    VariedSettingsKind,
    distribution_text,
)
from mjrun.options.simulation import INTERPOLATIONS, NO_VALUES, DisturbanceOptions

# The extras of policies and tasks, with the libraries that each installs and the feature that needs them.
EXTRAS: dict[str, tuple[tuple[str, ...], str]] = {
    "policy": (("onnxruntime",), "policies in ONNX"),
    "gym": (("gymnasium",), "Gymnasium's environments and mjrun.gym"),
}

CURRENT, LAGGED = DERIVED = ("current", "lagged")
JOINT_FIELDS = ("qpos", "qvel")
WORLD = "world"
PREVIOUS = "previous"
CONTROL, POSITION, VELOCITY, TORQUE = TARGETS = ("control", "position", "velocity", "torque")
SUCCESS, FAILURE, TIMEOUT = ENDINGS = ("success", "failure", "timeout")
# Sources of an observation and of a command, each of which has exactly one.
OBSERVED = ("probe", "joints", "action", "command", "phase", "value")
COMMANDED = ("constant", "table", "schedule", "random")


class RandomValueKind(Kind["str | float | Mapping[str, object]", str]):
    """A distribution, such as `uniform(-0.1, 0.1)`, or a number."""

    metavar = "DISTRIBUTION"

    @property
    def form(self) -> Schema:
        return {"anyOf": [NUMBER, TEXT, DISTRIBUTION]}

    def __call__(self, value: "str | float | Mapping[str, object]") -> str:
        return distribution_text(value)

    def read(self, value: object, reader: ReadingContext) -> object:
        return distribution_text(value)


class LimitsKind(Kind[Sequence[float | Sequence[float]], tuple[Numbers, Numbers]]):
    """The lowest and the highest value: one number each, or one per component."""

    metavar = "[LOW, HIGH]"
    expected = "two numbers, or two lists of numbers, the lower first"

    @property
    def form(self) -> Schema:
        return {"type": "array", "items": NUMBERS, "minItems": 2, "maxItems": 2}

    def __call__(self, value: Sequence[float | Sequence[float]]) -> tuple[Numbers, Numbers]:
        try:
            low, high = (NumberVectorKind()(bound) for bound in value)
        except (TypeError, ValueError):
            raise InvalidValueError(self.expected) from None
        fits = len(low) == len(high) or 1 in (len(low), len(high))
        count = max(len(low), len(high))
        if not fits or not all(a < b for a, b in zip(_spread(low, count), _spread(high, count), strict=True)):
            raise InvalidValueError(self.expected)
        return low, high

    def plain(self, value: tuple[Numbers, Numbers]) -> object:
        return [NumberVectorKind().plain(bound) for bound in value]


class VectorOrKeyframeKind(Kind["float | str | Sequence[float]", "Numbers | str"]):
    """One number, one per component, or the name of a keyframe that contains them."""

    metavar = "NUMBERS|KEY"

    @property
    def form(self) -> Schema:
        numbers = {"type": "array", "items": NUMBER, "minItems": 1}
        return {"anyOf": [NUMBER, numbers, TEXT], "forms": "a number, a list of numbers, or the name of a keyframe"}

    def __call__(self, value: "float | str | Sequence[float]") -> "Numbers | str":
        if isinstance(value, str) and value:
            return value
        try:
            return NumberVectorKind()(cast("float | Sequence[float]", value))
        except InvalidValueError:
            raise InvalidValueError("a number, a list of numbers, or the name of a keyframe") from None

    def plain(self, value: "Numbers | str") -> object:
        return value if isinstance(value, str) else NumberVectorKind().plain(value)


class TimedValuesKind(Kind[Sequence[Sequence[object]], "tuple[tuple[Fraction, Numbers], ...]"]):
    """Values that change at given times [s], the first at 0: `[[0, [1, 0]], [2, [0, 1]]]`."""

    metavar = "[[TIME, VALUES], …]"
    expected = "a list of [time, values], with times that rise from 0 and equally many values each"

    @property
    def form(self) -> Schema:
        entry = {
            "type": "array",
            "prefixItems": [ExactNumberKind(zero=True).form, NUMBERS],
            "minItems": 2,
            "maxItems": 2,
        }
        return {"type": "array", "items": {**entry, "counted": "entries: a time and values"}}

    def __call__(self, value: Sequence[Sequence[object]]) -> "tuple[tuple[Fraction, Numbers], ...]":
        try:
            entries = [(ExactNumberKind(zero=True)(cast("float", time)), _vector(values)) for time, values in value]
        except (TypeError, ValueError):
            raise InvalidValueError(self.expected) from None
        times, sizes = [time for time, _ in entries], {len(values) for _, values in entries}
        if len(sizes) != 1 or times[0] != 0 or times != sorted(set(times)):
            raise InvalidValueError(self.expected, ", ".join(f"[{', '.join(map(str, entry))}]" for entry in value))
        return tuple(entries)

    def plain(self, value: "tuple[tuple[Fraction, Numbers], ...]") -> object:
        return [[float(time), NumberVectorKind().plain(values)] for time, values in value]


def _vector(value: object) -> Numbers:
    return NumberVectorKind()(cast("float | Sequence[float]", value))


def _spread(numbers: Numbers, count: int) -> Numbers:
    return numbers * count if len(numbers) == 1 else numbers


@options
class TaskOptions(DisturbanceOptions, ModelOptions):
    """All options of a task but its model and its terms."""

    section: ClassVar[str] = "Task"

    control_dt: Fraction = required(
        converter=ExactNumberKind("SECONDS"),
        help="Control period [s]: time between two actions of the policy; must be a whole number of timesteps.",
    )
    duration: Fraction = required(
        converter=ExactNumberKind("SECONDS"),
        help="Maximum length of an episode [s]; an episode that reaches it ends with the termination timeout.",
    )
    derived: str = option(
        converter=ChoiceKind(DERIVED),
        default=CURRENT,
        help="Values of quantities that MuJoCo derives from the state, such as xpos: current, computed from the "
        "observed state; or lagged, as left by the last step, one step behind the state, as in Gymnasium.",
    )


@options
class ResetOptions(Options):
    """The initial state of an episode, and its randomization."""

    section: ClassVar[str] = "Reset"

    key: str | None = option(
        converter=optional(NameOrIndexKind()), default=None, help="Keyframe to start from, by name or index."
    )
    qpos: Mapping[str, Numbers] = option(
        converter=JointNumbersKind(),
        default=NO_VALUES,
        help="Initial joint positions by name [m, rad]: hip, root/z, root.",
    )
    qvel: Mapping[str, Numbers] = option(
        converter=JointNumbersKind(rate=True), default=NO_VALUES, help="Initial joint velocities by name [m/s, rad/s]."
    )
    ctrl: Mapping[str, Numbers] = option(
        converter=NamedNumbersKind(), default=NO_VALUES, help="Initial controls by actuator name or wildcard."
    )
    noise: tuple[tuple[str, str], ...] = option(
        converter=VariedSettingsKind(),
        default=(),
        help="Noise added to the initial state, by column: {'qpos/*': 'uniform(-0.1, 0.1)', 'qvel/*': 'normal(0, "
        "0.1)'}. Quaternions are normalized afterwards.",
    )
    set: tuple[tuple[str, str], ...] = option(
        converter=VariedSettingsKind(),
        default=(),
        help="Random values that replace those of the initial state, by column: {qpos/slider: 'uniform(-1, 1)'}.",
    )
    vary: tuple[tuple[str, str], ...] = option(
        converter=VariedSettingsKind(),
        default=(),
        help="Random values in the model for each episode: {'geom/floor.friction[0]': 'uniform(0.3, 1)'}.",
    )


@options
class ObservationOptions(Options):
    """A term of the observation: its source and its processing, in the order of these keys."""

    section: ClassVar[str] = "Observation"

    name: str = required(converter=TextKind("NAME"), help="Name of the term.")
    probe: tuple[str, ...] | None = option(
        converter=optional(OneOrMoreKind(TextKind("COLUMN"), commas=True)),
        default=None,
        help="Columns of a trace, by name, group or wildcard, in the model's order: xpos/car, qvel[left_*].",
    )
    joints: tuple[str, ...] | None = option(
        converter=optional(OneOrMoreKind(TextKind("JOINT"))),
        default=None,
        help="Joints by name or wildcard, in this order.",
    )
    of: str = option(converter=ChoiceKind(JOINT_FIELDS), default="qpos", help="Quantity of the joints to observe.")
    action: str | None = option(
        converter=optional(ChoiceKind((PREVIOUS,))),
        default=None,
        help="Previous action of the policy, before any processing; zeros at the start.",
    )
    command: str | None = option(
        converter=optional(TextKind("COMMAND")), default=None, help="Command of the task to observe."
    )
    phase: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        help="Period [s]; the sine and the cosine of 2π t/period are observed.",
    )
    value: str | None = option(
        converter=optional(TextKind("EXPR")), default=None, help="An expression over columns: qpos/root/z - 1.2."
    )
    frame: str = option(
        converter=TextKind("world|BODY"),
        default=WORLD,
        help="Body into whose axes vectors of three components are rotated; world leaves them unchanged.",
    )
    noise: str | None = option(
        converter=optional(RandomValueKind()),
        default=None,
        help="Noise added to each number, drawn at every observation: normal(0, 0.01).",
    )
    offset: Numbers = option(
        converter=NumberVectorKind(), default=(0.0,), help="Value to subtract: one number, or one per component."
    )
    scale: Numbers = option(
        converter=NumberVectorKind(), default=(1.0,), help="Factor to multiply by: one number, or one per component."
    )
    clip: tuple[Numbers, Numbers] | None = option(
        converter=optional(LimitsKind()), default=None, help="Lowest and highest value."
    )
    delay: int = option(converter=IntegerKind(), default=0, help="Delay of the observation, in control periods.")
    history: int = option(converter=IntegerKind(1), default=1, help="Number of latest values to observe, oldest first.")


@options
class ActionOptions(Options):
    """Components of the action: what they drive, and their processing, in the order of these keys."""

    section: ClassVar[str] = "Action"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("actuators", "joints"), "an action drives either"),
    )

    actuators: tuple[str, ...] | None = option(
        converter=optional(OneOrMoreKind(TextKind("ACTUATOR"))),
        default=None,
        help="Actuators by name or wildcard, in this order.",
    )
    joints: tuple[str, ...] | None = option(
        converter=optional(OneOrMoreKind(TextKind("JOINT"))),
        default=None,
        help="Joints by name or wildcard, in this order, each with one actuator.",
    )
    target: str | None = option(
        converter=optional(ChoiceKind(TARGETS)),
        default=None,
        usual="control with actuators",
        help="Quantity that the action sets: control, of the actuator; position or velocity, a target q* or q̇* of"
        " the joint, reached by a torque kp (q* - q) - kd q̇ or kd (q̇* - q̇) that is computed at every step;"
        " or torque, of the joint.",
    )
    kp: Numbers | None = option(
        converter=optional(NumberVectorKind()), default=None, help="Stiffness of a position target [N·m/rad, N/m]."
    )
    kd: Numbers | None = option(
        converter=optional(NumberVectorKind()), default=None, help="Damping of a target [N·m·s/rad, N·s/m]."
    )
    squash: str = option(
        converter=ChoiceKind(("none", "tanh")),
        default="none",
        help="Function applied to the action first; tanh limits it to -1 … 1.",
    )
    clip: tuple[Numbers, Numbers] | None = option(
        converter=optional(LimitsKind()), default=None, help="Lowest and highest value, before scale and offset."
    )
    scale: Numbers = option(
        converter=NumberVectorKind(), default=(1.0,), help="Factor to multiply by: one number, or one per component."
    )
    offset: "Numbers | str" = option(
        converter=VectorOrKeyframeKind(),
        default=(0.0,),
        help="Value added last: one number, one per component, or the keyframe that contains the targets.",
    )
    delay: int = option(
        converter=IntegerKind(),
        default=0,
        help="Delay of the action, in control periods; until the first one arrives, an action of zeros is in force.",
    )


@options
class CommandTermOptions(Options):
    """A command that the policy receives over the time of an episode."""

    section: ClassVar[str] = "Command"

    constant: Numbers | None = option(converter=optional(NumberVectorKind()), default=None, help="Constant values.")
    table: str | None = option(
        converter=optional(PathKind()), default=None, help="Table with a column time [s] and one column per value."
    )
    interpolation: str = option(
        converter=ChoiceKind(INTERPOLATIONS), default="hold", help="Interpolation between the rows of the table."
    )
    schedule: "tuple[tuple[Fraction, Numbers], ...] | None" = option(
        converter=optional(TimedValuesKind()),
        default=None,
        help="Values that change at given times [s]: [[0, [1, 0]], [2, [0, 1]]].",
    )
    random: tuple[str, ...] | None = option(
        converter=optional(OneOrMoreKind(RandomValueKind())),
        default=None,
        help="Distribution of each value, or one for all: uniform(-1, 1).",
    )
    size: int | None = option(
        converter=optional(IntegerKind(1)), default=None, usual="one per distribution", help="Number of random values."
    )
    every: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="once per episode",
        help="Time after which new random values are drawn [s], a whole number of control periods.",
    )


@options
class RewardTermOptions(Options):
    """A term of the reward for each control period."""

    section: ClassVar[str] = "Reward"

    value: str = required(
        converter=TextKind("EXPR"),
        help="Expression over columns at the end of the period: exp(-norm(xpos/car/x, xpos/car/y)).",
    )
    weight: float = option(converter=RealKind(least=None), default=1.0, help="Weight of the term in the sum.")


@options
class TerminationOptions(Options):
    """A condition that ends an episode."""

    section: ClassVar[str] = "Termination"

    when: str = required(
        converter=TextKind("EXPR"),
        help="Condition on columns, evaluated after each period but not at the start: qpos/root/z < 0.8.",
    )
    as_: str = required(converter=ChoiceKind(ENDINGS), help="Outcome of an episode that ends this way.")


# The parts of a task by their keys in documents, with the path of an entry and its options.
PARTS: dict[str, tuple[str, type[Options]]] = {
    "reset": ("", ResetOptions),
    "observations": ("[]", ObservationOptions),
    "actions": ("[]", ActionOptions),
    "commands": (".NAME", CommandTermOptions),
    "rewards": (".NAME", RewardTermOptions),
    "terminations": (".NAME", TerminationOptions),
}
