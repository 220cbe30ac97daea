"""Free parameters of a fit: paths in the model, inertia of bodies and delays of signals, each within bounds.

The inertia of a body is given as mass, centre and shape, a parametrization of which all values are physical.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, listing, option
from mjrun.fitting.measurements import Floats
from mjrun.model.override import ELEMENTS, Override, elements_at, indices_at, source_values
from mjrun.model.source import ModelSource, physics_fingerprint
from mjrun.model.units import setting_unit

INERTIA = "inertia:"  # begins the name of a parameter: `inertia:payload.mass`
QUANTITIES = {"mass": 1, "center": 3, "shape": 6}  # number of parameters of each
INERTIA_UNITS = {"mass": "kg", "center": "m", "shape": ""}
STRETCHES = 3  # the first numbers of a shape are factors, the others shears
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # numbers of a shape in a triangular matrix
THINNEST = 1e-6  # least second moment over the largest; thinner plates and rods are thickened
DELAY = "delay:"  # prefix of delays: `delay:ctrl/motor`
EXPECTED = "LOW..HIGH, log:LOW..HIGH, or either with a prior as in 0.1..2~normal(1, 0.2)"
# Attributes of position servos, with the fields of the model and the factors that each sets.
GAINS = {".kp": (("gainprm[0]", 1.0), ("biasprm[1]", -1.0)), ".kv": (("biasprm[2]", -1.0),)}
MARGIN = 0.02  # least distance of a start from a bound, as a share of the range

_INERTIA = re.compile(rf"{INERTIA}(?P<body>.+)\.(?P<quantity>{'|'.join(QUANTITIES)})(?:\[(?P<index>\d)\])?")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_BOUNDS = re.compile(
    rf"(?P<log>log:)?(?P<low>{_NUMBER})\.\.(?P<high>{_NUMBER})"
    rf"(?:\s*~\s*normal\(\s*(?P<mean>{_NUMBER})\s*,\s*(?P<std>{_NUMBER})\s*\))?"
)


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """The inertia of one body and the overrides that change it.

    Second moments of mass about the centre, divided by the mass, are S·L·(S·L)ᵀ, where S is the Cholesky factor of the
    model's own, and L is an upper triangular matrix with a positive diagonal, the identity for the model itself. With
    mass and centre, this is the log-Cholesky form of C. Rucker, P. M. Wensing, "Smooth parameterization of rigid-body
    inertia" (2022), relative to the model: for any L, moments of inertia are positive and obey the triangle
    inequality. With a constant shape, moments of inertia scale with the mass.

    Attributes:
      body: name or index of the body.
      mass: mass in the source [kg].
      center: centre of mass in the frame of the body [m], `(3,)`.
      factor: S, `(3, 3)` [m].
      moments: moments in the source, principal `(3,)` or, if `is_full`, `fullinertia` `(6,)` [kg m²].
      is_full: whether the source has the full matrix.
    """

    body: str
    mass: float
    center: Floats
    factor: Floats
    moments: Floats
    is_full: bool

    def start(self, name: str) -> float:
        """Returns the value of `mass`, `center[i]` or `shape[i]` in the model."""
        quantity, index = _parts(name)
        if quantity == "shape":
            return float(index < STRETCHES)
        return self.mass if quantity == "mass" else float(self.center[index])

    def overrides(self, values: Mapping[str, float]) -> list[Override]:
        """Returns the overrides that set these values; others remain unchanged."""
        quantities = {_parts(name)[0] for name in values}
        mass, center, factor = self.at(values)
        changes: list[Override] = []
        if "mass" in quantities:
            changes.append(self._override("mass", mass))
        if "center" in quantities:
            changes.append(self._override("ipos", center))
        if "shape" in quantities:
            changes += self._of_matrix(_inertia(mass, factor))
        elif "mass" in quantities:
            changes.append(
                self._override("fullinertia" if self.is_full else "inertia", self.moments * mass / self.mass)
            )
        return changes

    def principal_moments(self, values: Mapping[str, float]) -> Floats:
        """Returns the moments of inertia about the principal axes through the centre, largest first: `(3,)` [kg m²]."""
        mass, _, factor = self.at(values)
        return np.asarray(np.linalg.eigvalsh(_inertia(mass, factor))[::-1], np.float64)

    def path_of(self, name: str) -> str | None:
        """Returns the path of an override that sets this number alone; None for numbers of the shape."""
        quantity, index = _parts(name)
        return {"mass": f"body/{self.body}.mass", "center": f"body/{self.body}.ipos[{index}]"}.get(quantity)

    def at(self, values: Mapping[str, float]) -> tuple[float, Floats, Floats]:
        """Returns mass [kg], centre `(3,)` [m], and the factor of the second moments over the mass `(3, 3)` [m]."""
        center, change = self.center.copy(), np.eye(3)
        for name, value in values.items():
            quantity, index = _parts(name)
            if quantity == "center":
                center[index] = value
            elif quantity == "shape":
                change[_PLACES[index]] = value
        return float(values.get("mass", self.mass)), center, self.factor @ change

    def _of_matrix(self, inertia: Floats) -> list[Override]:
        if self.is_full:
            return [self._override("fullinertia", inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])]
        moments, axes = np.linalg.eigh(inertia)
        moments, axes = moments[::-1], axes[:, ::-1].copy()  # largest first, as the compiler orders them
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, axes.ravel())
        return [self._override("inertia", moments), self._override("iquat", quat)]

    def _override(self, field: str, value: "float | Floats") -> Override:
        return Override(f"body/{self.body}.{field}", ",".join(repr(float(v)) for v in np.ravel(value)))


def body_inertia(body: str, spec: mujoco.MjSpec, model: mujoco.MjModel) -> BodyInertia:
    """Reads the inertia of a body.

    Args:
      model: the model compiled from `spec`.

    Raises:
      UnknownNameError: no body has this name.
      UsageError: the name matches several bodies, or the body has no `<inertial>` element.
    """
    indices, _ = indices_at(spec, Override(f"body/{body}.mass", "1"))
    bodies = [spec.bodies[index] for index in indices]
    where = f"{option('free')} {INERTIA}{clean(body)}"
    if len(bodies) > 1:
        raise UsageError(f"{where} matches {listing([each.name for each in bodies])}: give one body at a time")
    (element,) = bodies
    if not element.explicitinertial:
        raise UsageError(
            f"{where}: the inertia of this body comes from its geoms\ngive it an <inertial>, or free geom/NAME.mass"
        )
    full = np.array(element.fullinertia, float)
    is_full = bool(np.isfinite(full).all())
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[element.id])
    principal, mass = model.body_inertia[element.id], float(element.mass)
    # Second moments about the principal axes: along x, half of I_y + I_z - I_x.
    spread = (principal.sum() / 2 - principal) / model.body_mass[element.id]
    spread = np.maximum(spread, THINNEST * spread.max())
    axes = axes.reshape(3, 3)
    factor = _upper_factor((axes * spread) @ axes.T)
    moments = full if is_full else np.array(element.inertia, float)
    return BodyInertia(body, mass, np.array(element.ipos, float), factor, moments, is_full)


def _parts(name: str) -> tuple[str, int]:
    quantity, _, index = name.rstrip("]").partition("[")
    return quantity, int(index or 0)


def _upper_factor(matrix: Floats) -> Floats:
    """Returns the upper triangular U with U·Uᵀ = `matrix`."""
    return np.asarray(np.linalg.cholesky(matrix[::-1, ::-1])[::-1, ::-1], np.float64)


def _inertia(mass: float, factor: Floats) -> Floats:
    """Returns the matrix of inertia about the centre, from the factor of the second moments over the mass."""
    moments = mass * factor @ factor.T
    return np.trace(moments) * np.eye(3) - moments


@dataclass(frozen=True)
class FreeParameter:
    """A parameter to estimate. Optimizers see it as a coordinate from 0 to 1 between its bounds.

    Attributes:
      path: path of an override, `delay:COLUMN` [s], with wildcards, or a number of the inertia of a body, such as
        `inertia:BODY.center[0]`.
      low, high: bounds.
      start: value in the model, or 0 s.
      is_log: whether the coordinate is proportional to the logarithm.
      prior: mean and standard deviation of a normal prior, or None.
      inertia: inertia that the number belongs to; None for other parameters.
      delayed: columns that it delays.
      objects: names of the objects of the model that share it.
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
        """A sentence about the objects that share the number; empty for a single object."""
        tied = self.objects or self.delayed
        return f"{clean(self.path)} is a single number, shared by {listing(tied)}" if len(tied) > 1 else ""

    @property
    def is_delay(self) -> bool:
        """True if it is a delay, false if it is a number of the model."""
        return bool(self.delayed)

    def unit(self, model: mujoco.MjModel) -> str:
        """Returns the unit of the number; empty if it has none, or if it is unknown."""
        if self.is_delay:
            return "s"
        if self.inertia is not None:
            return INERTIA_UNITS[self.path.rpartition(".")[2].partition("[")[0]]
        return setting_unit(model, self.path)

    def value(self, coordinate: float) -> float:
        """Returns the number at a coordinate."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        scaled = low + (high - low) * coordinate
        return math.exp(scaled) if self.is_log else float(scaled)

    def coordinate(self, value: float) -> float:
        """Returns the coordinate of a number, clipped to the bounds."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        return (self._scaled(min(max(value, self.low), self.high)) - low) / (high - low)

    def prior_slope(self, coordinate: float) -> float:
        """Returns the slope of the number to its coordinate in standard deviations of the prior; 0 without one."""
        if self.prior is None:
            return 0.0
        slope = self._scaled(self.high) - self._scaled(self.low)
        return (slope * self.value(coordinate) if self.is_log else slope) / self.prior[1]

    @property
    def name(self) -> str:
        """The last part of the path, which names a number of an inertia."""
        return self.path.rpartition(".")[2]

    @property
    def override_path(self) -> str | None:
        """The path of an override that sets it alone, or None."""
        if self.inertia is not None:
            return self.inertia.path_of(self.name)
        return None if self.is_delay else self.path

    @property
    def first_coordinate(self) -> float:
        """Initial coordinate: the mean of the prior or the value of the model, at a distance from the bounds."""
        first = self.start if self.prior is None else self.prior[0]
        return min(max(self.coordinate(first), MARGIN), 1 - MARGIN)

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.is_log else value


def values_at(parameters: Sequence[FreeParameter], coordinates: Iterable[float]) -> tuple[float, ...]:
    """Returns the numbers at coordinates."""
    return tuple(each.value(c) for each, c in zip(parameters, coordinates, strict=True))


def overrides(parameters: Sequence[FreeParameter], values: Sequence[float]) -> list[Override]:
    """Returns the overrides that set these values of `parameters`; delays need none."""
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


def free_parameters(
    texts: Sequence[tuple[str, str]], source: ModelSource, delayed: Sequence[str]
) -> list[FreeParameter]:
    """Parses free parameters, given as paths and bounds.

    Args:
      source: the model, with its overrides.
      delayed: columns that can have a delay: measured columns and controls.

    Raises:
      UsageError: no parameter is free, a path matches nothing, or bounds are invalid.
    """
    if not texts:
        raise UsageError(f"nothing to fit: name parameters with {option('free')}, such as joint/hinge.damping=0.001..1")
    spec, model = source.compile()
    bodies = _Bodies(spec, model)
    parameters: list[FreeParameter] = []
    for path, text in texts:
        with concerning("free", path):
            if path.rpartition(":")[2] == "opt.timestep":
                raise UsageError(f"{option('free')} {clean(path)}: the log determines it; use {option('set')} instead")
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
    """Inertias of bodies with free parameters."""

    def __init__(self, spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> None:
        self._spec, self._model = spec, model
        self._inertias: dict[str, BodyInertia] = {}

    def parameters(self, path: str, text: str) -> list[FreeParameter]:
        """Returns the numbers of a mass, a centre or a shape, or the single one that `path` names."""
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


def require_effect(parameter: FreeParameter, source: ModelSource) -> None:
    """Compiles the model at both bounds of a parameter.

    Raises:
      UsageError: the model does not compile at a bound, or does not depend on the parameter.
    """
    if parameter.is_delay:
        return
    with concerning("free", parameter.path):
        prints = {physics_fingerprint(_compiled(parameter, bound, source)) for bound in (parameter.low, parameter.high)}
        if len(prints) == 1:
            raise UsageError(f"{option('free')} {clean(parameter.path)} does not affect the physics of this model")


def _compiled(parameter: FreeParameter, bound: float, source: ModelSource) -> mujoco.MjModel:
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
        raise BadValueError(name, text, "a delay of at least 0 s")
    prior = None
    if match["mean"] is not None:
        prior = float(match["mean"]), float(match["std"])
        if prior[1] <= 0:
            raise BadValueError(name, text, "a prior with a standard deviation above 0")
    return FreeParameter(path, low, high, start, is_log, prior)


def _delayed(path: str, columns: Sequence[str]) -> tuple[str, ...]:
    """Returns the columns that a delay affects."""
    pattern = path.removeprefix(DELAY)
    if pattern in columns:
        return (pattern,)
    matches = tuple(column for column in columns if fnmatchcase(column, pattern))
    if not matches:
        raise UnknownNameError("signal", pattern, columns, where=f"{option('free')} delay:")
    return matches


def _model_start(path: str, spec: mujoco.MjSpec | None) -> float:
    """Returns the number at `path` in the source, the mean of several objects."""
    override = _overrides(path, 1.0)[-1]
    values = source_values(_source_of(spec, path), override) * float(
        override.value
    )  # a gain may be the negative of its bias
    if override.operation:
        return {"scale": 1.0, "add": 0.0}[override.operation]
    if not np.isfinite(values).all():
        raise UsageError(
            f"{option('free')} {clean(path)} is not in the source{_without_value(path, values, spec)}, since the "
            "compiler computes it\nfree objects that specify it, or write it into the source of the others"
        )
    return float(np.mean(values))


def _without_value(path: str, values: Floats, spec: mujoco.MjSpec | None) -> str:
    """Returns ` of A, B`, the objects of a path whose `values` `(n,)` in the source are NaN, or an empty text."""
    names = _objects(path, _source_of(spec, path))
    return f" of {listing([name for name, value in zip(names, values, strict=True) if np.isnan(value)])}" * bool(names)


def _objects(path: str, spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Returns the names of the objects that a path of the form `KIND/NAME.FIELD` matches."""
    override = _overrides(path, 1.0)[-1]
    if override.target.partition("/")[0] not in ELEMENTS:
        return ()
    return tuple(element.name or "an object without a name" for element in elements_at(spec, override)[0])


def _source_of(spec: mujoco.MjSpec | None, path: str) -> mujoco.MjSpec:
    if spec is None:
        raise UsageError(f"{option('free')} {clean(path)}: a compiled model has no source to change")
    return spec
