"""Construction of typed values from the contents of a document, with errors at their lines."""

import dataclasses
import sys
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Generic, TypeVar, cast

from mjrun.document.paths import DocumentContext
from mjrun.document.reader import read
from mjrun.document.tree import DeclaredAt, DocumentFault, DocumentPath, MappingNode, document_error, option_fault
from mjrun.errors import DocumentError, UsageError
from mjrun.options.kinds import TextKind
from mjrun.options.option import Options, document_key, document_options, requirements_of
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.options.structured_kinds import OptionsMappingKind
from mjrun.simulation.simulation import Simulation
from mjrun.suffixes import MODELS

MODEL = document_key(
    "model",
    TextKind(),
    f"The model: a file ({', '.join(MODELS)}), relative to the folder of this document, or another source such as "
    "scene:dominos.",
    dataclasses.MISSING,
)

Values = dict[str, object]  # Python arguments, by attribute
T = TypeVar("T")


class DocumentValueBuilder:
    """A builder of values from the options of a document, which collects their faults.

    Args:
      tree: the document with the places of its values.
      folders: the folders that resolve its relative paths.
      declared_at: returns the options at a place.
      overriding: options of the command line, whose errors have no place in the document.
    """

    def __init__(
        self, tree: MappingNode, folders: DocumentContext, declared_at: DeclaredAt, overriding: Collection[str] = ()
    ) -> None:
        self.tree, self.folders = tree, folders
        self._declared_at, self._overriding = declared_at, overriding
        self._faults: list[DocumentFault] = []

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
          DocumentError: the document is faulty; all faults are listed.
        """
        self.raise_faults()
        made = self.attempt((), make)
        self.raise_faults()
        assert made is not None
        return made

    def attempt(self, place: DocumentPath, make: Callable[[], T]) -> T | None:
        """Calls `make`; collects its error and returns None if it fails."""
        try:
            return make()
        except DocumentError as error:
            self.folders.problems.extend(error.problems)
        except UsageError as error:
            if error.path and error.path[0] in self._overriding:
                raise
            self._faults.append(option_fault(self.tree, place, error, self._declared_at))
        return None


def values_of(declared: type[Options], document: Mapping[str, object]) -> Values:
    """Returns the values of a document that are options of a class."""
    attributes = (each.attribute for each in document_options(declared))
    return {attribute: document[attribute] for attribute in attributes if attribute in document}


def merged_values(
    declared: type[Options], tree: MappingNode, document: Mapping[str, object], values: Mapping[str, object]
) -> Values:
    """Returns the values of a document that are options of a class, overridden by `values` of the command line.

    An option loses its effect if its partner is overridden: `videos=0` for a document that sets the size of its videos.
    It is left out then, instead of being refused.
    """
    merged = {**values_of(declared, document), **values}
    names = {each.key: each.attribute for each in document_options(declared)}
    by_key = {key: merged[name] for key, name in names.items() if name in merged}

    def order(key: str) -> int:
        """Returns the rank of the place that sets an option: the command line is above assignments and documents."""
        if names.get(key) in values:
            return sys.maxsize
        return tree.keys[key].precedence if key in tree.keys else -1

    for each in requirements_of(declared):
        partners = (each.partner, *each.alternatives)
        if each.name in by_key and not each.is_met(by_key) and order(each.name) < max(map(order, partners)):
            del merged[names[each.name]]
    return merged


@contextmanager
def located_errors(tree: MappingNode, declared_at: DeclaredAt, overriding: Collection[str] = ()) -> Generator[None]:
    """Converts errors about options to errors at lines of the document.

    Args:
      overriding: options of the command line, whose errors have no place in the document.

    Raises:
      DocumentError: an option is invalid.
    """
    try:
        yield
    except DocumentError:
        raise
    except UsageError as error:
        if not error.path or error.path[0] in overriding:
            raise
        raise document_error([option_fault(tree, (), error, declared_at)]) from error


Made = TypeVar("Made")


class LoadedDocument(Generic[Made]):
    """A document that was read: the value that it describes, with a context that locates its errors.

    Attributes:
      made: the study, fit or evaluation, ready to run.
    """

    def __init__(self, made: Made, located: Callable[[], AbstractContextManager[None]]) -> None:
        self.made, self.located = made, located


class SimulationDocumentReader(Generic[Made]):
    """A reader of one kind of documents about simulations.

    Args:
      name: the name of the product.
      declared: its options in addition to those of a simulation; `output` may be left out.
      every: these options and those of a simulation.
      make: makes the product from a simulation and these options.

    Attributes:
      record: the form of the documents.
    """

    def __init__(self, name: str, declared: type[Options], every: type[Options], make: Callable[..., Made]) -> None:
        self._declared, self._every, self._make = declared, every, make
        self.record = OptionsMappingKind[Values](
            every, dict, name=name, more=[MODEL], optional=["output"], is_partial=True
        )

    def declared_at(self, place: DocumentPath) -> type[Options]:
        """Returns the options at a place of such a document."""
        return self._every

    def read(
        self,
        path: Path | str,
        assignments: Sequence[str],
        values: Mapping[str, object],
        defaults: Mapping[str, object],
        code: CodeOptions,
    ) -> LoadedDocument[Made]:
        """Reads the document at `path`.

        Input files are relative to the folder of the document, output files to the current one.

        Args:
          assignments: `key=value`, which override the document.
          values: options that override the document's.
          defaults: options for keys that the document leaves out.
          code: options that a document cannot contain.

        Raises:
          DocumentError: the document, one that it names or an assignment is faulty; all faults are listed.
          FileError: one of them is missing or cannot be read.
        """
        folders = DocumentContext(Path(path).parent)
        document, tree = read(path, self.record, folders, assignments, variables=True)
        made = self.made(tree, folders, document, defaults, values, code)
        return LoadedDocument(made, lambda: located_errors(tree, self.declared_at, values))

    def made(
        self,
        tree: MappingNode,
        folders: DocumentContext,
        document: Values,
        defaults: Mapping[str, object],
        values: Mapping[str, object],
        code: CodeOptions,
    ) -> Made:
        """Makes the product from the contents of a document.

        Raises:
          DocumentError: the document is faulty; all faults are listed.
        """
        builder = DocumentValueBuilder(tree, folders, self.declared_at, values)
        simulation: Simulation = builder.simulation(document, code)
        chosen = {**defaults, **merged_values(self._declared, tree, document, values)}
        return builder.made(lambda: self._make(simulation, **chosen))
