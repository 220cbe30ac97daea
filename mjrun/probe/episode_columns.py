"""Columns of episodes, in which a policy acts: `obs/…`, `action/…`, `reward/…` and `return`."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, option, quoted
from mjrun.model.table_column import Column

OBSERVATION, ACTION, REWARD, RETURN = EPISODE_GROUPS = ("obs", "action", "reward", "return")
TOTAL = f"{REWARD}/total"


@dataclass(frozen=True)
class EpisodeValues:
    """The values from a control instant until the next; arrays are not modified.

    Attributes:
      observation: observation of the policy, `(nobs,)`.
      action: action of the policy, before scale and clip, `(nact,)`, applied until the next instant. At the end of an
        episode, the action that led there.
      reward: reward for the control period that ended here; 0 at the start.
      reward_terms: weighted terms of the reward, `(nterms,)`; zeros at the start. Their sum is the reward, unless an
        external environment reports only some of them.
      total: sum of all rewards so far, which is the return once the episode has ended.
    """

    observation: np.ndarray
    action: np.ndarray
    reward: float
    reward_terms: np.ndarray
    total: float


@dataclass(frozen=True)
class EpisodeProbe:
    """A probe of columns of an episode, in contrast to those of the model.

    Attributes:
      columns: columns in order.
      read: returns their values `(len(columns),)` at a control instant.
    """

    columns: Sequence[Column]
    read: Callable[[EpisodeValues], np.ndarray]

    def only(self, indices: Sequence[int]) -> "EpisodeProbe":
        """Returns the probe with only these of its columns."""
        index, read = np.array(indices, int), self.read
        return EpisodeProbe([self.columns[i] for i in indices], lambda values: read(values)[index])


class EpisodeColumns:
    """The columns of an episode.

    Args:
      observations: names of the observed numbers, with their units.
      actions: names of the numbers of an action.
      rewards: names of the terms of the reward.

    Attributes:
      probes: probes by name.
    """

    def __init__(self, observations: Mapping[str, str], actions: Sequence[str], rewards: Sequence[str]) -> None:
        seen = [Column(f"{OBSERVATION}/{name}", unit, "observed by the policy") for name, unit in observations.items()]
        acted = [Column(f"{ACTION}/{name}", "", "action of the policy, before scale and clip") for name in actions]
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
        """All columns."""
        return [column for probe in self.probes.values() for column in probe.columns]

    @property
    def names(self) -> list[str]:
        """The names of all columns."""
        return [column.name for column in self.columns]


def within_task(name: str) -> UsageError:
    """Returns the error of a task that uses `name`, which is derived from it."""
    return UsageError(
        f"{quoted(name)} is derived from the task, which therefore cannot use it\n"
        "a task can use: the columns of the model, and in expressions action/NAME and command/NAME"
    )


def no_episode(name: str) -> UsageError:
    """Returns the error of `name`, a column of episodes, in a simulation without a policy."""
    return UsageError(f"{quoted(name)} can only be measured if a policy acts: set {option('policy')}")
