"""The run document: all outputs of one simulation, made in one pass.

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
exports: [dominos.glb]
html: dominos.html
```
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import cast

from mjrun.document.builder import MODEL, DocumentContext, DocumentValueBuilder, OutputFolder, Values, values_of
from mjrun.document.reader import read
from mjrun.document.simulation_document import simulation_at_top
from mjrun.document.tree import (
    DocumentFault,
    DocumentPath,
    MappingNode,
    document_error,
    find,
    located_files,
    option_fault,
    path_text,
    written_path,
)
from mjrun.errors import FaultyRequestsError, UsageError, flag
from mjrun.options.export import ExportOptions
from mjrun.options.kinds import PathKind, ReadingContext
from mjrun.options.option import Options, document_key, options
from mjrun.options.output import KeyframeOptions, OutputOptions
from mjrun.options.plot import PlotOptions
from mjrun.options.report import PageOptions
from mjrun.options.run import RunCommandOptions
from mjrun.options.schema_validation import Schema
from mjrun.options.simulation import SimulationOptions
from mjrun.options.structured_kinds import ListKind, OneOfKind, OptionsMappingKind
from mjrun.options.trace import RecordingOptions, TraceOptions
from mjrun.options.video import ImageOptions, VideoOptions
from mjrun.outputs.output import OutputRequest, OutputResult
from mjrun.simulation.simulation import Simulation

# The options of all outputs, by key; the classes of outputs are imported only when a document uses them.
OUTPUTS: dict[str, type[OutputOptions]] = {
    "videos": VideoOptions,
    "images": ImageOptions,
    "traces": TraceOptions,
    "plots": PlotOptions,
    "recordings": RecordingOptions,
    "keyframes": KeyframeOptions,
    "exports": ExportOptions,
}


@options
class _TopLevel(SimulationOptions, PageOptions):
    """A simulation and its outputs."""


def _entry(output: type[OutputOptions]) -> OneOfKind[object, object]:
    """Returns the form of an output: a mapping of its options, or its file alone."""
    mapping = OptionsMappingKind[Values](output, dict, name=output.__name__.removesuffix("Options"))
    return OneOfKind("a file, or a mapping with an output", string=PathKind(written=True), object=mapping)


class _Run(OptionsMappingKind[Values]):
    """A simulation and its outputs."""

    def __init__(self) -> None:
        outputs = [
            document_key(key, ListKind[object](_entry(output)), f"The {key}: a file or a mapping each.", ())
            for key, output in OUTPUTS.items()
        ]
        super().__init__(_TopLevel, dict, name="Run", more=[MODEL, *outputs], is_partial=True)

    def conflicts(self, values: Mapping[str, object]) -> Iterator[tuple[DocumentPath, str]]:
        yield from super().conflicts(values)
        if not any(values.get(key, []) != [] for key in OUTPUTS):
            yield (), f"the document has no outputs; add one of {', '.join(OUTPUTS)}"

    def mapping_schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> dict[str, object]:
        schema = super().mapping_schema(reader, definitions)
        return {**schema, "anyOf": [{"required": [key]} for key in OUTPUTS]}


RUN = _Run()


class LoadedRunDocument:
    """A run document that was read: the requested outputs, with a context that locates their errors.

    Attributes:
      outputs: the requested outputs, which share one simulation.
      page: the page about their outputs.
      documents: the files of the document and of those that it refers to.
    """

    def __init__(
        self,
        tree: MappingNode,
        requests: Mapping[DocumentPath, OutputRequest[OutputResult]],
        page: PageOptions,
        folders: DocumentContext,
    ) -> None:
        self.page, self.documents = page, folders.documents
        self._tree, self._folders, self._places = tree, folders, list(requests)
        self.outputs = list(requests.values())

    @contextmanager
    def located(self) -> Generator[None]:
        """Converts errors of the requests to errors at lines of the document, and adds these to errors of its files.

        Raises:
          DocumentError: the document is faulty; all faults are listed.
        """
        try:
            with located_files(self._tree, self._folders.input):
                yield
        except UsageError as error:
            faulty = (
                error if isinstance(error, FaultyRequestsError) else error.__cause__
            )  # a lone one is raised as itself
            if not isinstance(faulty, FaultyRequestsError):
                raise
            raise document_error(self._fault(*fault) for fault in faulty.faults) from error

    def _fault(self, index: int | None, error: UsageError) -> DocumentFault:
        """Returns the fault for `error` at its option, or else at its request."""
        place: DocumentPath = () if index is None else self._places[index]
        return option_fault(self._tree, place, error, _declared_at)


def read_run(
    path: Path | str, assignments: Sequence[str] = (), options: RunCommandOptions | None = None, command: str = ""
) -> LoadedRunDocument:
    """Reads the run document at `path`.

    Input files are relative to the folder of the document; outputs are inside the folder in `options`.

    Args:
      assignments: `key=value` from the command line, such as `videos[0].fps=30` or `set.opt.cone=elliptic`, which
        override the document.
      options: options that a document cannot contain.
      command: the command line, for manifests.

    Raises:
      DocumentError: the document, one that it names or an assignment is faulty; all faults are listed.
      FileError: one of them is missing or cannot be read.
    """
    options = options or RunCommandOptions()
    folders = DocumentContext(Path(path).parent, OutputFolder(Path(options.output)))
    document, tree = read(path, RUN, folders, assignments, variables=True)
    builder = _Builder(tree, folders, options, command)
    page = builder.page(document)
    return LoadedRunDocument(tree, builder.requests(document), page, folders)


class _Builder(DocumentValueBuilder):
    """A builder of requests from the contents of a document."""

    def __init__(self, tree: MappingNode, folders: DocumentContext, options: RunCommandOptions, command: str) -> None:
        super().__init__(tree, folders, _declared_at)
        self._options, self._command = options, command
        self._goldens = OutputFolder(folders.inputs, "the folder of the document")

    def requests(self, document: Values) -> dict[DocumentPath, OutputRequest[OutputResult]]:
        """Returns all requests by their places in the document."""
        simulation = simulation_at_top(self, document, self._options)
        requests: dict[DocumentPath, OutputRequest[OutputResult]] = {}
        for key in OUTPUTS:
            for index, entry in enumerate(cast("Sequence[Values | str]", document.get(key, ()))):
                request = self._request(entry, (key, index), simulation)
                if request is not None:
                    requests[key, index] = request
        self.raise_faults()
        return requests

    def page(self, document: Values) -> PageOptions:
        """Returns the page that the command line requests, or else the document."""
        page_options = cast("Callable[..., PageOptions]", PageOptions)
        overriding = {"html": self._options.html, "embed_up_to": self._options.embed_up_to}
        values = values_of(PageOptions, document)
        values |= {name: value for name, value in overriding.items() if value is not None}
        page = self.attempt((), lambda: page_options(**values)) or PageOptions()
        if page.html is not None and self._options.html is None:
            from mjrun.plotting.html_page import check_page_name

            self.attempt((), partial(check_page_name, page.html))
            self._reserve_file("html", page.html, ())
        elif page.html is not None:
            self.folders.outputs.reserve(page.html, flag("html"), anywhere=True)
        return page

    def _request(
        self, entry: Values | str, place: DocumentPath, simulation: Simulation
    ) -> OutputRequest[OutputResult] | None:
        key = str(place[0])
        values = {"output": entry} if isinstance(entry, str) else entry
        values = {**values, **self._machine_values(key), "command": self._command}
        name = OUTPUTS[key].__name__.removesuffix("Options")
        output = cast(
            "Callable[..., OutputRequest[OutputResult]]", resolve_name(f"mjrun.outputs.{name.lower()}:{name}")
        )
        request = self.attempt(place, lambda: output(simulation, **values))
        if request is None:
            return None
        for name, file in self.attempt(place, lambda: request.files) or ():
            self._reserve_file(name, file, place)
        return self._updated(request, place) if key == "traces" and self._options.update else request

    def _machine_values(self, key: str) -> Values:
        """Returns the options of the command line for all outputs under a key."""
        options = self._options
        if key not in ("videos", "images"):
            return {}
        values: Values = {"gl": options.gl, "require_gpu": options.require_gpu, "quality": options.quality}
        values |= {"jobs": options.jobs} if key == "videos" else {}
        return {name: value for name, value in values.items() if value is not None}

    def _updated(self, request: OutputRequest[OutputResult], place: DocumentPath) -> OutputRequest[OutputResult]:
        """Returns the trace with its golden table to be updated, if the document may write to that file."""
        from mjrun.outputs.trace import Trace, golden_files

        assert isinstance(request, Trace)
        if request.golden is None:
            return request
        updated = replace(request, update=True)
        for file in golden_files(updated):
            where = written_path(self.tree, (*place, "golden"))
            owner = f"{path_text(where)} at {find(self.tree, where).mark}"
            self.attempt((*place, "golden"), partial(self._goldens.reserve, file, owner))
        return updated

    def _reserve_file(self, name: str, file: str, place: DocumentPath) -> None:
        where = written_path(self.tree, (*place, name))
        owner = f"{path_text(where)} at {find(self.tree, where).mark}"
        self.attempt(where, partial(self.folders.outputs.reserve, file, owner))


def _declared_at(place: DocumentPath) -> type[Options]:
    """Returns the options at a place of the document."""
    return OUTPUTS[str(place[0])] if place else _TopLevel
