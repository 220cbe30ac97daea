"""Builds typed values from what a document holds, and tells what is wrong with them where it is written."""

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

Values = dict[str, object]  # by attribute, as Python might give them
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

    def raise_faults(self) -> None:
        """Raises DocumentError with everything that is wrong, if anything is."""
        if self._faults or self.folders.problems:
            raise document_error(self._faults, self.folders.problems)

    def simulation(self, document: Values, code: CodeOptions) -> Simulation:
        """The simulation at the top of a document, driven by `code`, which no document holds."""
        values = values_of(SimulationOptions, document)
        values |= {"controller": code.controller, "control_dt": code.control_dt, "trust": code.trust}
        from mjrun.document.task import task_or_model  # which builds a task

        text = self.folders.model(str(document["model"]))
        simulation = cast("Callable[..., Simulation]", Simulation)
        return self.attempt((), lambda: simulation(task_or_model(text), **values)) or Simulation("")

    def made(self, make: Callable[[], T]) -> T:
        """What `make` makes of the whole document.

        Raises:
          DocumentError: with everything that is wrong.
        """
        self.raise_faults()
        made = self.attempt((), make)
        self.raise_faults()
        assert made is not None
        return made

    def attempt(self, place: Place, make: Callable[[], T]) -> T | None:
        """What `make` makes; None if it is wrong, which is noted."""
        try:
            return make()
        except DocumentError as error:
            self.folders.problems.extend(error.problems)
        except UsageError as error:
            self._faults.append(option_fault(self.tree, place, error, self._declared_at))
        return None


def values_of(declared: type[Options], document: Mapping[str, object]) -> Values:
    """Those of the values of a document that are options of a class."""
    attributes = (each.attribute for each in document_options(declared))
    return {attribute: document[attribute] for attribute in attributes if attribute in document}


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
        raise document_error([option_fault(tree, (), error, declared_at)]) from error
