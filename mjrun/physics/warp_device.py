"""A device of MuJoCo Warp: finding it, and explaining what it refuses. Warp is imported when one is looked for."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib.metadata import version
from typing import Any

from mjrun.errors import UnknownNameError, UsageError, clean, option
from mjrun.packages import require

EXTRA, LIBRARIES, PACKAGE = "warp", ("mujoco_warp", "warp"), "mujoco-warp"


class WarpDevice:
    """A GPU, or Warp's own CPU device.

    Args:
      alias: `cpu`, `cuda:0` and so on; the first GPU, or else `cpu`, when None.

    Attributes:
      alias, name: what it is called by, and what it calls itself.
      is_gpu: whether it is one.
      version: of mujoco_warp and of Warp.
      warp, library: the modules of Warp and of mujoco_warp.

    Raises:
      MissingExtraError: mujoco_warp is not installed.
      UnknownNameError: there is no such device.
    """

    def __init__(self, alias: str | None = None) -> None:
        self.warp, self.library = _imported()
        device = _device(self.warp, alias)
        self.alias, self.name, self.is_gpu = str(device.alias), str(device.name), bool(device.is_cuda)
        self.version = f"{LIBRARIES[0]} {version(PACKAGE)}, warp {self.warp.__version__}"

    def active(self) -> AbstractContextManager[Any]:
        """Lets Warp work on this device."""
        return self.warp.ScopedDevice(self.alias)

    @contextmanager
    def refusals(self, worlds: int) -> Iterator[None]:
        """Explains how mujoco_warp refuses a model, fails on one, or has no memory for so many worlds."""
        engine = option("engine")
        try:
            yield
        except NotImplementedError as error:
            raise UsageError(f"{engine} warp cannot simulate this model: {clean(str(error))}\n{engine} c can") from None
        except Exception as error:
            reason = clean(" ".join(str(error).split()))
            if "allocate" in reason:
                raise UsageError(
                    f"{worlds} worlds do not fit in the memory of {clean(self.name)} ({self.alias}): {reason}\n"
                    f"reduce {option('worlds')}, {option('nconmax')} or {option('njmax')}"
                ) from error
            if "nconmax" in reason or "njmax" in reason:
                raise UsageError(f"{engine} warp: {reason}\nraise {option('nconmax')} or {option('njmax')}") from error
            raise UsageError(
                f"{engine} warp fails on this model: {type(error).__name__}: {reason}\n{engine} c may not"
            ) from error


def require_library() -> None:
    """Raises MissingExtraError or WrongVersionError if the libraries of the extra cannot be used."""
    require(f"{option('engine')} warp", EXTRA, *LIBRARIES)


def _imported() -> tuple[Any, Any]:
    """Warp, told not to report what it compiles, and mujoco_warp."""
    require_library()
    import warp  # pyright: ignore[reportMissingImports]

    warp.config.log_level = max(warp.config.log_level, warp.LOG_WARNING)
    import mujoco_warp  # pyright: ignore[reportMissingImports]

    return warp, mujoco_warp


def _device(warp: Any, alias: str | None) -> Any:
    if alias is None:
        return warp.get_preferred_device()
    try:
        return warp.get_device(alias)
    except (ValueError, RuntimeError):
        valid = [str(device.alias) for device in warp.get_devices()]
        raise UnknownNameError("device", alias, valid, "Warp") from None
