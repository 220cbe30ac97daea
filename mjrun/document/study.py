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

from collections.abc import Mapping, Sequence
from pathlib import Path

from mjrun.document.simulation_document import Request, SimulationDocument
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.study.study import Study


class _StudyOptions(Study, SimulationOptions):
    """The options of a study document."""


STUDY = SimulationDocument("Study", "A simulation, and what varies in it.", Study, _StudyOptions, Study)
StudyDocument = STUDY.model


def read_study(
    path: Path | str,
    assignments: Sequence[str] = (),
    *,
    values: Mapping[str, object] | None = None,
    code: CodeOptions | None = None,
    command: str = "",
) -> Request[Study]:
    """The study that the document at `path` asks for; its folder is called as the document if nothing else is said.

    Args:
      assignments: `key=value` from the command line, such as `samples=8` or `vary.opt.timestep=1e-3,2e-3`, over what is
        written.
      values: options of a study that count instead of the document's, such as its `output`, or how it runs.
      code: what a document cannot hold.
      command: the command line, for manifests.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    values = {**(values or {}), "command": command}
    return STUDY.read(path, assignments, values, {"output": Path(path).stem}, code or CodeOptions())
