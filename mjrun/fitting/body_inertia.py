"""Inertia of a body as mass, centre and shape, a parametrization of which all values are physical."""

from collections.abc import Mapping

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, listing, option
from mjrun.fitting.rotations_and_noise import Floats
from mjrun.model.override import Override, indices_at

INERTIA = "inertia:"  # begins the name of a parameter: `inertia:payload.mass`
QUANTITIES = {"mass": 1, "center": 3, "shape": 6}  # number of parameters of each
STRETCHES = 3  # the first numbers of a shape are factors, the others shears
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # numbers of a shape in a triangular matrix
THINNEST = 1e-6  # least second moment over the largest; thinner plates and rods are thickened


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
