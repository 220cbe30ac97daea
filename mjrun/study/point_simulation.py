"""One simulation of a study: the base simulation, with the values of a point."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.experiment.design import simulation_kinds
from mjrun.model.override import Override, apply
from mjrun.options.schema import ExpectedError
from mjrun.simulation.simulation import Simulation

BY_NAME = ("qpos", "qvel", "ctrl")  # written `qpos/hip`
# Options of a simulation that may vary as a whole.
WHOLE = ("timestep", "integrator", "key", "perturb", "seed", "ctrl_noise", "ctrl_noise_time", "ctrl_from")
WHOLE += ("ctrl_interpolation", "duration", "steps", "control_dt", "push")
MANY = 1000  # values that are each looked at
MODEL, CONTROLLER = "model", "controller"
FILES = (MODEL, "ctrl_from")  # whose values name files
NO_CONTROLLERS: Mapping[str, Callable[..., object]] = {}


def simulation_at(
    base: Simulation,
    names: tuple[str, ...],
    values: tuple[str, ...],
    controllers: Mapping[str, Callable[..., object]] = NO_CONTROLLERS,
) -> Simulation:
    """The simulation of the point at which `names` have `values`.

    Args:
      controllers: what the values of `controller` stand for.

    Raises:
      UsageError: a name that nothing has, or a value that cannot be.
    """
    changes: dict[str, object] = {}
    overrides: list[tuple[str, str]] = []
    for name, text in zip(names, values, strict=True):
        if _is_path(name):
            overrides.append((name, text))
            continue
        key, value = _change(name, text, controllers)
        if key in BY_NAME:
            entries = changes.setdefault(key, dict({"qpos": base.qpos, "qvel": base.qvel, "ctrl": base.ctrl}[key]))
            assert isinstance(entries, dict)
            entries |= dict([value])
        else:
            changes[key] = value
    if overrides:
        changes["set"] = (*base.set, *overrides)
    return replace(base, **changes) if changes else base


def _is_path(name: str) -> bool:
    """Whether it is the path of an override, rather than an option."""
    return "." in name and name.partition("/")[0] not in BY_NAME


def _change(name: str, text: str, controllers: Mapping[str, Callable[..., object]]) -> tuple[str, Any]:
    """The option that `name` stands for, and its value; of those that are by name, an entry.

    Raises:
      UsageError: a name that nothing has, or a value that cannot be.
    """
    group, slash, rest = name.partition("/")
    if name == MODEL:
        return name, text
    if name == CONTROLLER:
        if text not in controllers:
            message = f"{option('vary')} controller: {clean(text)}: only the command line and Python may name code"
            raise UsageError(message)
        return name, controllers[text]
    if slash and group in BY_NAME:
        return group, _value(name, f"{rest}={text}", group)
    if name in WHOLE:
        return name, _value(name, text, name)
    valid = [*WHOLE, MODEL, CONTROLLER, *(f"{each}/NAME" for each in BY_NAME), "opt.FIELD", "KIND/NAME.FIELD"]
    with concerning("vary", name):
        raise UnknownNameError("parameter", name, valid, where=option("vary"))


def _value(name: str, text: str, of: str) -> object:
    """The value of the option `of` that `text` writes on a command line."""
    try:
        return simulation_kinds()[of].parse(text)
    except ExpectedError as error:
        with concerning("vary", name):
            raise BadValueError(f"{option('vary')} {clean(name)}", text, error.expected) from None


def require_values(
    names: Sequence[str],
    points: Sequence[Sequence[str]],
    controllers: Mapping[str, Callable[..., object]] = NO_CONTROLLERS,
    spec: mujoco.MjSpec | None = None,
) -> None:
    """Refuses values that no model could be simulated with, such as a seed of 1.5.

    Args:
      spec: of the model that all points have in common, if they do.

    Raises:
      UsageError: there is such a value.
    """
    for index, name in enumerate(names):
        for text in _telling([point[index] for point in points]):
            if not _is_path(name):
                _change(name, text, controllers)
            elif spec is not None:
                with concerning("vary", name):
                    apply(spec.copy(), Override(name, text))


def _telling(texts: Sequence[str]) -> list[str]:
    """Those of many values that tell whether something is wrong with any of them."""
    distinct = list(dict.fromkeys(texts))
    try:
        numbers = {float(text): text for text in distinct}
    except ValueError:
        return distinct[:MANY]
    broken = next((text for number, text in numbers.items() if not number.is_integer()), distinct[0])
    return list(dict.fromkeys([distinct[0], broken, numbers[min(numbers)], numbers[max(numbers)]]))
