"""Kinds of values: what Python, a command line and a document may give, and what is made of it."""

import math
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.options.datasets import NamedSharesKind
from mjrun.options.diff import ColumnTolerancesKind
from mjrun.options.evaluation import LowestValuesKind
from mjrun.options.kinds import (
    AnyKind,
    CameraKind,
    ChoiceKind,
    FlagKind,
    Kind,
    NameOrIndexKind,
    OneOrMoreKind,
    PathKind,
    TextKind,
    optional,
)
from mjrun.options.number_kinds import (
    GROUPS,
    ExactNumberKind,
    FigureSizeKind,
    GroupsKind,
    InstantKind,
    IntegerKind,
    PercentKind,
    ProcessCountKind,
    RangeKind,
    RealKind,
    SizeKind,
)
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import (
    DISTRIBUTIONS,
    ColumnDefinitionsKind,
    JointNumbersKind,
    NamedNumbersKind,
    SettingsKind,
    VariedSettingsKind,
    setting_text,
    with_paths,
)
from mjrun.options.task import LimitsKind, RandomValueKind, TimedValuesKind, VectorOrKeyframeKind
from mjrun.physics.random_distribution import parse_distribution
from tests.cases import cases


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        (TextKind(), "a", "a"),
        (ChoiceKind(("rgb", "depth")), "depth", "depth"),
        (FlagKind(), True, True),
        (IntegerKind(1), np.int64(3), 3),
        (IntegerKind(None), -4, -4),
        (RealKind(), 3, 3.0),
        (RealKind(most=1), 1, 1.0),
        (ExactNumberKind(), 0.1, Fraction(1, 10)),
        (ExactNumberKind(), "30000/1001", Fraction(30000, 1001)),
        (ExactNumberKind(zero=True), 0, Fraction(0)),
        (ExactNumberKind("SECONDS"), "1.5s", Fraction(3, 2)),
        (ExactNumberKind("SECONDS"), "20 ms", Fraction(1, 50)),
        (ExactNumberKind("SECONDS"), "1e3us", Fraction(1, 1000)),
        (ExactNumberKind("SECONDS"), "2min", Fraction(120)),
        (ExactNumberKind("SECONDS"), "1.5h", Fraction(5400)),
        (ExactNumberKind("FACTOR"), "1/4x", Fraction(1, 4)),
        (ExactNumberKind("HZ"), "1kHz", Fraction(1000)),
        (InstantKind(), 0.3, Fraction(3, 10)),
        (SizeKind(), [640, 480], (640, 480)),
        (SizeKind(), np.array([640, 480]), (640, 480)),
        (RangeKind(), (0.5, 4), (0.5, 4.0)),
        (ProcessCountKind(), "auto", "auto"),
        (ProcessCountKind(), 4, 4),
        (PercentKind(), 0.1, 0.1),
        (GroupsKind(), "all", GROUPS),
        (GroupsKind(), "none", ()),
        (GroupsKind(), [2, 0], (2, 0)),
        (NameOrIndexKind(), 3, "3"),
        (PathKind(), Path("a/b.npz"), "a/b.npz"),
        (PathKind(written=True, streamed=True), "-", "-"),
        (CameraKind(), 0, "0"),
        (NamedNumbersKind(), {"hip": 0.3, "root": [0, 0, 1]}, {"hip": (0.3,), "root": (0.0, 0.0, 1.0)}),
        (NamedNumbersKind(), {"root": np.zeros(2)}, {"root": (0.0, 0.0)}),
        (
            SettingsKind(),
            {"opt.cone": "elliptic", "opt.gravity": [0, 0, -1]},
            (("opt.cone", "elliptic"), ("opt.gravity", "0,0,-1")),
        ),
        (ColumnDefinitionsKind(), "time=t", ("time=t",)),
        (ColumnDefinitionsKind(), Path("a/names.map"), ("@a/names.map",)),
        (ColumnDefinitionsKind(), {"time": "t/1e3", "qpos/hip": 0.5}, ("time=t/1e3", "qpos/hip=0.5")),
        (ColumnDefinitionsKind(), ["time=t", "@names.map"], ("time=t", "@names.map")),
        (OneOrMoreKind(TextKind()), "one", ("one",)),
        (OneOrMoreKind(TextKind()), ["one", "two"], ("one", "two")),
        (OneOrMoreKind(SizeKind()), (640, 480), ((640, 480),)),
        (OneOrMoreKind(SizeKind()), [(640, 480), (320, 240)], ((640, 480), (320, 240))),
        (ColumnTolerancesKind(), {"x": 1, "y": [1, 2]}, {"x": (1.0,), "y": (1.0, 2.0)}),
        (
            NamedSharesKind(),
            "train=0.7, val=0.2,test=1/10",
            (("train", Fraction(7, 10)), ("val", Fraction(1, 5)), ("test", Fraction(1, 10))),
        ),
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
        (TextKind(), 3, "text"),
        (ChoiceKind(("rgb", "depth")), "seg", "one of rgb, depth"),
        (FlagKind(), 1, "true or false"),
        (IntegerKind(1), 0, "a whole number of at least 1"),
        (IntegerKind(1, 9), 10, "a whole number from 1 to 9"),
        (IntegerKind(), 10**18, "a whole number of at least 0 and below 1e18"),
        (IntegerKind(None), -(10**18), "a whole number between -1e18 and 1e18"),
        (IntegerKind(), True, "a whole number of at least 0"),
        (IntegerKind(), 1.0, "a whole number of at least 0"),
        (RealKind(), -1, "a number of at least 0"),
        (RealKind(), float("inf"), "a number of at least 0"),
        (RealKind(above=0.0), 0, "a positive number"),
        (RealKind(most=1), 2, "a number from 0 to 1"),
        (RealKind(above=0.0, most=0.5), 1, "a number above 0 and up to 0.5"),
        (RealKind(least=None), "x", "a finite number"),
        (ExactNumberKind(), 0, "a positive number"),
        (ExactNumberKind(), "1e99999", "a positive number"),
        (ExactNumberKind("SECONDS"), "2sec", "a positive number; units: s, ms, us, ns, min, h"),
        (ExactNumberKind("SECONDS"), "s", "a positive number"),
        (ExactNumberKind("SECONDS"), "-1s", "a positive number"),
        (ExactNumberKind(zero=True), -1, "a number of at least 0"),
        (PathKind(), "", "the name of a file"),
        (
            PathKind(written=True, unlike=[".xml"]),
            "a.XML",
            "a name for this file: it ends like a model, a document or code",
        ),
        (PathKind(written=True), "-", "the name of a file or folder; it cannot be standard output"),
        (SizeKind(), "640x480", "a width and a height in pixels, as in (640, 480)"),
        (SizeKind(), (640, 0), "a width and a height in pixels, as in (640, 480)"),
        (RangeKind(), (4, 0.5), "two numbers, the smaller first"),
        (ProcessCountKind(), 0, "a number of processes, at least 1, or auto"),
        (GroupsKind(), [6], "a list of groups from 0 to 5, all or none"),
        (ColumnDefinitionsKind(), ["time=t", "time"], "COLUMN=EXPRESSION, as in qpos/knee=knee_deg*pi/180, or @FILE"),
        (ColumnDefinitionsKind(), {"time": True}, "an expression or a number"),
    ],
)
def test_what_python_cannot_mean_is_refused(kind: Kind[Any, Any], value: object, message: str) -> None:
    with pytest.raises(InvalidValueError) as error:
        kind(value)
    assert error.value.expected == message


@pytest.mark.parametrize(
    ("kind", "text", "expected"),
    [
        (SizeKind(), "1280x720", (1280, 720)),
        (SizeKind(), "64X48", (64, 48)),
        (RangeKind(), "0.5..4", (0.5, 4.0)),
        (ExactNumberKind(), "0.25", Fraction(1, 4)),
        (RealKind(), "1e-3", 0.001),
        (IntegerKind(), "12", 12),
        (ProcessCountKind(), "2", 2),
        (ProcessCountKind(), "auto", "auto"),
        (PercentKind(), "10%", 0.1),
        (PercentKind(), "0.7%", 0.007),
        (GroupsKind(), "0,1", (0, 1)),
        (GroupsKind(), "all", GROUPS),
        (NamedNumbersKind(), "root/z=1", ("root/z", (1.0,))),
        (NamedNumbersKind(), "a=b=1,2", ("a=b", (1.0, 2.0))),
        (SettingsKind(), "opt.gravity=0,0,10", ("opt.gravity", "0,0,10")),
        (OneOrMoreKind(TextKind(), commas=True), "a, b,,c", ("a", "b", "c")),
        (OneOrMoreKind(TextKind()), "a,b", "a,b"),
        (FigureSizeKind(), "1280x720", (1280, 720)),
        (FigureSizeKind(), "85mmx60mm", (321, 227)),
        (FigureSizeKind(), "85x60mm", (321, 227)),
        (FigureSizeKind(), "25.4mmx50.8mm", (96, 192)),
        (ColumnTolerancesKind(), "qvel/*=1e-6", ("qvel/*", (1e-6,))),
        (ColumnTolerancesKind(), "a=b=0,1e-3", ("a=b", (0.0, 1e-3))),
        (LowestValuesKind(), "success=90%", ("success", (0.9,))),
        (LowestValuesKind(), "success=99.9%", ("success", (0.999,))),
        (LowestValuesKind(), "return=-200", ("return", (-200.0,))),
        (LowestValuesKind(), "success_low=0.8", ("success_low", (0.8,))),
    ],
)
def test_a_command_line_is_parsed(kind: Kind[Any, Any], text: str, expected: object) -> None:
    assert kind.parse(text) == expected


@pytest.mark.parametrize(
    ("kind", "texts"),
    [
        (SizeKind(), ["640", "0x480", "9" * 5000 + "x2"]),
        (FigureSizeKind(), ["85mmx60", "85mm", "x60mm", "0x0mm", "1.2.3x4mm", "85cmx60cm", "9" * 400 + "mmx60mm"]),
        (RangeKind(), ["4..1", "1", "nan..1"]),
        (ExactNumberKind(), ["-1", "x"]),
        (RealKind(), ["nan"]),
        (IntegerKind(), ["1.5", "9" * 31]),
        (ProcessCountKind(), ["0"]),
        (PercentKind(), ["10", "x%", "1e400%", "nan%"]),
        (GroupsKind(), ["6", "0;1"]),
        (NamedNumbersKind(), ["hip", "hip=nan", "=1"]),
        (JointNumbersKind(), ["hip=90degrees", "hip=deg", "hip=nandeg", "hip=1e999m", "hip=", "90deg", "hip=1deg/s"]),
        (SettingsKind(), ["opt.cone="]),
        (ColumnDefinitionsKind(), ["time=", "=t", "@"]),
        (ColumnTolerancesKind(), ["x", "x=", "=1", "x=one", "x=-1", "x=1,2,3", "x=nan", "x=1,inf"]),
        (LowestValuesKind(), ["0.9", "success", "=3", "success=most", "success=nan", "success=1,2", "a=%", "a=1e400%"]),
        (NamedSharesKind(), ["", "train", "train=0.8", "a=0.5,a=0.5", "a=1.5,b=-0.5", "a/b=1", "a=1/0", "a=x"]),
        (NamedSharesKind(), ["a=1e999999999", "a=1e9_99_99_99"]),
    ],
)
def test_text_that_means_nothing_is_refused(kind: Kind[Any, Any], texts: list[str]) -> None:
    forms = {
        JointNumbersKind: r"units: deg, rad, mm, cm, m|NAME=VALUE",
        LowestValuesKind: "success=90% or return=200",
    }
    for text in texts:
        with pytest.raises(InvalidValueError, match=forms.get(type(kind))):
            (kind if isinstance(kind, NamedSharesKind) else kind.parse)(text)


@pytest.mark.parametrize("kind", [NamedNumbersKind(), JointNumbersKind()])
def test_two_settings_in_one_text_are_refused_instead_of_one_with_a_comma_in_its_name(kind: Kind[Any, Any]) -> None:
    with pytest.raises(InvalidValueError, match="one NAME=VALUE; repeat the option for each name"):
        kind.parse("forward=0.5,turn=0.1")


@given(st.lists(st.integers(0, 5)))
def test_groups_survive_a_document(groups: list[int]) -> None:
    kind = GroupsKind()
    assert kind(kind.plain(kind(groups))) == tuple(groups)


@given(st.dictionaries(st.text(min_size=1), st.lists(st.floats(allow_nan=False), min_size=1)))
def test_values_survive_a_document(values: dict[str, list[float]]) -> None:
    kind = NamedNumbersKind()
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


@pytest.mark.parametrize(
    "make", [lambda: OneOrMoreKind(SizeKind()), lambda: optional(ChoiceKind(("a", "b"))), lambda: IntegerKind()]
)
def test_a_kind_says_what_stands_for_its_value(make: Callable[[], Kind[Any, Any]]) -> None:
    assert make().metavar in ("WxH", "a|b", "N")


@cases("value, text")
def test_every_form_of_what_varies_is_a_text(value: object, text: str) -> None:
    assert VariedSettingsKind()({"x": value}) == (("x", text),)


@pytest.mark.parametrize(
    "value", [None, {}, {"from": 1}, {"gauss": [0, 1]}, {"uniform": 1}, {"uniform": [0, 1], "normal": [0, 1]}, [None]]
)
def test_what_varies_in_no_known_way_is_refused(value: object) -> None:
    with pytest.raises(InvalidValueError):
        VariedSettingsKind()({"x": value})


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_every_distribution_can_be_written_as_a_mapping(name: str) -> None:
    numbers = [1, 2, 0, 3] if name == "truncnormal" else [1, 2]
    text = VariedSettingsKind().text({name: numbers})
    distribution = parse_distribution(text, "vary x")
    assert distribution
    assert (distribution.name, [float(each) for each in distribution.arguments]) == (name, numbers)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a.xml,b.xml", "d/a.xml,d/b.xml"), ("a.xml;", "d/a.xml;"), (" choice(a.xml, b.xml)", "choice(d/a.xml,d/b.xml)")],
)
def test_paths_are_converted_one_by_one(text: str, expected: str) -> None:
    assert with_paths(text, lambda path: f"d/{path}") == expected


def test_lengths_with_units_are_the_floats_of_their_decimals() -> None:
    lengths = [f"{number}mm" for number in range(100)]
    assert JointNumbersKind(rate=False).parse(f"root={','.join(lengths)}")[1] == tuple(k / 1000 for k in range(100))


@pytest.mark.parametrize(
    ("text", "rate", "value"),
    [
        ("hip=90deg", False, (math.pi / 2,)),
        ("hip=-1.5e1 deg", False, (-math.pi / 12,)),
        ("hip=2rad", False, (2.0,)),
        ("root/z=25cm", False, (0.25,)),
        ("root=0,10mm,1m,1,0,0,0", False, (0, 0.01, 1, 1, 0, 0, 0)),
        ("hip=180deg/s", True, (math.pi,)),
        ("slide=3mm/s", True, (0.003,)),
    ],
)
def test_joints_take_numbers_with_units(text: str, rate: bool, value: tuple[float, ...]) -> None:
    kind = JointNumbersKind(rate=rate)
    name, numbers = kind.parse(text)
    assert numbers == pytest.approx(value)
    made = kind({name: numbers})
    assert kind(made) == made
    assert [type(number) for number in made[name]] == [type(number) for number in numbers]
    plain = kind.plain(made)[name]
    assert all(type(number) is float for number in (plain if isinstance(plain, list) else [plain]))
    assert kind({name: text.partition("=")[2].split(",")}) == made


@pytest.mark.parametrize(
    ("kind", "value", "made", "plain"),
    [
        (LimitsKind(), [-1, 1], ((-1.0,), (1.0,)), [-1.0, 1.0]),
        (LimitsKind(), [[-1, -2], 3], ((-1.0, -2.0), (3.0,)), [[-1.0, -2.0], 3.0]),
        (VectorOrKeyframeKind(), "home", "home", "home"),
        (VectorOrKeyframeKind(), [1, 2], (1.0, 2.0), [1.0, 2.0]),
        (RandomValueKind(), {"uniform": [-1, 1]}, "uniform(-1, 1)", "uniform(-1, 1)"),
        (RandomValueKind(), 0.5, "0.5", "0.5"),
        (TimedValuesKind(), [[0, [1, 0]], [0.1, [0, 1]]], ((0, (1.0, 0.0)), (Fraction(1, 10), (0.0, 1.0))), None),
    ],
)
def test_a_kind_of_tasks_takes_what_documents_write(kind: AnyKind, value: object, made: object, plain: object) -> None:
    assert kind(value) == made
    assert kind(kind.plain(made)) == made
    assert plain is None or kind.plain(made) == plain


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (LimitsKind(), [1, -1]),
        (LimitsKind(), [1]),
        (LimitsKind(), "ab"),
        (LimitsKind(), [[1, 2], [3, 4, 5]]),
        (VectorOrKeyframeKind(), ""),
        (VectorOrKeyframeKind(), [float("nan")]),
        (RandomValueKind(), {"from": 0, "to": 1}),
        (RandomValueKind(), [1, 2]),
        (TimedValuesKind(), []),
        (TimedValuesKind(), [[1, [0]]]),
        (TimedValuesKind(), [[0, [1]], [1, [1, 2]]]),
        (TimedValuesKind(), [[0, [1]], [0, [2]]]),
        (TimedValuesKind(), [3]),
    ],
)
def test_a_kind_of_tasks_refuses_what_cannot_be(kind: AnyKind, value: object) -> None:
    with pytest.raises(InvalidValueError):
        kind(value)
