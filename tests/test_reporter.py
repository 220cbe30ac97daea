"""Theorems about the reporter of the Python API."""

import sys
import warnings
from types import ModuleType, SimpleNamespace

import pytest

from mjrun.errors import MjrunWarning, option
from mjrun.model.mujoco_globals import report_warnings
from mjrun.reporter import PythonApiReporter, is_notebook


def test_warnings_become_pythons_with_options_in_its_spelling_and_the_rest_is_silent(
    capfd: pytest.CaptureFixture[str],
) -> None:
    reporter = PythonApiReporter()
    with pytest.warns(MjrunWarning, match="^trail_span is long$"):
        reporter.warn(f"{option('trail_span')} is long")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reporter.note("noted")
        reporter.progress("frames", 1, 2)
    assert capfd.readouterr() == ("", "")


def test_mujocos_warnings_are_passed_on_in_a_line_each_and_cleaned() -> None:
    with pytest.warns(MjrunWarning) as caught:
        report_warnings(["one\ntwo", "a\x1b[31m"], PythonApiReporter())
    assert [str(warning.message) for warning in caught] == ["MuJoCo: one; two", r"MuJoCo: a\x1b[31m"]
    assert {warning.filename for warning in caught} == {__file__}  # not the line of mjrun that warns


def test_a_notebook_shows_a_bar_that_disappears_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []

    class Handle:
        def update(self, html: str) -> None:
            shown.append(html)

    def display(html: str, *, display_id: bool) -> Handle:
        assert display_id
        shown.append(html)
        return Handle()

    library, displays = ModuleType("IPython"), ModuleType("IPython.display")
    vars(library).update(get_ipython=lambda: SimpleNamespace(kernel=object()))
    vars(displays).update(HTML=str, display=display)
    monkeypatch.setitem(sys.modules, "IPython", library)
    monkeypatch.setitem(sys.modules, "IPython.display", displays)
    monkeypatch.setattr("mjrun.reporter.PAUSE", 0)
    assert is_notebook()
    bar = PythonApiReporter()
    for done in (1, 2, 3):
        bar.progress("frames", done, 3)
    assert shown == [
        "<progress value='1' max='3'></progress> 1 of 3 frames",
        "<progress value='2' max='3'></progress> 2 of 3 frames",
        "",
    ]
    PythonApiReporter().progress("frames", 3, 3)  # needs no bar
    assert len(shown) == 3
    vars(library).update(get_ipython=lambda: None)  # in a script that imports IPython
    assert not is_notebook()
    bar.progress("frames", 1, 3)
    assert len(shown) == 3
