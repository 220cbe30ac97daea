"""What is required of an evaluation, checked for its names before it runs and for its truth after."""

from collections.abc import Sequence

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.episode import OUTCOMES
from mjrun.evaluation.result import Comparison, EpisodeSummary
from mjrun.evaluation.table import DIFFERENCE, LENGTH, RETURN, SUCCESS, measures
from mjrun.experiment.results_table import Requirements, ResultsTable
from mjrun.options.evaluation import EvaluationOptions
from mjrun.probe.verdict import Verdict

LOW = "_low"  # after a name: the lower end of its interval


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
        self._flags = [name for name in dict.fromkeys([*OUTCOMES, *endings]) if name not in numbers]
        self._requirements = Requirements(options.require, numbers, self._flags)

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
        self, table: ResultsTable, count: int, summary: EpisodeSummary, comparison: Comparison | None
    ) -> list[Verdict]:
        """Returns whether each requirement holds.

        Args:
          table: of the episodes, of which the first `count` are those of the policy itself.
        """
        endings = [flag for flag in self._flags if flag not in OUTCOMES]
        outcomes = [flag for flag in self._flags if flag in OUTCOMES]
        columns = {**table.flags("ending", endings), **table.flags("outcome", outcomes), **table.numbers}
        verdicts = self._requirements.verdicts({name: values[:count] for name, values in columns.items()})
        made = measures(summary, comparison)
        known = {name: each.value for name, each in made.items()}
        known |= {name + LOW: each.interval.low for name, each in made.items()}
        return verdicts + [_threshold(name, least, known.get(name), count) for name, least in self._thresholds.items()]


def _threshold(name: str, least: float, value: float | None, rows: int) -> Verdict:
    text = f"{name} >= {least:g}"
    if value is None:
        return Verdict(text, False, f"{clean(text)}: there are too few episodes to have one", rows)
    return Verdict(text, value >= least, f"{clean(text)}: it is {value:.6g}", rows)
