"""Builds typed values from what a document holds, and tells what is wrong with them where it is written."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar, cast

from mjrun.document.option_models import OptionsModel, option_value
from mjrun.document.output_folder import Folders
from mjrun.document.reader import document_error
from mjrun.document.tree import Fault, ListNode, MappingNode, find, key_mark, path_text, plain, written_path
from mjrun.document.tree import Path as Place
from mjrun.errors import DocumentError, Problem, UsageError
from mjrun.options.kinds import Several
from mjrun.options.option import Options, document_options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.simulation.simulation import Simulation

# Places below which names stand that may hold dots.
NAMED = (
    *("set", "qpos", "qvel", "ctrl", "vary", "metrics", "free", "changes"),
    *("reset.qpos", "reset.qvel", "reset.ctrl", "reset.noise", "reset.set", "reset.vary"),
)
DeclaredAt = Callable[[Place], type[Options]]
T = TypeVar("T")


class DocumentBuilder:
    """Makes values from the options of a document, and collects what is wrong with them.

    Args:
      tree: the document as it is written.
      folders: where its relative paths lead.
      declared_at: the options that stand at a place.
    """

    def __init__(self, tree: MappingNode, folders: Folders, declared_at: DeclaredAt) -> None:
        self.tree, self.folders, self._declared_at = tree, folders, declared_at
        self._faults: list[Fault] = []
        self._others: list[Problem] = []  # in documents that this one names

    @property
    def fault_count(self) -> int:
        """How much is wrong so far."""
        return len(self._faults) + len(self._others)

    def raise_faults(self) -> None:
        """Raises DocumentError with everything that is wrong, if anything is."""
        if self.fault_count:
            raise document_error(self._faults, self._others)

    def simulation(self, document: OptionsModel, code: CodeOptions) -> Simulation:
        """The simulation at the top of a document, driven by `code`, which no document holds."""
        values = self.values(SimulationOptions, document, ())
        values |= {"controller": code.controller, "control_dt": code.control_dt, "trust": code.trust}
        from mjrun.document.task import task_or_model  # which builds a task

        text = self.folders.model(document.model_dump(include={"model"})["model"])
        simulation = cast("Callable[..., Simulation]", Simulation)
        return self.attempt((), lambda: simulation(task_or_model(text), **values)) or Simulation("")

    def values(self, declared: type[Options], entry: OptionsModel, place: Place) -> dict[str, object]:
        """What the options are given for what the document says of them."""
        values: dict[str, object] = {}
        for each in document_options(declared):
            if each.attribute in entry.model_fields_set:
                written = getattr(entry, each.attribute)
                value = self.attempt(place, partial(option_value, each, written, self.folders))
                if value is not None:
                    values[each.attribute] = value
        return values

    def attempt(self, place: Place, make: Callable[[], T]) -> T | None:
        """What `make` makes; None if it is wrong, which is noted."""
        try:
            return make()
        except DocumentError as error:
            self._others += error.problems
        except UsageError as error:
            self._faults.append(fault_at(self.tree, place, error, self._declared_at))
        return None


@contextmanager
def located_errors(tree: MappingNode, declared_at: DeclaredAt) -> Generator[None]:
    """Turns errors about options into those of the document, at its lines.

    Raises:
      DocumentError: with the error.
    """
    try:
        yield
    except DocumentError:
        raise
    except UsageError as error:
        if not error.path:
            raise
        raise document_error([fault_at(tree, (), error, declared_at)]) from error


def fault_at(tree: MappingNode, place: Place, error: UsageError, declared_at: DeclaredAt) -> Fault:
    """`error` at the option below `place` that it is about."""
    path = written_path(tree, (*place, *_entry_path(tree, place, error.path, declared_at(place))))
    owners = [tuple(owner.split(".")) for owner in NAMED]
    named = any(path[: len(owner)] == owner and len(path) > len(owner) for owner in owners)
    mark = key_mark(tree, path) if named else find(tree, path).mark
    return Fault(mark, path_text(path), error.one_line(error.path))


def _entry_path(tree: MappingNode, place: Place, path: Place, declared: type[Options]) -> Place:
    """`path` as the document writes it: its own keys, and of texts with commas, as in [qpos, 'ctrl,energy'], theirs."""
    each = next((each for each in document_options(declared) if path and each.name == path[0]), None)
    if each is None:
        return path
    kind, entries = each.kind, find(tree, (*place, each.key))
    match path:
        case (_, int() as index, *rest) if isinstance(entries, ListNode) and isinstance(kind, Several) and kind.commas:
            counts = [len(cast("tuple[object, ...]", kind.parse(str(plain(entry))))) for entry in entries.items]
            owners = [i for i, count in enumerate(counts) for _ in range(count)]
            return (each.key, owners[index], *rest)
        case _:
            return (each.key, *path[1:])
