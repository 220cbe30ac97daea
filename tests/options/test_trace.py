"""Options of traces: probes, sampling, and what excludes what."""

from pathlib import Path

import pytest

from mjrun.errors import BadValueError, UsageError
from mjrun.model.sources import load
from mjrun.options.option import options_of
from mjrun.options.plot import PlotOptions
from mjrun.options.trace import PROBES, RecordingOptions, TraceOptions
from mjrun.probe.select import select


def test_the_default_probes_can_be_measured_in_any_model(swing: Path) -> None:
    columns = [column.name for probe in select(load(swing), PROBES) for column in probe.columns]
    assert {"qpos/hinge", "energy/total", "contact/ncon"} <= set(columns)
    assert TraceOptions(None).probe == PROBES


def test_probes_are_split_at_commas_but_not_within_brackets() -> None:
    expected = ("qpos", "xpos[hand, foot]", "energy")
    assert TraceOptions(None, probe="qpos, xpos[hand, foot],energy").probe == expected
    assert TraceOptions(None, probe=["qpos,xpos[hand, foot]", "energy"]).probe == expected


@pytest.mark.parametrize("text", ["", " , "])
def test_a_text_without_probes_is_refused(text: str) -> None:
    with pytest.raises(BadValueError, match=r"^probe: .* is not the name of something to measure"):
        TraceOptions(None, probe=["qpos", text])


def test_a_plot_keeps_the_probes_of_a_panel_together() -> None:
    assert PlotOptions(None, "a.png", probe=["qpos,qvel", "energy"]).probe == ("qpos,qvel", "energy")


@pytest.mark.parametrize("make", [TraceOptions, lambda *args, **rates: PlotOptions(*args, probe="energy", **rates)])
def test_how_often_is_said_once(make: type[TraceOptions]) -> None:
    with pytest.raises(UsageError, match=r"^every and rate exclude each other: both say how often"):
        make(None, "a.csv", every=2, rate=100)


def test_a_recording_has_every_step() -> None:
    assert {each.name for each in options_of(RecordingOptions)} == {"output", "keep_partial", "manifest"}
