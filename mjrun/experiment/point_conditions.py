"""Conditions on the parameters of points: which points a study includes, and where a parameter exists."""

from collections.abc import Sequence

import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, listing, option, quoted
from mjrun.experiment.design_points import ABSENT, Design, DesignColumn, GridPoints, NumberTexts, texts_at
from mjrun.probe.expression import TextMatch, walk
from mjrun.probe.row_expression import parse_condition
from mjrun.probe.scanner import Vocabulary


def parameter_names(paths: Sequence[str]) -> dict[str, str]:
    """Returns the paths of parameters by their names: each path, and its last part (`mass`) where that is unique."""
    short = [path.rpartition(".")[2].rpartition("/")[2] for path in paths]
    own = dict(zip(paths, paths, strict=True))
    return {name: path for name, path in zip(short, paths, strict=True) if short.count(name) == 1} | own


class PointVocabulary(Vocabulary):
    """The parameters of points, whose values may be texts."""

    has_texts = True


class PointCondition:
    """A condition on the parameters of points, such as `mass < 10 and integrator == "rk4"`.

    Attributes:
      parameters: paths of the parameters that it compares.

    Raises:
      UsageError: the condition is malformed, or contains an unknown name.
    """

    def __init__(self, text: str, paths: Sequence[str], label: str) -> None:
        self._condition = parse_condition(text, PointVocabulary(parameter_names(paths)), label)
        nodes = [*walk(self._condition.root)]
        self._matches = [node for node in nodes if isinstance(node, TextMatch)]
        self.parameters = {*self._condition.columns, *(match.name for match in self._matches)}

    def holds(self, points: Design) -> np.ndarray:
        """Returns at which points it holds, `(n,)` bool. No comparison holds for a parameter that does not exist.

        Raises:
          UsageError: it compares texts with numbers.
        """
        columns = dict[str, np.ndarray]()
        for path in self._condition.columns:
            column = points.column(points.names.index(path))
            if (values := column.numbers) is None:
                texts = listing([f'"{clean(each)}"' for each in column.distinct[:4]])
                raise UsageError(f"{quoted(path)} has values that are not numbers; compare it with one of {texts}")
            columns[path] = values
        known = {match: _matched(match, points.column(points.names.index(match.name))) for match in self._matches}
        return np.broadcast_to(self._condition.holds(columns, known), len(points.points))


def _matched(match: TextMatch, column: DesignColumn) -> np.ndarray:
    """Returns the values of a match `(n,)`."""
    if match.text not in column.texts:
        texts = listing([clean(each) for each in column.texts if each != ABSENT])
        raise UsageError(f"{quoted(match.name)} has no value {quoted(match.text)}; values: {texts}")
    equal = np.array([np.nan if each == ABSENT else float(each == match.text) for each in column.texts])
    return equal[column.places]


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
