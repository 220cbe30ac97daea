"""The task document: a model, and what a policy observes, does and is rewarded for in it.

```yaml
model: car.xml
control_dt: 0.02
duration: 5
reset:
  noise: {qpos/car/x: "uniform(-0.1, 0.1)"}
observations:
  - {name: position, probe: xpos/car}
  - {name: wheels, joints: [left, right], of: qvel, scale: 0.1}
actions:
  - {actuators: [forward, turn], squash: tanh}
rewards:
  distance: exp(-norm(xpos/car/x + 1, xpos/car/y - 4))
terminations:
  lost: {when: abs(xpos/car/y) > 10, as: failure}
```
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar, cast

from pydantic import Field, Tag

from mjrun.confinement.confinement import is_readable
from mjrun.document.builder import NAMED, DocumentBuilder, fault_at
from mjrun.document.document_model import MAPPING, MODEL, NUMBER, TEXT, Key, Name, Omittable, by_type
from mjrun.document.option_models import OptionsModel, options_model
from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.reader import LARGEST, document_error, read_placed
from mjrun.document.tree import MappingNode, Mark
from mjrun.document.tree import Path as Place
from mjrun.document.yaml_parser import compose
from mjrun.document.yaml_writer import number
from mjrun.errors import FileError, UsageError, quoted
from mjrun.formats.input_file import opened
from mjrun.model.override import overrides_of
from mjrun.model.source import Source
from mjrun.model.sources import names_task, parse_source
from mjrun.model.sources.bundled_scene import bundled_task
from mjrun.options.model import ModelOptions
from mjrun.options.option import Options, options, options_of
from mjrun.options.task import PARTS, TaskOptions
from mjrun.suffixes import YAML
from mjrun.task.task import Task
from mjrun.task.terms import Action, Command, Observation, Reset, Reward, Termination

Made = TypeVar("Made")


@options
class _Overrides(ModelOptions):
    """What a document overrides in the model of its task."""


def _task_model() -> type[OptionsModel]:
    source = Field(description=MODEL)
    reset, observation, action, command, reward, termination = (
        options_model(declared, name=declared.section) for _, declared in PARTS.values()
    )
    reward_or_expression = Annotated[
        Annotated[Name, Tag(TEXT)] | Annotated[float, Tag(NUMBER)] | Annotated[reward, Tag(MAPPING)],
        by_type("an expression, or a mapping with value and weight", TEXT, NUMBER, MAPPING),
    ]
    keys: dict[str, Key] = {
        "reset": (Omittable[reset], Field(None, description="How an episode starts.")),
        "observations": (
            Annotated[list[observation], Field(min_length=1)],
            Field(description="What the policy observes: terms in the order of its input."),
        ),
        "actions": (
            Annotated[list[action], Field(min_length=1)],
            Field(description="What the policy does: groups of actuators or joints in the order of its output."),
        ),
        "commands": (dict[Name, command], Field({}, description="What the policy is told to do, by name.")),
        "rewards": (
            dict[Name, reward_or_expression],
            Field({}, description="What is summed up as the reward of a period."),
        ),
        "terminations": (
            dict[Name, termination],
            Field({}, description="What ends an episode, by name; the first that holds counts."),
        ),
    }
    return options_model(TaskOptions, name="Task", first={"model": (Name, source)}, last=keys)


TaskDocument = _task_model()
TaskDocument.__doc__ = "A model, and what a policy observes, does and is rewarded for in it."


@dataclass(frozen=True)
class DocumentPlaces:
    """Where a document says what its task is.

    Attributes:
      tree: the document as it is written.
    """

    tree: MappingNode

    def located(self, error: UsageError) -> UsageError:
        """`error` at its line; as it is if the document does not say what it is about."""
        if not error.path or error.path[0] not in self.tree.entries:
            return error
        return document_error([fault_at(self.tree, (), error, declared_at)])


def read_task(path: Path | str, assignments: Sequence[str] = ()) -> Task:
    """The task in the document at `path`, or in that of the gallery which `scene:NAME` names.

    The model and other files are relative to the folder of the document. Errors that only the model brings to light,
    such as joints that it does not have, are told at the document's lines too when the task is first used.

    Args:
      assignments: `key=value` from the command line, such as `duration=2` or `reset.key=home`, over what is written.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    bundled = bundled_task(str(path))
    file = bundled or Path(path)
    document, tree = read_placed(file, TaskDocument, assignments, variables=True, named=NAMED)
    folders = Folders(file.parent, OutputFolder(Path()))
    return _Builder(tree, folders, declared_at).task(document, file, str(path) if bundled else "")


def task_or_model(text: str) -> Task | str:
    """What stands where a model stands: the task that `text` names, or `text` itself."""
    return read_task(text) if names_task(text) else text


def is_task(path: Path | str) -> bool:
    """Whether the document at `path` is one of a task: it says what is observed."""
    if not is_readable(path):
        return False  # as below
    try:
        with opened(Path(path), "document", YAML) as file:
            text = file.read(LARGEST).decode("utf-8-sig")
    except (FileError, OSError, UnicodeDecodeError):
        return False  # whoever reads it is told why
    node, _ = compose(text, lambda index: Mark(0, 0, 0, str(path)))
    return isinstance(node, MappingNode) and "observations" in node.entries


class _Builder(DocumentBuilder):
    """Builds a task from what a document holds."""

    def task(self, document: OptionsModel, path: Path, name: str) -> Task:
        values = self.values(TaskOptions, document, ())
        model_options = {each.name for each in options_of(ModelOptions)}
        settings = {name: values.pop(name) for name in model_options & set(values)}
        overrides = self.attempt((), lambda: overrides_of(cast("Callable[..., _Overrides]", _Overrides)(**settings)))

        values |= {
            "model": self.attempt((), lambda: self._model(document)),
            "overrides": overrides,
            "observations": self._listed(document, "observations", Observation),
            "actions": self._listed(document, "actions", Action),
            "commands": self._named(document, "commands", Command),
            "rewards": self._named(document, "rewards", Reward),
            "terminations": self._named(document, "terminations", Termination),
            "reset": self._reset(document),
        }
        self.raise_faults()
        made = cast("Callable[..., Task]", Task)
        task = self.attempt((), lambda: made(**values, path=path, name=name, places=DocumentPlaces(self.tree)))
        self.raise_faults()
        assert task
        return task

    def _model(self, document: OptionsModel) -> Source:
        written: str = document.model_dump(include={"model"})["model"]
        if names_task(written):
            raise UsageError(f"{quoted(written)} is a document; a task is made of a model", ("model",))
        return parse_source(self.folders.model(written))

    def _reset(self, document: OptionsModel) -> Reset | None:
        entry: OptionsModel | None = getattr(document, "reset")  # noqa: B009
        return None if entry is None else self._part(cast("Callable[..., Reset]", Reset), entry, ("reset",))

    def _listed(self, document: OptionsModel, key: str, kind: Callable[..., Made]) -> list[Made | None]:
        return [self._part(kind, entry, (key, index)) for index, entry in enumerate(getattr(document, key))]

    def _named(self, document: OptionsModel, key: str, kind: Callable[..., Made]) -> dict[str, Made | None]:
        entries: Mapping[str, OptionsModel | str | float] = getattr(document, key)
        return {name: self._part(kind, entry, (key, name)) for name, entry in entries.items()}

    def _part(self, kind: Callable[..., Made], entry: OptionsModel | str | float, place: Place) -> Made | None:
        """A part of the task; None if it is wrong, which is noted. An expression alone is the value of a reward."""
        if not isinstance(entry, OptionsModel):
            return self.attempt(place, lambda: kind(value=str(entry if isinstance(entry, str) else number(entry))))
        faults = self.fault_count
        values = self.values(entry.declared, entry, place)
        return None if self.fault_count > faults else self.attempt(place, partial(kind, **values))


def declared_at(place: Place) -> type[Options]:
    """The options that stand at a place of a task document."""
    return PARTS[str(place[0])][1] if place else TaskOptions
