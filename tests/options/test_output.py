"""Options of all outputs, and the placeholders for formats."""

from pathlib import Path

from mjrun.formats.format_lists import LISTS
from mjrun.options.image import ImageOptions
from mjrun.options.keyframe import KeyframeOptions
from mjrun.options.option import FrontEnd, options_of
from mjrun.options.output import CommandOptions, OutputOptions
from mjrun.options.plot import PlotOptions
from mjrun.options.trace import RecordingOptions, TraceOptions
from mjrun.options.video import VideoOptions

OUTPUTS = (VideoOptions, ImageOptions, TraceOptions, PlotOptions, RecordingOptions, KeyframeOptions)


def test_every_output_has_a_file_and_a_manifest() -> None:
    for cls in OUTPUTS:
        names = [each.name for each in options_of(cls)]
        assert issubclass(cls, OutputOptions)
        assert names[0] == "output"
        assert "manifest" in names


def test_paths_become_text() -> None:
    trace = TraceOptions(None, Path("a.csv"), manifest=Path("a.json"))  # type: ignore[arg-type]
    assert (trace.output, trace.manifest) == ("a.csv", "a.json")


def test_every_placeholder_stands_in_a_help_text() -> None:
    texts = " ".join(each.help for cls in OUTPUTS for each in options_of(cls))
    assert all(placeholder in texts for placeholder in LISTS)


def test_what_a_command_does_besides_is_no_document_s() -> None:
    assert {each.places for each in options_of(CommandOptions)} == {FrontEnd.COMMAND}
