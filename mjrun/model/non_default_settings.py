"""The options and visual settings of a model that differ from MuJoCo's defaults, or from those of another model."""

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.fields import decimal_float, floats
from mjrun.model.names import enum_members, enum_name
from mjrun.model.override import NAMED_INTEGERS
from mjrun.model.units import SETTINGS

VISUAL = {"global": "global_", "quality": "quality", "headlight": "headlight", "map": "map", "scale": "scale"}
VISUAL |= {"rgba": "rgba"}

Value = str | int | float | bool | tuple[float, ...]


@dataclass(frozen=True)
class NonDefaultSetting:
    """A setting of the model that differs from MuJoCo's default.

    Attributes:
      path: its path in the option `set`: `opt.gravity`, `opt.flag.contact`, `vis.quality.shadowsize`.
      value, default: numbers, or MuJoCo's names.
      unit: the unit; empty for pure numbers.
    """

    path: str
    value: Value
    default: Value
    unit: str = ""


def option_differences(model: mujoco.MjModel, base: mujoco.MjModel | None = None) -> tuple[NonDefaultSetting, ...]:
    """Returns the options and flags of `model` that differ from those of `base`, by default an empty model."""
    other = _default_model() if base is None else base
    settings = [
        NonDefaultSetting(f"opt.{name}", mine, theirs, SETTINGS.get(f"opt.{name}", ""))
        for name, mine, theirs in _differences(model.opt, other.opt)
    ]
    flags = [*_flags(mujoco.mjtDisableBit, model.opt.disableflags, other.opt.disableflags, ("enable", "disable"))]
    flags += _flags(mujoco.mjtEnableBit, model.opt.enableflags, other.opt.enableflags, ("disable", "enable"))
    return (*settings, *flags)


def visual_differences(model: mujoco.MjModel, base: mujoco.MjModel | None = None) -> tuple[NonDefaultSetting, ...]:
    """Returns the visual settings of `model` that differ from those of `base`, by default an empty model."""
    other = _default_model() if base is None else base
    return tuple(
        NonDefaultSetting(f"vis.{section}.{name}", mine, theirs)
        for section, field in VISUAL.items()
        for name, mine, theirs in _differences(getattr(model.vis, field), getattr(other.vis, field))
    )


def statistic_differences(model: mujoco.MjModel, other: mujoco.MjModel) -> tuple[NonDefaultSetting, ...]:
    """Returns the statistics of `model` that differ from those of `other`, which represent the defaults."""
    return tuple(
        NonDefaultSetting(f"stat.{name}", mine, theirs, SETTINGS.get(f"stat.{name}", ""))
        for name, mine, theirs in _differences(model.stat, other.stat)
    )


@cache
def _default_model() -> mujoco.MjModel:
    """Returns an empty model."""
    return mujoco.MjSpec().compile()


def _differences(mine: Any, theirs: Any) -> Iterator[tuple[str, Value, Value]]:
    """Yields the fields that differ between two MuJoCo structures."""
    number = float if isinstance(mine, mujoco.MjOption | mujoco.MjStatistic) else _single
    for name in dir(type(mine)):
        if name.startswith("_") or name in ("disableflags", "enableflags"):
            continue
        value, default = getattr(mine, name), getattr(theirs, name)
        if not np.array_equal(value, default, equal_nan=True):
            yield name, _plain(name, value, number), _plain(name, default, number)


def _plain(name: str, value: Any, number: Callable[[Any], float]) -> Value:
    if isinstance(value, np.ndarray):
        return floats(value)
    if name in NAMED_INTEGERS:
        return enum_name(NAMED_INTEGERS[name], value)
    return value if isinstance(value, int) else number(value)


def _single(value: float) -> float:
    """Returns a number that MuJoCo stores in single precision as it was written."""
    return decimal_float(np.float32(value))


def _flags(enum: Any, mine: int, theirs: int, words: tuple[str, str]) -> Iterator[NonDefaultSetting]:
    for name, bit in enum_members(enum).items():
        if (mine ^ theirs) & bit:
            yield NonDefaultSetting(f"opt.flag.{name}", words[bool(mine & bit)], words[bool(theirs & bit)])
