"""Tests of many cases as one item: an item costs 5 ms in all, a hundred times as much as most cases.

The cases of a parametrized test are merged where its parameters are all that it takes, or it takes a folder too that no
fixture fills: each case has one of its own in `tmp_path`, and works there if the test works in its folder. A test that
names another fixture stays apart, with a new one for each case; so do slow tests, which the workers share. A command
line that selects cases, by -k or by an id in brackets, merges nothing.
"""

import functools
import inspect
import os
from collections.abc import Callable, Collection
from itertools import product
from pathlib import Path
from typing import Any

import pytest

Test = Callable[..., None]
Case = dict[str, Any]
ONE = type(pytest.param())  # `pytest.param(...)`, whose type has no public name


def merged(test: Test, marks: list[pytest.Mark]) -> Test | None:
    """Returns a test that tries all cases in turn, and names the first that fails; None where they stay apart."""
    families = list[list[Case]]()
    for mark in marks:
        if mark.name in ("slow", "usefixtures"):
            return None
        if mark.name == "parametrize":
            cases = _cases(mark)
            if not cases:
                return None
            families.insert(0, cases)
    fixtures = {*inspect.signature(test).parameters} - {name for cases in families for name in cases[0]}
    if not families or fixtures - {"tmp_path"}:
        return None

    @functools.wraps(test)
    def all_cases(tmp_path: Path | None = None) -> None:
        __tracebackhide__ = True
        skipped = list[str]()
        is_workplace = tmp_path is not None and tmp_path == Path.cwd()
        for number, parts in enumerate(product(*families)):
            case = {name: value for part in parts for name, value in part.items()}
            if tmp_path:
                case["tmp_path"] = tmp_path / str(number)
                case["tmp_path"].mkdir()
                if is_workplace:
                    os.chdir(case["tmp_path"])
            try:
                test(**case)
            except pytest.skip.Exception as reason:
                skipped.append(str(reason))
            except BaseException as error:
                error.add_note(f"in the case {case}"[:1000])
                raise
        if skipped:
            pytest.skip(f"{len(skipped)} cases: {skipped[0]}")

    folder = inspect.Parameter("tmp_path", inspect.Parameter.KEYWORD_ONLY)
    all_cases.__signature__ = inspect.Signature([folder] if fixtures else [])  # type: ignore[attr-defined]
    all_cases.pytestmark = [mark for mark in marks if mark.name != "parametrize"]  # type: ignore[attr-defined]
    return all_cases


def _cases(mark: pytest.Mark) -> list[Case] | None:
    """Returns the cases of one `parametrize`; None where one of them has marks, or fixtures take them."""
    names, values = mark.args
    if {*mark.kwargs} - {"ids"} or not isinstance(values, Collection):
        return None
    names = [name.strip() for name in names.split(",") if name.strip()] if isinstance(names, str) else list(names)
    cases = list[Case]()
    for value in values:
        if isinstance(value, ONE):
            if value.marks:
                return None
            value = value.values
        elif len(names) == 1:
            value = (value,)
        cases.append(dict(zip(names, value, strict=True)))
    return cases
