"""The sentence with which MuJoCo refuses a model, and the element that it means."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mjrun.check.finding import Sighting
from mjrun.check.xml_source import Element, Source
from mjrun.errors import BrokenModelError, clean


class Refusal(NamedTuple):
    """What MuJoCo said of the model `source`, without its line, and that line in the model itself."""

    source: Source
    message: str
    line: int | None

    @property
    def place(self) -> tuple[Path, int | None]:
        """The model, with the line only if it cannot be one of a model that is attached."""
        return self.source.path, None if self.source.attached else self.line or None

    def element(self, told: str = "") -> Element | None:
        """The element that MuJoCo means: by line, the one that holds the text `told`."""
        named = re.search(r"; Element name '(.+)', id", self.message)
        told = told or (named[1] if named else "")
        words = set(re.findall(r"\w+", self.message))
        if not self.line:  # in an included file, whose lines MuJoCo forgets
            found = [e for e in self._elements() if told and told in e.attributes.values()]
            return next((e for e in found if e.tag in words), next(iter(found), None))
        files = {self.source.path, *(root.file for root in self.source.attached)}  # MuJoCo does not say which
        lined = [e for e in self._elements() if e.line == self.line and e.file in files]
        lined = [e for e in lined if told in e.attributes.values()] or lined
        lined = [e for e in lined if e.tag in words] or lined
        return lined[0] if len({e.file for e in lined}) == 1 else None

    def _elements(self) -> Iterator[Element]:
        yield from self.source.elements()
        yield from (e for root in self.source.attached for e in root.walk())

    @property
    def said(self) -> str:
        """MuJoCo's sentence without what it says of the element, which it names by its tag."""
        return re.sub(r"; Element .*", "", self.message)

    @property
    def form(self) -> str:
        """The sentence without names and numbers, which change when a model is attached."""
        return re.sub(r"'.*?'|\d+", "", self.said)

    @classmethod
    def of(cls, error: BrokenModelError, source: Source) -> "Refusal":
        """What MuJoCo said in `error`, on one line."""
        text = str(error)
        place = clean(str(error.path)) + (f":{error.line}" if error.line else "")
        return cls(source, "; ".join(text.removeprefix(f"{place}: ").splitlines()), error.line)

    def sighting(self, message: str, remedy: str, told: str = "") -> Sighting:
        """A sighting at the element that MuJoCo means."""
        element = self.element(told)
        if element is None:
            return Sighting(message, remedy, "", self.place)
        return Sighting(message, remedy, str(element), (element.file, element.line))
