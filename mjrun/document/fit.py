"""The fit document: a model, measurements, and which numbers of the model are looked for.

```yaml
model: pendulum.xml
data: [swing.csv]
map: ["qpos/hinge=angle_deg*pi/180"]
free:
  joint/hinge.damping: log:1e-3..1
  joint/hinge.armature: 0..0.5
output: fitted.xml
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
from mjrun.fit.fit import Fit
from mjrun.options.fit import FitOptions
from mjrun.options.option import Options
from mjrun.options.simulation import CodeOptions, SimulationOptions


def _fit_model() -> type[OptionsModel]:
    source = Field(
        description="The model: a file (.xml, .urdf, .mjz, .zip), relative to the folder of this document, or another "
        "source such as scene:pendulum."
    )
    return options_model(
        SimulationOptions, name="Fit", first={"model": (Name, source)}, last=option_keys(FitOptions, ["output"])
    )


FitDocument = _fit_model()
FitDocument.__doc__ = "A model, measurements, and what is looked for."


class FitRequest:
    """The fit that a document asks for, and where it does.

    Attributes:
      fit: ready to be run.
    """

    def __init__(self, tree: MappingNode, fit: Fit) -> None:
        self._tree, self.fit = tree, fit

    def located(self) -> AbstractContextManager[None]:
        """Turns errors of the fit into those of the document, at its lines."""
        return located_errors(self._tree, declared_at)


class _AllOptions(FitOptions, SimulationOptions):
    """The options of a fit document."""


def read_fit(
    path: Path | str, assignments: Sequence[str] = (), *, given: Mapping[str, object] | None = None
) -> FitRequest:
    """The fit that the document at `path` asks for.

    Files that are read are relative to the folder of the document, those that are written to the current one.

    Args:
      assignments: `key=value` from the command line, such as `starts=8` or `free.joint/a.damping=0..1`, over what is
        written.
      given: options that count instead of the document's, such as its `output`.

    Raises:
      DocumentError: with everything that is wrong in the document, and the assignments.
      FileError: it is not there, or cannot be read.
    """
    document, tree = read_placed(path, FitDocument, assignments, variables=True, named=NAMED)
    builder = DocumentBuilder(tree, Folders(Path(path).parent, OutputFolder(Path())), declared_at)
    simulation = builder.simulation(document, CodeOptions())
    values = {**builder.values(FitOptions, document, ()), **(given or {})}
    builder.raise_faults()
    fit = builder.attempt((), lambda: cast("Callable[..., Fit]", Fit)(simulation, **values))
    builder.raise_faults()
    assert fit
    return FitRequest(tree, fit)


def declared_at(place: Place) -> type[Options]:
    """The options that stand at a place of a fit document."""
    return _AllOptions
