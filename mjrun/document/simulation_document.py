"""What the documents of studies and of fits are: a simulation, and the options of one thing that is made of it."""

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
    """What a document asks for, and where it does.

    Attributes:
      made: ready to be run.
    """

    def __init__(self, made: Made, located: Callable[[], AbstractContextManager[None]]) -> None:
        self.made, self.located = made, located


class SimulationDocument(Generic[Made]):
    """A kind of document.

    Args:
      name: of what it describes.
      declared: the options beside those of a simulation; `output` may be left out.
      every: these and those of a simulation.
      make: from a simulation and these options to what is made.

    Attributes:
      record: what documents hold.
    """

    def __init__(self, name: str, declared: type[Options], every: type[Options], make: Callable[..., Made]) -> None:
        self._declared, self._every, self._make = declared, every, make
        self.record = Record[Values](every, dict, name=name, more=[MODEL], optional=["output"])

    def declared_at(self, place: Place) -> type[Options]:
        """The options that stand at a place of such a document."""
        return self._every

    def read(
        self,
        path: Path | str,
        assignments: Sequence[str],
        values: Mapping[str, object],
        defaults: Mapping[str, object],
        code: CodeOptions,
    ) -> Request[Made]:
        """What the document at `path` asks for.

        Files that are read are relative to the folder of the document, those that are written to the current one.

        Args:
          assignments: `key=value` over what is written.
          values: options that count instead of the document's.
          defaults: options that count where it says nothing.
          code: what a document cannot hold.

        Raises:
          DocumentError: with everything that is wrong in the document, those it names, and the assignments.
          FileError: one of them is not there, or cannot be read.
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
        """What a document that is read describes.

        Raises:
          DocumentError: with all that is wrong with it.
        """
        builder = DocumentBuilder(tree, folders, self.declared_at)
        simulation: Simulation = builder.simulation(document, code)
        chosen = {**defaults, **values_of(self._declared, document), **values}
        return builder.made(lambda: self._make(simulation, **chosen))
