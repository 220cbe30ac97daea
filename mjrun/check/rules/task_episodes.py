"""Faults of a task beyond mistakes in its document: those that random actions reveal."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mjrun.check.finding import Finding
from mjrun.check.rule import Rule
from mjrun.errors import counted, listing, quoted
from mjrun.model.names import names
from mjrun.options.task import CONTROL

if TYPE_CHECKING:  # the rules are loaded for every check, tasks and policies for few
    from mjrun.check.task_checker import NonFiniteOccurrence, TaskEpisodeFaults, TaskPlaces
    from mjrun.task.worlds import TaskWorlds

MISTAKE = Rule("MJ801", "error", "mistake in a task document")
MISFIT = Rule("MJ802", "error", "policy that does not fit its task")
NOT_FINITE = Rule("MJ803", "error", "observation or reward that is not finite")
ENDS_AT_ONCE = Rule("MJ804", "error", "termination at the start of an episode")
BEYOND_RANGE = Rule("MJ805", "note", "action beyond the range of a control")
UNSTABLE = Rule("MJ806", "warning", "episode that becomes unstable")
CONSTANT = Rule("MJ807", "note", "observation that never changes")
CODES = frozenset(rule.code for rule in (NOT_FINITE, ENDS_AT_ONCE, UNSTABLE, CONSTANT))

MEASURED = ("probe", "joints", "value")  # sources of observations that should not be constant
SLACK = 1e-9  # relative to a range


def beyond_ranges(worlds: "TaskWorlds", places: "TaskPlaces") -> Iterator[Finding]:
    """Yields actions that exceed the limits of a control, where MuJoCo clamps them."""
    from mjrun.task.description import control_range

    model, actions = worlds.model(0), worlds.actions
    limits = np.where(actions.squashed, 1.0, np.inf)
    low, high = np.maximum(actions.low, -limits), np.minimum(actions.high, limits)
    ends = np.stack([low * actions.scale + actions.offset, high * actions.scale + actions.offset])
    actuators = names(model, "actuator")

    for index, owned in enumerate(places.numbers_of_actions(worlds)):
        beyond: list[str] = []
        for i in owned:
            actuator = actions.driven[i].actuator(model)
            span = control_range(model, actions.driven[i].control)
            if actions.driven[i].target != CONTROL or span is None or not np.isfinite(ends[:, i]).all():
                continue
            slack = SLACK * (span[1] - span[0])
            reached = ends[:, i].min(), ends[:, i].max()
            if reached[0] < span[0] - slack or reached[1] > span[1] + slack:
                shown = f"{reached[0]:.4g}..{reached[1]:.4g} of {span[0]:.4g}..{span[1]:.4g}"
                beyond.append(f"{actuators[actuator]} ({shown})")
        if beyond:
            message = f"actions exceed the ranges of controls, and MuJoCo clamps them: {listing(beyond)}"
            yield BEYOND_RANGE.finding(message, "lower the scale, or clip", places.at("actions", index))


def episode_findings(episodes: "TaskEpisodeFaults", places: "TaskPlaces") -> Iterator[Finding]:
    """Yields the faults that episodes show."""
    yield from _at_once(episodes, places)
    for fault in episodes.not_finite:
        yield _not_finite(fault, episodes, places)
    if episodes.unstable:
        share = f"{len(episodes.unstable)} of {counted(episodes.count, 'episode')}"
        seeds = listing([str(seed) for seed in episodes.unstable])
        message = f"{share} of {episodes.acting} become unstable: seeds {seeds}"
        remedy = "limit the actions by clip, scale or ctrlrange, or use a smaller timestep"
        yield UNSTABLE.finding(message, remedy, places.at("actions"))
    yield from _constant(episodes, places)


def _at_once(episodes: "TaskEpisodeFaults", places: "TaskPlaces") -> Iterator[Finding]:
    for name, seeds in episodes.ended_at_start.items():
        always = len(seeds) == episodes.count
        which = "every episode" if always else f"{len(seeds)} of {counted(episodes.count, 'episode')}"
        message = f"{quoted(name)} holds at the start of {which}, before the first action"
        remedy = "" if always else f"for example in that of seed {seeds[0]}"
        yield ENDS_AT_ONCE.finding(
            message, remedy, places.at("terminations", name, "when"), severity="" if always else "warning"
        )


def _not_finite(fault: "NonFiniteOccurrence", episodes: "TaskEpisodeFaults", places: "TaskPlaces") -> Finding:
    message = f"{fault.value} {fault.time:.6g} s into the episode of seed {fault.seed}"
    remedy = f"with {episodes.acting}; guard it in the expression: where(isfinite(x), x, 0)"
    if fault.kind == "rewards":
        return NOT_FINITE.finding(message, remedy, places.at("rewards", fault.name, "value"), f"reward '{fault.name}'")
    index = next(i for i, term in enumerate(places.task.observations) if term.name == fault.term)
    return NOT_FINITE.finding(message, remedy, places.at("observations", index), f"observation '{fault.name}'")


def _constant(episodes: "TaskEpisodeFaults", places: "TaskPlaces") -> Iterator[Finding]:
    if episodes.periods < 2 or episodes.unstable:
        return
    for index, term in enumerate(places.task.observations):
        still = [name for name, owner in episodes.constant if owner == term.name]
        if term.source in MEASURED and still:
            message = f"{listing(still)}: the same in all {counted(episodes.count, 'episode')} of {episodes.acting}"
            yield CONSTANT.finding(message, "a policy learns nothing from it", places.at("observations", index))
