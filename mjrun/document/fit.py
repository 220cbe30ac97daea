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

from collections.abc import Mapping, Sequence
from pathlib import Path

from mjrun.document.simulation_document import Request, SimulationDocument
from mjrun.fit.fit import Fit
from mjrun.options.fit import FitOptions
from mjrun.options.option import options
from mjrun.options.simulation import CodeOptions, SimulationOptions


@options
class _FitOptions(FitOptions, SimulationOptions):
    """A model, measurements, and what is looked for."""


FIT = SimulationDocument("Fit", FitOptions, _FitOptions, Fit)


def read_fit(
    path: Path | str, assignments: Sequence[str] = (), *, values: Mapping[str, object] | None = None
) -> Request[Fit]:
    """The fit that the document at `path` asks for.

    Args:
      assignments: `key=value` from the command line, such as `starts=8` or `free.joint/a.damping=0..1`, over what is
        written.
      values: options that count instead of the document's, such as its `output`.

    Raises:
      DocumentError: with everything that is wrong in the document, and the assignments.
      FileError: it is not there, or cannot be read.
    """
    return FIT.read(path, assignments, values or {}, {}, CodeOptions())
