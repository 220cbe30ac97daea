"""The result of a run document: the results of its outputs."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from mjrun.outputs.image import ImageResult
from mjrun.outputs.keyframe import KeyframeResult
from mjrun.outputs.output import OutputResult
from mjrun.outputs.plot import PlotResult
from mjrun.outputs.recording import RecordingResult
from mjrun.outputs.trace import TraceResult
from mjrun.outputs.video import VideoResult

# Results by the kind of output in reports.
RESULTS: dict[str, type[OutputResult]] = {
    "Video": VideoResult,
    "Image": ImageResult,
    "Trace": TraceResult,
    "Plot": PlotResult,
    "Recording": RecordingResult,
    "Keyframe": KeyframeResult,
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
