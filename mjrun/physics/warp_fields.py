"""What worlds of MuJoCo Warp can differ in: masses, frictions, gains and most other numbers of their models."""

import dataclasses
import hashlib
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from mjrun.model.fingerprint import physics_fields
from mjrun.physics.warp_device import WarpDevice

# Options that mujoco_warp has for each world, but that it changes (tolerance) or that all worlds keep in step with.
COMMON_OPTIONS = ("timestep", "tolerance")
UNUSED = ("bvh_aabb", "dof_M0", "dof_length")  # by mujoco_warp, as worlds that sleep are not for it here


class WarpFields:
    """The fields that mujoco_warp keeps for each world, as a version of it has them."""

    def __init__(self, device: WarpDevice) -> None:
        self._device = device

    def group(self, model: mujoco.MjModel) -> str:
        """What models have in common whose simulations can be worlds of one group.

        That is every number of their physics that worlds cannot differ in, and which of those that they can are zero:
        mujoco_warp leaves out forces and sizes arrays by it.
        """
        digest = hashlib.sha256()
        varying = {*self._fields, *self._options}
        for name, value in physics_fields(model):
            if name in UNUSED:
                continue
            shown = abs(value) >= mujoco.mjMINVAL if name in varying else value
            digest.update(name.encode() + b"\0" + shown.tobytes())
        # Servos, whose commands it wraps on ball joints.
        digest.update((model.actuator_gainprm[:, 0] == -model.actuator_biasprm[:, 1]).tobytes())
        return digest.hexdigest()

    def put_models(self, first: mujoco.MjModel, models: Sequence[mujoco.MjModel]) -> Any:
        """mujoco_warp's model on the device, in which the world of each of `models` has its own numbers.

        Args:
          first: the model of the first world, without what mujoco_warp refuses.
          models: of one `group`.
        """
        if len({id(model) for model in models}) == 1:
            return self._device.library.put_model(first)
        fields = {name: self._stacked(name, models) for name in self._fields}
        fields = {name: values for name, values in fields.items() if _differ(values)}
        put = self._device.library.put_model(first, batch_sizes=dict.fromkeys(fields, len(models)))
        for name, values in fields.items():
            array = getattr(put, name)
            array.assign(values.reshape(array.numpy().shape))
        for name in self._options:
            values = np.array([getattr(model.opt, name) for model in models])
            if _differ(values):
                kind = getattr(put.opt, name).dtype
                setattr(put.opt, name, self._device.warp.array(values.astype(np.float32), dtype=kind))
        return put

    def _stacked(self, name: str, models: Sequence[mujoco.MjModel]) -> np.ndarray:
        return np.array([getattr(model, name) for model in models])

    @cached_property
    def _fields(self) -> tuple[str, ...]:
        """Arrays of MjModel that mujoco_warp has for each world under the same name."""
        return self._of_each_world(self._device.library.Model, mujoco.MjModel)

    @cached_property
    def _options(self) -> tuple[str, ...]:
        names = self._of_each_world(self._device.library.Option, mujoco.MjOption)
        return tuple(name for name in names if name not in COMMON_OPTIONS)

    def _of_each_world(self, library_type: type, mujoco_type: type) -> tuple[str, ...]:
        """Fields whose first dimension may be the worlds, which mujoco_warp writes as `*`, of real numbers."""
        names: list[str] = []
        for field in dataclasses.fields(library_type):
            shape = getattr(field.type, "shape", None)
            kind = getattr(field.type, "dtype", None)
            real = self._device.warp.float32 in (kind, getattr(kind, "_wp_scalar_type_", None))
            if shape and shape[0] == "*" and real and hasattr(mujoco_type, field.name):
                names.append(field.name)
        return tuple(names)


def _differ(values: np.ndarray) -> bool:
    return bool((values != values[:1]).any())
