"""The run document: everything that is made of one simulation, in one pass.

```yaml
vars: {slow: 0.25}
model: dominos.xml
set: {opt.cone: elliptic}
duration: 3
films:
  - {output: dominos.mp4, size: 1440x1024, camera: [top, "orbit:lookat=box,distance=1"], speed: "${slow}"}
stills:
  - {output: hit.png, at: {when: "contact(domino_6, seesaw)"}, camera: top}
traces:
  - {output: run.csv, probe: [qpos, energy], rate: 100, assert: max(abs(energy/drift)) < 1e-3}
plots:
  - {output: energy.png, probe: energy}
```
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, Tag

from mjrun.document.document_model import MAPPING, TEXT, Loc, Maybe, kinds
from mjrun.document.field_types import one_line
from mjrun.document.machine import ANY, Machine
from mjrun.document.output_folder import WRITTEN, Files, Inside
from mjrun.document.outputs import Film, Graphs, Kept, Still, Table
from mjrun.document.reader import document_error, read_placed
from mjrun.document.simulation import Simulated
from mjrun.document.tree import Fault, Mapped, find, spelled, texts
from mjrun.document.tree import Path as Place
from mjrun.errors import DocumentError, JobsError, Problem, UsageError
from mjrun.job.perform import Job
from mjrun.job.simulation import Simulation

MADE = ("films", "stills", "traces", "plots", "recording")
NAMED = ("set", "qpos", "qvel", "ctrl")  # keys below which the model's own names stand

Output = Film | Still | Table | Graphs | Kept
T = TypeVar("T")


class Run(Simulated):
    """A simulation, and what is made of it."""

    model_config = ConfigDict(json_schema_extra={"anyOf": [{"required": [kind]} for kind in MADE]})

    films: list[Film] = Field([])
    """Films."""
    stills: list[Still] = Field([])
    """Pictures of one instant."""
    traces: list[Table] = Field([])
    """Tables of measured values."""
    plots: list[Graphs] = Field([])
    """Measured values over time, as pictures."""
    recording: Maybe[
        Annotated[
            Annotated[Inside, Tag(TEXT)] | Annotated[Kept, Tag(MAPPING)],
            kinds("an .npz file or {output, manifest}", TEXT, MAPPING),
        ]
    ] = None
    """An .npz file for the states of all steps, inside the folder of outputs."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        yield from super().complaints(given)
        if not any(given.get(kind, []) != [] for kind in MADE):
            yield (), f"there is nothing to do; ask for one of {', '.join(MADE)}"

    def outputs(self) -> Iterator[tuple[Place, Output]]:
        """What is to be made, each with its place in the document."""
        for kind in MADE[:-1]:
            yield from (((kind, i), form) for i, form in enumerate(getattr(self, kind)))
        if isinstance(self.recording, Kept):
            yield ("recording",), self.recording
        elif self.recording is not None:
            yield ("recording",), Kept(output=self.recording)


class Orders:
    """The jobs that a document asks for, and where it does.

    Attributes:
      jobs: they have one simulation in common.
    """

    def __init__(self, tree: Mapped, jobs: Mapping[Place, Job]) -> None:
        self._tree, self._places = tree, list(jobs)
        self.jobs = list(jobs.values())

    @contextlib.contextmanager
    def located(self) -> Iterator[None]:
        """Tells of what is found wrong with the jobs where the document says it.

        Raises:
          DocumentError: with everything that was found.
        """
        try:
            yield
        except UsageError as error:
            found = error if isinstance(error, JobsError) else error.__cause__  # a lone one is raised as itself
            if not isinstance(found, JobsError):
                raise
            raise document_error(self._fault(*fault) for fault in found.faults) from error

    def _fault(self, index: int | None, error: UsageError) -> Fault:
        """`error` at the first value or key that says what is wrong, or else at the job."""
        area: Place = () if index is None else self._places[index]
        tree = self._tree.without(*MADE) if index is None else find(self._tree, area)
        written = list(texts(tree, area))
        wrong = getattr(error, "name", None) or getattr(error, "value", None)
        whole = [(path, mark) for path, mark, text in written if text == wrong]
        parts = [(path, mark) for path, mark, text in written if wrong and wrong in text]
        path, mark = next(iter([*whole, *parts]), (area, tree.mark))
        return Fault(mark, spelled(path), one_line(error))


def read_run(path: Path | str, assignments: Sequence[str], folder: Path, machine: Machine = ANY) -> Orders:
    """What the run document at `path` asks for.

    Files that are read are relative to the folder of the document, outputs are inside `folder`.

    Args:
      assignments: `key=value` from the command line, such as `films[0].fps=30` or `set.opt.cone=elliptic`, over what
        is written.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    document, tree = read_placed(path, Run, assignments, preamble=True, named=NAMED)
    return Orders(tree, _Maker(tree, Path(path).parent, Files(folder), machine).jobs(document))


class _Maker:
    def __init__(self, tree: Mapped, inputs: Path, files: Files, machine: Machine) -> None:
        self._tree, self._inputs, self._files, self._machine = tree, inputs, files, machine
        self._faults: list[Fault] = []
        self._others: list[Problem] = []  # in documents that this one names

    def jobs(self, document: Run) -> dict[Place, Job]:
        """All jobs, if nothing was wrong, by their places in the document."""
        simulation = self._tried((), lambda: document.simulation(self._inputs, self._machine)) or Simulation("")
        found = {place: self._job(form, place, simulation) for place, form in document.outputs()}
        if self._faults or self._others:
            raise document_error(self._faults, self._others)
        return {place: job for place, job in found.items() if job is not None}

    def _job(self, form: Output, place: Place, simulation: Simulation) -> Job | None:
        asked = {key: text for key in WRITTEN if (text := getattr(form, key, None)) is not None}
        files = {
            key: self._tried((*place, key), lambda text=text: self._files.path(text)) for key, text in asked.items()
        }
        job = self._tried(place, lambda: form.job(simulation, files, self._inputs, self._machine))
        if job is not None and None not in files.values():
            self._take(job, place)
        return job

    def _take(self, job: Job, place: Place) -> None:
        """Reserves all files that `job` writes."""
        for key, file in job.files:
            where = (*place, key)
            taker = f"{spelled(where)} at {find(self._tree, where).mark}"
            self._tried(where, lambda file=file, taker=taker: self._files.take(file, taker))

    def _tried(self, place: Place, make: Callable[[], T]) -> T | None:
        """What `make` makes; None if it is wrong, which is noted."""
        try:
            return make()
        except DocumentError as error:
            self._others += error.problems
        except UsageError as error:
            self._faults.append(Fault(find(self._tree, place).mark, spelled(place), one_line(error)))
        return None
