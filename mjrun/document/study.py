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

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TypeVar, cast

from mjrun.document.builder import DocumentContext, Values
from mjrun.document.run_writer import plain_options, plain_value, simulation_document, text_of
from mjrun.document.simulation_document import LoadedDocument, SimulationDocumentReader
from mjrun.document.tree import (
    DocumentFault,
    DocumentPlace,
    Mapped,
    MappingNode,
    Node,
    document_error,
    node_of,
    violation_faults,
)
from mjrun.errors import FileError, UsageError, clean, option, quoted
from mjrun.formats.input_file import opened
from mjrun.formats.local_and_remote_folders import folder_at, opened_at, written_file
from mjrun.formats.output_writer import publish_together
from mjrun.options.kinds import ChoiceKind, Kind, ReadingContext, TextKind
from mjrun.options.option import Options, document_options, options, required
from mjrun.options.report import PageOptions
from mjrun.options.schema_validation import InvalidValueError, Schema, SchemaViolationCollector, SchemaViolationError
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.options.structured_kinds import OptionsMappingKind
from mjrun.options.sweep import MANIFEST, MOST_POINTS, PLANS
from mjrun.study.job_plan import SCHEMA, JobPlan
from mjrun.study.study import Study
from mjrun.suffixes import is_url

LARGEST = 2**26  # bytes per line

V = TypeVar("V")


@options
class _StudyOptions(Study, SimulationOptions):
    """A simulation, its variations and its metrics."""


STUDY = SimulationDocumentReader("Study", Study, _StudyOptions, Study)


def read_study(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    values: Mapping[str, object] | None = None,
    code: CodeOptions | None = None,
    command: str = "",
) -> LoadedDocument[Study]:
    """Reads the study document at `path`; by default, its folder has the name of the document.

    Args:
      assignments: `key=value` from the command line, such as `samples=8` or `vary.opt.timestep=1e-3,2e-3`, which
        override the document.
      values: options of a study that override the document's, such as its `output` or its execution.
      code: options that a document cannot contain.
      command: the command line, for manifests.

    Raises:
      DocumentError: the document, one that it names or an assignment is faulty; all faults are listed.
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
    if study.controllers:
        raise UsageError(f"{option('vary')} controller: a document cannot contain code; give it on the command line")
    return {**simulation_document(study.simulation), **plain_options(study)}


class _MovedReader(DocumentContext):
    """A reader of a document that will be written to another folder; output paths are unchanged."""

    def output(self, path: str) -> str:
        return path


def portable_document(study: Study, folder: str | Path) -> Mapped:
    """Returns the study as a document in `folder`, without its output.

    In a store, which is nowhere in the file system, its paths are relative to the current folder.

    Raises:
      UsageError: a document cannot represent the study.
    """
    document = study_document(replace(study, output="study", html=None, embed_up_to=PageOptions.embed_up_to))
    if document["model"] == "-":
        raise UsageError("a study cannot be resumed with a model from standard input; give a file")
    reader = _MovedReader(Path() if is_url(folder) else Path(os.path.relpath(Path.cwd(), folder)), lexical=True)
    values = cast("Values", STUDY.record.read(document, reader))
    moved: Mapped = {"model": reader.model(str(document["model"]))}
    for each in document_options(_StudyOptions):
        if each.attribute in values and each.name != "output":
            moved[each.key] = plain_value(each.kind, each.kind(values[each.attribute]))
    return moved


def with_document(study: Study) -> Study:
    """Returns the study with its document for the manifest, if a document can represent it."""
    with suppress(UsageError):
        return replace(study, document=portable_document(study, study.output))
    return study


class _PlainValueKind(Kind[V, V]):
    """Plain values with a rule of JSON Schema; an empty rule accepts everything."""

    def __init__(self, rule: Schema) -> None:
        super().__init__()
        self._rule = rule

    @property
    def form(self) -> Schema:
        return self._rule

    def __call__(self, value: V) -> V:
        return value


STRING: Schema = {"type": "string"}
RANGE: Schema = {"type": "array", "items": {"type": "integer"}}


@options
class _PlannedStudy(Options):
    """A plan."""

    format: str = required(converter=ChoiceKind((SCHEMA,)), key="schema", help="Format of the plan.")
    folder: str = required(converter=TextKind(), help="Folder of the study.")
    study: object = required(converter=_PlainValueKind[object]({}), help="Study, as a document.")
    identity: Mapping[str, str] = required(
        converter=_PlainValueKind[Mapping[str, str]]({"type": "object", "additionalProperties": STRING}),
        help="Versions of the programs, and hashes of everything that determines the results.",
    )
    ranges: Sequence[Sequence[int]] = required(
        converter=_PlainValueKind[Sequence[Sequence[int]]]({"type": "array", "items": RANGE}),
        help="Ranges of points: the first point, and that after the last.",
    )


LINE = OptionsMappingKind(_PlannedStudy, _PlannedStudy)


def write_plan(path: str, plan: JobPlan) -> None:
    """Writes a plan, a line of JSON, together with the manifest of the study: both or neither.

    Raises:
      FileError: the plan cannot be written.
    """
    folder = Path(path).parent
    study = portable_document(plan.study, folder)
    home = plan.study.output if is_url(plan.study.output) else os.path.relpath(plan.study.output, folder)
    about = {"schema": SCHEMA, "folder": home, "study": study, "identity": plan.identity, "ranges": plan.ranges}
    text = f"{json.dumps(about)}\n" if plan.ranges else ""
    with written_file(Path(path), text.encode()) as output, plan.study.manifest_writer({}) as manifest:
        publish_together([output, manifest])


def read_plan(path: str, given: Mapping[str, object] | None = None) -> JobPlan | None:
    """Reads a plan; returns None if it has no points.

    Args:
      given: options of the study that override the plan's, such as its execution.

    Raises:
      DocumentError: the file is not a plan.
      UsageError: the plan names a folder that it must not write to.
      FileError: the file cannot be read.
    """
    with opened(Path(path), "plan", PLANS) as file:
        lines = [(number, text) for number, text in enumerate(file, 1) if text.strip()]
    if not lines:
        return None
    plan = _line(path, *lines[0])
    if len(lines) > 1:
        raise document_error([DocumentFault(DocumentPlace(0, lines[1][0], 1, path), "", "a plan is one line")])
    folder = Path(path).parent
    values = dict(given or {})
    if "output" not in values:
        values["output"] = _study_folder(folder, plan.folder)
    study = _study(path, cast("Mapping[str, object]", plan.study), folder, values)
    return JobPlan(study, plan.identity, [(first, stop) for first, stop in plan.ranges])


def read_folder(path: str, given: Mapping[str, object] | None = None) -> Study:
    """Reads the study in a folder from its manifest.

    Raises:
      DocumentError: the manifest does not contain a study.
      FileError: the manifest cannot be read.
    """
    manifest = folder_at(path).path(MANIFEST)
    with opened_at(manifest, "manifest of a study", [".json"]) as file:
        text = file.read(LARGEST)
    try:
        study = json.loads(text).get("study")
    except (ValueError, AttributeError, RecursionError):
        study = None
    if study is None:  # no document describes code, a model in memory or one on standard input; mjrun.Study writes none
        hint = "give the study's document instead, or repeat the command or the Python code that wrote the folder"
        raise FileError(manifest, "does not contain a study", hint)
    return _study(manifest, study, Path() if is_url(path) else Path(path), {"output": path, **(given or {})})


def _study_folder(folder: Path, path: str) -> str:
    """Returns the folder of a study that a plan in `folder` names, or its URL.

    Raises:
      UsageError: the folder is outside of the plan's and is not a study: a plan is untrusted and must not write there.
    """
    study = path if is_url(path) else os.path.normpath(folder / path)
    outside = is_url(path) or Path(path).is_absolute() or Path(os.path.normpath(path)).parts[:1] == (os.pardir,)
    if outside and not folder_at(study).has(MANIFEST):
        raise UsageError(
            f"{option('output')}: the plan names {quoted(study)}, outside of the plan's folder and not a study\n"
            f"to write the results there, give {option('output')} DIR"
        )
    return study


def _line(path: str, number: int, text: bytes) -> _PlannedStudy:
    mark = DocumentPlace(0, number, 1, path)
    try:
        value = json.loads(text[:LARGEST])
        tree = node_of(value, mark)
    except (ValueError, RecursionError) as error:
        raise document_error([DocumentFault(mark, "", f"not JSON: {clean(str(error))}")]) from None
    line = _read(LINE, value, tree, ReadingContext())
    ends = [end for each in line.ranges for end in each]
    is_ascending = all(one < other for one, other in pairwise([-1, *ends, MOST_POINTS + 1]))
    if not is_ascending or any(len(each) != 2 for each in line.ranges):
        raise document_error(
            [DocumentFault(mark, "ranges", "expected ascending pairs: the first point, that after the last")]
        )
    return line


def _study(path: str, value: object, folder: Path, given: Mapping[str, object]) -> Study:
    """Returns the study in `value`, a document in `folder`."""
    tree = node_of(value, DocumentPlace(0, 1, 1, path))
    folders = DocumentContext(folder, lexical=True)
    document = _read(STUDY.record, value, tree, folders)
    assert isinstance(tree, MappingNode)
    return STUDY.made(tree, folders, document, {}, given, CodeOptions())


def _read(record: OptionsMappingKind[V], value: object, tree: Node, reader: ReadingContext) -> V:
    """Reads plain values by `record`.

    Raises:
      DocumentError: the document is faulty; all faults are listed.
    """
    try:
        return cast("V", record.read(value, reader))
    except (SchemaViolationError, InvalidValueError) as error:
        top = SchemaViolationCollector()
        with top.at():
            raise error
        raise document_error(violation_faults(top.all, tree)) from None
