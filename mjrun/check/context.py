"""A model that loads, as rules see it: compiled, at its start, and in its XML."""

import math
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.check.finding import Place
from mjrun.check.xml_source import XML, Element, Source, regular
from mjrun.model.compilation import FAULTS
from mjrun.model.load import load
from mjrun.model.names import COUNTS, KINDS, names

KEYS = 8  # keyframes that rules start from
LISTS = {
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "camera": "cameras",
    "actuator": "actuators",
    "sensor": "sensors",
    "tendon": "tendons",
    "equality": "equalities",
    "keyframe": "keys",
}
TAGS = {
    "body": ("body", "flexcomp", "link"),
    "joint": ("joint", "freejoint"),
    "tendon": ("fixed", "spatial"),
    "keyframe": ("key",),
}
WHERE = ("actuator", "sensor", "equality")  # kinds whose elements are all that stands in one element
LISTED = (*WHERE, "keyframe")  # kinds numbered as they stand in the file


class Attach(NamedTuple):
    """An `<attach>`, what it puts before names, and the paths at which MuJoCo looks for what it attaches."""

    element: Element
    prefix: str
    files: set[Path]


class LintContext:
    """A model that loads.

    Attributes:
      path: its file.
      model: compiled.
      spec: what it was compiled from; None for a binary.
      source: its XML, as far as it could be read.
    """

    def __init__(self, path: Path, model: mujoco.MjModel, spec: mujoco.MjSpec | None, source: Source) -> None:
        self.path, self.model, self.spec, self.source = path, model, spec, source
        self._names: dict[str, list[str]] = {}
        self._infos: dict[str, dict[int, int]] = {}
        self._kinds: dict[str, list[Element]] = {}
        self._data: dict[int | None, mujoco.MjData] = {}

    @classmethod
    def load(cls, path: Path, source: Source) -> "LintContext":
        """Loads the model in `path`.

        Raises:
          ModelError: it cannot be.
        """
        with suppress(*FAULTS):  # what fails is loaded once more, for an error that says what and where
            if path.suffix in XML and regular(path):
                spec = mujoco.MjSpec.from_file(str(path))
                model = spec.compile()
                model.names.decode("utf-8")
                if 0 < model.opt.timestep < math.inf:
                    return cls(path, model, spec, source)
        return cls(path, load(path), None, source)

    def name(self, kind: str, index: int) -> str:
        """The name of an object, `joint:3` without one."""
        if kind not in self._names:
            self._names[kind] = names(self.model, kind)
        return self._names[kind][index]

    def object(self, kind: str, index: int) -> str:
        """An object as findings call it: `joint 'knee'`."""
        return f"{kind} '{self.name(kind, index)}'"

    @cached_property
    def starts(self) -> list[int | None]:
        """Where a simulation can start: None for the model's own state, and the first keyframes that are finite."""
        model = self.model
        fields = (model.key_qpos, model.key_qvel, model.key_act, model.key_ctrl, model.key_mpos, model.key_mquat)
        good = (k for k in range(model.nkey) if all(np.isfinite(field[k]).all() for field in fields))
        return [None, *list(good)[:KEYS]]

    def at(self, start: int | None) -> mujoco.MjData:
        """The model at a start, at rest, with all that follows from that; not to be written to."""
        if start not in self._data:
            data = mujoco.MjData(self.model)
            if start is not None:
                mujoco.mj_resetDataKeyframe(self.model, data, start)
                data.qvel[:] = 0
            mujoco.mj_forward(self.model, data)
            self._data[start] = data
        return self._data[start]

    def called(self, start: int | None) -> str:
        """What a message calls a start."""
        return "at the start" if start is None else f"in keyframe '{self.name('keyframe', start)}'"

    def element(self, kind: str, index: int) -> Element | None:
        """The element that made an object, if it can be told."""
        name = mujoco.mj_id2name(self.model, KINDS[kind], index) or ""
        line = self._lines(kind).get(index, 0)
        own, attached = self._elements(kind), self._attached(kind)
        lined = [e for e in (*own, *attached) if e.line == line and e.file in self._mains and self._fits(e, name)]
        if line and lined:
            return lined[0]
        named = [e for e in own if name and e.attributes.get("name") == name]
        named += self._closest([e for e in attached if name and self._fits(e, name)])
        if named:
            return named[0]
        if kind == "joint":  # MuJoCo notes no line for free joints
            return self._of_body(index)
        return own[index] if kind in LISTED and len(own) == getattr(self.model, COUNTS[kind]) else None

    def _closest(self, attached: list[Element]) -> list[Element]:
        """Those that share the most with the name of an object; of several without a name, none is closest."""
        longest = max((len(e.attributes.get("name", "")) for e in attached), default=0)
        found = [e for e in attached if len(e.attributes.get("name", "")) == longest]
        return found if longest or len(found) == 1 else []

    def _of_body(self, joint: int) -> Element | None:
        """The element of a joint by its place in its body."""
        body = int(self.model.jnt_bodyid[joint])
        home = self.element("body", body) if body else None
        joints = [child for child in home.children if child.tag in TAGS["joint"]] if home else []
        which = joint - int(self.model.body_jntadr[body])
        return joints[which] if which < len(joints) else home

    def place(self, kind: str, index: int) -> Place:
        """Where the model says that there is an object: of what it attaches, where it does, as far as that is clear."""
        element = self.element(kind, index)
        if element is None:
            return Place(self.path)
        if not self._foreign(element):
            return Place(element.file, element.line)
        name = mujoco.mj_id2name(self.model, KINDS[kind], index) or ""
        attaches = self._attaching(element, name) or [a.element for a in self._attaches if element.file in a.files]
        file, line = (attaches[0].file, attaches[0].line) if len(attaches) == 1 else (self.path, None)
        return Place(file, line, (element.file, element.line))

    def _fits(self, element: Element, name: str) -> bool:
        """Whether an element can have made an object of this name; attaching and replicating add to names."""
        own = element.attributes.get("name", "")
        if self._foreign(element) and name:
            return bool(self._attaching(element, name))
        return own in name if own and name else own == name

    def _foreign(self, element: Element) -> bool:
        """Whether an element stands in a model that is attached."""
        while element.parent is not None:
            element = element.parent
        return element is not self.source.root

    def _attaching(self, element: Element, name: str) -> list[Element]:
        """What makes objects of this name out of an element of an attached model."""
        own, found = element.attributes.get("name", ""), []
        for attach in self._attaches:
            made = name.startswith(attach.prefix + own) if own else name == attach.prefix
            if made and element.file in attach.files:
                found.append(attach.element)
        return found

    @cached_property
    def _attaches(self) -> list[Attach]:
        models = [e.attributes for e in self.source.elements() if e.tag == "model"]
        found = []
        for element in self.source.elements():
            if element.tag == "attach":
                wanted = element.attributes.get("model", "")
                names = [model.get("file", "") for model in models if model.get("name", wanted) == wanted]
                files = {path for name in names for path in (Path(name), self.source.path.parent / name)}
                found.append(Attach(element, element.attributes.get("prefix", ""), files))
        return found

    def _lines(self, kind: str) -> dict[int, int]:
        """Lines that MuJoCo notes in its elements, by id; 0 in included files."""
        if kind not in self._infos:
            made: Iterator[Any] = iter(getattr(self.spec, LISTS[kind])) if self.spec else iter(())
            self._infos[kind] = {element.id: _line(element.info) for element in made}
        return self._infos[kind]

    def _elements(self, kind: str) -> list[Element]:
        if kind not in self._kinds:
            self._kinds[kind] = [e for e in self.source.elements() if _is(e, kind)]
        return self._kinds[kind]

    def _attached(self, kind: str) -> list[Element]:
        return [e for root in self.source.attached for e in root.walk() if _is(e, kind)]

    @cached_property
    def _mains(self) -> set[Path]:
        """The files whose lines MuJoCo knows."""
        return {self.path, *(root.file for root in self.source.attached)}


def _is(element: Element, kind: str) -> bool:
    if kind in WHERE:
        return element.parent is not None and element.parent.tag == kind
    return element.tag in TAGS.get(kind, (kind,)) and not element.within("default")


def _line(info: str) -> int:
    digits = info.removeprefix("line ")
    return int(digits) if digits.isdigit() else 0
