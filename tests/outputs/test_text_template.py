"""Templates of text, against Python's own formatting."""

import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.outputs.text_template import BUILTIN, DEFAULT_FORMAT, parse_template

COLUMNS = ["qpos/knee", "qpos/joint:0", "energy/kinetic"]
VALUES = {"qpos/knee": 0.123456, "qpos/joint:0": -2.5, "energy/kinetic": 1e6, "time": 1.25, "frame": 30, "speed": 0.5}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        ("{{literal}}", "{literal}"),
        ("{time:.3f} s", f"{1.25:.3f} s"),
        ("{frame:04d} at {speed:%}", f"{30:04d} at {0.5:%}"),
        ("{qpos/knee:+10.2e}|{qpos/knee:.1f}", f"{0.123456:+10.2e}|{0.123456:.1f}"),
        ("{time} {frame} {speed} {qpos/knee}", f"{1.25:.2f} {30:d} {0.5:g} {0.123456:.4g}"),
        ("{qpos/joint:0} {qpos/joint:0:.2f}", f"{-2.5:.4g} {-2.5:.2f}"),
        (r"one\ntwo {energy/kinetic}", f"one\ntwo {1e6:.4g}"),
    ],
)
def test_a_template_is_filled_as_python_formats(text: str, expected: str) -> None:
    assert parse_template(text, COLUMNS).filled(VALUES) == expected


@pytest.mark.parametrize("name", [*BUILTIN, "qpos/knee"])
def test_a_value_without_a_format_has_that_of_its_kind(name: str) -> None:
    form = BUILTIN.get(name, DEFAULT_FORMAT)
    plain, formatted = (parse_template(f"{{{text}}}", COLUMNS) for text in (name, f"{name}:{form}"))
    assert plain == formatted


def test_a_template_names_each_column_once_and_no_value_of_its_own() -> None:
    template = parse_template("{qpos/knee} {time} {energy/kinetic} {qpos/knee:.1f} {step}", COLUMNS)
    assert template.columns == ["qpos/knee", "energy/kinetic"]


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("{qpos/nee}", UnknownNameError, "no value 'qpos/nee'.*did you mean 'qpos/knee'"),
        ("{}", UnknownNameError, "no value ''"),
        ("{time", UsageError, "write a value as {time:.2f}, and a brace as {{"),
        ("time}", UsageError, "a brace as {{"),
        ("{time:d}", UsageError, "'d' cannot format 'time'"),
        ("{frame:q}", UsageError, "'q' cannot format 'frame'"),
    ],
)
def test_a_template_that_cannot_be_filled_is_refused(text: str, kind: type, message: str) -> None:
    with pytest.raises(kind, match=f"(?s){message}"):
        parse_template(text, COLUMNS)
