"""The study document: a simulation, what varies in it, and what is measured.

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
    """A simulation, and what varies in it."""


STUDY = SimulationDocument("Study", Study, _StudyOptions, Study)


def read_study(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    values: Mapping[str, object] | None = None,
    code: CodeOptions | None = None,
    command: str = "",
) -> Request[Study]:
    """The study that the document at `path` asks for; its folder is called as the document if nothing else is said.

    Args:
      assignments: `key=value` from the command line, such as `samples=8` or `vary.opt.timestep=1e-3,2e-3`, over what is
        written.
      values: options of a study that count instead of the document's, such as its `output`, or how it runs.
      code: what a document cannot hold.
      command: the command line, for manifests.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    values = {**(values or {}), "command": command}
    return STUDY.read(path, assignments, values, {"output": Path(path).stem}, code or CodeOptions())


def study_text(study: Study, command: str = "") -> str:
    """The study document of `study`; it holds what is not the default, and not how this machine runs it.

    Args:
      command: what made the study, for a comment.

    Raises:
      UsageError: a document cannot hold this: code, a compiled model, a folder outside of the current one.
    """
    return text_of(study_document(study), command)


def study_document(study: Study) -> Mapped:
    """The same as plain values."""
    return {**simulation_document(study.simulation), **plain_options(study)}


class _MovedReader(DocumentReader):
    """Reads a document for another that is written elsewhere; outputs stay as they are written."""

    def output(self, path: str) -> str:
        return path


def portable_document(study: Study, folder: Path) -> Mapped:
    """The study as a document in `folder`, without its output.

    Raises:
      UsageError: no document can hold it.
    """
    document = study_document(replace(study, output="study"))
    if document["model"] == "-":
        raise UsageError("a model from standard input is gone when its study is read again; give a file")
    reader = _MovedReader(Path(os.path.relpath(Path.cwd(), folder)), OutputFolder(folder), lexical=True)
    values = cast("Values", STUDY.record.read(document, reader))
    moved: Mapped = {"model": reader.model(str(document["model"]))}
    for each in document_options(_StudyOptions):
        if each.attribute in values and each.name != "output":
            moved[each.key] = plain_value(each.kind, each.kind(values[each.attribute]))
    return moved
