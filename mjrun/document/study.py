"""The study document: a simulation, what varies in it, and what is measured.

```yaml
model: chaotic_pendulum.xml
duration: 10
vary:
  opt.timestep: {from: 1e-4, to: 1e-2, count: 5, log: true}
  qvel/root: [9, 10, 11]
metrics:
  drift: max(abs(energy/drift))
require: max(drift) < 0.5
```
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import cast

from pydantic import Field

from mjrun.document.builder import NAMED, DocumentBuilder, located_errors
from mjrun.document.document_model import Name
from mjrun.document.option_models import OptionsModel, option_keys, options_model
from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.reader import read_placed
from mjrun.document.tree import MappingNode
from mjrun.document.tree import Path as Place
from mjrun.job.simulation import Simulation
from mjrun.options.option import Options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.study.study import Study


def _study_model() -> type[OptionsModel]:
    source = Field(
        description="The model: a file (.xml, .urdf, .mjz, .zip, .mjb), relative to the folder of this document, or "
        "another source such as scene:dominos."
    )
    return options_model(
        SimulationOptions, name="Study", first={"model": (Name, source)}, last=option_keys(Study, ["output"])
    )


StudyDocument = _study_model()
StudyDocument.__doc__ = "A simulation, and what varies in it."


class StudyRequest:
    """The study that a document asks for, and where it does.

    Attributes:
      study: ready to be run.
    """

    def __init__(self, tree: MappingNode, study: Study) -> None:
        self._tree, self.study = tree, study

    def located(self) -> AbstractContextManager[None]:
        """Turns errors of the study into those of the document, at its lines."""
        return located_errors(self._tree, declared_at)


class _AllOptions(Study, SimulationOptions):
    """The options of a study document."""


def read_study(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    given: Mapping[str, object] | None = None,
    code: CodeOptions | None = None,
    command: str = "",
) -> StudyRequest:
    """The study that the document at `path` asks for.

    Files that are read are relative to the folder of the document, that of the study to the current one.

    Args:
      assignments: `key=value` from the command line, such as `samples=8` or `vary.opt.timestep=1e-3,2e-3`, over what is
        written.
      given: options of a study that count instead of the document's, such as its `output`, or how it runs.
      code: what a document cannot hold.
      command: the command line, for manifests.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    document, tree = read_placed(path, StudyDocument, assignments, variables=True, named=NAMED)
    folders = Folders(Path(path).parent, OutputFolder(Path()))
    builder = DocumentBuilder(tree, folders, declared_at)
    simulation = builder.simulation(document, code or CodeOptions())
    values = {"output": Path(path).stem, **builder.values(Study, document, ()), **(given or {})}
    return StudyRequest(tree, made_study(builder, simulation, {**values, "command": command}))


def made_study(builder: DocumentBuilder, simulation: Simulation, values: Mapping[str, object]) -> Study:
    """The study of a simulation with these values, unless something is wrong with any.

    Raises:
      DocumentError: with all that is.
    """
    builder.raise_faults()
    study = builder.attempt((), lambda: cast("Callable[..., Study]", Study)(simulation, **values))
    builder.raise_faults()
    assert study
    return study


def declared_at(place: Place) -> type[Options]:
    """The options that stand at a place of a study document."""
    return _AllOptions
