"""Theorems about the reporter of the Python API."""

import warnings

import pytest

from mjrun.errors import MjrunWarning, option
from mjrun.reporter import WarningReporter, pass_on


def test_warnings_become_pythons_with_options_in_its_spelling_and_the_rest_is_silent(
    capfd: pytest.CaptureFixture[str],
) -> None:
    reporter = WarningReporter()
    with pytest.warns(MjrunWarning, match="^trail_span is long$"):
        reporter.warn(f"{option('trail_span')} is long")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reporter.note("noted")
        reporter.progress("frames", 1, 2)
    assert capfd.readouterr() == ("", "")


def test_mujocos_warnings_are_passed_on_in_a_line_each_and_cleaned() -> None:
    with pytest.warns(MjrunWarning) as caught:
        pass_on(["one\ntwo", "a\x1b[31m"], WarningReporter())
    assert [str(warning.message) for warning in caught] == ["MuJoCo: one; two", r"MuJoCo: a\x1b[31m"]
