"""Construction of typed values from the contents of a document, with errors at their lines."""

import dataclasses
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import TypeVar, cast

from mjrun.document.faults import DeclaredAt, document_error, option_fault
from mjrun.document.output_folder import Folders
from mjrun.document.tree import Fault, MappingNode
from mjrun.document.tree import Path as Place
from mjrun.errors import DocumentError, UsageError
from mjrun.options.kinds import Text
from mjrun.options.option import Options, document_key, document_options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.simulation.simulation import Simulation
from mjrun.suffixes import MODELS

MODEL = document_key(
    "model",
    Text(),
    f"The model: a file ({', '.join(MODELS)}), relative to the folder of this document, or another source such as "
    "scene:dominos.",
    dataclasses.MISSING,
)

Values = dict[str, object]  # Python arguments, by attribute
T = TypeVar("T")


class DocumentBuilder:
    """Makes values from the options of a document, and collects their faults.

    Args:
      tree: the document with the places of its values.
      folders: the folders that resolve its relative paths.
      declared_at: returns the options at a place.
    """

    def __init__(self, tree: MappingNode, folders: Folders, declared_at: DeclaredAt) -> None:
        self.tree, self.folders, self._declared_at = tree, folders, declared_at
        self._faults: list[Fault] = []

    def raise_faults(self) -> None:
        """Raises DocumentError with all faults, if there are any."""
        if self._faults or self.folders.problems:
            raise document_error(self._faults, self.folders.problems)

    def simulation(self, document: Values, code: CodeOptions) -> Simulation:
        """Returns the simulation at the top level of a document, controlled by `code`."""
        values = values_of(SimulationOptions, document)
        values |= {"controller": code.controller, "control_dt": code.control_dt, "trust": code.trust}
        from mjrun.document.task import task_or_model  # which builds a task

        text = self.folders.model(str(document["model"]))
        simulation = cast("Callable[..., Simulation]", Simulation)
        return self.attempt((), lambda: simulation(task_or_model(text), **values)) or Simulation("")

    def made(self, make: Callable[[], T]) -> T:
        """Calls `make` and returns its value.

        Raises:
          DocumentError: with all faults.
        """
        self.raise_faults()
        made = self.attempt((), make)
        self.raise_faults()
        assert made is not None
        return made

    def attempt(self, place: Place, make: Callable[[], T]) -> T | None:
        """Calls `make`; collects its error and returns None if it fails."""
        try:
            return make()
        except DocumentError as error:
            self.folders.problems.extend(error.problems)
        except UsageError as error:
            self._faults.append(option_fault(self.tree, place, error, self._declared_at))
        return None


def values_of(declared: type[Options], document: Mapping[str, object]) -> Values:
    """Returns the values of a document that are options of a class."""
    attributes = (each.attribute for each in document_options(declared))
    return {attribute: document[attribute] for attribute in attributes if attribute in document}


@contextmanager
def located_errors(tree: MappingNode, declared_at: DeclaredAt) -> Generator[None]:
    """Converts errors about options to errors at lines of the document.

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
        raise document_error([option_fault(tree, (), error, declared_at)]) from error
