"""One simulation of a study: the base simulation, with the values of a point."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.job.simulation import Simulation
from mjrun.options.kinds import AnyKind, ExpectedError, Numbers
from mjrun.options.option import options_of
from mjrun.options.simulation import SimulationOptions

BY_NAME = ("qpos", "qvel", "ctrl")  # written `qpos/hip`
# Options of a simulation that may vary as a whole.
WHOLE = ("timestep", "integrator", "key", "perturb", "seed", "ctrl_noise", "ctrl_noise_time", "ctrl_from")
WHOLE += ("ctrl_interpolation", "duration", "steps", "control_dt", "push")
MODEL, CONTROLLER = "model", "controller"
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
        group, slash, rest = name.partition("/")
        if name == MODEL:
            changes[name] = text
        elif name == CONTROLLER:
            if text not in controllers:
                message = f"{option('vary')} controller: {clean(text)}: only the command line and Python may name code"
                raise UsageError(message)
            changes[name] = controllers[text]
        elif slash and group in BY_NAME:
            entries = changes.setdefault(group, dict(_by_name(base)[group]))
            assert isinstance(entries, dict)
            named: Any = _value(name, f"{rest}={text}", group)
            entries |= dict([named])
        elif name in WHOLE:
            changes[name] = _value(name, text, name)
        elif "." in name:
            overrides.append((name, text))
        else:
            valid = [*WHOLE, MODEL, CONTROLLER, *(f"{each}/NAME" for each in BY_NAME), "opt.FIELD", "KIND/NAME.FIELD"]
            with concerning("vary", name):
                raise UnknownNameError("parameter", name, valid, where=option("vary"))
    if overrides:
        changes["set"] = (*base.set, *overrides)
    return replace(base, **changes) if changes else base


def _by_name(base: Simulation) -> dict[str, Mapping[str, Numbers]]:
    return {"qpos": base.qpos, "qvel": base.qvel, "ctrl": base.ctrl}


def _value(name: str, text: str, of: str) -> object:
    """The value of the option `of` that `text` writes on a command line."""
    try:
        return _kinds()[of].parse(text)
    except ExpectedError as error:
        with concerning("vary", name):
            raise BadValueError(f"{option('vary')} {clean(name)}", text, error.expected) from None


@cache
def _kinds() -> dict[str, AnyKind]:
    return {each.name: each.kind for each in options_of(SimulationOptions)}
