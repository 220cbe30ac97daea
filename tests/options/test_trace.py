"""Options of traces: probes, sampling, and what excludes what."""

from pathlib import Path

import pytest

from mjrun.errors import BadValueError
from mjrun.model.sources import load
from mjrun.options.trace import PROBES, TraceOptions
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
