"""Options of all outputs, and the placeholders for formats."""

from mjrun.options.export import ExportOptions
from mjrun.options.image import ImageOptions
from mjrun.options.option import options_of
from mjrun.options.output import KeyframeOptions, OutputOptions
from mjrun.options.plot import PlotOptions
from mjrun.options.policy import PolicyOptions
from mjrun.options.trace import RecordingOptions, TraceOptions
from mjrun.options.video import VideoOptions
from mjrun.outputs.format_lists import LISTS

OUTPUTS = (VideoOptions, ImageOptions, TraceOptions, PlotOptions, RecordingOptions, KeyframeOptions, ExportOptions)


def test_every_output_has_a_file_and_a_manifest() -> None:
    for cls in OUTPUTS:
        names = [each.name for each in options_of(cls)]
        assert issubclass(cls, OutputOptions)
        assert names[0] == "output"
        assert "manifest" in names


def test_every_placeholder_stands_in_a_help_text() -> None:
    texts = " ".join(each.help for cls in (*OUTPUTS, PolicyOptions) for each in options_of(cls))
    assert all(placeholder in texts for placeholder in LISTS)
