"""The reports on a run: its result, and the HTML page about everything that it makes."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, field, replace
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError, PartlyDoneError
from mjrun.file_version import file_version
from mjrun.formats.manifest import with_fingerprints
from mjrun.formats.table_reader import STDIN
from mjrun.options.plot import FigureOptions
from mjrun.options.report import PageOptions
from mjrun.outputs.export import ExportResult
from mjrun.outputs.image import ImageResult
from mjrun.outputs.keyframe import KeyframeResult
from mjrun.outputs.output import OutputRequest, OutputResult
from mjrun.outputs.perform import PublishedOutput
from mjrun.outputs.plot import PlotResult
from mjrun.outputs.recording import RecordingResult
from mjrun.outputs.trace import Trace, TraceResult
from mjrun.outputs.video import VideoResult
from mjrun.plotting.figure_writer import require_matplotlib
from mjrun.plotting.html_page import (
    MAKER,
    FileManifest,
    Page,
    PageFigure,
    PageWriter,
    ShownFile,
    TableStatistics,
    page_file,
)
from mjrun.plotting.table_figure import TableFigure
from mjrun.plotting.table_statistics import TableSummarizer
from mjrun.probe.verdict import Verdict

# Results by the kind of output in reports.
RESULTS: dict[str, type[OutputResult]] = {
    "Video": VideoResult,
    "Image": ImageResult,
    "Trace": TraceResult,
    "Plot": PlotResult,
    "Recording": RecordingResult,
    "Keyframe": KeyframeResult,
    "Export": ExportResult,
}


@dataclass(frozen=True)
class RunResult:
    """The results of a run.

    Attributes:
      results: the results of the outputs, in order.
    """

    results: Sequence[VideoResult | ImageResult | TraceResult | PlotResult | RecordingResult | KeyframeResult]

    def document(self) -> dict[str, object]:
        """Returns the results as a JSON document, each with the `kind` of its output."""
        kinds = {result: kind for kind, result in RESULTS.items()}
        return {"results": [{"kind": kinds[type(result)], **asdict(result)} for result in self.results]}


@contextmanager
def run_page(
    options: PageOptions, title: str, requests: Sequence[OutputRequest[OutputResult]]
) -> Generator[list[PublishedOutput]]:
    """Yields the list to which the `with` block adds the outputs that the page at `options.html` is about.

    The page is published at the end of the block if anything was made, even if other outputs failed.

    Raises:
      MissingExtraError: there are tables to plot, and matplotlib is missing.
      PartlyDoneError: the page cannot be written.
      MjrunError: the page's location is not writable.
    """
    assert options.html is not None
    if any(isinstance(request, Trace) and request.output != STDIN for request in requests):
        require_matplotlib()
    with PageWriter(options.html) as writer:
        published: list[PublishedOutput] = []
        try:
            yield published
        finally:
            if published:
                _publish(writer, options, title, published)


def _publish(writer: PageWriter, options: PageOptions, title: str, published: list[PublishedOutput]) -> None:
    """Publishes the page, and adds its version to the last output; if that fails, the outputs remain."""
    assert options.html is not None
    contents = _Contents(options.html, options.embed_up_to)
    try:
        for output in published:
            contents.add(output)
        writer.write(contents.page(title))
        pages = {path: file_version(str(path)) for path in writer.publish()}
        published[-1] = replace(published[-1], file_versions={**published[-1].file_versions, **pages})
    except MjrunError as error:
        made = [path for output in published for path in _made(output)]
        partly = PartlyDoneError(made, [(options.html, error)])
        partly.results = [output.result for output in published]
        raise partly from None


def _made(output: PublishedOutput) -> list[str]:
    """Returns the paths of an output that a message lists."""
    result, files = output.result, output.files
    return _paths(result, files) if isinstance(result, VideoResult) else [*map(str, files)]


@dataclass
class _Contents:
    """The contents of the page."""

    path: str
    limit: float
    figures: list[PageFigure] = field(default_factory=list[PageFigure])
    tables: list[TableStatistics] = field(default_factory=list[TableStatistics])
    verdicts: list[tuple[str, Verdict]] = field(default_factory=list[tuple[str, Verdict]])
    files: list[ShownFile] = field(default_factory=list[ShownFile])
    manifests: list[FileManifest] = field(default_factory=list[FileManifest])

    def add(self, output: PublishedOutput) -> None:
        """Adds a published output."""
        result, files = output.result, output.files
        self.manifests.append(FileManifest(result.path, with_fingerprints(output.facts, files)))
        for path in _paths(result, files):
            self.files.append(page_file(path, self.path, self.limit))
        if isinstance(result, TraceResult | ExportResult):
            self.verdicts += [(result.path, verdict) for verdict in result.assertions]
        if isinstance(result, TraceResult) and result.rows and result.path != STDIN:
            self._add_table(result.path, output.units)

    def page(self, title: str) -> Page:
        return Page(title, MAKER, self.figures, self.verdicts, self.files, self.tables, self.manifests)

    def _add_table(self, path: str, units: Mapping[str, str]) -> None:
        with ExitStack() as stack:
            figure = TableFigure([path], FigureOptions(), stack, units=units)
            summary = TableSummarizer(path, figure.units[path], None, ())
            figure.read([summary])
        self.figures.append(figure.for_page())
        self.tables.append(TableStatistics(path, summary.rows, summary.statistics()))


def _paths(result: OutputResult, files: Sequence[Path]) -> list[str]:
    """Returns the paths that a page shows for an output: its files, or the folder of its frames."""
    outputs = result.paths if isinstance(result, VideoResult | ImageResult) else [result.path]
    shown: dict[str, None] = {}
    for path in outputs:
        if path != STDIN:
            exists = Path(path).exists()
            shown[path if exists else str(files[0].parent)] = None
    return list(shown)
