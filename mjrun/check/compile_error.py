"""The error with which a model does not load, and the XML element that it refers to."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mjrun.check.rule import Finding, MakeFix, Place, Rule
from mjrun.errors import BrokenModelError, clean, spelled
from mjrun.model.xml_source import Element, XmlSource


class CompileError(NamedTuple):
    """An error of MuJoCo's parser or compiler, or of mjrun, which refuses models that would crash MuJoCo.

    Attributes:
      source: the model.
      path: the model, or the part of it with the error.
      message: the message in one line, without the line number and the hint.
      line: the line in the model, or in a model that it attaches; None or 0 if unknown.
      hint: the remedy; empty if the error contains none.
    """

    source: XmlSource
    path: Path
    message: str
    line: int | None
    hint: str = ""

    @classmethod
    def of(cls, error: BrokenModelError, source: XmlSource) -> "CompileError":
        """Returns the compile error that `error` of the model `source` describes."""
        place = clean(str(error.path)) + (f":{error.line}" if error.line else "")
        hint = f"\n{spelled(error.hint)}" if error.hint else ""
        message = str(error).removeprefix(f"{place}: ").removesuffix(hint)
        return cls(source, error.path, "; ".join(message.splitlines()), error.line, error.hint)

    @property
    def text(self) -> str:
        """The message without MuJoCo's own description of the element."""
        return re.sub(r"; Element .*", "", self.message)

    @property
    def pattern(self) -> str:
        """The message without names and numbers, which change when a model is attached."""
        return re.sub(r"'.*?'|\d+", "", self.text)

    @property
    def place(self) -> Place:
        """The file of the error, with the line unless the line may be in an attached model."""
        if self.path != self.source.path:
            return Place(self.path, self.line or None)
        return Place(self.path, None if self.source.attached else self.line or None)

    def element(self, value: str = "") -> Element | None:
        """Returns the element that the message refers to; it has an attribute `value`, unless that is empty."""
        name = re.search(r"; Element name '(.+)', id", self.message)
        value = value or (name[1] if name else "")
        words = set(re.findall(r"\w+", self.message))
        if not self.line:  # it is in an included file, whose lines MuJoCo does not record
            candidates = [e for e in self._elements() if value and value in e.attributes.values()]
            return next((e for e in candidates if e.tag in words), next(iter(candidates), None))

        files = {self.path}
        if self.path == self.source.path:
            files |= {root.file for root in self.source.attached}  # MuJoCo does not report which
        candidates = [e for e in self._elements() if e.line == self.line and e.file in files]
        candidates = [e for e in candidates if value in e.attributes.values()] or candidates
        candidates = [e for e in candidates if e.tag in words] or candidates
        return candidates[0] if len({e.file for e in candidates}) == 1 else None

    def _elements(self) -> Iterator[Element]:
        yield from self.source.elements()
        yield from (e for root in self.source.attached for e in root.walk())

    def finding(self, rule: Rule, message: str, remedy: str, value: str = "", fix: MakeFix | None = None) -> Finding:
        """Returns a violation of `rule` by the element that the message refers to."""
        element = self.element(value)
        if element is None:
            return rule.finding(message, remedy, self.place, fix=fix)
        return rule.in_element(element, message, remedy, fix)
