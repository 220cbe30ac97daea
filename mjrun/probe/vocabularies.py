"""Names in expressions over models and tables, and the columns of `xpos(top).z` and `contact(ball, floor)`."""

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property

import mujoco

from mjrun.errors import UnknownNameError, UsageError, clean, listing, option, quoted
from mjrun.probe.contacts import identify_party, pair
from mjrun.probe.episode_columns import EPISODE_GROUPS, no_episode
from mjrun.probe.scanner import ProbeReference, SourceText, Token, Vocabulary, spelled
from mjrun.probe.select import PAIRS, TIME, aliases, available_columns, joints_of, object_of

_GROUP = re.compile(r"(\w+)/")  # at the beginning of a name


class ModelVocabulary(Vocabulary):
    """Every column that can be measured of `model`, by each of its names, `time`, and `others`.

    The columns of a group are listed when a name of it is looked up: those of all take a while.
    """

    beginnings = (f"{PAIRS}/",)

    def __init__(self, model: mujoco.MjModel, others: Iterable[str] = ()) -> None:
        self._model, self._others = model, tuple(others)
        self._parts: dict[str, Vocabulary] = {}

    @cached_property
    def columns(self) -> Mapping[str, str]:
        own = {column.name: column.name for column in available_columns(self._model)}
        own |= {name: name for name in self._others}
        # A column's own name comes first in lists, and is never another's alias.
        return {TIME: TIME, **own, **aliases(self._model), **own}

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(name.partition("/")[0] for name in self.names) - {TIME}

    def is_group(self, name: str) -> bool:
        return name != TIME and (name in self._part("").names or bool(self._part(name).names))

    def ends(self, text: str, start: int) -> Iterator[int]:
        if group := _GROUP.match(text, start):
            yield from self._part(group[1]).ends(text, start)
        yield from self._part("").ends(text, start)

    def column(self, name: str) -> str | None:
        column_name = self._listed(name)
        if column_name is None and name.startswith(self.beginnings):
            return None if self._unpaired(name) else name
        return column_name

    def is_pair(self, name: str) -> bool:
        """Returns whether `name` is a column `contact/A/B`."""
        return name.startswith(self.beginnings) and self.column(name) == name

    def _listed(self, name: str) -> str | None:
        return self._part(_group(name)).column(name)

    def _part(self, group: str) -> Vocabulary:
        """Returns the columns of a group; those without one if it is empty."""
        if group not in self._parts:
            own = [column.name for column in available_columns(self._model, groups={group})]
            own += [name for name in (TIME, *self._others) if _group(name) == group]
            self._parts[group] = Vocabulary(aliases(self._model, {group}) | {name: name for name in own})
        return self._parts[group]

    def is_count(self, column: str) -> bool:
        return column.startswith(self.beginnings)

    def missing(self, name: str, position: int, source: SourceText) -> UsageError:
        if name.partition("/")[0] in {*EPISODE_GROUPS} - self.groups:
            return no_episode(name)
        error = self._unpaired(name) if name.startswith(self.beginnings) and name.count("/") > 1 else None
        if error:
            return source.unknown(position, "object", error.name, error.valid, meant=error.meant)
        return super().missing(name, position, source)

    def accessed(self, accessor: ProbeReference, source: SourceText) -> str:
        group, objects, component = accessor.group, accessor.objects, accessor.component
        if group.text == PAIRS and len(objects) == 2:
            return self._touching(objects, component, source)
        if len(objects) > 1:
            valid = "two" if group.text == PAIRS else "one"
            raise source.fault(group.start, f"{group.text} of {len(objects)} objects", f"{group.text} of {valid}")
        name = "/".join([group.text, *(token.text for token in objects)])
        column = self._listed(name + component.text.replace(".", "/"))
        if column is None:
            raise self._misread(accessor, source)
        return column

    def _unpaired(self, name: str) -> UnknownNameError | None:
        """Returns the error of `contact/A/B`; None if it can be measured."""
        try:
            pair(name.partition("/")[2], self._model)
        except UnknownNameError as error:
            return error
        return None

    def _touching(self, objects: tuple[Token, ...], component: Token, source: SourceText) -> str:
        for token in objects:
            try:
                identify_party(token.text, self._model)
            except UnknownNameError as error:
                raise source.unknown(token.start, "object", error.name, error.valid, meant=error.meant) from None
        name = "/".join([PAIRS, *(token.text for token in objects)])
        if component.text:
            raise _plain(name, component, source)
        pair(name.partition("/")[2], self._model)  # which raises an error if it can be read in two ways
        return name

    def _misread(self, accessor: ProbeReference, source: SourceText) -> UsageError:
        """Returns the error of an accessor of one object."""
        group, token, component = accessor.group, accessor.objects[0], accessor.component
        name = f"{group.text}/{token.text}"
        parts = [known.removeprefix(f"{name}/") for known in self.names if known.startswith(f"{name}/")]
        if component.text and self._listed(name) is not None:
            return _plain(name, component, source)
        if component.text and parts:
            return source.unknown(component.start + 1, "component", component.text[1:], _dotted(parts))
        if parts:
            written = clean(source.text[group.start : component.end])
            reason = f"{written}, which has several components"
            return source.fault(group.start, reason, f"one of {listing([f'.{part}' for part in _dotted(parts)])}")
        if group.text == PAIRS:
            return source.fault(group.start, f"{PAIRS} of one object", f"{PAIRS} of two")
        known = dict.fromkeys(object_of(name) for name in self.names if name.startswith(f"{group.text}/"))
        meant = joints_of(self._model, token.text, known)
        return source.unknown(token.start, "object", token.text, list(known), meant=meant)


class TraceVocabulary(Vocabulary):
    """The columns of a table that measures `model`, and `others`. Messages explain how to add other columns."""

    def __init__(self, columns: Sequence[str], model: mujoco.MjModel, others: Iterable[str] = ()) -> None:
        super().__init__(columns)
        self._offer = ModelVocabulary(model, others)

    @property
    def groups(self) -> frozenset[str]:
        return self._offer.groups

    def is_group(self, name: str) -> bool:
        return self._offer.is_group(name)

    def missing(self, name: str, position: int, source: SourceText) -> UsageError:
        column = self._offer.column(name)
        if column is None:
            return super().missing(name, position, source)
        if column in self.names:
            return source.fault(position, quoted(name), f"the column's own name, {clean(spelled(column))}")
        place, probe = clean(source.place(position)), shlex.quote(clean(column))
        return UsageError(f"no column {quoted(name)} in {place}\nthe model offers it: add {option('probe')} {probe}")

    def accessed(self, accessor: ProbeReference, source: SourceText) -> str:
        column = self._offer.accessed(accessor, source)
        if self.column(column) is None:
            raise self.missing(column, accessor.group.start, source)
        return column


class TableVocabulary(Vocabulary):
    """The columns of a table, by their own names and as `group(object).component`."""

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(name.partition("/")[0] for name in self.names if "/" in name)

    def is_count(self, column: str) -> bool:
        return column.startswith(f"{PAIRS}/")

    def accessed(self, accessor: ProbeReference, source: SourceText) -> str:
        objects = "/".join(token.text for token in accessor.objects)
        name = f"{accessor.group.text}/{objects}" + accessor.component.text.replace(".", "/")
        if self.column(name) is None:
            raise self.missing(name, accessor.group.start, source)
        return name


def _group(name: str) -> str:
    """Returns the group of a column; an empty text for `time` and others without one."""
    group, slash, _ = name.partition("/")
    return group if slash else ""


def _plain(name: str, component: Token, source: SourceText) -> UsageError:
    return source.fault(component.start, f"component {clean(component.text)}", f"none, {clean(name)} is one number")


def _dotted(parts: list[str]) -> list[str]:
    return [part.replace("/", ".") for part in parts]
