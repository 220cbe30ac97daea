"""What varies, as Python and documents may say it, is what a command line writes."""

import pytest

from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import DISTRIBUTIONS, VariedSettings, with_paths
from mjrun.physics.random_distribution import parse_distribution


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("1..5:5", "1..5:5"),
        (3, "3"),
        (0.1, "0.1"),
        (True, "true"),
        (["elliptic", "pyramidal"], "elliptic,pyramidal"),
        ([0.1, 2], "0.1,2"),
        ([[0, 0, -9.81], [0, 0, -1.6]], "0,0,-9.81;0,0,-1.6"),
        ([[0, 0, -9.81]], "0,0,-9.81;"),
        ({"from": 0.1, "to": 1, "count": 10}, "0.1..1:10"),
        ({"from": 1e-4, "to": 1e-2, "count": 5, "log": True}, "log:0.0001..0.01:5"),
        ({"uniform": [0.3, 1]}, "uniform(0.3, 1)"),
        ({"choice": ["a.xml", "b.xml"]}, "choice(a.xml, b.xml)"),
    ],
)
def test_every_form_is_a_text(value: object, text: str) -> None:
    assert VariedSettings()({"x": value}) == (("x", text),)


@pytest.mark.parametrize(
    "value", [None, {}, {"from": 1}, {"gauss": [0, 1]}, {"uniform": 1}, {"uniform": [0, 1], "normal": [0, 1]}, [None]]
)
def test_anything_else_is_refused(value: object) -> None:
    with pytest.raises(InvalidValueError):
        VariedSettings()({"x": value})


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_every_distribution_can_be_written_as_a_mapping(name: str) -> None:
    numbers = [1, 2, 0, 3] if name == "truncnormal" else [1, 2]
    text = VariedSettings().text({name: numbers})
    distribution = parse_distribution(text, "vary x")
    assert distribution
    assert (distribution.name, [float(each) for each in distribution.arguments]) == (name, numbers)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a.xml,b.xml", "d/a.xml,d/b.xml"), ("a.xml;", "d/a.xml;"), (" choice(a.xml, b.xml)", "choice(d/a.xml,d/b.xml)")],
)
def test_paths_are_converted_one_by_one(text: str, expected: str) -> None:
    assert with_paths(text, lambda path: f"d/{path}") == expected
