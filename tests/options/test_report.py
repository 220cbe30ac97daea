"""Formats of reports: each is an option and a function."""

from mjrun.cli.console import CiVerdict
from mjrun.cli.report_formats import FORMATS
from mjrun.options.report import REPORT_FORMATS


def test_every_format_is_an_option_and_a_function() -> None:
    assert sorted(REPORT_FORMATS) == sorted(FORMATS)
    for name in REPORT_FORMATS:
        assert "broken" in FORMATS[name]([CiVerdict("m", "error", "t", "broken")])
