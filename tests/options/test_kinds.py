from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.options.kinds import CameraKind, Choice, Flag, Kind, NameOrIndex, OneOrMore, PathKind, Text, optional
from mjrun.options.number_kinds import (
    GROUPS,
    ExactNumber,
    Groups,
    Instant,
    Integer,
    Percent,
    ProcessCount,
    Range,
    Real,
    Size,
)
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import ColumnDefinitions, JointNumbers, NamedNumbers, Settings, setting_text


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        (Text(), "a", "a"),
        (Choice(("rgb", "depth")), "depth", "depth"),
        (Flag(), True, True),
        (Integer(1), np.int64(3), 3),
        (Integer(None), -4, -4),
        (Real(), 3, 3.0),
        (Real(most=1), 1, 1.0),
        (ExactNumber(), 0.1, Fraction(1, 10)),
        (ExactNumber(), "30000/1001", Fraction(30000, 1001)),
        (ExactNumber(zero=True), 0, Fraction(0)),
        (ExactNumber("SECONDS"), "1.5s", Fraction(3, 2)),
        (ExactNumber("SECONDS"), "20 ms", Fraction(1, 50)),
        (ExactNumber("SECONDS"), "1e3us", Fraction(1, 1000)),
        (ExactNumber("SECONDS"), "2min", Fraction(120)),
        (ExactNumber("SECONDS"), "1.5h", Fraction(5400)),
        (ExactNumber("FACTOR"), "1/4x", Fraction(1, 4)),
        (ExactNumber("HZ"), "1kHz", Fraction(1000)),
        (Instant(), 0.3, Fraction(3, 10)),
        (Size(), [640, 480], (640, 480)),
        (Size(), np.array([640, 480]), (640, 480)),
        (Range(), (0.5, 4), (0.5, 4.0)),
        (ProcessCount(), "auto", "auto"),
        (ProcessCount(), 4, 4),
        (Percent(), 0.1, 0.1),
        (Groups(), "all", GROUPS),
        (Groups(), "none", ()),
        (Groups(), [2, 0], (2, 0)),
        (NameOrIndex(), 3, "3"),
        (PathKind(), Path("a/b.npz"), "a/b.npz"),
        (PathKind(written=True, streamed=True), "-", "-"),
        (CameraKind(), 0, "0"),
        (NamedNumbers(), {"hip": 0.3, "root": [0, 0, 1]}, {"hip": (0.3,), "root": (0.0, 0.0, 1.0)}),
        (NamedNumbers(), {"root": np.zeros(2)}, {"root": (0.0, 0.0)}),
        (
            Settings(),
            {"opt.cone": "elliptic", "opt.gravity": [0, 0, -1]},
            (("opt.cone", "elliptic"), ("opt.gravity", "0,0,-1")),
        ),
        (ColumnDefinitions(), "time=t", ("time=t",)),
        (ColumnDefinitions(), Path("a/names.map"), ("@a/names.map",)),
        (ColumnDefinitions(), {"time": "t/1e3", "qpos/hip": 0.5}, ("time=t/1e3", "qpos/hip=0.5")),
        (ColumnDefinitions(), ["time=t", "@names.map"], ("time=t", "@names.map")),
        (OneOrMore(Text()), "one", ("one",)),
        (OneOrMore(Text()), ["one", "two"], ("one", "two")),
        (OneOrMore(Size()), (640, 480), ((640, 480),)),
        (OneOrMore(Size()), [(640, 480), (320, 240)], ((640, 480), (320, 240))),
    ],
)
def test_python_gives_a_value_and_a_kind_makes_it_immutable(
    kind: Kind[Any, Any], value: object, expected: object
) -> None:
    made = kind(value)
    assert made == expected
    assert kind(made) == expected  # a value is its own meaning


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        (Text(), 3, "text"),
        (Choice(("rgb", "depth")), "seg", "one of rgb, depth"),
        (Flag(), 1, "true or false"),
        (Integer(1), 0, "a whole number of at least 1"),
        (Integer(1, 9), 10, "a whole number from 1 to 9"),
        (Integer(), True, "a whole number of at least 0"),
        (Integer(), 1.0, "a whole number of at least 0"),
        (Real(), -1, "a number of at least 0"),
        (Real(), float("inf"), "a number of at least 0"),
        (Real(above=0.0), 0, "a positive number"),
        (Real(most=1), 2, "a number from 0 to 1"),
        (Real(least=None), "x", "a finite number"),
        (ExactNumber(), 0, "a positive number"),
        (ExactNumber(), "1e99999", "a positive number"),
        (ExactNumber("SECONDS"), "2x", "a positive number"),
        (ExactNumber("SECONDS"), "s", "a positive number"),
        (ExactNumber("SECONDS"), "-1s", "a positive number"),
        (ExactNumber(zero=True), -1, "a number of at least 0"),
        (PathKind(), "", "the name of a file"),
        (PathKind(written=True), "-", "the name of a file or folder; it cannot be standard output"),
        (Size(), "640x480", "a width and a height in pixels, as in (640, 480)"),
        (Size(), (640, 0), "a width and a height in pixels, as in (640, 480)"),
        (Range(), (4, 0.5), "two numbers, the smaller first"),
        (ProcessCount(), 0, "a number of processes, at least 1, or auto"),
        (Groups(), [6], "a list of groups from 0 to 5, all or none"),
        (ColumnDefinitions(), ["time=t", "time"], "COLUMN=EXPRESSION, as in qpos/knee=knee_deg*pi/180, or @FILE"),
        (ColumnDefinitions(), {"time": True}, "an expression or a number"),
    ],
)
def test_what_python_cannot_mean_is_refused(kind: Kind[Any, Any], value: object, message: str) -> None:
    with pytest.raises(InvalidValueError) as error:
        kind(value)
    assert error.value.expected == message


@pytest.mark.parametrize(
    ("kind", "text", "expected"),
    [
        (Size(), "1280x720", (1280, 720)),
        (Size(), "64X48", (64, 48)),
        (Range(), "0.5..4", (0.5, 4.0)),
        (ExactNumber(), "0.25", Fraction(1, 4)),
        (Real(), "1e-3", 0.001),
        (Integer(), "12", 12),
        (ProcessCount(), "2", 2),
        (ProcessCount(), "auto", "auto"),
        (Percent(), "10%", 0.1),
        (Groups(), "0,1", (0, 1)),
        (Groups(), "all", GROUPS),
        (NamedNumbers(), "root/z=1", ("root/z", (1.0,))),
        (NamedNumbers(), "a=b=1,2", ("a=b", (1.0, 2.0))),
        (Settings(), "opt.gravity=0,0,10", ("opt.gravity", "0,0,10")),
        (OneOrMore(Text(), commas=True), "a, b,,c", ("a", "b", "c")),
        (OneOrMore(Text()), "a,b", "a,b"),
    ],
)
def test_a_command_line_is_parsed(kind: Kind[Any, Any], text: str, expected: object) -> None:
    assert kind.parse(text) == expected


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (Size(), "640"),
        (Size(), "0x480"),
        (Range(), "4..1"),
        (Range(), "1"),
        (Range(), "nan..1"),
        (ExactNumber(), "-1"),
        (ExactNumber(), "x"),
        (Real(), "nan"),
        (Integer(), "1.5"),
        (Integer(), "9" * 31),
        (ProcessCount(), "0"),
        (Percent(), "10"),
        (Percent(), "x%"),
        (Groups(), "6"),
        (Groups(), "0;1"),
        (NamedNumbers(), "hip"),
        (NamedNumbers(), "hip=nan"),
        (NamedNumbers(), "=1"),
        (Settings(), "opt.cone="),
        (ColumnDefinitions(), "time="),
        (ColumnDefinitions(), "=t"),
        (ColumnDefinitions(), "@"),
    ],
)
def test_text_that_means_nothing_is_refused(kind: Kind[Any, Any], text: str) -> None:
    with pytest.raises(InvalidValueError):
        kind.parse(text)


@pytest.mark.parametrize("kind", [NamedNumbers(), JointNumbers()])
def test_two_settings_in_one_text_are_refused_instead_of_one_with_a_comma_in_its_name(kind: Kind[Any, Any]) -> None:
    with pytest.raises(InvalidValueError, match="one NAME=VALUE; repeat the option for each name"):
        kind.parse("forward=0.5,turn=0.1")


@given(st.lists(st.integers(0, 5)))
def test_groups_survive_a_document(groups: list[int]) -> None:
    kind = Groups()
    assert kind(kind.plain(kind(groups))) == tuple(groups)


@given(st.dictionaries(st.text(min_size=1), st.lists(st.floats(allow_nan=False), min_size=1)))
def test_values_survive_a_document(values: dict[str, list[float]]) -> None:
    kind = NamedNumbers()
    assert kind(kind.plain(kind(values))) == {name: tuple(numbers) for name, numbers in values.items()}


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "true"), (3, "3"), (0.5, "0.5"), ("elliptic", "elliptic"), ([0, 0, -1.6], "0,0,-1.6"), ((1, 2), "1,2")],
)
def test_the_text_of_a_setting_is_what_a_command_line_would_say(value: object, text: str) -> None:
    assert setting_text(value) == text


@pytest.mark.parametrize("value", ["", [], [True], {}, None, float("nan"), float("inf"), [[1]]])
def test_a_setting_that_has_no_text_is_refused(value: object) -> None:
    with pytest.raises(InvalidValueError):
        setting_text(value)


@pytest.mark.parametrize("make", [lambda: OneOrMore(Size()), lambda: optional(Choice(("a", "b"))), lambda: Integer()])
def test_a_kind_says_what_stands_for_its_value(make: Callable[[], Kind[Any, Any]]) -> None:
    assert make().metavar in ("WxH", "a|b", "N")
