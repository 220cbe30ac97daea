"""Documents that describe a simulation at their top level, and what is made from it: a study, a fit, an evaluation."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Generic, TypeVar, cast

from mjrun.document.builder import (
    MODEL,
    DocumentContext,
    DocumentValueBuilder,
    Values,
    located_errors,
    merged_values,
    values_of,
)
from mjrun.document.reader import read
from mjrun.document.task import task_or_model
from mjrun.document.tree import DocumentPath, MappingNode
from mjrun.options.option import Options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.options.structured_kinds import OptionsMappingKind
from mjrun.simulation.simulation import Simulation


def simulation_at_top(builder: DocumentValueBuilder, document: Values, code: CodeOptions) -> Simulation:
    """Returns the simulation at the top level of a document, controlled by `code`; faults are collected."""
    values = values_of(SimulationOptions, document)
    values |= {"controller": code.controller, "control_dt": code.control_dt, "trust": code.trust}
    text = builder.folders.model(str(document["model"]))
    simulation = cast("Callable[..., Simulation]", Simulation)
    return builder.attempt((), lambda: simulation(task_or_model(text), **values)) or Simulation("")


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
        return LoadedDocument(made, lambda: located_errors(tree, folders, self.declared_at, values))

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
        simulation = simulation_at_top(builder, document, code)
        chosen = {**defaults, **merged_values(self._declared, tree, document, values)}
        return builder.made(lambda: self._make(simulation, **chosen))
