"""Options of disturbances: noise on the controls, and pushes, forces that act on a body for a limited time.

Pushes are written in the forms of the command line, documents and Python.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import cast

from mjrun.dataclass import dataclass
from mjrun.options.kinds import OneOrMoreKind, ReadingContext, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, PointKind, RealKind
from mjrun.options.option import OptionRequirement, Options, option, options, required
from mjrun.options.schema_validation import InvalidValueError, Path, check
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
# Checked when a simulation or an episode starts, since a study may vary the noise, and a task may contain it.
NOISE_REQUIREMENT = OptionRequirement("ctrl_noise_time", "ctrl_noise", "whose correlation it sets")


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
