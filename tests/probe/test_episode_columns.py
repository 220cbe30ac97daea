"""Columns of an episode, selected as those of a model are."""

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.probe.assertion import parse
from mjrun.probe.episode_columns import EpisodeColumns, EpisodeProbe, EpisodeValues
from mjrun.probe.row_expression import parse_condition
from mjrun.probe.select import available_columns, select
from mjrun.probe.vocabularies import ModelVocabulary, TraceVocabulary
from tests.cases import cases

MODEL = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint name="hip"/><geom size=".1"/></body></worldbody></mujoco>'
)
EPISODE = EpisodeColumns({"position/x": "m", "position/y": "m", "last/hip": ""}, ["hip", "knee"], ["alive", "effort"])


VALUES = EpisodeValues(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0]), 13.0, np.array([6.0, 7.0]), 20.0)


@cases("text, names, values")
def test_a_name_selects_columns_and_their_values(text: str, names: list[str], values: list[float]) -> None:
    (probe,) = select(MODEL, [text], EPISODE)
    assert isinstance(probe, EpisodeProbe)
    assert [column.name for column in probe.columns] == names
    np.testing.assert_array_equal(probe.read(VALUES), values)


def test_units_are_those_of_the_observation() -> None:
    assert [column.unit for column in EPISODE.probes["obs"].columns] == ["m", "m", ""]


def test_a_term_called_total_takes_the_place_of_the_sum() -> None:
    columns = EpisodeColumns({}, [], ["alive", "total"])
    assert columns.names == ["reward/alive", "reward/total", "return"]
    np.testing.assert_array_equal(columns.probes["reward"].read(VALUES), [6, 7])


def test_they_are_offered_where_a_policy_acts() -> None:
    names = [column.name for column in available_columns(MODEL, EPISODE)]
    assert names[-len(EPISODE.names) :] == EPISODE.names
    assert not {*EPISODE.names} & {column.name for column in available_columns(MODEL)}


@pytest.mark.parametrize("text", ["obs", "obs/position/x", "action[hip]", "reward/alive", "return"])
def test_without_a_policy_an_error_says_so(text: str) -> None:
    with pytest.raises(UsageError, match="can only be measured if a policy acts: set policy"):
        select(MODEL, [text])


def test_expressions_read_them() -> None:
    expression = parse_condition(
        "reward/alive > 1 and norm('obs/position/*') < action(hip)", ModelVocabulary(MODEL, EPISODE.names), "when"
    )
    assert expression.columns == ("reward/alive", "obs/position/x", "obs/position/y", "action/hip")
    with pytest.raises(UsageError, match="'return' can only be measured if a policy acts"):
        parse_condition("return > 1", ModelVocabulary(MODEL), "when")
    with pytest.raises(UnknownNameError, match=r"no column .reward/alife. .*did you mean .reward/alive."):
        parse("last(reward/alife) > 1", ModelVocabulary(MODEL, EPISODE.names))
    with pytest.raises(UsageError, match="the model offers it: add probe return"):
        parse("last(return) > 1", TraceVocabulary(["time"], MODEL, EPISODE.names))
