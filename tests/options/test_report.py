"""Formats of reports: each is an option and a function; the options of pages."""

import pytest

from mjrun.cli.console import CiVerdict
from mjrun.cli.report_formats import FORMATS
from mjrun.errors import BadValueError
from mjrun.options.report import REPORT_FORMATS, PageOptions


def test_every_format_is_an_option_and_a_function() -> None:
    assert sorted(REPORT_FORMATS) == sorted(FORMATS)
    for name in REPORT_FORMATS:
        assert "broken" in FORMATS[name]([CiVerdict("m", "error", "t", "broken")])


def test_the_size_of_embedded_files_is_not_negative() -> None:
    assert PageOptions(html="a.html", embed_up_to=0).embed_up_to == 0
    with pytest.raises(BadValueError, match="embed_up_to"):
        PageOptions(embed_up_to=-1)
