"""What is required of an evaluation, checked for its names before it runs and for its truth after."""

from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.comparison import Comparison
from mjrun.evaluation.statistics import NumberSummary
from mjrun.evaluation.summary import EpisodeSummary
from mjrun.evaluation.table import OUTCOMES
from mjrun.model.column import Column
from mjrun.options.evaluation import EvaluationOptions
from mjrun.probe.assertion import parse
from mjrun.probe.scanner import Vocabulary
from mjrun.probe.verdict import Verdict

LOW = "_low"  # after a name: the lower end of its interval
SUCCESS, RETURN, LENGTH, DIFFERENCE = "success", "return", "length", "_difference"


class Criteria:
    """What `options` require of the episodes.

    Args:
      numbers: the names of the columns of numbers that the table of episodes will have.
      endings: the names that endings can have; each is a column of ones and zeros, as each outcome is.
      can_succeed: whether a termination of the task is a success.
      compared: whether there is another policy.

    Raises:
      UsageError: a requirement is not well formed, or names nothing.
    """

    def __init__(
        self,
        options: EvaluationOptions,
        numbers: Sequence[str],
        endings: Sequence[str],
        *,
        can_succeed: bool,
        compared: bool,
    ) -> None:
        flags = [name for name in dict.fromkeys([*OUTCOMES, *endings]) if name not in numbers]
        names = EpisodeNames(numbers, flags)
        self._flags, self._numbers = flags, [*numbers]
        self._assertions = []
        for index, text in enumerate(options.require):
            with concerning("require", index):
                self._assertions.append(parse(text, names, "require"))

        self._thresholds = {name: least for name, (least,) in options.fail_below.items()}
        means = [RETURN, LENGTH, *(name for name, _ in options.metric), *([SUCCESS] if can_succeed else [])]
        differences = [f"{name}{DIFFERENCE}" for name in (RETURN, SUCCESS) if compared and name in means]
        valid = [name + end for name in [*means, *differences] for end in ("", LOW)]
        for name in self._thresholds:
            with concerning("fail_below", name):
                if name == SUCCESS and not can_succeed:
                    raise UsageError(f"{option('fail_below')} {name}: no termination of the task is a success")
                if name not in valid:
                    raise UnknownNameError("number", name, valid, where=option("fail_below"))

    def verdicts(
        self,
        columns: Sequence[Column],
        rows: np.ndarray,
        summary: EpisodeSummary,
        comparison: Comparison | None,
    ) -> list[Verdict]:
        """Whether each requirement holds.

        Args:
          columns, rows: the table of the policy's own episodes.
        """
        table = self._table(columns, rows)
        verdicts: list[Verdict] = []
        for assertion in self._assertions:
            checker = assertion.checker()
            checker.feed(table, 0)
            verdicts.append(checker.verdict())
        known = _numbers(summary, comparison)
        thresholds = [_threshold(name, least, known.get(name), len(rows)) for name, least in self._thresholds.items()]
        return [*verdicts, *thresholds]

    def _table(self, columns: Sequence[Column], rows: np.ndarray) -> np.ndarray:
        """The numbers, and a column of ones and zeros for each way in which an episode can end."""
        place = {column.name: index for index, column in enumerate(columns)}
        parts = [rows[:, place[name]] for name in self._numbers]
        for flag in self._flags:
            column = "outcome" if flag in OUTCOMES else "ending"
            labels = columns[place[column]].labels
            is_so = rows[:, place[column]] == labels.index(flag) if flag in labels else np.zeros(len(rows))
            parts.append(is_so.astype(float))
        return np.stack(parts, axis=1)


class EpisodeNames(Vocabulary):
    """The columns of the table of episodes, and each ending as what is so or is not: `share(fallen) < 0.1`."""

    def __init__(self, numbers: Sequence[str], flags: Sequence[str]) -> None:
        super().__init__([*numbers, *flags])
        self._flags = {*flags}

    def is_count(self, column: str) -> bool:
        return column in self._flags


def _numbers(summary: EpisodeSummary, comparison: Comparison | None) -> dict[str, float | None]:
    """What thresholds can be set for; None for what has no value."""
    means: Mapping[str, NumberSummary] = {RETURN: summary.returns, LENGTH: summary.lengths, **summary.metrics}
    known = {name: each.mean for name, each in means.items()}
    known |= {name + LOW: each.mean_interval.low for name, each in means.items()}
    if summary.success:
        known |= {SUCCESS: summary.success.share, SUCCESS + LOW: summary.success.interval.low}
    if comparison:
        for name, each in ((RETURN, comparison.returns), (SUCCESS, comparison.success)):
            if each:
                known |= {name + DIFFERENCE: each.difference, name + DIFFERENCE + LOW: each.interval.low}
    return known


def _threshold(name: str, least: float, value: float | None, rows: int) -> Verdict:
    text = f"{name} >= {least:g}"
    if value is None:
        return Verdict(text, False, f"{clean(text)}: there are too few episodes to have one", rows)
    return Verdict(text, value >= least, f"{clean(text)}: it is {value:.6g}", rows)
