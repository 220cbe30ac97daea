"""The study document: a simulation, its variations and its metrics.

```yaml
model: chaotic_pendulum.xml
duration: 10
vary:
  opt.timestep: {from: 1e-4, to: 1e-2, count: 5, log: true}
  qvel/root: [9, 10, 11]
metrics:
  drift: max(abs(energy/drift))
require: max(drift) < 0.5
```
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

from mjrun.document.builder import Values
from mjrun.document.forms import DocumentReader
from mjrun.document.output_folder import OutputFolder
from mjrun.document.run_writer import plain_options, plain_value, simulation_document, text_of
from mjrun.document.simulation_document import Request, SimulationDocument
from mjrun.document.tree import Mapped
from mjrun.errors import UsageError
from mjrun.options.option import document_options, options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.study.study import Study


@options
class _StudyOptions(Study, SimulationOptions):
    """A simulation, its variations and its metrics."""


STUDY = SimulationDocument("Study", Study, _StudyOptions, Study)


def read_study(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    values: Mapping[str, object] | None = None,
    code: CodeOptions | None = None,
    command: str = "",
) -> Request[Study]:
    """Reads the study document at `path`; by default, its folder has the name of the document.

    Args:
      assignments: `key=value` from the command line, such as `samples=8` or `vary.opt.timestep=1e-3,2e-3`, which
        override the document.
      values: options of a study that override the document's, such as its `output` or its execution.
      code: options that a document cannot contain.
      command: the command line, for manifests.

    Raises:
      DocumentError: with all faults in the document, the documents that it names, and the assignments.
      FileError: one of them is missing or cannot be read.
    """
    values = {**(values or {}), "command": command}
    return STUDY.read(path, assignments, values, {"output": Path(path).stem}, code or CodeOptions())


def study_text(study: Study, command: str = "") -> str:
    """Formats `study` as a study document, without default values and without execution options.

    Args:
      command: the command that made the study, for a comment.

    Raises:
      UsageError: a document cannot contain this: code, a compiled model, a folder outside of the current one.
    """
    return text_of(study_document(study), command)


def study_document(study: Study) -> Mapped:
    """Returns the study document as plain values."""
    return {**simulation_document(study.simulation), **plain_options(study)}


class _MovedReader(DocumentReader):
    """Reads a document that will be written to another folder; output paths are unchanged."""

    def output(self, path: str) -> str:
        return path


def portable_document(study: Study, folder: Path) -> Mapped:
    """Returns the study as a document in `folder`, without its output.

    Raises:
      UsageError: a document cannot represent the study.
    """
    document = study_document(replace(study, output="study"))
    if document["model"] == "-":
        raise UsageError("a study cannot be resumed with a model from standard input; give a file")
    reader = _MovedReader(Path(os.path.relpath(Path.cwd(), folder)), OutputFolder(folder), lexical=True)
    values = cast("Values", STUDY.record.read(document, reader))
    moved: Mapped = {"model": reader.model(str(document["model"]))}
    for each in document_options(_StudyOptions):
        if each.attribute in values and each.name != "output":
            moved[each.key] = plain_value(each.kind, each.kind(values[each.attribute]))
    return moved
