"""Formats of reports: each is an option and a module."""

import pkgutil
from importlib import import_module

from mjrun.cli import report_formats
from mjrun.cli.console import Case
from mjrun.options.report import REPORT_FORMATS


def test_every_format_is_an_option_and_a_module() -> None:
    assert sorted(REPORT_FORMATS) == sorted(module.name for module in pkgutil.iter_modules(report_formats.__path__))
    for name in REPORT_FORMATS:
        assert "broken" in import_module(f"mjrun.cli.report_formats.{name}").text([Case("m", "error", "t", "broken")])
