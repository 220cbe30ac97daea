"""What a fit may change: paths in the model and delays of signals, each within bounds."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, listing, option
from mjrun.fit.body_inertia import INERTIA, QUANTITIES, STRETCHES, BodyInertia, body_inertia
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.override import ELEMENTS, Override, elements_at, source_values
from mjrun.model.source import Source

DELAY = "delay:"  # begins the name of a delay: `delay:ctrl/motor`
EXPECTED = "LOW..HIGH, log:LOW..HIGH, or either with a prior as in 0.1..2~normal(1, 0.2)"
# Gains of position servos by the names of their attributes, and the numbers of the model that each stands for.
GAINS = {".kp": (("gainprm[0]", 1.0), ("biasprm[1]", -1.0)), ".kv": (("biasprm[2]", -1.0),)}
MARGIN = 0.02  # of the range: a start at a bound is moved this far from it

_INERTIA = re.compile(rf"{INERTIA}(?P<body>.+)\.(?P<quantity>{'|'.join(QUANTITIES)})(?:\[(?P<index>\d)\])?")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_BOUNDS = re.compile(
    rf"(?P<log>log:)?(?P<low>{_NUMBER})\.\.(?P<high>{_NUMBER})"
    rf"(?:\s*~\s*normal\(\s*(?P<mean>{_NUMBER})\s*,\s*(?P<std>{_NUMBER})\s*\))?"
)


@dataclass(frozen=True)
class FreeParameter:
    """One number that a fit looks for. Optimizers see it as a coordinate from 0 to 1 between its bounds.

    Attributes:
      path: in the model, as overrides have it, `delay:COLUMN` [s], wildcards allowed, or a number of the inertia of a
        body, such as `inertia:BODY.center[0]`.
      low, high: its bounds.
      start: what the model has, or 0 s.
      is_log: whether the coordinate goes with the logarithm.
      prior: mean and standard deviation of a normal distribution that is known beforehand; None without one.
      inertia: of which it is a number; None where it stands for itself.
      delayed: the columns that it delays.
      objects: the names of the objects of the model whose number it is.
    """

    path: str
    low: float
    high: float
    start: float
    is_log: bool = False
    prior: tuple[float, float] | None = None
    inertia: BodyInertia | None = None
    delayed: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()

    @property
    def sharing(self) -> str:
        """A sentence about all that has this number, where a wildcard ties several; empty where it does not."""
        tied = self.objects or self.delayed
        return f"{clean(self.path)} is one number, shared by {listing(tied)}" if len(tied) > 1 else ""

    @property
    def is_delay(self) -> bool:
        """Whether it is the delay of signals rather than a number of the model."""
        return bool(self.delayed)

    def value(self, coordinate: float) -> float:
        """The number at a coordinate."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        scaled = low + (high - low) * coordinate
        return math.exp(scaled) if self.is_log else float(scaled)

    def coordinate(self, value: float) -> float:
        """The coordinate of a number; that of the nearer bound for one beyond both."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        return (self._scaled(min(max(value, self.low), self.high)) - low) / (high - low)

    def prior_slope(self, coordinate: float) -> float:
        """How many standard deviations of the prior the number moves for each unit of the coordinate; 0 without one."""
        if self.prior is None:
            return 0.0
        slope = self._scaled(self.high) - self._scaled(self.low)
        return (slope * self.value(coordinate) if self.is_log else slope) / self.prior[1]

    @property
    def name(self) -> str:
        """The last part of the path: what a body calls this number of its inertia."""
        return self.path.rpartition(".")[2]

    @property
    def override_path(self) -> str | None:
        """The path of an override that sets it alone; None where there is none."""
        if self.inertia is not None:
            return self.inertia.path_of(self.name)
        return None if self.is_delay else self.path

    @property
    def first_coordinate(self) -> float:
        """Where to begin: at the mean of the prior, or the value that the model has, off the bounds."""
        first = self.start if self.prior is None else self.prior[0]
        return min(max(self.coordinate(first), MARGIN), 1 - MARGIN)

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.is_log else value


def values_at(parameters: Sequence[FreeParameter], coordinates: Iterable[float]) -> tuple[float, ...]:
    """The numbers at coordinates."""
    return tuple(each.value(c) for each, c in zip(parameters, coordinates, strict=True))


def overrides(parameters: Sequence[FreeParameter], values: Sequence[float]) -> list[Override]:
    """What gives the model these values of `parameters`; delays change nothing in it."""
    changes: list[Override] = []
    inertias: dict[BodyInertia, dict[str, float]] = {}
    for parameter, value in zip(parameters, values, strict=True):
        if parameter.inertia is not None:
            inertias.setdefault(parameter.inertia, {})[parameter.name] = value
        elif not parameter.is_delay:
            changes += _overrides(parameter.path, value)
    return changes + [each for inertia, numbers in inertias.items() for each in inertia.overrides(numbers)]


def _overrides(path: str, value: float) -> list[Override]:
    gains = GAINS.get(path[-3:]) if path.startswith("actuator/") else None
    if gains is None:
        return [Override(path, repr(float(value)))]
    return [Override(f"{path[:-2]}{field}", repr(float(sign * value))) for field, sign in gains]


def free_parameters(texts: Sequence[tuple[str, str]], source: Source, delayed: Sequence[str]) -> list[FreeParameter]:
    """The parameters that `texts` name, as path and bounds.

    Args:
      source: the model, with its overrides.
      delayed: the columns that can have a delay: those measured, and the controls.

    Raises:
      UsageError: nothing is free; a path that names nothing, or bounds that cannot be.
    """
    if not texts:
        raise UsageError(f"{option('free')} says what is looked for, as in joint/hinge.damping=0.001..1; nothing is")
    spec, model = source.compile()
    bodies = _Bodies(spec, model)
    parameters: list[FreeParameter] = []
    for path, text in texts:
        with concerning("free", path):
            if path.rpartition(":")[2] == "opt.timestep":
                raise UsageError(f"{option('free')} {clean(path)}: time is that of the log; {option('set')} it instead")
            if path.startswith(INERTIA):
                parameters += bodies.parameters(path, text)
            elif path.startswith(DELAY):
                parameters.append(replace(_parameter(path, text, 0.0), delayed=_delayed(path, delayed)))
            else:
                parameter = _parameter(path, text, _model_start(path, spec))
                parameters.append(replace(parameter, objects=_objects(path, _source_of(spec, path))))
            names = [name for each in parameters for name in each.delayed or [each.path]]
            if len(set(names)) < len(names):
                raise UsageError(f"{option('free')} {clean(path)} is given twice")
    return parameters


class _Bodies:
    """The inertias of the bodies that parameters name."""

    def __init__(self, spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> None:
        self._spec, self._model = spec, model
        self._inertias: dict[str, BodyInertia] = {}

    def parameters(self, path: str, text: str) -> list[FreeParameter]:
        """The numbers of a mass, a centre or a shape, or the one that `path` names."""
        match = _INERTIA.fullmatch(path)
        if match is None or int(match["index"] or 0) >= QUANTITIES[match["quantity"]]:
            expected = f"{INERTIA}BODY.mass, .center or .shape, or one number of them such as .center[0]"
            raise BadValueError(option("free"), path, expected)
        quantity, count = match["quantity"], QUANTITIES[match["quantity"]]
        inertia = self._of(match["body"], path)
        all_names = [quantity] if count == 1 else [f"{quantity}[{i}]" for i in range(count)]
        names = [f"{quantity}[{match['index']}]"] if match["index"] and count > 1 else all_names
        return [self._parameter(path, text, name, inertia) for name in names]

    def _of(self, body: str, path: str) -> BodyInertia:
        if body not in self._inertias:
            self._inertias[body] = body_inertia(body, _source_of(self._spec, path), self._model)
        return self._inertias[body]

    def _parameter(self, path: str, text: str, name: str, inertia: BodyInertia) -> FreeParameter:
        parameter = _parameter(path, text, inertia.start(name))
        parameter = replace(parameter, path=f"{INERTIA}{inertia.body}.{name}", inertia=inertia)
        if not name.startswith("center") and parameter.low <= 0:
            raise BadValueError(f"{option('free')} {clean(path)}", text, "LOW..HIGH above 0")
        if not name.startswith("shape"):
            return parameter
        if int(name[-2]) < STRETCHES:
            return replace(parameter, is_log=True)
        reach = (parameter.high - parameter.low) / 2
        prior = (0.0, parameter.prior[1]) if parameter.prior else None
        return replace(parameter, low=-reach, high=reach, start=0.0, is_log=False, prior=prior)


def require_effect(parameter: FreeParameter, source: Source) -> None:
    """Compiles the model at both bounds of a parameter of the model.

    Raises:
      UsageError: it compiles at one of them only, or the bounds make no difference.
    """
    if parameter.is_delay:
        return
    with concerning("free", parameter.path):
        prints = {physics_fingerprint(_compiled(parameter, bound, source)) for bound in (parameter.low, parameter.high)}
        if len(prints) == 1:
            raise UsageError(f"{option('free')} {clean(parameter.path)} changes nothing in the physics of this model")


def _compiled(parameter: FreeParameter, bound: float, source: Source) -> mujoco.MjModel:
    try:
        return replace(source, overrides=(*source.overrides, *overrides([parameter], [bound]))).load()
    except UsageError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f"{option('free')} {clean(parameter.path)}={bound:g} does not compile: {reason}") from None


def _parameter(path: str, text: str, start: float) -> FreeParameter:
    name = f"{option('free')} {clean(path)}"
    match = _BOUNDS.fullmatch(text.strip())
    if match is None:
        raise BadValueError(name, text, EXPECTED)
    low, high, is_log = float(match["low"]), float(match["high"]), match["log"] is not None
    if not low < high or (is_log and low <= 0):
        raise BadValueError(name, text, "LOW..HIGH with LOW below HIGH" + (" and above 0" if is_log else ""))
    if path.startswith(DELAY) and low < 0:
        raise BadValueError(name, text, "a delay [s]: 0 or more")
    prior = None
    if match["mean"] is not None:
        prior = float(match["mean"]), float(match["std"])
        if prior[1] <= 0:
            raise BadValueError(name, text, "a prior with a standard deviation above 0")
    return FreeParameter(path, low, high, start, is_log, prior)


def _delayed(path: str, columns: Sequence[str]) -> tuple[str, ...]:
    """The columns that a delay is of."""
    pattern = path.removeprefix(DELAY)
    if pattern in columns:
        return (pattern,)
    matches = tuple(column for column in columns if fnmatchcase(column, pattern))
    if not matches:
        raise UnknownNameError("signal", pattern, columns, where=f"{option('free')} delay:")
    return matches


def _model_start(path: str, spec: mujoco.MjSpec | None) -> float:
    """The number at `path` in the source: of several objects, their mean."""
    override = _overrides(path, 1.0)[-1]
    values = source_values(_source_of(spec, path), override) * float(
        override.value
    )  # a gain may be the negative of its bias
    if override.operation:
        return {"scale": 1.0, "add": 0.0}[override.operation]
    if not np.isfinite(values).all():
        raise UsageError(f"{option('free')} {clean(path)} is not in the source: the compiler works it out")
    return float(np.mean(values))


def _objects(path: str, spec: mujoco.MjSpec) -> tuple[str, ...]:
    """The names of those that a path of `KIND/NAME.FIELD` names."""
    override = _overrides(path, 1.0)[-1]
    if override.target.partition("/")[0] not in ELEMENTS:
        return ()
    return tuple(element.name or "one without a name" for element in elements_at(spec, override)[0])


def _source_of(spec: mujoco.MjSpec | None, path: str) -> mujoco.MjSpec:
    if spec is None:
        raise UsageError(f"{option('free')} {clean(path)}: a compiled model has no source that could be changed")
    return spec
