"""The matching of the objects of two compiled models, and of the rows of their fields.

Objects of a kind are matched by name, wherever they are. Objects without a name in one of the models, or with a name
that the other lacks, are compared in order within their parent body (within the model, for kinds without one). Equal
objects are matched first, so that a renamed object stays the same; between these, unnamed objects of one type that
refer to the same objects, and then the remaining unnamed objects one after the other.
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from functools import cached_property
from itertools import takewhile
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.fields import (
    STRETCHES,
    ModelField,
    array,
    as_rows,
    model_fields,
    referred_kinds,
    stretch,
    stretch_kind,
)
from mjrun.model.names import COUNTS, KIND_OF, KIND_OF_COUNT, KINDS, QPOS_COMPONENTS, QUATERNION, QVEL_COMPONENTS


class EqualBlock(NamedTuple):
    """A stretch of `size` items from `a` on in one sequence that equals that from `b` on in the other."""

    a: int
    b: int
    size: int


def equal_blocks(a: Sequence[Hashable], b: Sequence[Hashable]) -> list[EqualBlock]:
    """Returns the equal stretches of two sequences, in order; the last is empty, at the end of both.

    The common beginning and the common end are equal; longest common stretches are searched between them. Thus one item
    that changes into the next one counts as a change, not as one removal and one addition.
    """
    start = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(a, b, strict=False)))
    rest = min(len(a), len(b)) - start
    tails = zip(reversed(a), reversed(b), strict=False)
    end = min(rest, sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], tails)))

    inner_a, inner_b = a[start : len(a) - end], b[start : len(b) - end]
    between = SequenceMatcher(None, inner_a, inner_b, autojunk=False).get_matching_blocks()[:-1]
    blocks = [EqualBlock(0, 0, start), *(EqualBlock(start + i, start + j, size) for i, j, size in between)]
    return [*blocks, EqualBlock(len(a) - end, len(b) - end, end), EqualBlock(len(a), len(b), 0)]


BODY = "body"
# The field with the body of each object, for kinds whose objects belong to a body.
PARENTS = {
    BODY: "body_parentid", "joint": "jnt_bodyid", "geom": "geom_bodyid", "site": "site_bodyid", "camera": "cam_bodyid",
    "light": "light_bodyid",
}  # fmt: skip
# The fields with the two objects of each pair and exclude. MuJoCo orders the two by their bodies' ids.
UNORDERED = {"pair": ("pair_geom1", "pair_geom2"), "exclude": ("exclude_signature",)}
Pair = tuple[int, int]


class ModelObjects:
    """The objects of a compiled model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._keys: dict[tuple[str, bool], list[Hashable]] = {}

    @cached_property
    def names(self) -> dict[str, list[str]]:
        """The names of the objects of each kind, by id; empty for unnamed objects."""
        return {
            kind: [mujoco.mj_id2name(self.model, obj, i) or "" for i in range(getattr(self.model, COUNTS[kind]))]
            for kind, obj in KINDS.items()
        }

    def label(self, kind: str, index: int) -> str:
        """Returns the name of an object, `geom:3` if it has none."""
        return self.names[kind][index] or f"{kind}:{index}"

    def referred(self, obj: int, index: int) -> str:
        """Returns the name of the object that an id of the type `obj` refers to; `none` for −1."""
        kind = KIND_OF[obj]
        return self.label(kind, index) if 0 <= index < len(self.names[kind]) else "none"

    def parents(self, kind: str) -> np.ndarray:
        """Returns the body of each object; 0 for kinds that belong to none."""
        if kind not in PARENTS:
            return np.zeros(len(self.names[kind]), int)
        parents = array(self.model, PARENTS[kind]).astype(int)
        if kind == BODY:
            parents[0] = -1  # the world has no parent
        return parents

    def two(self, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """Returns the two objects of each pair or exclude, `(n, 2)`, and their types."""
        values = [array(self.model, name) for name in UNORDERED[kind]]
        kinds = [referred_kinds(self.model, name) for name in UNORDERED[kind]]
        return np.column_stack(values), np.column_stack([each for each in kinds if each is not None])

    def keys(self, kind: str, *, whole: bool) -> list[Hashable]:
        """Returns the comparison key of each object of a kind: all its values, or only its types and references."""
        if (kind, whole) not in self._keys:
            fields = [f for f in model_fields() if f.rows == COUNTS[kind] and not f.computed]
            fields = [f for f in fields if f.name not in (PARENTS.get(kind), *UNORDERED.get(kind, ()))]
            columns = [self._column(f) for f in fields if whole or self._is_coarse(f)]
            if kind in UNORDERED:
                columns.append([frozenset(row) for row in self._tokens(*self.two(kind))])
            stretches = [f for f in model_fields() if f.rows in STRETCHES and stretch_kind(f.rows) == kind]
            columns += [self._references(f, kind) for f in stretches if referred_kinds(self.model, f.name) is not None]
            self._keys[kind, whole] = [*zip(*columns, strict=True)] if columns else [()] * len(self.names[kind])
        return self._keys[kind, whole]

    def _is_coarse(self, field: ModelField) -> bool:
        return field.enum is not None or referred_kinds(self.model, field.name) is not None

    def _column(self, field: ModelField) -> list[Hashable]:
        values, kinds = array(self.model, field.name), referred_kinds(self.model, field.name)
        if kinds is None:
            return [row.tobytes() for row in values]
        return [*self._tokens(as_rows(values), as_rows(kinds))]

    def _tokens(self, values: np.ndarray, kinds: np.ndarray) -> list[tuple[Hashable, ...]]:
        """Returns a row of names for each row of ids of the types `kinds`."""
        rows = zip(values.tolist(), kinds.tolist(), strict=True)
        return [tuple(self._token(k, i) for i, k in zip(row, of, strict=True)) for row, of in rows]

    def _references(self, field: ModelField, kind: str) -> list[Hashable]:
        """Returns the names of all objects that each object refers to in its rows of a field, as in its path."""
        values, kinds = array(self.model, field.name), referred_kinds(self.model, field.name)
        assert kinds is not None
        rows = zip(as_rows(values).tolist(), as_rows(kinds).tolist(), strict=True)
        tokens = [tuple(self._token(k, i) for i, k in zip(row, of, strict=True) if k) for row, of in rows]
        return [tuple(tokens[stretch(self.model, field.rows, i)]) for i in range(len(self.names[kind]))]

    def _token(self, obj: int, index: float) -> Hashable:
        """Returns the name of the object that an id refers to; the number itself if it is not an id."""
        names = self.names[KIND_OF[obj]] if obj else []
        if not obj:
            return index
        return names[int(index)] if 0 <= index < len(names) else -1


@dataclass(frozen=True)
class KindMatching:
    """The matching of the objects of one kind: `a[k]` of one model is `b[k]` of the other, in the order of the first.

    Attributes:
      a, b: ids, `(n,)`.
      only_a, only_b: the ids of the objects that only one of the models has.
    """

    a: np.ndarray
    b: np.ndarray
    only_a: Sequence[int]
    only_b: Sequence[int]


class ObjectMatching:
    """The matching of the objects of two models."""

    def __init__(self, a: ModelObjects, b: ModelObjects) -> None:
        self.a, self.b = a, b
        bodies = self._match_bodies()
        self.matches = {BODY: self._match(BODY, bodies)}
        for kind in KINDS:
            if kind != BODY:
                self.matches[kind] = self._match(kind, self._match_within_bodies(kind, bodies))

    def canonical(self, side: str, values: np.ndarray, kinds: np.ndarray | None) -> np.ndarray:
        """Replaces the ids among `values`, of the types `kinds`, by numbers that both models share.

        Args:
          side: the model of the values, `a` or `b`.
        """
        if kinds is None:
            return values
        result = values.astype(float)
        for obj in np.unique(kinds):
            if obj:
                chosen = kinds == obj
                result[chosen] = self._numbers(side, KIND_OF[int(obj)])[values[chosen].astype(int)]
        return result

    def are_turned(self, kind: str) -> np.ndarray:
        """Returns for which matched pairs or excludes the two objects of one model are those of the other in reverse.

        Of two that share a single object, this is the one that stays in its place.
        """
        match = self.matches[kind]
        a = self.canonical("a", *(each[match.a] for each in self.a.two(kind)))
        b = self.canonical("b", *(each[match.b] for each in self.b.two(kind)))
        return (a == b[:, ::-1]).sum(axis=1) > (a == b).sum(axis=1)

    def parent_numbers(self, side: str, kind: str) -> np.ndarray:
        """Returns the body of each object of a kind, by numbers that both models share."""
        parents = (self.a if side == "a" else self.b).parents(kind)
        return self._numbers(side, BODY)[parents]

    def _numbers(self, side: str, kind: str) -> np.ndarray:
        """Returns a number for each object of a kind; the last one, for the id −1, is −1."""
        match, objects = self.matches[kind], self.a if side == "a" else self.b
        numbers = -2.0 * np.arange(1, len(objects.names[kind]) + 2) - (side == "b")
        numbers[match.a if side == "a" else match.b] = np.arange(len(match.a))
        numbers[-1] = -1
        return numbers

    def _match(self, kind: str, pairs: Mapping[int, int]) -> KindMatching:
        a = np.array(sorted(pairs), int)
        b = np.array([pairs[i] for i in a.tolist()], int)
        only_a = [i for i in range(len(self.a.names[kind])) if i not in pairs]
        matched = set(b.tolist())
        return KindMatching(a, b, only_a, [i for i in range(len(self.b.names[kind])) if i not in matched])

    def _match_bodies(self) -> dict[int, int]:
        """Matches the bodies of both models: by name, and the others below matched parents."""
        pairs = {0: 0} | self._named(BODY)
        left_a, left_b = self._unmatched(BODY, pairs)
        queue = list(pairs.items())
        for parent_a, parent_b in queue:  # it grows
            added = [*self._aligned(BODY, left_a.get(parent_a, []), left_b.get(parent_b, []))]
            pairs |= dict(added)
            queue += added
        return pairs

    def _match_within_bodies(self, kind: str, bodies: Mapping[int, int]) -> dict[int, int]:
        """Matches the objects of a kind: by name, and the others within matched bodies."""
        pairs = self._named(kind)
        left_a, left_b = self._unmatched(kind, pairs)
        for body_a, body_b in bodies.items():
            pairs |= dict(self._aligned(kind, left_a.get(body_a, []), left_b.get(body_b, [])))
        return pairs

    def _named(self, kind: str) -> dict[int, int]:
        ids = {name: i for i, name in enumerate(self.b.names[kind]) if name}
        return {i: ids[name] for i, name in enumerate(self.a.names[kind]) if name in ids}

    def _unmatched(self, kind: str, pairs: Mapping[int, int]) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
        """Returns the objects of both models that are not in `pairs`, by their bodies."""
        groups: tuple[dict[int, list[int]], dict[int, list[int]]] = {}, {}
        for objects, matched, group in zip((self.a, self.b), (set(pairs), set(pairs.values())), groups, strict=True):
            for index, body in enumerate(objects.parents(kind).tolist()):
                if index not in matched:
                    group.setdefault(body, []).append(index)
        return groups

    def _aligned(self, kind: str, a: Sequence[int], b: Sequence[int]) -> Iterator[Pair]:
        """Yields pairs of objects without a common name: first equal ones; between them unnamed ones in order."""
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
        """Yields the objects of both models as stretches that differ, each with the equal objects that follow it."""
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


@dataclass(frozen=True)
class MatchedModelRows:
    """The rows along one dimension that both models have.

    Attributes:
      a, b: indices of rows: `a[k]` of one model is `b[k]` of the other.
      labels: the object of each row: `torso`, `root/x`; both names if they differ, `torso → trunk`.
    """

    a: np.ndarray
    b: np.ndarray
    labels: Sequence[str]


class ModelRowMatching:
    """The matching of the rows of two models along each dimension."""

    def __init__(self, objects: ObjectMatching) -> None:
        self.objects = objects
        self._rows: dict[str, MatchedModelRows | None] = {}

    def rows(self, dimension: str) -> MatchedModelRows | None:
        """Returns the rows along `dimension`, MuJoCo's name of a count; None if they belong to no objects."""
        if dimension not in self._rows:
            self._rows[dimension] = self._find(dimension)
        return self._rows[dimension]

    def label(self, kind: str, a: int, b: int) -> str:
        """Returns the label of an object that both models have."""
        first, second = self.objects.a.label(kind, a), self.objects.b.label(kind, b)
        return first if first == second else f"{first} → {second}"

    def _find(self, dimension: str) -> MatchedModelRows | None:
        if kind := KIND_OF_COUNT.get(dimension):
            match = self.objects.matches[kind]
            labels = [self.label(kind, *pair) for pair in zip(match.a.tolist(), match.b.tolist(), strict=True)]
            return MatchedModelRows(match.a, match.b, labels)
        return self._parts(dimension) if dimension in PARTS else None

    def _parts(self, dimension: str) -> MatchedModelRows:
        """Returns the rows of a dimension along which an object may have several, such as degrees of freedom."""
        kind = PARTS[dimension]
        a, b, labels = list[int](), list[int](), list[str]()
        match = self.objects.matches[kind]
        for index_a, index_b in zip(match.a.tolist(), match.b.tolist(), strict=True):
            start_a, names_a = _stretch(self.objects.a.model, dimension, index_a)
            start_b, names_b = _stretch(self.objects.b.model, dimension, index_b)
            if names_a == names_b:
                a += range(start_a, start_a + len(names_a))
                b += range(start_b, start_b + len(names_b))
                label = self.label(kind, index_a, index_b)
                labels += [f"{label}/{name}" if name else label for name in names_a]
        return MatchedModelRows(np.array(a, int), np.array(b, int), labels)


# The kind of object to which the rows of a dimension belong.
PARTS = {
    "nq": "joint", "nv": "joint", "nu": "actuator", "nout": "actuator", "na": "actuator", "ntree": "body",
    "nmocap*3": "body", "nmocap*4": "body",
}  # fmt: skip


def _stretch(model: mujoco.MjModel, dimension: str, index: int) -> tuple[int, Sequence[str]]:
    """Returns the first row of an object along a dimension, and the names of its rows; a single one needs none."""
    if dimension in ("nq", "nv"):
        start, components = (
            (model.jnt_qposadr, QPOS_COMPONENTS) if dimension == "nq" else (model.jnt_dofadr, QVEL_COMPONENTS)
        )
        return int(start[index]), components.get(int(model.jnt_type[index]), ("",))
    if dimension == "ntree":
        tree = int(model.body_treeid[index])
        return (tree, ("",)) if tree >= 0 and model.tree_bodyadr[tree] == index else (0, ())
    if dimension.startswith("nmocap"):
        mocap, components = int(model.body_mocapid[index]), ("x", "y", "z") if dimension.endswith("3") else QUATERNION
        return (mocap * len(components), components) if mocap >= 0 else (0, ())
    starts, counts = {
        "nu": (model.actuator_ctrladr, model.actuator_ctrlnum),
        "nout": (model.actuator_outadr, model.actuator_outnum),
        "na": (model.actuator_actadr, model.actuator_actnum),
    }[dimension]
    count = int(counts[index])
    return int(starts[index]), [str(part) for part in range(count)] if count > 1 else [""] * count
