"""What varies, as Python and documents may say it, is what a command line writes."""

import math

import pytest

from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import DISTRIBUTIONS, JointNumbersKind, VariedSettingsKind, with_paths
from mjrun.physics.random_distribution import parse_distribution
from tests.cases import cases


@cases("value, text")
def test_every_form_is_a_text(value: object, text: str) -> None:
    assert VariedSettingsKind()({"x": value}) == (("x", text),)


@pytest.mark.parametrize(
    "value", [None, {}, {"from": 1}, {"gauss": [0, 1]}, {"uniform": 1}, {"uniform": [0, 1], "normal": [0, 1]}, [None]]
)
def test_anything_else_is_refused(value: object) -> None:
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
    "text", ["hip=90degrees", "hip=deg", "hip=nandeg", "hip=1e999m", "hip=", "90deg", "hip=1deg/s"]
)
def test_numbers_with_other_units_are_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match=r"units: deg, rad, mm, cm, m|NAME=VALUE"):
        JointNumbersKind().parse(text)
