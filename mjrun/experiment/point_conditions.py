"""Conditions on the parameters of points: which points a study includes, and where a parameter exists."""

import re
from collections.abc import Sequence

import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, listing, option, quoted
from mjrun.experiment.design_points import ABSENT, Design, DesignColumn, GridPoints, NumberTexts, texts_at
from mjrun.probe.row_expression import parse_condition
from mjrun.probe.scanner import Vocabulary

TEXT_COMPARISON = re.compile(r"""([\w/:.\-]+)\s*(==|!=)\s*(["'])(.*?)\3""")  # integrator == "rk4"


def parameter_names(paths: Sequence[str]) -> dict[str, str]:
    """Returns the paths of parameters by their names: each path, and its last part (`mass`) where that is unique."""
    short = [path.rpartition(".")[2].rpartition("/")[2] for path in paths]
    own = dict(zip(paths, paths, strict=True))
    return {name: path for name, path in zip(short, paths, strict=True) if short.count(name) == 1} | own


class PointCondition:
    """A condition on the parameters of points, such as `mass < 10 and integrator == "rk4"`.

    Attributes:
      parameters: paths of the parameters that it compares.

    Raises:
      UsageError: the condition is malformed, or contains an unknown name.
    """

    def __init__(self, text: str, paths: Sequence[str], label: str) -> None:
        self._names = parameter_names(paths)
        self._flags = dict[str, tuple[str, str]]()  # path and text that each column of a text comparison is about
        rewritten = TEXT_COMPARISON.sub(self._as_flag, text)
        known = {**self._names, **{flag: flag for flag in self._flags}}
        self._condition = parse_condition(rewritten, Vocabulary(known), label)
        self.parameters = {self._flags[name][0] if name in self._flags else name for name in self._condition.columns}

    def holds(self, points: Design) -> np.ndarray:
        """Returns at which points it holds, `(n,)` bool. No comparison holds for a parameter that does not exist.

        Raises:
          UsageError: it compares texts with numbers.
        """
        columns = dict[str, np.ndarray]()
        for name in self._condition.columns:
            path, text = self._flags.get(name, (name, ""))
            column = points.column(points.names.index(path))
            if name in self._flags:
                if text not in column.texts:
                    texts = listing([clean(each) for each in column.texts if each != ABSENT])
                    raise UsageError(f"{quoted(path)} has no value {quoted(text)}; values: {texts}")
                equal = np.array([np.nan if each == ABSENT else float(each == text) for each in column.texts])
                columns[name] = equal[column.places]
            elif (values := column.numbers) is not None:
                columns[name] = values
            else:
                texts = listing([f'"{clean(each)}"' for each in column.distinct[:4]])
                raise UsageError(f"{quoted(path)} has values that are not numbers; compare it with one of {texts}")
        return np.broadcast_to(self._condition.holds(columns), len(points.points))

    def _as_flag(self, comparison: re.Match[str]) -> str:
        """Replaces a comparison with a text by one of a column of ones and zeros, of the same length."""
        name, operator, _, text = comparison.groups()
        if name not in self._names:
            return comparison[0]
        flag = f"_{len(self._flags)}"
        self._flags[flag] = self._names[name], text
        return f"{flag} {operator} 1".ljust(len(comparison[0]))


def with_conditional(whole: Design, conditions: Sequence[tuple[str, str]]) -> Design:
    """Returns the points without each conditional parameter where its condition does not hold; equal points are one.

    Args:
      conditions: parameters, and their conditions on other parameters, which may be conditional, too.

    Raises:
      UsageError: a parameter is unknown, or a condition is invalid.
    """
    if not conditions:
        return whole
    names, waiting = parameter_names(whole.names), dict[str, tuple[str, PointCondition]]()
    for written, text in conditions:
        with concerning("when", written):
            if written not in names:
                raise UnknownNameError("parameter", written, [*names])
            waiting[names[written]] = written, PointCondition(text, whole.names, option("when"))
    columns = [whole.column(number) for number in range(len(whole.names))]
    while waiting:
        ready = [path for path, (_, condition) in waiting.items() if not condition.parameters & waiting.keys()]
        if not ready:
            names_in_cycle = listing([clean(written) for written, _ in waiting.values()])
            raise UsageError(
                f"{option('when')}: the conditions of these parameters depend on themselves: {names_in_cycle}"
            )
        for path in ready:
            written, condition = waiting.pop(path)
            with concerning("when", written):
                exists = condition.holds(_of_columns(whole.names, columns))
            number = whole.names.index(path)
            columns[number] = _present_where(columns[number], exists)
    _, first = np.unique(np.stack([column.places for column in columns], axis=1), axis=0, return_index=True)
    kept = np.sort(first)
    return _of_columns(whole.names, [DesignColumn(column.texts, column.places[kept]) for column in columns])


def chosen(whole: Design, conditions: Sequence[str]) -> Design:
    """Returns the points for which all conditions hold.

    Raises:
      UsageError: a condition is invalid, or there are no such points.
    """
    if not conditions:
        return whole
    is_chosen = np.ones(len(whole.points), bool)
    for index, text in enumerate(conditions):
        with concerning("where", index):
            is_chosen &= PointCondition(text, whole.names, option("where")).holds(whole)
    if not is_chosen.any():
        raise UsageError(f"{option('where')}: none of the {len(whole.points)} points satisfies it")
    return Design(whole.names, whole.grid.only(np.flatnonzero(is_chosen)))


def _present_where(column: DesignColumn, exists: np.ndarray) -> DesignColumn:
    """Returns a parameter that is absent at the other points."""
    texts = column.texts
    if isinstance(texts, NumberTexts):
        texts = NumberTexts(np.append(texts.numbers, np.nan), has_integers=texts.has_integers)
    else:
        texts = [*texts, ABSENT]
    return DesignColumn(texts, np.where(exists, column.places, len(column.texts)))


def _of_columns(names: Sequence[str], columns: Sequence[DesignColumn]) -> Design:
    values = [
        (each.texts.only(each.places) if isinstance(each.texts, NumberTexts) else texts_at(each.texts, each.places), 1)
        for each in columns
    ]
    return Design(tuple(names), GridPoints(values, len(columns[0].places)))
