"""Which object of one compiled model is which of another.

Objects of a kind are matched by name, wherever they are. Those that have no name in one of the models, or whose name
the other does not have, are compared within their parent body (within the model, for kinds without one), in order:
what is equal is matched, so that a renamed object is still the same; between these, unnamed objects of one type that
refer to the same are, and then unnamed objects one after the other.
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from mjrun.diff.sequence_alignment import equal_blocks
from mjrun.model.fields import ModelField, array, as_rows, model_fields, referred_kinds
from mjrun.model.names import COUNTS, KIND_OF, KINDS

BODY = "body"
# Kinds whose objects belong to a body, by the field that says to which.
PARENTS = {
    BODY: "body_parentid", "joint": "jnt_bodyid", "geom": "geom_bodyid", "site": "site_bodyid", "camera": "cam_bodyid",
    "light": "light_bodyid",
}  # fmt: skip
Pair = tuple[int, int]


class ModelObjects:
    """The objects of a compiled model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._keys: dict[tuple[str, bool], list[Hashable]] = {}

    @cached_property
    def names(self) -> dict[str, list[str]]:
        """The names of the objects of each kind, by id; empty for those without one."""
        return {
            kind: [mujoco.mj_id2name(self.model, obj, i) or "" for i in range(getattr(self.model, COUNTS[kind]))]
            for kind, obj in KINDS.items()
        }

    def label(self, kind: str, index: int) -> str:
        """The name of an object, `geom:3` if it has none."""
        return self.names[kind][index] or f"{kind}:{index}"

    def referred(self, obj: int, index: int) -> str:
        """The name of what an id of the type `obj` refers to; `none` of −1."""
        kind = KIND_OF[obj]
        return self.label(kind, index) if 0 <= index < len(self.names[kind]) else "none"

    def parents(self, kind: str) -> np.ndarray:
        """The body of each object; 0 for kinds that belong to none."""
        if kind not in PARENTS:
            return np.zeros(len(self.names[kind]), int)
        parents = array(self.model, PARENTS[kind]).astype(int)
        if kind == BODY:
            parents[0] = -1  # the world has none
        return parents

    def keys(self, kind: str, *, whole: bool) -> list[Hashable]:
        """What each object of a kind is compared by: all that it is, or only its types and what it refers to."""
        if (kind, whole) not in self._keys:
            fields = [f for f in model_fields() if f.rows == COUNTS[kind] and not f.computed]
            columns = [self._column(f) for f in fields if f.name != PARENTS.get(kind) and (whole or self._is_coarse(f))]
            self._keys[kind, whole] = [*zip(*columns, strict=True)] if columns else [()] * len(self.names[kind])
        return self._keys[kind, whole]

    def _is_coarse(self, field: ModelField) -> bool:
        return field.enum is not None or referred_kinds(self.model, field.name) is not None

    def _column(self, field: ModelField) -> list[Hashable]:
        values, kinds = array(self.model, field.name), referred_kinds(self.model, field.name)
        if kinds is None:
            return [row.tobytes() for row in values]
        rows = zip(as_rows(values).tolist(), as_rows(kinds).tolist(), strict=True)
        return [tuple(self._token(k, i) for i, k in zip(row, of, strict=True)) for row, of in rows]

    def _token(self, obj: int, index: float) -> Hashable:
        """What an id refers to, by name; the number itself if it is no id."""
        names = self.names[KIND_OF[obj]] if obj else []
        if not obj:
            return index
        return names[int(index)] if 0 <= index < len(names) else -1


@dataclass(frozen=True)
class Match:
    """The objects of one kind: `a[k]` of one model is `b[k]` of the other, in the order of the first.

    Attributes:
      a, b: ids, `(n,)`.
      only_a, only_b: ids of those that only one of the models has.
    """

    a: np.ndarray
    b: np.ndarray
    only_a: Sequence[int]
    only_b: Sequence[int]


class ObjectMatching:
    """Which objects of two models are the same."""

    def __init__(self, a: ModelObjects, b: ModelObjects) -> None:
        self.a, self.b = a, b
        bodies = self._match_bodies()
        self.matches = {BODY: self._match(BODY, bodies)}
        for kind in KINDS:
            if kind != BODY:
                self.matches[kind] = self._match(kind, self._match_within_bodies(kind, bodies))

    def canonical(self, side: str, values: np.ndarray, kinds: np.ndarray | None) -> np.ndarray:
        """The ids among `values`, of the types `kinds`, by numbers that both models share.

        Args:
          side: `a` or `b`: the model that the values are of.
        """
        if kinds is None:
            return values
        result = values.astype(float)
        for obj in np.unique(kinds):
            if obj:
                chosen = kinds == obj
                result[chosen] = self._numbers(side, KIND_OF[int(obj)])[values[chosen].astype(int)]
        return result

    def parent_numbers(self, side: str, kind: str) -> np.ndarray:
        """The body of each object of a kind, by numbers that both models share."""
        parents = (self.a if side == "a" else self.b).parents(kind)
        return self._numbers(side, BODY)[parents]

    def _numbers(self, side: str, kind: str) -> np.ndarray:
        """A number for every object of a kind; the last, which is that of −1, is −1."""
        match, objects = self.matches[kind], self.a if side == "a" else self.b
        numbers = -2.0 * np.arange(1, len(objects.names[kind]) + 2) - (side == "b")
        numbers[match.a if side == "a" else match.b] = np.arange(len(match.a))
        numbers[-1] = -1
        return numbers

    def _match(self, kind: str, pairs: Mapping[int, int]) -> Match:
        a = np.array(sorted(pairs), int)
        b = np.array([pairs[i] for i in a.tolist()], int)
        only_a = [i for i in range(len(self.a.names[kind])) if i not in pairs]
        matched = set(b.tolist())
        return Match(a, b, only_a, [i for i in range(len(self.b.names[kind])) if i not in matched])

    def _match_bodies(self) -> dict[int, int]:
        """The bodies of the second model by those of the first: by name, and the others below matched parents."""
        pairs = {0: 0} | self._named(BODY)
        left_a, left_b = self._unmatched(BODY, pairs)
        queue = list(pairs.items())
        for parent_a, parent_b in queue:  # which grows
            added = [*self._aligned(BODY, left_a.get(parent_a, []), left_b.get(parent_b, []))]
            pairs |= dict(added)
            queue += added
        return pairs

    def _match_within_bodies(self, kind: str, bodies: Mapping[int, int]) -> dict[int, int]:
        """The objects of a kind: by name, and the others within matched bodies."""
        pairs = self._named(kind)
        left_a, left_b = self._unmatched(kind, pairs)
        for body_a, body_b in bodies.items():
            pairs |= dict(self._aligned(kind, left_a.get(body_a, []), left_b.get(body_b, [])))
        return pairs

    def _named(self, kind: str) -> dict[int, int]:
        ids = {name: i for i, name in enumerate(self.b.names[kind]) if name}
        return {i: ids[name] for i, name in enumerate(self.a.names[kind]) if name in ids}

    def _unmatched(self, kind: str, pairs: Mapping[int, int]) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
        """The objects of both models that are not in `pairs`, by their bodies."""
        groups: tuple[dict[int, list[int]], dict[int, list[int]]] = {}, {}
        for objects, matched, group in zip((self.a, self.b), (set(pairs), set(pairs.values())), groups, strict=True):
            for index, body in enumerate(objects.parents(kind).tolist()):
                if index not in matched:
                    group.setdefault(body, []).append(index)
        return groups

    def _aligned(self, kind: str, a: Sequence[int], b: Sequence[int]) -> Iterator[Pair]:
        """Objects without a common name: first those that are equal; between them the unnamed, in order."""
        for gap_a, gap_b, equal in self._blocks(kind, a, b, whole=True):
            yield from equal
            unnamed_a = [i for i in gap_a if not self.a.names[kind][i]]
            unnamed_b = [i for i in gap_b if not self.b.names[kind][i]]
            for rest_a, rest_b, alike in self._blocks(kind, unnamed_a, unnamed_b, whole=False):
                yield from alike
                yield from zip(rest_a, rest_b, strict=False)

    def _blocks(
        self, kind: str, a: Sequence[int], b: Sequence[int], *, whole: bool
    ) -> Iterator[tuple[Sequence[int], Sequence[int], list[Pair]]]:
        """The objects of both models as stretches that differ, each with the equal ones that follow it."""
        if not a or not b:
            return
        keys_a, keys_b = self.a.keys(kind, whole=whole), self.b.keys(kind, whole=whole)
        first, second = [keys_a[i] for i in a], [keys_b[i] for i in b]
        start_a = start_b = 0
        for block in equal_blocks(first, second):
            end_a, end_b = block.a + block.size, block.b + block.size
            equal = [*zip(a[block.a : end_a], b[block.b : end_b], strict=True)]
            yield a[start_a : block.a], b[start_b : block.b], equal
            start_a, start_b = end_a, end_b
