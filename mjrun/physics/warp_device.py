"""A device of MuJoCo Warp: its selection, its error messages, and the models of its worlds.

Warp is imported on first use.
"""

import dataclasses
import hashlib
from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from importlib.metadata import version
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import DamagedPackageError, DeviceMemoryError, MjrunError, UnknownNameError, UsageError, clean, option
from mjrun.model.source import physics_fields
from mjrun.packages import require

COMPILES = "warp compiles kernels that are not cached, which may take minutes"
EXTRA, LIBRARIES, PACKAGE, WARP = "warp", ("mujoco_warp", "warp"), "mujoco-warp", "warp-lang"

# Options that mujoco_warp has for each world, but that it changes (tolerance) or that must be common (timestep).
COMMON_OPTIONS = ("timestep", "tolerance")
UNUSED = ("bvh_aabb", "dof_M0", "dof_length")  # mujoco_warp ignores them, as it does not let bodies sleep


class WarpDevice:
    """A GPU, or Warp's own CPU device.

    Args:
      alias: `cpu`, `cuda:0` and so on; the first GPU, or else `cpu`, when None.
      alternative: the engine that errors recommend instead, as the command names it.

    Attributes:
      alias, name: its identifier, and the name that it reports.
      is_gpu: True for a GPU.
      version: the versions of mujoco_warp and of Warp.
      warp, library: the modules of Warp and of mujoco_warp.

    Raises:
      MissingExtraError: mujoco_warp is not installed.
      DamagedPackageError: Warp does not start.
      UnknownNameError: the device does not exist.
    """

    def __init__(self, alias: str | None = None, alternative: str = "c") -> None:
        self._alternative = f"{option('engine')} {alternative}"
        self.warp, self.library = _imported()
        device = _device(self.warp, alias)
        self.alias, self.name, self.is_gpu = str(device.alias), str(device.name), bool(device.is_cuda)
        self.version = f"{LIBRARIES[0]} {version(PACKAGE)}, warp {self.warp.__version__}"

    def active(self) -> AbstractContextManager[Any]:
        """Makes Warp use this device within the context."""
        return self.warp.ScopedDevice(self.alias)

    @contextmanager
    def refusals(self, worlds: int) -> Generator[None]:
        """Converts errors of mujoco_warp: on a model, or on a lack of memory for this number of worlds."""
        engine = option("engine")
        try:
            yield
        except MjrunError:
            raise
        except NotImplementedError as error:
            reason = clean(str(error))
            raise UsageError(f"{engine} warp cannot simulate this model: {reason}\n{self._alternative} can") from None
        except Exception as error:
            reason = clean(" ".join(str(error).split()))
            if "allocate" in reason or "out of memory" in reason:
                raise DeviceMemoryError(
                    f"{worlds} worlds do not fit in the memory of {clean(self.name)} ({self.alias}): {reason}\n"
                    f"reduce {option('worlds')}, {option('nconmax')} or {option('njmax')}"
                ) from error
            if "nconmax" in reason or "njmax" in reason:
                raise UsageError(f"{engine} warp: {reason}\nraise {option('nconmax')} or {option('njmax')}") from error
            raise UsageError(
                f"{engine} warp fails on this model: {type(error).__name__}: {reason}\n{self._alternative} may not"
            ) from error


def require_library() -> None:
    """Checks that the libraries of the extra can be used.

    Raises:
      MissingExtraError: a library is not installed.
      WrongVersionError: a library has an unsupported version.
    """
    require(f"{option('engine')} warp", EXTRA, *LIBRARIES)


def _imported() -> tuple[Any, Any]:
    """Imports Warp, with its reports of compilation switched off, and mujoco_warp."""
    require_library()
    import warp  # pyright: ignore[reportMissingImports]

    warp.config.log_level = max(warp.config.log_level, warp.LOG_WARNING)
    try:
        warp.init()
    except RuntimeError as error:  # it cannot load its library
        raise DamagedPackageError(WARP, version(WARP), str(error)) from error
    import mujoco_warp  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]

    return warp, mujoco_warp


def _device(warp: Any, alias: str | None) -> Any:
    if alias is None:
        return warp.get_preferred_device()
    try:
        return warp.get_device(alias)
    except (ValueError, RuntimeError):
        valid = [str(device.alias) for device in warp.get_devices()]
        raise UnknownNameError("device", alias, valid, "Warp") from None


class PerWorldFields:
    """The fields that the installed version of mujoco_warp stores for each world."""

    def __init__(self, device: WarpDevice) -> None:
        self._device = device

    def group(self, model: mujoco.MjModel) -> str:
        """Returns the identifier of the group of models whose simulations can be worlds together.

        The models of a group agree in every number of their physics that mujoco_warp does not store for each world, and
        in which of the others are zero: these determine the forces that it leaves out, and the sizes of its arrays.
        """
        varying = {*self._fields, *self._options}
        common = [
            abs(value) >= mujoco.mjMINVAL if name in varying else value
            for name, value in physics_fields(model)
            if name not in UNUSED
        ]
        # Servos: mujoco_warp wraps their commands on ball joints.
        common.append(model.actuator_gainprm[:, 0] == -model.actuator_biasprm[:, 1])
        return hashlib.sha256(b"".join(values.tobytes() for values in common)).hexdigest()

    def put_models(self, first: mujoco.MjModel, models: Sequence[mujoco.MjModel]) -> Any:
        """Puts models on the device as one model, in which each world has separate numbers.

        Args:
          first: the model of the first world, without what mujoco_warp refuses.
          models: the models of one `group`.
        """
        if len({id(model) for model in models}) == 1:
            return self._device.library.put_model(first)
        fields = {name: np.array([getattr(model, name) for model in models]) for name in self._fields}
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

    @cached_property
    def _fields(self) -> tuple[str, ...]:
        """The arrays of MjModel that mujoco_warp stores for each world under the same name."""
        return self._of_each_world(self._device.library.Model, mujoco.MjModel)

    @cached_property
    def _options(self) -> tuple[str, ...]:
        names = self._of_each_world(self._device.library.Option, mujoco.MjOption)
        return tuple(name for name in names if name not in COMMON_OPTIONS)

    def _of_each_world(self, library_type: type, mujoco_type: type) -> tuple[str, ...]:
        """Returns the fields of real numbers whose first dimension is the worlds, which mujoco_warp marks by `*`."""
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
