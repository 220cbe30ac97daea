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
html: dominos.html
```
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar, cast

from pydantic import ConfigDict, Field, Tag

from mjrun.document.builder import NAMED, DocumentBuilder, fault_at
from mjrun.document.document_model import MAPPING, MODEL, TEXT, Key, Location, Name, by_type
from mjrun.document.error_messages import RENAMED
from mjrun.document.field_types import OutputPath
from mjrun.document.option_models import OptionsModel, options_model
from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.reader import document_error, read_placed
from mjrun.document.tree import Fault, MappingNode, find, path_text, written_path
from mjrun.document.tree import Path as Place
from mjrun.errors import InvalidJobsError, UsageError
from mjrun.options.option import Options, options
from mjrun.options.plot import PageOptions
from mjrun.options.run import RunOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.outputs.golden import golden_files
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.output import Job, OutputResult
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.plotting.page_writer import check_page_name
from mjrun.simulation.simulation import Simulation

# What a document can make, by key.
OUTPUTS: dict[str, type[Video | Image | Trace | Plot | Recording | Keyframe]] = {
    "videos": Video,
    "images": Image,
    "traces": Trace,
    "plots": Plot,
    "recordings": Recording,
    "keyframes": Keyframe,
}
T = TypeVar("T")


@options
class _TopLevel(SimulationOptions, PageOptions):
    """A simulation, and a page of what is made of it."""


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
    source = Field(description=MODEL)
    lists: dict[str, Key] = {
        key: (list[_entry(output)], Field([], description=f"The {key}: a file or a mapping each."))
        for key, output in OUTPUTS.items()
    }
    return options_model(_TopLevel, base=_Run, name="Run", first={"model": (Name, source)}, last=lists)


RunDocument = _run_model()
RunDocument.__doc__ = "A simulation, and what is made of it."


class RunRequest:
    """The jobs that a document asks for, and where it does.

    Attributes:
      jobs: they have one simulation in common.
      page: about what they make.
    """

    def __init__(self, tree: MappingNode, jobs: Mapping[Place, Job[OutputResult]], page: PageOptions) -> None:
        self.page = page
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
        return fault_at(self._tree, place, error, _declared_at)


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
    builder = _Builder(tree, folders, options, command)
    page = builder.page(document)
    return RunRequest(tree, builder.jobs(document), page)


class _Builder(DocumentBuilder):
    """Builds jobs from what a document holds."""

    def __init__(self, tree: MappingNode, folders: Folders, options: RunOptions, command: str) -> None:
        super().__init__(tree, folders, _declared_at)
        self._options, self._command = options, command
        self._goldens = OutputFolder(folders.inputs, "the folder of the document")

    def jobs(self, document: OptionsModel) -> dict[Place, Job[OutputResult]]:
        """All jobs, if nothing is wrong, by their places in the document."""
        simulation = self.simulation(document, self._options)
        jobs: dict[Place, Job[OutputResult]] = {}
        for key, output in OUTPUTS.items():
            for index, entry in enumerate(getattr(document, key)):
                job = self._job(output, entry, (key, index), simulation)
                if job is not None:
                    jobs[key, index] = job
        self.raise_faults()
        return jobs

    def page(self, document: OptionsModel) -> PageOptions:
        """The page that the document asks for, or else the command line."""
        page_options = cast("Callable[..., PageOptions]", PageOptions)
        page = page_options(**self.values(PageOptions, document, ()))
        if self._options.html is not None:
            page = replace(page, html=self._options.html)
        elif page.html is not None:
            self.attempt((), partial(check_page_name, page.html))
            self._reserve_file("html", page.html, ())
        limit = self._options.embed_up_to
        return page if limit is None else replace(page, embed_up_to=limit)

    def _job(
        self, output: Callable[..., Job[OutputResult]], entry: OptionsModel | str, place: Place, simulation: Simulation
    ) -> Job[OutputResult] | None:
        faults = self.fault_count
        if isinstance(entry, str):
            path = self.attempt(place, lambda: self.folders.outputs.path(entry))
            values: dict[str, object] = {} if path is None else {"output": path}
        else:
            values = self.values(entry.declared, entry, place)
        if "output" not in values:
            return None
        job = self.attempt(place, lambda: output(simulation, **values, command=self._command))
        if job is None or self.fault_count > faults:
            return None
        if isinstance(job, Video | Image):
            job = self._on_this_machine(job)
        self._reserve(job, place)
        return self._updated(job, place) if isinstance(job, Trace) else job

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
            where = written_path(self.tree, (*place, "golden"))
            owner = f"{path_text(where)} at {find(self.tree, where).mark}"
            self.attempt((*place, "golden"), partial(self._goldens.reserve, file, owner))
        return updated

    def _reserve(self, job: Job[OutputResult], place: Place) -> None:
        """Reserves all files that `job` writes."""
        for name, file in self.attempt(place, lambda: job.files) or ():
            self._reserve_file(name, file, place)

    def _reserve_file(self, name: str, file: str, place: Place) -> None:
        where = written_path(self.tree, (*place, name))
        owner = f"{path_text(where)} at {find(self.tree, where).mark}"
        self.attempt(where, partial(self.folders.outputs.reserve, file, owner))


def _declared_at(place: Place) -> type[Options]:
    """The options that stand at a place of the document."""
    return OUTPUTS[str(place[0])] if place else _TopLevel
