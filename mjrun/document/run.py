"""The run document: everything that is made of one simulation, in one pass.

```yaml
vars: {slow: 0.25}
model: dominos.xml
set: {opt.cone: elliptic}
duration: 3
videos:
  - {output: dominos.mp4, size: 1440x1024, camera: [top, "orbit:lookat=box,distance=1"], speed: "${slow}"}
images:
  - {output: hit.png, time: {when: "contact(domino_6, seesaw)"}, camera: top}
traces:
  - {output: run.csv, probe: [qpos, energy], rate: 100, assert: max(abs(energy/drift)) < 1e-3}
plots:
  - {output: energy.png, probe: energy}
```
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar, cast

from pydantic import ConfigDict, Field, Tag

from mjrun.document.document_model import MAPPING, TEXT, Key, Location, Name, by_type
from mjrun.document.error_messages import RENAMED
from mjrun.document.option_models import Folders, OptionsModel, document_options, option_value, options_model
from mjrun.document.output_folder import OutputFolder, OutputPath
from mjrun.document.reader import document_error, read_placed
from mjrun.document.tree import Fault, ListNode, MappingNode, find, key_mark, path_text, plain, written_path
from mjrun.document.tree import Path as Place
from mjrun.errors import DocumentError, InvalidJobsError, Problem, UsageError
from mjrun.job.golden import golden_files
from mjrun.job.image import Image
from mjrun.job.keyframe import Keyframe
from mjrun.job.plot import Plot
from mjrun.job.recording import Recording
from mjrun.job.simulation import Simulation
from mjrun.job.task import Job, OutputResult
from mjrun.job.trace import Trace
from mjrun.job.video import Video
from mjrun.options.kinds import Several
from mjrun.options.option import Options
from mjrun.options.run import RunOptions
from mjrun.options.simulation import SimulationOptions

# What a document can make, by key.
OUTPUTS: dict[str, type[Video | Image | Trace | Plot | Recording | Keyframe]] = {
    "videos": Video,
    "images": Image,
    "traces": Trace,
    "plots": Plot,
    "recordings": Recording,
    "keyframes": Keyframe,
}
NAMED = ("set", "qpos", "qvel", "ctrl")  # keys below which the model's own names stand
T = TypeVar("T")


class _Run(OptionsModel):
    model_config = ConfigDict(json_schema_extra={"anyOf": [{"required": [key]} for key in OUTPUTS]})

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        yield from super().cross_field_errors(values)
        renamed = any(RENAMED.get(key, "").startswith(tuple(OUTPUTS)) for key in values)  # an error of its own
        if not renamed and not any(values.get(key, []) != [] for key in OUTPUTS):
            yield (), f"there is nothing to do; ask for one of {', '.join(OUTPUTS)}"


def _entry(output: type[Options]) -> object:
    """The type of an output: a mapping of its options, or its file alone."""
    return Annotated[
        Annotated[OutputPath, Tag(TEXT)] | Annotated[options_model(output), Tag(MAPPING)],
        by_type("a file, or a mapping with an output", TEXT, MAPPING),
    ]


def _run_model() -> type[OptionsModel]:
    source = Field(
        description="The model: a file (.xml, .urdf, .mjz, .zip, .mjb), relative to the folder of this document, or "
        "another source such as scene:dominos."
    )
    lists: dict[str, Key] = {
        key: (list[_entry(output)], Field([], description=f"The {key}: a file or a mapping each."))
        for key, output in OUTPUTS.items()
    }
    return options_model(SimulationOptions, base=_Run, name="Run", first={"model": (Name, source)}, last=lists)


RunDocument = _run_model()
RunDocument.__doc__ = "A simulation, and what is made of it."


class RunRequest:
    """The jobs that a document asks for, and where it does.

    Attributes:
      jobs: they have one simulation in common.
    """

    def __init__(self, tree: MappingNode, jobs: Mapping[Place, Job[OutputResult]]) -> None:
        self._tree, self._places = tree, list(jobs)
        self.jobs = list(jobs.values())

    @contextmanager
    def located(self) -> Generator[None]:
        """Turns errors of the jobs into those of the document, at its lines.

        Raises:
          DocumentError: with every error.
        """
        try:
            yield
        except UsageError as error:
            jobs_error = (
                error if isinstance(error, InvalidJobsError) else error.__cause__
            )  # a lone one is raised as itself
            if not isinstance(jobs_error, InvalidJobsError):
                raise
            raise document_error(self._fault(*fault) for fault in jobs_error.faults) from error

    def _fault(self, index: int | None, error: UsageError) -> Fault:
        """`error` at the option that it is about, or else at the job."""
        place: Place = () if index is None else self._places[index]
        return _fault_at(self._tree, place, error)


def read_run(
    path: Path | str, assignments: Sequence[str] = (), options: RunOptions | None = None, command: str = ""
) -> RunRequest:
    """What the run document at `path` asks for.

    Files that are read are relative to the folder of the document, outputs are inside the folder that `options` name.

    Args:
      assignments: `key=value` from the command line, such as `videos[0].fps=30` or `set.opt.cone=elliptic`, over what
        is written.
      options: what a document cannot hold.
      command: the command line, for manifests.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names, and the assignments.
      FileError: one of them is not there, or cannot be read.
    """
    options = options or RunOptions()
    document, tree = read_placed(path, RunDocument, assignments, variables=True, named=NAMED)
    folders = Folders(Path(path).parent, OutputFolder(Path(options.output)))
    return RunRequest(tree, _Builder(tree, folders, options, command).jobs(document))


class _Builder:
    """Builds jobs from what a document holds, and collects what is wrong with them."""

    def __init__(self, tree: MappingNode, folders: Folders, options: RunOptions, command: str) -> None:
        self._tree, self._folders, self._options, self._command = tree, folders, options, command
        self._goldens = OutputFolder(folders.inputs, "the folder of the document")
        self._faults: list[Fault] = []
        self._others: list[Problem] = []  # in documents that this one names

    def jobs(self, document: OptionsModel) -> dict[Place, Job[OutputResult]]:
        """All jobs, if nothing is wrong, by their places in the document."""
        simulation = self._simulation(document)
        jobs: dict[Place, Job[OutputResult]] = {}
        for key, output in OUTPUTS.items():
            for index, entry in enumerate(getattr(document, key)):
                job = self._job(output, entry, (key, index), simulation)
                if job is not None:
                    jobs[key, index] = job
        if self._faults or self._others:
            raise document_error(self._faults, self._others)
        return jobs

    def _simulation(self, document: OptionsModel) -> Simulation:
        values = self._values(SimulationOptions, document, ())
        values |= {"controller": self._options.controller, "control_dt": self._options.control_dt}
        model = self._folders.model(document.model_dump(include={"model"})["model"])
        simulation = cast("Callable[..., Simulation]", Simulation)
        return self._attempt((), lambda: simulation(model, **values)) or Simulation("")

    def _job(
        self, output: Callable[..., Job[OutputResult]], entry: OptionsModel | str, place: Place, simulation: Simulation
    ) -> Job[OutputResult] | None:
        faults = len(self._faults) + len(self._others)
        if isinstance(entry, str):
            path = self._attempt(place, lambda: self._folders.outputs.path(entry))
            values: dict[str, object] = {} if path is None else {"output": path}
        else:
            values = self._values(entry.declared, entry, place)
        if "output" not in values:
            return None
        job = self._attempt(place, lambda: output(simulation, **values, command=self._command))
        if job is None or len(self._faults) + len(self._others) > faults:
            return None
        if isinstance(job, Video | Image):
            job = self._on_this_machine(job)
        self._reserve(job, place)
        return self._updated(job, place) if isinstance(job, Trace) else job

    def _values(self, declared: type[Options], entry: OptionsModel, place: Place) -> dict[str, object]:
        """What the options are given for what the document says of them."""
        values: dict[str, object] = {}
        for each in document_options(declared):
            if each.attribute in entry.model_fields_set:
                written = getattr(entry, each.attribute)
                value = self._attempt(place, partial(option_value, each, written, self._folders))
                if value is not None:
                    values[each.attribute] = value
        return values

    def _on_this_machine(self, job: Video | Image) -> Job[OutputResult]:
        """The job, with what the command line says of all of them."""
        options = self._options
        job = replace(job, gl=options.gl, require_gpu=options.require_gpu, quality=options.quality or job.quality)
        return replace(job, jobs=options.jobs or job.jobs) if isinstance(job, Video) else job

    def _updated(self, trace: Trace, place: Place) -> Trace:
        """The trace, with its golden table to be updated if the command line says so and the document may write it."""
        if trace.golden is None or not self._options.update:
            return trace
        updated = replace(trace, update=True)
        for file in golden_files(updated):
            where = written_path(self._tree, (*place, "golden"))
            owner = f"{path_text(where)} at {find(self._tree, where).mark}"
            self._attempt((*place, "golden"), partial(self._goldens.reserve, file, owner))
        return updated

    def _reserve(self, job: Job[OutputResult], place: Place) -> None:
        """Reserves all files that `job` writes."""
        for name, file in self._attempt(place, lambda: job.files) or ():
            where = written_path(self._tree, (*place, name))
            owner = f"{path_text(where)} at {find(self._tree, where).mark}"
            self._attempt(where, partial(self._folders.outputs.reserve, file, owner))

    def _attempt(self, place: Place, make: Callable[[], T]) -> T | None:
        """What `make` makes; None if it is wrong, which is noted."""
        try:
            return make()
        except DocumentError as error:
            self._others += error.problems
        except UsageError as error:
            self._faults.append(_fault_at(self._tree, place, error))
        return None


def _fault_at(tree: MappingNode, place: Place, error: UsageError) -> Fault:
    """`error` at the option below `place` that it is about."""
    path = written_path(tree, (*place, *_entry_path(tree, place, error.path)))
    named = path[:1] in [(key,) for key in NAMED] and len(path) > 1
    mark = key_mark(tree, path) if named else find(tree, path).mark
    return Fault(mark, path_text(path), error.one_line(error.path))


def _entry_path(tree: MappingNode, place: Place, path: Place) -> Place:
    """`path` with the index of a value replaced by that of the text it is part of, as in [qpos, 'ctrl,energy']."""
    declared = OUTPUTS[str(place[0])] if place else SimulationOptions
    match path:
        case (str() as name, int() as index, *rest) if isinstance(entries := find(tree, (*place, name)), ListNode):
            kind = next((each.kind for each in document_options(declared) if each.name == name), None)
            if isinstance(kind, Several) and kind.commas:
                counts = [len(cast("tuple[object, ...]", kind.parse(str(plain(entry))))) for entry in entries.items]
                owners = [i for i, count in enumerate(counts) for _ in range(count)]
                return (name, owners[index], *rest)
        case _:
            pass
    return path
