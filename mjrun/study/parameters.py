"""One simulation of a study: the base simulation, with the values of a point."""

from dataclasses import replace
from functools import cache

from mjrun.errors import BadValueError, UnknownNameError, clean, option
from mjrun.job.simulation import Simulation
from mjrun.options.kinds import AnyKind, ExpectedError
from mjrun.options.option import options_of
from mjrun.options.simulation import SimulationOptions

BY_NAME = ("qpos", "qvel", "ctrl")  # written `qpos/hip`
# Options of a simulation that may vary as a whole.
WHOLE = ("timestep", "integrator", "key", "perturb", "seed", "ctrl_noise", "ctrl_noise_time", "ctrl_from")
WHOLE += ("ctrl_interpolation", "duration", "steps", "control_dt", "push")
MODEL = "model"


def simulation_at(base: Simulation, names: tuple[str, ...], values: tuple[str, ...]) -> Simulation:
    """The simulation of the point at which `names` have `values`.

    Raises:
      UsageError: a name that nothing has, or a value that cannot be.
    """
    simulation = base
    overrides: list[tuple[str, str]] = []
    for name, text in zip(names, values, strict=True):
        group, slash, rest = name.partition("/")
        if name == MODEL:
            simulation = replace(simulation, model=text)
        elif slash and group in BY_NAME:
            simulation = _with_entry(simulation, group, rest, text)
        elif name in WHOLE:
            simulation = replace(simulation, **{name: _value(name, text)})
        elif "." in name:
            overrides.append((name, text))
        else:
            valid = [*WHOLE, MODEL, *(f"{each}/NAME" for each in BY_NAME), "opt.FIELD", "KIND/NAME.FIELD"]
            raise UnknownNameError("parameter", name, valid, where=option("vary"))
    return replace(simulation, set=(*simulation.set, *overrides)) if overrides else simulation


def _with_entry(simulation: Simulation, group: str, name: str, text: str) -> Simulation:
    entries = {"qpos": simulation.qpos, "qvel": simulation.qvel, "ctrl": simulation.ctrl}[group]
    parsed = _value(group, f"{name}={text}")
    return replace(simulation, **{group: {**entries, **dict([parsed])}})


def _value(name: str, text: str) -> object:
    """The value of an option that `text` writes on a command line."""
    try:
        return _kinds()[name].parse(text)
    except ExpectedError as error:
        raise BadValueError(f"{option('vary')} {clean(name)}", text, error.expected) from None


@cache
def _kinds() -> dict[str, AnyKind]:
    return {each.name: each.kind for each in options_of(SimulationOptions)}
