"""The inertia of a body in numbers that are physical whatever they are: mass, centre, and shape of its distribution."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjrun.errors import UsageError, clean, listing, option
from mjrun.model.override import Override, indices_at

INERTIA = "inertia:"  # begins the name of a parameter: `inertia:payload.mass`
QUANTITIES = {"mass": 1, "center": 3, "shape": 6}  # and how many numbers each is
STRETCHES = 3  # of a shape, the first numbers, which are factors; the others are shears
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # of the numbers of a shape in a triangular matrix
THINNEST = 1e-6  # least second moment over the largest: thin plates and rods of no thickness are given some

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """The inertia of one body, and what changes it.

    Second moments of mass about the centre, over the mass, are S·L·(S·L)ᵀ, where S is the Cholesky factor of those that
    the model has, and L is an upper triangular matrix of positive diagonal: that of no change is the identity. With
    mass and centre, this is the log-Cholesky form of C. Rucker, P. M. Wensing, "Smooth parameterization of rigid-body
    inertia" (2022), beginning at the model's: moments of inertia are positive and obey the triangle inequality for
    any L. Where the shape stays, moments of inertia grow with the mass.

    Attributes:
      body: its name or index.
      mass: in the source [kg].
      center: of mass, in the frame of the body [m], `(3,)`.
      factor: S, `(3, 3)` [m].
      moments: in the source, of the principal axes `(3,)` or, where `is_full`, `fullinertia` `(6,)` [kg m²].
      is_full: whether the source has the full matrix.
    """

    body: str
    mass: float
    center: Floats
    factor: Floats
    moments: Floats
    is_full: bool

    def start(self, name: str) -> float:
        """The value in the model of `mass`, `center[i]` or `shape[i]`."""
        quantity, index = _parts(name)
        if quantity == "shape":
            return float(index < STRETCHES)
        return self.mass if quantity == "mass" else float(self.center[index])

    def overrides(self, values: Mapping[str, float]) -> list[Override]:
        """What gives the model these values; what is not among them stays."""
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
        """Moments of inertia about the principal axes through the centre, largest first: `(3,)` [kg m²]."""
        mass, _, factor = self.at(values)
        return np.asarray(np.linalg.eigvalsh(_inertia(mass, factor))[::-1], np.float64)

    def path_of(self, name: str) -> str | None:
        """The path of an override that sets this number alone; None for those of the shape."""
        quantity, index = _parts(name)
        return {"mass": f"body/{self.body}.mass", "center": f"body/{self.body}.ipos[{index}]"}.get(quantity)

    def at(self, values: Mapping[str, float]) -> tuple[float, Floats, Floats]:
        """Mass [kg], centre `(3,)` [m], and the factor of the second moments over the mass `(3, 3)` [m]."""
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
        moments, axes = moments[::-1], axes[:, ::-1].copy()  # largest first, as the compiler has them
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, axes.ravel())
        return [self._override("inertia", moments), self._override("iquat", quat)]

    def _override(self, field: str, value: "float | Floats") -> Override:
        return Override(f"body/{self.body}.{field}", ",".join(repr(float(v)) for v in np.ravel(value)))


def body_inertia(body: str, spec: mujoco.MjSpec, model: mujoco.MjModel) -> BodyInertia:
    """The inertia of the body of a model.

    Args:
      model: what `spec` was compiled to.

    Raises:
      UnknownNameError: there is none of this name.
      UsageError: the name stands for several bodies, or its inertia is not written out but follows from its geoms.
    """
    indices, _ = indices_at(spec, Override(f"body/{body}.mass", "1"))
    bodies = [spec.bodies[index] for index in indices]
    where = f"{option('free')} {INERTIA}{clean(body)}"
    if len(bodies) > 1:
        raise UsageError(f"{where} names {listing([each.name for each in bodies])}: each body is free by itself")
    (found,) = bodies
    if not found.explicitinertial:
        raise UsageError(
            f"{where}: the inertia of this body comes from its geoms\ngive it an <inertial>, or free geom/NAME.mass"
        )
    full = np.array(found.fullinertia, float)
    is_full = bool(np.isfinite(full).all())
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[found.id])
    principal, mass = model.body_inertia[found.id], float(found.mass)
    # Second moments about the principal axes: that of x is half of what I_y + I_z - I_x is.
    spread = (principal.sum() / 2 - principal) / model.body_mass[found.id]
    spread = np.maximum(spread, THINNEST * spread.max())
    axes = axes.reshape(3, 3)
    factor = _upper_factor((axes * spread) @ axes.T)
    moments = full if is_full else np.array(found.inertia, float)
    return BodyInertia(body, mass, np.array(found.ipos, float), factor, moments, is_full)


def _parts(name: str) -> tuple[str, int]:
    quantity, _, index = name.rstrip("]").partition("[")
    return quantity, int(index or 0)


def _upper_factor(matrix: Floats) -> Floats:
    """The upper triangular U with U·Uᵀ = `matrix`."""
    return np.asarray(np.linalg.cholesky(matrix[::-1, ::-1])[::-1, ::-1], np.float64)


def _inertia(mass: float, factor: Floats) -> Floats:
    """The matrix of inertia about the centre, from the factor of the second moments over the mass."""
    moments = mass * factor @ factor.T
    return np.trace(moments) * np.eye(3) - moments
