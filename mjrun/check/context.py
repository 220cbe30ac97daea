"""A model that loads, as rules see it: compiled, at its start, and in its XML."""

import itertools
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.check.finding import MakeFix, Place, Violation
from mjrun.check.rule_catalogue import Thresholds
from mjrun.formats.user_cache import UserCache
from mjrun.model.names import COUNTS, KINDS, names
from mjrun.model.override import ELEMENTS
from mjrun.model.sources import source_of
from mjrun.model.text_edits import ElementEditor
from mjrun.model.xml_source import Element, XmlSource, with_slashes, xml_paths
from mjrun.suffixes import XML

DEFAULTS = Thresholds()
MAX_KEYFRAMES = 8  # the number of keyframes that rules start from
SPEC_LISTS = ELEMENTS | {"keyframe": "keys"}
TAGS = {
    "body": ("body", "flexcomp", "link"),
    "joint": ("joint", "freejoint"),
    "tendon": ("fixed", "spatial"),
    "keyframe": ("key",),
}
OWNERS = {"geom": "geom_bodyid", "site": "site_bodyid", "joint": "jnt_bodyid"}  # the bodies of objects
SECTIONS = ("actuator", "sensor", "equality")  # kinds whose objects are the children of one element
SIGNS = np.array(list(itertools.product((-1, 1), repeat=3)))  # of the corners of a box
IN_FILE_ORDER = (*SECTIONS, "keyframe")  # kinds whose ids follow the order of the file


class AttachedModel(NamedTuple):
    """An `<attach>`, its prefix, and the paths at which MuJoCo looks for the attached model."""

    element: Element
    prefix: str
    files: set[Path]


class CheckContext:
    """The context of rules: a model that loads, compiled, at its start, and in its XML.

    Attributes:
      path: its file.
      home: the folder of its file; of a copy, that of the original.
      model: the compiled model.
      spec: the specification that it was compiled from; None for a binary.
      source: its XML, as far as it could be read.
      editor: the editor of its elements.
      unsafe: true if rules may propose fixes that need a look.
      announce_slow_fix: called before a fix that computes for minutes, with its description.
      cache: the store of what takes minutes to compute; None without one.
      thresholds: the numbers beyond which rules report something.
    """

    def __init__(
        self,
        path: Path,
        model: mujoco.MjModel,
        spec: mujoco.MjSpec | None,
        source: XmlSource,
        thresholds: Thresholds = DEFAULTS,
    ) -> None:
        self.path, self.model, self.spec, self.source = path, model, spec, source
        self.home = path.absolute().parent
        self.editor, self.unsafe = ElementEditor(source.mjcf_texts), False
        self.announce_slow_fix: Callable[[str], None] = lambda stage: None
        self.cache: UserCache | None = None
        self.thresholds = thresholds
        self._names: dict[str, list[str]] = {}
        self._lines_by_id: dict[str, dict[int, int]] = {}
        self._elements_by_kind: dict[str, list[Element]] = {}
        self._attached_by_kind: dict[str, list[Element]] = {}
        self._data: dict[int | None, mujoco.MjData] = {}

    @classmethod
    def load(cls, path: Path, source: XmlSource, thresholds: Thresholds = DEFAULTS) -> "CheckContext":
        """Loads the model in `path`.

        Raises:
          ModelError: it cannot be loaded.
        """
        spec, model = source_of(path).compile()
        return cls(path, model, spec if path.suffix in XML else None, source, thresholds)

    def violation(
        self, kind: str, index: int, message: str, remedy: str, severity: str = "", fix: MakeFix | None = None
    ) -> Violation:
        """Returns a violation by the object `index` of a kind, at the line that declares it."""
        return Violation(message, remedy, self.place(kind, index), self.object(kind, index), severity, fix)

    def name(self, kind: str, index: int) -> str:
        """Returns the name of an object; `joint:3` if it has none."""
        if kind not in self._names:
            self._names[kind] = names(self.model, kind)
        return self._names[kind][index]

    def object(self, kind: str, index: int) -> str:
        """Returns an object as findings refer to it: `joint 'knee'`, or `geom 13 of body 'thigh'` without a name."""
        owner = OWNERS.get(kind, "")
        if owner and not mujoco.mj_id2name(self.model, KINDS[kind], index):
            return f"{kind} {index} of {self.object('body', int(getattr(self.model, owner)[index]))}"
        return f"{kind} '{self.name(kind, index)}'"

    @cached_property
    def starts(self) -> list[int | None]:
        """The starts of a simulation: None for the model's initial state, and the first keyframes that are finite."""
        model = self.model
        fields = (model.key_qpos, model.key_qvel, model.key_act, model.key_ctrl, model.key_mpos, model.key_mquat)
        finite = (k for k in range(model.nkey) if all(np.isfinite(field[k]).all() for field in fields))
        return [None, *list(finite)[:MAX_KEYFRAMES]]

    def data_at(self, start: int | None) -> mujoco.MjData:
        """Returns the model at rest at a start, after `mj_forward`; rules share it and must not write to it."""
        if start not in self._data:
            data = mujoco.MjData(self.model)
            if start is not None:
                mujoco.mj_resetDataKeyframe(self.model, data, start)
                data.qvel[:] = 0
            mujoco.mj_forward(self.model, data)
            self._data[start] = data
        return self._data[start]

    @cached_property
    def geom_corners(self) -> np.ndarray:
        """The corners of the bounding boxes of all geoms in the world, at the initial state, `(ngeom, 8, 3)` [m]."""
        model, data = self.model, self.data_at(None)
        local = model.geom_aabb[:, None, :3] + SIGNS * model.geom_aabb[:, None, 3:]
        return data.geom_xpos[:, None] + local @ data.geom_xmat.reshape(-1, 3, 3).transpose(0, 2, 1)

    def start_phrase(self, start: int | None) -> str:
        """Returns the phrase for a start that begins a message."""
        return "at the start" if start is None else f"in keyframe '{self.name('keyframe', start)}'"

    def element(self, kind: str, index: int) -> Element | None:
        """Returns the XML element that made an object; None if that is ambiguous."""
        name = mujoco.mj_id2name(self.model, KINDS[kind], index) or ""
        elements, attached = self._elements(kind), self._attached_elements(kind)

        if on_line := self._on_line(kind, index, name):
            return on_line
        if name:
            named = [e for e in elements if declared_name(e) == name]
            named += self._longest_named([e for e in attached if self._may_make(e, name)])
            if named:
                return named[0]
        if kind in OWNERS:  # MuJoCo records no line for free joints, nor for anything in included files
            return self._in_body(kind, index)
        if kind == "body":
            return self._bodies_in_order[index - 1] if self._bodies_in_order else None
        complete = len(elements) == getattr(self.model, COUNTS[kind])
        return elements[index] if kind in IN_FILE_ORDER and complete else None

    def _on_line(self, kind: str, index: int, name: str) -> Element | None:
        """Returns the element of an object on the line that MuJoCo records; of several, the one in the same order."""
        line = self._lines(kind).get(index, 0)
        elements = [
            element
            for element in (*self._elements(kind), *self._attached_elements(kind))
            if line
            and element.line == line
            and element.file in self._files_with_lines
            and self._may_make(element, name)
        ]
        if len(elements) < 2:
            return elements[0] if elements else None
        objects = sorted(i for i, each in self._lines(kind).items() if each == line and self._has_name(kind, i, name))
        return elements[objects.index(index) if len(objects) == len(elements) else 0]

    def _has_name(self, kind: str, index: int, name: str) -> bool:
        return index >= 0 and (mujoco.mj_id2name(self.model, KINDS[kind], index) or "") == name

    def _longest_named(self, elements: list[Element]) -> list[Element]:
        """Returns the elements with the longest name; none if several have no name."""
        longest = max((len(e.attributes.get("name", "")) for e in elements), default=0)
        candidates = [e for e in elements if len(e.attributes.get("name", "")) == longest]
        return candidates if longest or len(candidates) == 1 else []

    def _in_body(self, kind: str, index: int) -> Element | None:
        """Returns the element of an object, based on its position among those of its body; or that of its body."""
        owners = getattr(self.model, OWNERS[kind])
        body = int(owners[index])
        home = self.element("body", body) if body else self._root_link
        own = [e for e in _of_body(home) if _is_kind(e, kind)] if home else []
        siblings = np.flatnonzero(owners == body)
        return own[int(np.searchsorted(siblings, index))] if len(own) == len(siblings) else home

    @cached_property
    def _root_link(self) -> Element | None:
        """The link that a URDF attaches to no other, which MuJoCo fuses into the world; None if unknown."""
        parts = self.source.root.children if self.source.root and self.source.root.tag == "robot" else []
        attached = {child.attributes.get("link") for part in parts for child in part.children if child.tag == "child"}
        links = [part for part in parts if part.tag == "link" and part.attributes.get("name") not in attached]
        return links[0] if len(links) == 1 else None

    @cached_property
    def _bodies_in_order(self) -> list[Element]:
        """The elements of all bodies but the world; empty if MuJoCo generates some, or leaves some out."""
        elements = self._elements("body")
        written = [element.attributes.get("name", "") for element in elements]
        compiled = [mujoco.mj_id2name(self.model, KINDS["body"], i) or "" for i in range(1, self.model.nbody)]
        return elements if written == compiled else []

    def place(self, kind: str, index: int) -> Place:
        """Returns the place that declares an object, or that attaches the model declaring it, as far as known."""
        element = self.element(kind, index)
        if element is None:
            return Place(self.path)
        if not self._is_attached(element):
            return Place(element.file, element.line)
        name = mujoco.mj_id2name(self.model, KINDS[kind], index) or ""
        attaches = self._attaching(element, name) or [a.element for a in self._attaches if element.file in a.files]
        file, line = (attaches[0].file, attaches[0].line) if len(attaches) == 1 else (self.path, None)
        return Place(file, line, (element.file, element.line))

    def _may_make(self, element: Element, name: str) -> bool:
        """Returns whether an element can have made an object of this name; attaching and replicating extend names."""
        own = element.attributes.get("name", "")
        if self._is_attached(element) and name:
            return bool(self._attaching(element, name))
        return own in name if own and name else own == name

    def _is_attached(self, element: Element) -> bool:
        """Returns whether an element is part of an attached model."""
        while element.parent is not None:
            element = element.parent
        return element is not self.source.root

    def _attaching(self, element: Element, name: str) -> list[Element]:
        """Returns the `<attach>` elements that can have made an object of this name from an attached element."""
        own = element.attributes.get("name", "")
        return [
            attach.element
            for attach in self._attaches
            if element.file in attach.files and (name.startswith(attach.prefix + own) if own else name == attach.prefix)
        ]

    @cached_property
    def _attaches(self) -> list[AttachedModel]:
        models = [e for e in self.source.elements() if e.tag == "model"]
        attaches = list[AttachedModel]()
        for element in self.source.elements():
            if element.tag == "attach":
                wanted = element.attributes.get("model", "")
                named = [model for model in models if model.attributes.get("name", wanted) == wanted]
                files = {path for model in named for path in xml_paths(model, self.source.path)}
                attaches.append(AttachedModel(element, element.attributes.get("prefix", ""), files))
        return attaches

    def _lines(self, kind: str) -> dict[int, int]:
        """Returns the lines that MuJoCo records in its elements, by id; 0 in included files."""
        if kind not in self._lines_by_id:
            elements: Iterator[Any] = iter(getattr(self.spec, SPEC_LISTS[kind])) if self.spec else iter(())
            self._lines_by_id[kind] = {element.id: _line(element.info) for element in elements}
        return self._lines_by_id[kind]

    def _elements(self, kind: str) -> list[Element]:
        if kind not in self._elements_by_kind:
            self._elements_by_kind[kind] = [e for e in self.source.elements() if _is_kind(e, kind)]
        return self._elements_by_kind[kind]

    def _attached_elements(self, kind: str) -> list[Element]:
        if kind not in self._attached_by_kind:
            elements = (element for root in self.source.attached for element in root.walk())
            self._attached_by_kind[kind] = [element for element in elements if _is_kind(element, kind)]
        return self._attached_by_kind[kind]

    @cached_property
    def _files_with_lines(self) -> set[Path]:
        """The files whose lines MuJoCo records."""
        return {self.path, *(root.file for root in self.source.attached)}


def declared_name(element: Element) -> str:
    """Returns the name of the object that an element makes; assets without a name have that of their file."""
    file = with_slashes(element.attributes.get("file", ""))
    return element.attributes.get("name") or Path(file).stem


def _of_body(body: Element) -> Iterator[Element]:
    """Yields the elements of a body without those of other bodies in it."""
    for child in body.children:
        if child.tag == "frame":
            yield from _of_body(child)
        elif child.tag != "body":
            yield child


def _is_kind(element: Element, kind: str) -> bool:
    if kind in SECTIONS:
        return element.parent is not None and element.parent.tag == kind
    return element.tag in TAGS.get(kind, (kind,)) and not element.within("default")


def _line(info: str) -> int:
    digits = info.removeprefix("line ")
    return int(digits) if digits.isdigit() else 0
