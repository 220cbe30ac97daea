"""Which row of a field of one compiled model belongs to which row of the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.diff.model_matching import ObjectMatching
from mjrun.model.names import KIND_OF_COUNT, QPOS_COMPONENTS, QUATERNION, QVEL_COMPONENTS


@dataclass(frozen=True)
class Rows:
    """The rows along one dimension that both models have.

    Attributes:
      a, b: `a[k]` of one model is `b[k]` of the other.
      labels: what each belongs to: `torso`, `root/x`; both names where they differ, `torso → trunk`.
    """

    a: np.ndarray
    b: np.ndarray
    labels: Sequence[str]


class RowMatching:
    """The rows of two models, by what counts them."""

    def __init__(self, objects: ObjectMatching) -> None:
        self.objects = objects
        self._rows: dict[str, Rows | None] = {}

    def rows(self, dimension: str) -> Rows | None:
        """The rows along `dimension`, MuJoCo's name of a count; None if they belong to no objects."""
        if dimension not in self._rows:
            self._rows[dimension] = self._find(dimension)
        return self._rows[dimension]

    def label(self, kind: str, a: int, b: int) -> str:
        """An object that both models have."""
        first, second = self.objects.a.label(kind, a), self.objects.b.label(kind, b)
        return first if first == second else f"{first} → {second}"

    def _find(self, dimension: str) -> Rows | None:
        if kind := KIND_OF_COUNT.get(dimension):
            match = self.objects.matches[kind]
            labels = [self.label(kind, *pair) for pair in zip(match.a.tolist(), match.b.tolist(), strict=True)]
            return Rows(match.a, match.b, labels)
        return self._parts(dimension) if dimension in PARTS else None

    def _parts(self, dimension: str) -> Rows:
        """Rows of which an object may have several, such as degrees of freedom."""
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
        return Rows(np.array(a, int), np.array(b, int), labels)


# What counts parts of objects → the kind of these.
PARTS = {
    "nq": "joint", "nv": "joint", "nu": "actuator", "nout": "actuator", "na": "actuator", "ntree": "body",
    "nmocap*3": "body", "nmocap*4": "body",
}  # fmt: skip


def _stretch(model: mujoco.MjModel, dimension: str, index: int) -> tuple[int, Sequence[str]]:
    """The first row of the parts of an object, and the names of these; a single one needs none."""
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
