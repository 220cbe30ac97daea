"""Conditions and numbers per row: values against numpy, and where conditions begin to hold against bare loops."""

import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UnknownNameError, UsageError, clean
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from mjrun.probe.assertion import parse
from mjrun.probe.parser import LONGEST
from mjrun.probe.row_expression import (
    Condition,
    RisingEdgeDetector,
    named_condition,
    parse_condition,
    parse_row_expression,
)
from mjrun.probe.scanner import spelled
from mjrun.probe.select import aliases, available_columns
from mjrun.probe.vocabularies import ModelVocabulary, TableVocabulary
from mjrun.timeline import Timeline, rational
from tests.cases import cases, mjcf

RNG = np.random.default_rng(3)
TABLE = {"t": np.linspace(0.0, 1.0, 50), "knee_deg": RNG.normal(size=50), "qpos/root/x": RNG.normal(size=50)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t", TABLE["t"]),
        ("knee_deg*pi/180", TABLE["knee_deg"] * np.pi / 180),
        ("-qpos/root/x ^ 2 + 1", -(TABLE["qpos/root/x"] ** 2) + 1),
        ("max(t, knee_deg, 0)", np.maximum(np.maximum(TABLE["t"], TABLE["knee_deg"]), 0)),
        ("knee_deg - first(knee_deg)", TABLE["knee_deg"] - TABLE["knee_deg"][0]),
        ("3", np.full(50, 3.0)),
    ],
)
def test_the_values_are_numpys(text: str, expected: np.ndarray) -> None:
    expression = parse_row_expression(text, list(TABLE), "map")
    np.testing.assert_array_equal(expression.values(TABLE), expected)


@pytest.mark.parametrize("sizes", [(50,), (1, 49), (0, 7, 43)])
def test_values_do_not_depend_on_the_blocks(sizes: tuple[int, ...]) -> None:
    expression = parse_row_expression("knee_deg / t - first(qpos/root/x)", list(TABLE), "map")
    evaluator, values, start = expression.evaluator(), [], 0
    for size in sizes:
        values.append(evaluator.feed({name: column[start : start + size] for name, column in TABLE.items()}))
        start += size
    with np.errstate(divide="ignore"):
        expected = TABLE["knee_deg"] / TABLE["t"] - TABLE["qpos/root/x"][0]
    np.testing.assert_array_equal(np.concatenate(values), expected)


def test_the_columns_are_those_that_are_read_in_the_order_of_the_text() -> None:
    assert parse_row_expression("knee_deg + t*knee_deg", list(TABLE), "map").columns == ("knee_deg", "t")
    assert parse_row_expression("1", list(TABLE), "map").columns == ()


@cases("text, message")
def test_what_has_no_value_per_row_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_row_expression(text, list(TABLE), "map")


def test_an_unknown_column_is_named_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="knee_deg"):
        parse_row_expression("knee_dg", list(TABLE), "map")


SCENE = mujoco.MjModel.from_xml_string(mjcf("odd_names"))
NAN, INF = math.nan, math.inf


vocabulary = cache(ModelVocabulary)


def condition(text: str, model: mujoco.MjModel, label: str = "when") -> Condition:
    return parse_condition(text, vocabulary(model), label)


def probes(watched: Condition) -> list[str]:
    """What a condition asks for, but for the time."""
    return [name for name in watched.columns if name != "time"]


def holds(watched: Condition, rows: np.ndarray) -> np.ndarray:
    """Where a condition holds; the columns of `rows` are the time and what it asks for."""
    return watched.holds(dict(zip(("time", *probes(watched)), rows.T, strict=True)))


def begins(text: str, model: mujoco.MjModel, steps: int, qvel: Sequence[float] = ()) -> list[int]:
    """The steps from 0 to `steps` at which a condition begins to hold."""
    watched, timeline = condition(text, model), Timeline.of_steps(rational(model.opt.timestep), steps)
    table, data, rows = ProbeSampler(model, watched.columns, timeline), mujoco.MjData(model), []
    data.qvel[: len(qvel)] = qvel
    stepper = PhysicsStepper(table.model, data)
    tap = Tap(range(steps + 1), lambda s: rows.append([float(timeline.time(s.step)), *table.values(s)]))
    run_with_taps(stepper, [tap], steps)
    onsets = RisingEdgeDetector()
    onsets.feed(holds(watched, np.array(rows)))
    return onsets.indices


def loop(model: mujoco.MjModel, steps: int, qvel: Sequence[float], holds: Callable[[mujoco.MjData], bool]) -> list[int]:
    """Where `holds` begins to be true: a bare loop; each step is looked at on a copy."""
    data, seen, before, found = mujoco.MjData(model), mujoco.MjData(model), False, []
    data.qvel[: len(qvel)] = qvel
    for step in range(steps + 1):
        mujoco.mj_copyData(seen, model, data)
        mujoco.mj_forward(model, seen)
        if holds(seen) and not before:
            found.append(step)
        before = holds(seen)
        mujoco.mj_step(model, data)
    return found


# --- when events happen ----------------------------------------------------------------------------

THROWN = [0.3, 0.1, 2.0, 0, 0, 0]


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("speed(box) > 1.234", lambda data: np.linalg.norm(data.qvel[:3]) > 1.234),
        ("xpos(box).z > 1.1", lambda data: data.body("box").xpos[2] > 1.1),
        ("xpos(crate).z > 1.1", lambda data: data.geom("crate").xpos[2] > 1.1),
        ("abs(qvel(hinge)) > 2", lambda data: abs(data.joint("hinge").qvel[0]) > 2),
        ("qpos/hinge < -.1 and time > .301", lambda data: data.joint("hinge").qpos[0] < -0.1 and data.time > 0.301),
        ("contact(ball, floor)", lambda data: touch(data, "ball", "floor")),
        ("not contact(floor, ball)", lambda data: not touch(data, "ball", "floor")),
        ("contact(ball, crate) or contact(box, floor)", lambda data: touch(data, "crate", "floor")),
        ("contact(world, world) > 3", lambda data: data.ncon > 3),
        ("sensor(imu).y < -1", lambda data: data.sensor("imu").data[1] < -1),
    ],
)
def test_a_condition_begins_to_hold_where_a_bare_loop_finds_it(
    text: str, holds: Callable[[mujoco.MjData], bool]
) -> None:
    motion = [*THROWN, *[0] * 6, -3]
    expected = loop(SCENE, 500, motion, holds)
    assert begins(text, SCENE, 500, motion) == expected
    assert expected, "the example shows nothing"


def touch(data: mujoco.MjData, one: str, other: str) -> bool:
    geoms = {data.geom(one).id, data.geom(other).id}
    return any({int(contact.geom[0]), int(contact.geom[1])} == geoms for contact in data.contact)


def test_energy_is_measured_though_the_model_does_not_compute_it() -> None:
    motion = [*THROWN, *[0] * 6, -3]
    energetic = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    mass = energetic.body_mass[1]
    expected = loop(energetic, 100, motion[:6], lambda data: bool(mass * (data.qvel[:3] ** 2).sum() / 2 < 3))
    assert begins("energy/kinetic < 3", energetic, 100, motion[:6]) == expected
    assert len(expected) == 1
    assert expected[0] > 0


def test_time_is_exact_and_not_a_sum_of_timesteps() -> None:
    assert SCENE.opt.timestep == 0.002
    assert begins("time >= 0.2", SCENE, 200) == [100]
    assert begins("time > 0.2", SCENE, 200) == [101]


# --- what a condition says of an instant -----------------------------------------------------------

ROWS = np.array([[0, 1, 2], [0.5, -1, 2], [1, 0, 0], [1.5, NAN, 1], [2, INF, -INF], [2.5, 3, NAN]])
PAIR = [
    ("qpos(hinge) > qvel(hinge)", lambda t, x, y: x > y),
    ("qpos/hinge > qvel/hinge", lambda t, x, y: x > y),
    ("not qpos(hinge) > qvel(hinge)", lambda t, x, y: x <= y),
    ("qpos(hinge) != qvel(hinge)", lambda t, x, y: (x < y) | (x > y)),
    ("time > 1 and (qpos(hinge) > 0 or qvel(hinge) < 0)", lambda t, x, y: (t > 1) & ((x > 0) | (y < 0))),
    ("0 <= qpos(hinge) < 2 + 0*qvel(hinge)", lambda t, x, y: (x >= 0) & (x < 2 + 0 * y)),
    ("max(qpos(hinge), qvel(hinge)) > 1 - time", lambda t, x, y: np.maximum(x, y) > 1 - t),
    ("abs(qpos(hinge) - `qvel/hinge`)^2 > 4", lambda t, x, y: np.square(np.abs(x - y)) > 4),
]


@pytest.mark.parametrize(("text", "meant"), PAIR)
def test_a_condition_holds_where_numpy_says_and_nowhere_with_nan(text: str, meant: Callable[..., np.ndarray]) -> None:
    watched = condition(text, SCENE)
    assert probes(watched) == ["qpos/hinge", "qvel/hinge"]
    with np.errstate(all="ignore"):
        expected = meant(*ROWS.T)
    found = holds(watched, ROWS)
    assert (found.dtype, found.tolist()) == (np.dtype(bool), expected.tolist())
    assert 0 < found.sum() < len(found)


@cases("text, expected")
def test_a_number_of_contacts_alone_holds_above_zero(text: str, expected: list[bool]) -> None:
    watched = condition(text, SCENE)
    assert probes(watched) == ["contact/ball/floor"]
    assert holds(watched, np.array([[0, 0], [1, 1], [2, 2], [3, 0], [4, NAN]])).tolist() == expected


def test_a_condition_on_time_alone_measures_nothing_else() -> None:
    watched = condition("time >= 1", SCENE)
    assert watched.columns == ("time",)
    assert holds(watched, np.array([[0.5], [1.0]])).tolist() == [False, True]
    assert holds(watched, np.empty((0, 1))).shape == (0,)


@pytest.mark.parametrize(
    "text", ["sin(qpos(hinge)) + exp(qvel(hinge)) > .9", "qpos(hinge)^2.5 * log(qvel(hinge)) < .1"]
)
def test_rows_one_at_a_time_hold_as_all_at_once(text: str) -> None:
    rows = np.random.default_rng(3).standard_normal((500, 3))
    watched = condition(text, SCENE)
    assert holds(watched, rows).tolist() == [bool(holds(watched, row[None])[0]) for row in rows]


# --- names -----------------------------------------------------------------------------------------


@cases("text, columns")
def test_an_accessor_is_the_column_that_it_spells(text: str, columns: list[str]) -> None:
    watched = condition(text, SCENE)
    assert probes(watched) == columns
    timeline = Timeline.of_steps(rational(SCENE.opt.timestep), 1)
    assert [column.name for column in ProbeSampler(SCENE, watched.columns, timeline).columns[1:]] == columns


def test_every_column_of_the_model_can_be_spelled_and_accessed() -> None:
    names = [column.name for column in available_columns(SCENE)]
    for start in range(0, len(names), 100):
        part = names[start : start + 100]
        assert condition(" + ".join(map(spelled, part)) + " > 0", SCENE).columns == tuple(part)
        called = [f"{group}({spelled(rest)})" for group, _, rest in (name.partition("/") for name in part)]
        assert condition(" + ".join(called) + " > 0", SCENE).columns == tuple(part)


def test_every_alias_reads_the_column_that_it_stands_for() -> None:
    known = {column.name for column in available_columns(SCENE)}
    others = {name: column for name, column in aliases(SCENE).items() if name not in known}
    assert others
    assert condition(" + ".join(map(spelled, others)) + " > 0", SCENE).columns == tuple(dict.fromkeys(others.values()))


def test_in_assertions_there_are_no_accessors() -> None:
    with pytest.raises(UnknownNameError, match="no function 'speed'"):
        parse("speed(box) > 1", ["speed/box", "time"])


# --- what is no condition --------------------------------------------------------------------------

CLOSED = "',' or ')'; a name with other characters is quoted"
COMPARISONS = "a comparison (< <= > >= == !=)"

WRONG = [
    ("", 1, "the end", "a number, a column, a function, '(' or 'not'"),
    ("speed(box)", 1, "a number", COMPARISONS),
    ("time", 1, "a number", COMPARISONS),
    ("contact(ball, floor) + 1", 1, "a number", COMPARISONS),
    ("contact(ball, floor) > 1 and speed(box)", 30, "a number", COMPARISONS),
    ("speed(box) > 1 2", 16, "'2'", "an operator or the end"),
    ("speed(box) = 1", 12, "'=' (did you mean ==?)", "an operator or the end"),
    ("speed(box > 1", 11, "'>'", CLOSED),
    ("speed(box", 10, "the end", CLOSED),
    ("speed(", 7, "the end", "the name of an object"),
    ("speed() > 1", 7, "')'", "the name of an object"),
    ("speed(box,) > 1", 11, "')'", "the name of an object"),
    ("speed(q[0]) > 1", 8, "'['", CLOSED),
    ("speed('box) > 1", 7, "a quote that is not closed", "another '"),
    ("speed/q[0] > 1", 1, "the column speed/q[0] without quotes", "'speed/q[0]'"),
    ("1 < speed(box, ball)", 5, "speed of 2 objects", "speed of one"),
    ("contact(ball)", 1, "contact of one object", "contact of two"),
    ("contact(ball, box, floor)", 1, "contact of 3 objects", "contact of two"),
    ("contact(ball, floor).x > 1", 21, "component .x", "none, contact/ball/floor is one number"),
    ("speed(box).x > 1", 11, "component .x", "none, speed/box is one number"),
    ("2 < xpos(box)", 5, "xpos(box), which has several components", "one of .x, .y, .z"),
    ("qpos(ball) > 1", 1, "qpos(ball), which has several components", "one of .x, .y, .z, .qw, .qx, .qy, .qz"),
    ("max(speed(box)) > 1", 1, "max over all instants", "max of several, or of a vector"),
    ("mean(speed(box)) > 1", 1, "mean over all instants", "values of one instant"),
    ("mean(time, 2) > 1", 1, "mean over all instants", "values of one instant"),
    ("time > first(time)", 8, "first over all instants", "values of one instant"),
    ("1 < 2", 1, "a comparison of numbers only", "a column on one side"),
]


@pytest.mark.parametrize(("text", "place", "found", "expected"), WRONG)
@pytest.mark.parametrize("label", ["when", "camera.yaml:3: until"])
def test_what_is_no_condition_is_reported_where_what_was_found_and_what_is_valid(
    text: str, place: int, found: str, expected: str, label: str
) -> None:
    with pytest.raises(UsageError) as caught:
        condition(text, SCENE, label)
    assert caught.value.exit_code == 2
    pointer = f"\n  {text}\n  {' ' * (place - 1)}^" if text else ""
    assert str(caught.value) == f"{label}, character {place}: found {found}, expected {expected}{pointer}"


@cases("text, nothing, place, near, valid")
def test_an_unknown_name_is_reported_with_near_and_valid_ones(
    text: str, nothing: str, place: int, near: str, valid: str
) -> None:
    with pytest.raises(UnknownNameError) as caught:
        condition(text, SCENE)
    first, second = str(caught.value).split("\n")
    told, _, meant = first.partition(" (did you mean ")
    assert told == f"{nothing} in '{text}', character {place}"
    assert meant.startswith(f"'{near}'" if near else "")
    assert second.startswith(valid)


def test_a_condition_too_long_is_refused_by_its_label() -> None:
    with pytest.raises(UsageError, match=rf"^when: {LONGEST + 1} characters, expected at most {LONGEST}$"):
        condition("(" * (LONGEST + 1), SCENE)


PARTS = [
    *"xyab/.-+*^<>()',` \t01",
    *"\x1b\u202eé²",
    " and ",
    " not ",
    "max(",
    "speed(",
    "xpos(b)",
    "contact(",
    "contact/",
]
SMALL = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body name='b'><geom size='.1'/></body></worldbody></mujoco>"
)


@given(st.lists(st.sampled_from([*PARTS, "b", "b)", "b, b)", "geom:0", ".z", " > 1"])).map("".join))
@settings(max_examples=100, deadline=None)
def test_any_text_is_a_condition_or_a_usage_error_fit_for_a_terminal(text: str) -> None:
    try:
        watched = condition(text, SMALL)
    except UsageError as error:
        message = str(error)
        assert [clean(line) for line in message.split("\n")] == message.split("\n")
    else:
        assert holds(watched, np.ones((2, 1 + len(probes(watched))))).shape == (2,)


# --- where it begins -------------------------------------------------------------------------------


def naive(holds: Sequence[bool]) -> list[int]:
    return [i for i, now in enumerate(holds) if now and (i == 0 or not holds[i - 1])]


@given(st.lists(st.booleans()), st.lists(st.integers(0, 30)))
def test_onsets_do_not_depend_on_how_the_rows_are_split(holds: list[bool], cuts: list[int]) -> None:
    onsets: Any = RisingEdgeDetector()
    for start, end in pairwise(sorted({0, *(min(cut, len(holds)) for cut in cuts), len(holds)})):
        onsets.feed(np.array(holds[start:end], bool))
        assert onsets.indices == naive(holds[:end])
    onsets.feed(np.empty(0, bool))
    assert onsets.indices == naive(holds)


TOUCHING_ROWS = {
    "time": np.array([0.0, 1, 2]),
    "contact/ball/floor": np.array([0.0, 2, np.nan]),
    "xpos/top/z": np.array([3.0, 2, 1]),
}


TABLE_NAMES = TableVocabulary(list(TOUCHING_ROWS))


@cases("text, expected")
def test_a_condition_holds_row_by_row(text: str, expected: list[bool]) -> None:
    assert parse_condition(text, TABLE_NAMES, "when").holds(TOUCHING_ROWS).tolist() == expected


def test_a_condition_knows_what_it_reads() -> None:
    assert parse_condition("xpos(top).z < time", TABLE_NAMES, "when").columns == ("xpos/top/z", "time")


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("contact(ball, wall)", UnknownNameError, "no column 'contact/ball/wall'"),
        ("time", UsageError, "found a number, expected a comparison"),
        ("max(time) > 3", UsageError, "over all instants"),
        ("1 < 2", UsageError, "numbers only"),
    ],
)
def test_what_is_no_condition_is_refused(text: str, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        parse_condition(text, TABLE_NAMES, "when")


@pytest.mark.parametrize(
    ("text", "label", "condition"),
    [
        ("landed=time > 1", "landed", "time > 1"),
        ("time >= 1", "time >= 1", "time >= 1"),
        ("'a=b' > 1", "'a=b' > 1", "'a=b' > 1"),
        ("`a=b` > 1", "`a=b` > 1", "`a=b` > 1"),
        ('"a=b" > 1', '"a=b" > 1', '"a=b" > 1'),
        ('high="a=b" > 1', "high", '"a=b" > 1'),
    ],
)
def test_a_condition_may_have_a_label_and_names_in_any_quotes_hold_no_label(
    text: str, label: str, condition: str
) -> None:
    assert named_condition(text) == (label, condition)
