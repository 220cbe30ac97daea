"""Values of parameters that change nothing, since the simulation that points vary has them already.

Points are identified without them: a study keeps its points when it gains or loses a parameter with such a value.
"""

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from mjrun.errors import MjrunError
from mjrun.experiment.design import SHORT_PATHS, Design
from mjrun.experiment.design_points import numbers
from mjrun.model import state
from mjrun.model.override import Override, changes_nothing, source_values
from mjrun.simulation.simulation import Simulation
from mjrun.study.spec import BY_NAME, MODEL, StudySpec, is_path, simulation_at

NEUTRAL = {"scale": 1.0, "add": 0.0}  # relative values that change nothing
MOST = 64  # values that are tried one by one
# Kinds of elements, and settings, on which initial states do not depend.
NOT_IN_STARTS = ("geom", "site", "camera", "light", "material", "actuator", "sensor", "tendon", "pair", "opt", "vis")


def own_values(
    points: Design, spec: StudySpec, source: mujoco.MjSpec | None, model: mujoco.MjModel
) -> Mapping[int, frozenset[str]]:
    """Returns the values of parameters, by their places, that change nothing at any point.

    Args:
      source: specification of the base model; None for a compiled model.
      model: base model.
    """
    if spec.product:  # whose parameters include settings of cameras
        return {}
    names = [SHORT_PATHS.get(name, name) for name in points.names]
    found = dict[int, frozenset[str]]()
    for index, name in enumerate(names):
        others, distinct = [*names[:index], *names[index + 1 :]], points.distinct(index)
        if not is_path(name):
            found[index] = frozenset(_of_simulation(name, distinct, others, spec, model))
        elif source and MODEL not in others and not any(_share_a_field(name, other) for other in others):
            found[index] = frozenset(_of_model(name, distinct, source))
    return {index: texts for index, texts in found.items() if texts}


def _of_model(path: str, distinct: Sequence[str], source: mujoco.MjSpec) -> Iterator[str]:
    """Yields the values that change nothing in the source of the model."""
    operation = Override(path, "").operation
    try:
        present = np.array([NEUTRAL[operation]]) if operation else source_values(source, Override(path, ""))
    except MjrunError:  # texts, or several numbers
        present = None
    for text in _candidates(distinct, present):
        try:
            if changes_nothing(source, Override(path, text)):
                yield text
        except MjrunError:  # the point will fail with this error
            continue


def _of_simulation(
    name: str, distinct: Sequence[str], others: Sequence[str], spec: StudySpec, model: mujoco.MjModel
) -> Iterator[str]:
    """Yields the values that change no option, or neither the initial state nor the length."""
    base, group = spec.base, name.partition("/")[0]
    by_start = group == "key" or group in BY_NAME
    if group in BY_NAME and any(_share_an_entry(name, other) for other in others):
        return
    by_start &= base.replay is base.ctrl_from is base.policy is base.position_control is None
    by_start &= not any(other in (MODEL, "key") or _moves_starts(other) for other in others)
    by_length = group == "duration" and base.replay is base.policy is None and MODEL not in others
    value = getattr(base, group)
    is_number = isinstance(value, int | float) and not by_length
    for text in _candidates(distinct, np.array([value], float) if is_number else None):
        try:
            varied = simulation_at(base, (name,), (text,), dict(spec.controllers))
            is_same = getattr(varied, group) == value
            is_same |= by_start and _start(varied, model) == _start(base, model)
            is_same |= by_length and varied.timeline(model) == base.timeline(model)
        except MjrunError:  # the point will fail with this error
            continue
        if is_same:
            yield text


def _candidates(distinct: Sequence[str], present: np.ndarray | None) -> Sequence[str]:
    """Returns the values that may be among the present numbers; without these, all values unless they are many."""
    values = None if present is None else numbers(distinct)
    if present is None or values is None:
        return distinct if len(distinct) <= MOST else []
    return [distinct[int(place)] for place in np.flatnonzero(np.isin(values, present))[:MOST]]


def _start(simulation: Simulation, model: mujoco.MjModel) -> bytes:
    return state.save(model, simulation.initial_data(model)).tobytes()


def _moves_starts(name: str) -> bool:
    kind = Override(name, "").target.partition(".")[0].partition("/")[0]
    return is_path(name) and kind not in NOT_IN_STARTS


def _share_a_field(one: str, other: str) -> bool:
    """Returns whether two paths may change the same number."""
    paths = [Override(path, "") for path in (one, other)]
    (owner, _, field), (other_owner, _, other_field) = (path.target.rpartition(".") for path in paths)
    indices = [path.index for path in paths]
    if not is_path(other) or field != other_field or (None not in indices and indices[0] != indices[1]):
        return False
    return owner == other_owner or any(_is_open(each) for each in (owner, other_owner))


def _share_an_entry(one: str, other: str) -> bool:
    """Returns whether two parameters such as `qpos/root` and `qpos/root/z` may change the same number."""
    if one.partition("/")[0] != other.partition("/")[0]:
        return False
    return f"{one}/".startswith(f"{other}/") or f"{other}/".startswith(f"{one}/") or _is_open(one) or _is_open(other)


def _is_open(name: str) -> bool:
    """Returns whether a name may match several objects, or one by its index."""
    return bool(set(name) & set("*?[:")) or name.rpartition("/")[2].isdigit()
