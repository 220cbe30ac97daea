"""What a model is: its sections, as typed plain values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from mjrun.errors import UnknownNameError
from mjrun.model import mujoco_bugs
from mjrun.model.description.model_description import SECTIONS, ModelDescription
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.sources import ModelLike, source_of
from mjrun.reporter import QuietReporter, Reporter, pass_on


@dataclass(frozen=True)
class Info:
    """Which model, and what of it.

    Args:
      model: a compiled model, or the path of one. It is not changed.
      sections: names of `mjrun.model.description.model_description.SECTIONS`; all of them when empty.
    """

    model: ModelLike
    sections: Sequence[str] = ()

    def run(self, reporter: Reporter | None = None) -> "InfoResult":
        """Loads the model and describes it.

        Raises:
          UnknownNameError: there is no such section; the model is not loaded.
          ModelError: the model cannot be loaded.
        """
        reporter = reporter or QuietReporter()
        for name in self.sections:
            if name not in SECTIONS:
                raise UnknownNameError("section", name, SECTIONS)
        sections = tuple(dict.fromkeys(self.sections)) or SECTIONS
        with collected_warnings() as heard:
            description = self._description()
            for name in sections:
                getattr(description, name)  # now, where warnings are heard
        known = mujoco_bugs.bugs_of_model(description.model)
        for text in known:
            reporter.warn(text)
        pass_on(heard, reporter)
        return InfoResult(description, sections, (*known, *heard))

    def _description(self) -> ModelDescription:
        source = source_of(self.model)
        return ModelDescription(source.load(), source.main_file)


@dataclass(frozen=True)
class InfoResult:
    """What was found.

    Attributes:
      description: of the model, each section an attribute of it.
      sections: those that were asked for, in order.
      warnings: what MuJoCo warned of, and faults of its that touch the model.
    """

    description: ModelDescription
    sections: Sequence[str]
    warnings: Sequence[str]

    def document(self) -> dict[str, Any]:
        """The sections by name, and `warnings`, as JSON holds them; a number that is not finite is null."""
        found = {name: _plain(getattr(self.description, name)) for name in self.sections}
        return {**found, "warnings": list(self.warnings)}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
