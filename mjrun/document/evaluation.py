"""The evaluation document: a task, who plays it, and what is asked of its episodes.

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

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import cast

from pydantic import Field

from mjrun.document.builder import NAMED, DocumentBuilder, located_errors
from mjrun.document.document_model import Key, Name
from mjrun.document.option_models import OptionsModel, SettingText, option_keys, options_model
from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.reader import read_placed
from mjrun.document.simulation_document import Request
from mjrun.document.task import read_task
from mjrun.document.tree import Path as Place
from mjrun.errors import UsageError, clean, concerning
from mjrun.evaluation.evaluation import Evaluation
from mjrun.evaluation.prepared import Rewritten
from mjrun.model.source import Source
from mjrun.model.sources import names_task, parse_source
from mjrun.options.evaluation import EvaluationOptions
from mjrun.options.option import Options, options

TASK = (
    "The task: a document, relative to the folder of this one; one of ours, such as scene:car_drive; or an environment "
    "of Gymnasium's, gym:Walker2d-v5."
)
CHANGES = "Values of the task's document that are others here, by their paths: duration, observations[0].noise."
NO_CHANGES: Mapping[str, str] = {}


class EvaluationRequest(Request[Evaluation]):
    """An evaluation that a document asks for, and where it does.

    Attributes:
      changes: `key=value`, what it changes in the document of the task.
    """

    def __init__(
        self, made: Evaluation, located: Callable[[], AbstractContextManager[None]], changes: Sequence[str]
    ) -> None:
        super().__init__(made, located)
        self.changes = changes


@options
class _NoOptions(Options):
    """What the model of documents begins with, as the task comes first."""


def _evaluation_model() -> type[OptionsModel]:
    nothing: dict[str, str] = {}
    first: dict[str, Key] = {
        "task": (Name, Field(description=TASK)),
        "changes": (dict[str, SettingText], Field(nothing, description=CHANGES)),
    }
    model = options_model(_NoOptions, name="Evaluation", first=first, last=option_keys(EvaluationOptions, ["output"]))
    model.declared = EvaluationOptions
    return model


EvaluationDocument = _evaluation_model()
EvaluationDocument.__doc__ = "A task, who plays it, and what is asked of its episodes."


def read_evaluation(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    values: Mapping[str, object] | None = None,
    command: str = "",
) -> EvaluationRequest:
    """The evaluation that the document at `path` asks for; its folder is called as the document if nothing is said.

    Files that are read are relative to the folder of the document, the folder of results to the current one.

    Args:
      assignments: `key=value` from the command line, such as `episodes=20` or `changes.duration=2`, over what is
        written.
      values: options that count instead of the document's, such as its `policy`.
      command: the command line, for the manifest.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    document, tree = read_placed(path, EvaluationDocument, assignments, variables=True, named=NAMED)
    folders = Folders(Path(path).parent, OutputFolder(Path()))
    builder = DocumentBuilder(tree, folders, _declared_at)
    written = document.model_dump(include={"task", "changes"})
    changes = [f"{key}={text}" for key, text in cast("Mapping[str, str]", written["changes"]).items()]
    chosen = {"output": f"{Path(path).stem}_eval", **builder.values(EvaluationOptions, document, ())}
    chosen |= {**(values or {}), "command": command}

    def make() -> Evaluation:
        with concerning("task"):
            task, rewritten = evaluated_task(folders.model(written["task"]), changes)
        return Evaluation(task=task, rewritten=rewritten, **chosen)  # type: ignore[arg-type]

    builder.raise_faults()
    made = builder.attempt((), make)
    builder.raise_faults()
    assert made is not None
    return EvaluationRequest(made, lambda: located_errors(tree, _declared_at), changes)


def evaluated_task(text: str, assignments: Sequence[str]) -> tuple[Source, Rewritten | None]:
    """The task that `text` names, with values of its document changed, and what makes it with more of them changed.

    Raises:
      UsageError: values are to be changed, and `text` names no document.
      DocumentError: with everything that is wrong in the document.
      FileError: it is not there, or cannot be read.
    """
    if names_task(text):
        return _read(text, assignments), partial(_read, text, assignments)
    if assignments:
        raise UsageError(f"{clean(assignments[0])}: {clean(text)} is no document whose values could be changed")
    return parse_source(text), None


def _read(path: str, assignments: Sequence[str], changes: Mapping[str, str] = NO_CHANGES) -> Source:
    return read_task(path, [*assignments, *(f"{name}={text}" for name, text in changes.items())])


def _declared_at(place: Place) -> type[Options]:
    """The options of an evaluation document, all of which stand at its top."""
    return EvaluationOptions
