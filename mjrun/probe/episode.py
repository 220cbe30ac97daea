"""What can be measured where a policy acts: `obs/…`, `action/…`, `reward/…` and `return`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import UsageError, option, quoted
from mjrun.model.column import Column

OBSERVATION, ACTION, REWARD, RETURN = EPISODE_GROUPS = ("obs", "action", "reward", "return")
TOTAL = f"{REWARD}/total"


@dataclass(frozen=True)
class EpisodeValues:
    """What holds from a control instant until the next; arrays are not written to.

    Attributes:
      observation: `(nobs,)`, as the policy saw it.
      action: `(nact,)`, what the policy answered, before scale and clip; it is in force until the next instant. Where
        the episode has ended nobody was asked: the action that led here.
      reward: for the control period that ended here; 0 at the start.
      reward_terms: `(nterms,)`, weighted; zeros at the start. Their sum is the reward, except where an environment of
        others does not tell all.
      total: of all rewards so far, which is the return once the episode has ended.
    """

    observation: np.ndarray
    action: np.ndarray
    reward: float
    reward_terms: np.ndarray
    total: float


@dataclass(frozen=True)
class EpisodeProbe:
    """Columns that belong to an episode, and not to the model.

    Attributes:
      columns: in order.
      read: from what holds at a control instant to `(len(columns),)`.
    """

    columns: Sequence[Column]
    read: Callable[[EpisodeValues], np.ndarray]

    def only(self, indices: Sequence[int]) -> "EpisodeProbe":
        """The probe with only these of its columns."""
        index, read = np.array(indices, int), self.read
        return EpisodeProbe([self.columns[i] for i in indices], lambda values: read(values)[index])


class EpisodeColumns:
    """The columns of an episode.

    Args:
      observations: names of the numbers that the policy observes, with their units.
      actions: names of those that it answers.
      rewards: names of the terms of the reward.

    Attributes:
      probes: by name.
    """

    def __init__(self, observations: Mapping[str, str], actions: Sequence[str], rewards: Sequence[str]) -> None:
        seen = [Column(f"{OBSERVATION}/{name}", unit, "observed by the policy") for name, unit in observations.items()]
        acted = [Column(f"{ACTION}/{name}", "", "what the policy answers, before scale and clip") for name in actions]
        terms = [Column(f"{REWARD}/{name}", "", "weighted term of the reward") for name in rewards]
        total = [Column(TOTAL, "", "reward of the control period that ended last")] if "total" not in rewards else []
        count = len(terms) + len(total)
        self.probes: Mapping[str, EpisodeProbe] = {
            OBSERVATION: EpisodeProbe(seen, lambda values: values.observation),
            ACTION: EpisodeProbe(acted, lambda values: values.action),
            REWARD: EpisodeProbe(
                [*terms, *total], lambda values: np.append(values.reward_terms, values.reward)[:count]
            ),
            RETURN: EpisodeProbe(
                [Column(RETURN, "", "sum of all rewards so far")], lambda values: np.array([values.total])
            ),
        }

    @property
    def columns(self) -> list[Column]:
        """All of them."""
        return [column for probe in self.probes.values() for column in probe.columns]

    @property
    def names(self) -> list[str]:
        """Their names."""
        return [column.name for column in self.columns]


def within_task(name: str) -> UsageError:
    """The error that a task itself asks for `name`, which follows from it."""
    return UsageError(
        f"{quoted(name)} follows from the task, which therefore cannot use it\n"
        "what a task can use: the columns of the model, and in expressions action/NAME and command/NAME"
    )


def no_episode(name: str) -> UsageError:
    """The error that `name`, of an episode, is asked for where no policy acts."""
    return UsageError(f"{quoted(name)} can be measured where a policy acts only: give a {option('policy')}")
