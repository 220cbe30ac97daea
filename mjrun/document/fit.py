"""The fit document: a model, measurements, and the parameters to estimate.

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

from collections.abc import Mapping, Sequence
from pathlib import Path

from mjrun.document.simulation_document import LoadedDocument, SimulationDocumentReader
from mjrun.fitting.fit import Fit
from mjrun.options.fit import FitOptions
from mjrun.options.option import options
from mjrun.options.simulation import CodeOptions, SimulationOptions


@options
class _FitOptions(FitOptions, SimulationOptions):
    """A model, measurements, and the parameters to estimate."""


FIT = SimulationDocumentReader("Fit", FitOptions, _FitOptions, Fit)


def read_fit(
    path: Path | str, assignments: Sequence[str] = (), *, values: Mapping[str, object] | None = None
) -> LoadedDocument[Fit]:
    """Reads the fit document at `path`.

    Args:
      assignments: `key=value` from the command line, such as `starts=8` or `free.joint/a.damping=0..1`, which override
        the document.
      values: options that override the document's, such as its `output`.

    Raises:
      DocumentError: the document or an assignment is faulty; all faults are listed.
      FileError: the document is missing or cannot be read.
    """
    return FIT.read(path, assignments, values or {}, {}, CodeOptions())
