"""`mjrun info`: the description of a model, section by section."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError
from mjrun.model import known_bugs
from mjrun.model.description.model_description import SECTIONS, ModelDescription
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.sources import ModelLike, source_of
from mjrun.reporter import Reporter, WarningReporter, pass_on
from mjrun.shared_status import doing


@dataclass(frozen=True)
class Info:
    """A request for the description of a model.

    Args:
      model: a file, `scene:NAME`, another source, or a compiled model. It is not changed.
      sections: some of `mjrun.model.description.model_description.SECTIONS`; all of them if empty.
    """

    model: ModelLike
    sections: Sequence[str] = ()

    def run(self, reporter: Reporter | None = None) -> "InfoResult":
        """Loads the model and describes it.

        Raises:
          UnknownNameError: a section does not exist; the model is not loaded.
          ModelError: the model cannot be loaded.
        """
        reporter = reporter or WarningReporter()
        for name in self.sections:
            if name not in SECTIONS:
                raise UnknownNameError("section", name, SECTIONS)
        sections = tuple(dict.fromkeys(self.sections)) or SECTIONS
        with doing("simulating"), collected_warnings() as warnings:
            source = source_of(self.model)
            description = ModelDescription(source.load(), source.main_file)
            for name in sections:
                description.section(name)  # computed here, so that warnings are collected
        bugs = known_bugs.bugs_of_model(description.model)
        for text in bugs:
            reporter.warn(text)
        pass_on(warnings, reporter)
        return InfoResult(description, sections, (*bugs, *warnings))


@dataclass(frozen=True)
class InfoResult:
    """The description of a model.

    Attributes:
      description: the description, with an attribute for each section.
      sections: the names of the requested sections, in order.
      warnings: MuJoCo's warnings, and those about its known bugs that affect the model.
    """

    description: ModelDescription
    sections: Sequence[str]
    warnings: Sequence[str]

    def document(self) -> dict[str, Any]:
        """Returns the sections by name, and `warnings`, as a JSON object; numbers that are not finite become null."""
        sections = {name: _plain(self.description.section(name)) for name in self.sections}
        return {**sections, "warnings": list(self.warnings)}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
