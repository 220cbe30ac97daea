"""Assertions about a table of a known model: what is measured, what could be, and what is not there."""

import mujoco
import pytest

from mjrun.errors import UsageError
from mjrun.probe.assertion import parse
from mjrun.probe.scanner import is_bare
from mjrun.probe.select import select
from mjrun.probe.vocabularies import ModelVocabulary, TraceVocabulary
from tests.cases import cases

MODEL = mujoco.MjModel.from_xml_string(
    """
    <mujoco>
      <worldbody>
        <geom name="floor" type="plane" size="1 1 1"/>
        <body name="arm"><joint name="hip"/><geom name="skin" size=".1" pos=".1 0 0"/>
          <site name="low_tip"/><site name="it's"/></body>
      </worldbody>
    </mujoco>
    """
)


def columns_of(*asked: str) -> list[str]:
    return ["time", *(column.name for probe in select(MODEL, asked) for column in probe.columns)]


MEASURED = columns_of("qpos", "speed[low_tip,it's]", "site_xpos[low_tip]", "contact/skin/floor", "energy[drift]")


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("max(speed(low_tip)) < 1", ("speed/low_tip",)),
        ("speed('it''s') < 1", ("speed/it's",)),
        ("max(abs(site_xpos(low_tip).z)) < first(xpos(low_tip).x)", ("site_xpos/low_tip/x", "site_xpos/low_tip/z")),
        ("not (qpos(hip) < 1 and (time > 2))", ("time", "qpos/hip")),
        ("contact(skin, floor) == 0", ("contact/skin/floor",)),
        ("energy(drift) < 1", ("energy/drift",)),
    ],
)
def test_an_assertion_may_call_a_column_as_an_event_does(text: str, columns: tuple[str, ...]) -> None:
    assert parse(text, TraceVocabulary(MEASURED, MODEL)).columns == columns


@cases("text, name, probe")
def test_what_could_be_measured_is_reported_with_the_probe_that_measures_it(text: str, name: str, probe: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse(text, TraceVocabulary(MEASURED, MODEL))
    first, hint = str(caught.value).splitlines()
    assert first.startswith(f"no column '{name}' in '")
    assert hint == f"the model offers it: add probe {probe}"
    assert columns_of(probe) == ["time", probe]
    if name == probe:
        assert probe in parse(text, TraceVocabulary([*MEASURED, probe], MODEL)).columns


@cases("text, message")
def test_what_is_not_there_is_reported_as_ever(text: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse(text, TraceVocabulary(MEASURED, MODEL))
    assert message in str(caught.value)


def test_names_looked_up_one_by_one_are_those_of_the_whole_list() -> None:
    listed = ModelVocabulary(MODEL, ["obs/a b", "return"]).columns
    assert {*listed} >= {"time", "return", "obs/a b", "xpos/skin/z", "contact/ncon"}
    single = ModelVocabulary(MODEL, ["obs/a b", "return"])
    assert {name: single.column(name) for name in listed} == listed
    for name in filter(is_bare, listed):
        assert name in {f"{name} > 1"[:end] for end in single.ends(f"{name} > 1", 0)}
    assert {name for name in {"time", "none", *map(first_word, listed)} if single.is_group(name)} == single.groups


def first_word(name: str) -> str:
    return name.partition("/")[0]
