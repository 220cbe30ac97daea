"""The evaluation document: a task, its policies, and criteria for the episodes.

```yaml
task: car_drive.yaml
changes: {duration: 4}
policy: policies/car_drive.onnx
compare: random
episodes: 200
metrics: {effort: mean(abs(ctrl/forward))}
fail_below: {success: 0.9}
```
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import cast

from mjrun.document.builder import DocumentContext, DocumentValueBuilder, Values, located_errors, merged_values
from mjrun.document.reader import read
from mjrun.document.run_writer import plain_options, plain_value, text_of
from mjrun.document.simulation_document import LoadedDocument
from mjrun.document.task import read_task
from mjrun.document.tree import DocumentPath, Mapped
from mjrun.errors import UsageError, clean, concerning, option
from mjrun.evaluation.evaluation import Evaluation
from mjrun.evaluation.prepared import Rewritten
from mjrun.formats.input_file import is_folder
from mjrun.model.source import ModelSource
from mjrun.model.sources import is_task_name, parse_source
from mjrun.options.evaluation import EvaluationOptions
from mjrun.options.kinds import TextKind
from mjrun.options.option import Options, document_key
from mjrun.options.setting_kinds import SettingsKind
from mjrun.options.structured_kinds import OptionsMappingKind

TASK = (
    "Task: a document, relative to the folder of this one; a task of the gallery, such as scene:car_drive; or an "
    "environment of Gymnasium, gym:Walker2d-v5."
)
CHANGES = "Changed values of the task's document, by their paths: duration, observations[0].noise."
NO_CHANGES: Mapping[str, str] = {}


class _EvaluationOptions(EvaluationOptions):
    """A task, its policies, and criteria for the episodes."""


EVALUATION = OptionsMappingKind[Values](
    _EvaluationOptions,
    dict,
    name="Evaluation",
    more=[
        document_key("task", TextKind(), TASK, dataclasses.MISSING),
        document_key("changes", SettingsKind(), CHANGES, ()),
    ],
    optional=["output"],
    is_partial=True,
)


class LoadedEvaluationDocument(LoadedDocument[Evaluation]):
    """An evaluation document that was read, with a context that locates its errors.

    Attributes:
      changes: assignments `key=value` to the document of the task.
    """

    def __init__(
        self, made: Evaluation, located: Callable[[], AbstractContextManager[None]], changes: Sequence[str]
    ) -> None:
        super().__init__(made, located)
        self.changes = changes


def read_evaluation(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    values: Mapping[str, object] | None = None,
    command: str = "",
) -> LoadedEvaluationDocument:
    """Reads the evaluation document at `path`; by default, its folder has the name of the document.

    Input files are relative to the folder of the document, the output folder is relative to the current one.

    Args:
      assignments: `key=value` from the command line, such as `episodes=20` or `changes.duration=2`, which override the
        document.
      values: options that override the document's, such as its `policy`.
      command: the command line, for the manifest.

    Raises:
      DocumentError: the document, one that it names or an assignment is faulty; all faults are listed.
      FileError: one of them is missing or cannot be read.
    """
    folders = DocumentContext(Path(path).parent)
    document, tree = read(path, EVALUATION, folders, assignments, variables=True)
    values = {**(values or {}), "command": command}
    builder = DocumentValueBuilder(tree, folders, _declared_at, values)
    changed = SettingsKind()(cast("Mapping[str, object]", document.get("changes", {})))
    changes = [f"{key}={text}" for key, text in changed]
    chosen = {"output": f"{Path(path).stem}_eval"}
    chosen |= merged_values(EvaluationOptions, tree, document, values)

    def make() -> Evaluation:
        with concerning("task"):
            task, rewritten = evaluated_task(folders.model(str(document["task"])), changes)
        return Evaluation(task=task, rewritten=rewritten, **chosen)  # type: ignore[arg-type]

    made = builder.made(make)
    return LoadedEvaluationDocument(made, lambda: located_errors(tree, folders, _declared_at, values), changes)


def evaluated_task(text: str, assignments: Sequence[str]) -> tuple[ModelSource, Rewritten | None]:
    """Returns the task that `text` names, with changed values, and a function that makes it with further changes.

    Raises:
      UsageError: `text` names a folder, or there are assignments, and it does not name a document.
      DocumentError: the document is faulty; all faults are listed.
      FileError: the document is missing or cannot be read.
    """
    if is_task_name(text):
        return _read(text, assignments), partial(_read, text, assignments)
    if is_folder(text):
        raise UsageError(
            f"{clean(text)} is a folder, not a task\ntasks are task documents (.yaml), included ones such as "
            f"scene:car_drive, and Gymnasium environments (gym:ID); {option('output')} FOLDER continues an evaluation"
        )
    if assignments:
        raise UsageError(f"{clean(assignments[0])}: {clean(text)} is not a document, so KEY=VALUE cannot change it")
    return parse_source(text), None


def _read(path: str, assignments: Sequence[str], changes: Mapping[str, str] = NO_CHANGES) -> ModelSource:
    return read_task(path, [*assignments, *(f"{name}={text}" for name, text in changes.items())])


def _declared_at(place: DocumentPath) -> type[Options]:
    """Returns the options of an evaluation document, which are all at its top level."""
    return EvaluationOptions


def evaluation_text(evaluation: Evaluation, changes: Sequence[str] = (), command: str = "") -> str:
    """Formats `evaluation` as an evaluation document, without defaults and without execution options.

    Args:
      changes: assignments `key=value` to the document of its task.
      command: the command that made the evaluation, for a comment.

    Raises:
      UsageError: a document cannot contain this: code, or a folder outside of the current one.
    """
    pairs = dict(change.split("=", 1) for change in changes)  # as for the task, the last value of a key applies
    changed: Mapped = {"changes": plain_value(SettingsKind(), [*pairs.items()])} if pairs else {}
    return text_of({"task": evaluation.task.text, **changed, **plain_options(evaluation)}, command)
