"""The message with which MuJoCo rejects a model, and the XML element that it is about."""

import re
from collections.abc import Iterator
from typing import NamedTuple

from mjrun.check.finding import Finding, Place
from mjrun.check.rule import Rule
from mjrun.errors import BrokenModelError, clean
from mjrun.model.xml_source import Element, XmlSource


class CompileError(NamedTuple):
    """An error of MuJoCo's parser or compiler.

    Attributes:
      source: the model.
      message: in one line, without the line number.
      line: in the model, or in a model that it attaches; None or 0 if unknown.
    """

    source: XmlSource
    message: str
    line: int | None

    @classmethod
    def of(cls, error: BrokenModelError, source: XmlSource) -> "CompileError":
        """MuJoCo's message in `error`."""
        place = clean(str(error.path)) + (f":{error.line}" if error.line else "")
        return cls(source, "; ".join(str(error).removeprefix(f"{place}: ").splitlines()), error.line)

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
        """The model, with the line unless it could be one of an attached model."""
        return Place(self.source.path, None if self.source.attached else self.line or None)

    def element(self, value: str = "") -> Element | None:
        """The element that the message is about, which has an attribute `value`, if that is not empty."""
        name = re.search(r"; Element name '(.+)', id", self.message)
        value = value or (name[1] if name else "")
        words = set(re.findall(r"\w+", self.message))
        if not self.line:  # in an included file, whose lines MuJoCo does not keep
            candidates = [e for e in self._elements() if value and value in e.attributes.values()]
            return next((e for e in candidates if e.tag in words), next(iter(candidates), None))

        files = {self.source.path, *(root.file for root in self.source.attached)}  # MuJoCo does not say which
        candidates = [e for e in self._elements() if e.line == self.line and e.file in files]
        candidates = [e for e in candidates if value in e.attributes.values()] or candidates
        candidates = [e for e in candidates if e.tag in words] or candidates
        return candidates[0] if len({e.file for e in candidates}) == 1 else None

    def _elements(self) -> Iterator[Element]:
        yield from self.source.elements()
        yield from (e for root in self.source.attached for e in root.walk())

    def finding(self, rule: Rule, message: str, remedy: str, value: str = "") -> Finding:
        """A violation of `rule` by the element that the message is about."""
        element = self.element(value)
        if element is None:
            return rule.finding(message, remedy, self.place)
        return rule.in_element(element, message, remedy)
