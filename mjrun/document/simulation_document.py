"""Documents of studies and fits: a simulation, and the options of the product that is made of it."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Generic, TypeVar

from mjrun.document.builder import MODEL, DocumentBuilder, Values, located_errors, values_of
from mjrun.document.forms import DocumentReader
from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.reader import read
from mjrun.document.tree import MappingNode
from mjrun.document.tree import Path as Place
from mjrun.options.option import Options
from mjrun.options.record import Record
from mjrun.options.simulation import CodeOptions
from mjrun.simulation.simulation import Simulation

Made = TypeVar("Made")


class Request(Generic[Made]):
    """The contents of a document, with a context that locates its errors.

    Attributes:
      made: the study, fit or evaluation, ready to run.
    """

    def __init__(self, made: Made, located: Callable[[], AbstractContextManager[None]]) -> None:
        self.made, self.located = made, located


class SimulationDocument(Generic[Made]):
    """A kind of document.

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
        self.record = Record[Values](every, dict, name=name, more=[MODEL], optional=["output"])

    def declared_at(self, place: Place) -> type[Options]:
        """Returns the options at a place of such a document."""
        return self._every

    def read(
        self,
        path: Path | str,
        assignments: Sequence[str],
        values: Mapping[str, object],
        defaults: Mapping[str, object],
        code: CodeOptions,
    ) -> Request[Made]:
        """Reads the document at `path`.

        Input files are relative to the folder of the document, output files to the current one.

        Args:
          assignments: `key=value`, which override the document.
          values: options that override the document's.
          defaults: options for keys that the document leaves out.
          code: options that a document cannot contain.

        Raises:
          DocumentError: with all faults in the document, the documents that it names, and the assignments.
          FileError: one of them is missing or cannot be read.
        """
        folders = DocumentReader(Path(path).parent, OutputFolder(Path()))
        document, tree = read(path, self.record, folders, assignments, variables=True)
        made = self.made(tree, folders, document, defaults, values, code)
        return Request(made, lambda: located_errors(tree, self.declared_at))

    def made(
        self,
        tree: MappingNode,
        folders: Folders,
        document: Values,
        defaults: Mapping[str, object],
        values: Mapping[str, object],
        code: CodeOptions,
    ) -> Made:
        """Makes the product from the contents of a document.

        Raises:
          DocumentError: with all faults.
        """
        builder = DocumentBuilder(tree, folders, self.declared_at)
        simulation: Simulation = builder.simulation(document, code)
        chosen = {**defaults, **values_of(self._declared, document), **values}
        return builder.made(lambda: self._make(simulation, **chosen))
