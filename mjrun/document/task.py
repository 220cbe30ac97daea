"""The task document: a model, and the observations, actions and rewards of a policy.

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

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

from mjrun.confinement.confinement import is_readable
from mjrun.dataclass import dataclass
from mjrun.document.builder import MODEL, DocumentContext, DocumentValueBuilder, Values, values_of
from mjrun.document.reader import read, unchecked_document
from mjrun.document.tree import DocumentPath, MappingNode, document_error, locate_file, number, option_fault
from mjrun.errors import UnknownNameError, UsageError, quoted
from mjrun.model.override import overrides_of
from mjrun.model.source import ModelSource
from mjrun.model.sources import is_file, is_task_name, parse_source
from mjrun.model.sources.bundled_scene import bundled_task, bundled_task_names
from mjrun.options.kinds import TextKind
from mjrun.options.model import ModelOptions
from mjrun.options.number_kinds import RealKind
from mjrun.options.option import Options, document_key, options, options_of
from mjrun.options.structured_kinds import ListKind, MappingKind, OneOfKind, OptionsMappingKind
from mjrun.options.task import PARTS, TaskOptions
from mjrun.suffixes import YAML
from mjrun.task.task import Action, Command, LocatableError, Observation, Reset, Reward, Task, Termination

Made = TypeVar("Made")


@options
class _Overrides(ModelOptions):
    """Overrides of the task's model."""


class _TaskOptions(TaskOptions):
    """A model, and the observations, actions and rewards of a policy."""


def _part(key: str) -> OptionsMappingKind[Values]:
    declared = PARTS[key][1]
    return OptionsMappingKind[Values](declared, dict, name=declared.section)


_REWARD = OneOfKind[object, object](
    "an expression, or a mapping with value and weight",
    string=TextKind(),
    number=RealKind(least=None),
    object=_part("rewards"),
)
TASK = OptionsMappingKind[Values](
    _TaskOptions,
    dict,
    name="Task",
    more=[
        MODEL,
        document_key("reset", _part("reset"), "Initial state of an episode."),
        document_key(
            "observations",
            ListKind[Values](_part("observations"), least=1),
            "Observations of the policy: terms in the order of its input.",
            dataclasses.MISSING,
        ),
        document_key(
            "actions",
            ListKind[Values](_part("actions"), least=1),
            "Actions of the policy: groups of actuators or joints in the order of its output.",
            dataclasses.MISSING,
        ),
        document_key("commands", MappingKind[Values](_part("commands")), "Commands to the policy, by name.", {}),
        document_key("rewards", MappingKind[Values](_REWARD), "Terms whose sum is the reward of a control period.", {}),
        document_key(
            "terminations",
            MappingKind[Values](_part("terminations")),
            "Conditions that end an episode, by name; the first true one applies.",
            {},
        ),
    ],
)


@dataclass(frozen=True)
class _TaskDocumentPlaces:
    """The places of a task's parts in its document.

    Attributes:
      tree: the document with the places of its values.
      folder: the folder of the document.
    """

    tree: MappingNode
    folder: Path

    def located(self, error: LocatableError) -> LocatableError:
        """Returns `error` at its line; unchanged if the document does not contain its subject."""
        if not isinstance(error, UsageError):
            locate_file(self.tree, DocumentContext(self.folder).input, error)
            return error
        if not error.path or error.path[0] not in self.tree.entries or self._lacks_setting(error.path):
            return error
        return document_error([option_fault(self.tree, (), error, declared_at)])

    def _lacks_setting(self, path: DocumentPath) -> bool:
        """Returns whether `path` is that of a setting from elsewhere: the command line, another document, a study."""
        settings = self.tree.entries[str(path[0])]
        return path[0] == "set" and isinstance(settings, MappingNode) and not {*path[1:2]} <= settings.entries.keys()


def read_task(path: Path | str, assignments: Sequence[str] = ()) -> Task:
    """Reads the task document at `path`, or the one of the gallery that `scene:NAME` names.

    Files are relative to the folder of the document. Errors that only the model reveals, such as missing joints, are
    reported at the document's lines when the task is first used.

    Args:
      assignments: `key=value` from the command line, such as `duration=2` or `reset.key=home`, which override the
        document.

    Raises:
      DocumentError: the document, one that it names or an assignment is faulty; all faults are listed.
      FileError: one of them is missing or cannot be read.
      UnknownNameError: the path names a model in a collection, or an unknown task of the gallery.
    """
    bundled = bundled_task(str(path))
    if bundled is None and not is_file(str(path)):
        raise UnknownNameError("task", str(path), bundled_task_names())
    file = bundled or Path(path)
    folders = DocumentContext(file.parent)
    document, tree = read(file, TASK, folders, assignments, variables=True)
    return _Builder(tree, folders, declared_at).task(document, file, str(path) if bundled else "")


def task_or_model(text: str) -> Task | str:
    """Returns the task that `text` names, or else `text` itself, which names a model."""
    return read_task(text) if is_task_name(text) else text


def is_task(path: Path | str) -> bool:
    """Returns whether the document at `path` is a task document: it has observations."""
    root = unchecked_document(path, YAML) if is_readable(path) else None
    return root is not None and "observations" in root.entries


class _Builder(DocumentValueBuilder):
    """A builder of a task from the contents of a document."""

    def task(self, document: Values, path: Path, name: str) -> Task:
        values = values_of(TaskOptions, document)
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
        task = cast("Callable[..., Task]", Task)
        places = _TaskDocumentPlaces(self.tree, path.parent)
        return self.made(lambda: task(**values, path=path, name=name, places=places))

    def _model(self, document: Values) -> ModelSource:
        written = str(document["model"])
        if is_task_name(written):
            raise UsageError(f"{quoted(written)} is a document; a task requires a model", ("model",))
        return parse_source(self.folders.model(written))

    def _reset(self, document: Values) -> Reset | None:
        entry = document.get("reset")
        return None if entry is None else self._part(cast("Callable[..., Reset]", Reset), entry, ("reset",))

    def _listed(self, document: Values, key: str, kind: Callable[..., Made]) -> list[Made | None]:
        entries = cast("Sequence[object]", document[key])
        return [self._part(kind, entry, (key, index)) for index, entry in enumerate(entries)]

    def _named(self, document: Values, key: str, kind: Callable[..., Made]) -> dict[str, Made | None]:
        entries = cast("Mapping[str, object]", document.get(key, {}))
        return {name: self._part(kind, entry, (key, name)) for name, entry in entries.items()}

    def _part(self, kind: Callable[..., Made], entry: object, place: DocumentPath) -> Made | None:
        """Returns a part of the task, or None after collecting its fault. A reward may be an expression alone."""
        match entry:
            case dict():
                values = cast("Values", entry)
            case str():
                values = {"value": entry}
            case _:
                values = {"value": str(number(cast("float", entry)))}
        return self.attempt(place, partial(kind, **values))


def declared_at(place: DocumentPath) -> type[Options]:
    """Returns the options at a place of a task document."""
    return PARTS[str(place[0])][1] if place else TaskOptions
