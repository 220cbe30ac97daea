"""Fixtures for tests of models, which pytest offers where mjrun is installed; MuJoCo is imported when one is used.

`mjrun_simulation(model, …)` makes a simulation, and `assert_trace_golden(simulation, …)` compares what it measures with
a golden table beside the test. `pytest --mjrun-update` creates or replaces the golden tables of the tests that run.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mjrun.outputs.trace import TraceResult
    from mjrun.simulation.simulation import Simulation

UPDATE = "--mjrun-update"
FOLDER = "golden"  # beside the file with the test
FIXTURE = "assert_trace_golden"
TESTS = pytest.StashKey[dict[Path, list[str]]]()  # by the golden table that is named after each


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option that replaces golden tables."""
    text = "create or replace the golden tables of assert_trace_golden"
    parser.getgroup("mjrun").addoption(UPDATE, action="store_true", help=text)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Notes which tests share the name of a golden table; every process of pytest-xdist collects all of them."""
    tests = config.stash.setdefault(TESTS, {})
    for item in items:
        if FIXTURE in getattr(item, "fixturenames", ()):
            tests.setdefault(_usual_table(item), []).append(_test_name(item))


@pytest.fixture
def mjrun_simulation(request: pytest.FixtureRequest) -> "Callable[..., Simulation]":
    """Returns a function like `mjrun.Simulation`, which finds a model beside the test by its name."""
    from mjrun.simulation.simulation import Simulation

    def simulation(model: Any, **options: Any) -> Simulation:
        beside = request.path.parent / str(model)
        return Simulation(beside if isinstance(model, str | Path) and beside.is_file() else model, **options)

    return simulation


@pytest.fixture
def assert_trace_golden(request: pytest.FixtureRequest) -> "Callable[..., TraceResult]":
    """Returns a function that fails the test if a trace of a simulation differs from its golden table.

    Its arguments are the simulation; `golden`, the path of the table relative to the folder of the test, by default
    `golden/MODULE/TEST.csv`; and the options of `mjrun.Trace`, such as `probe`, `rate`, `atol` and `tol`. It returns
    the result of the trace. A second table of a test needs a path, and so do those of tests of similar names.
    """
    from mjrun.errors import FileError, GoldenDifferenceError
    from mjrun.outputs.trace import Trace

    test, usual = _test_name(request.node), _usual_table(request.node)
    update = bool(request.config.getoption(UPDATE))
    others = [each for each in request.config.stash[TESTS].get(usual, []) if each != test]
    used = list[Path]()

    def assert_golden(simulation: "Simulation", golden: str | Path | None = None, **options: Any) -> "TraceResult":
        if golden is None:
            if used or others:
                owner = (others or [test])[0]
                pytest.fail(f"{usual} is already the table of {owner}; name another: golden=…", pytrace=False)
            used.append(usual)
        path = str(request.path.parent / golden if golden else usual)
        try:
            return Trace(simulation, written=False, golden=path, update=update, **options).run()
        except (FileError, GoldenDifferenceError) as error:
            message = error.spelled(lambda name: UPDATE if name == "update" else name)
        pytest.fail(message, pytrace=False)

    return assert_golden


def _test_name(item: pytest.Item) -> str:
    """Returns the name of a test with its class and its parameters."""
    return item.nodeid.partition("::")[2]


def _usual_table(item: pytest.Item) -> Path:
    """Returns the path of the golden table that is named after a test."""
    name = re.sub(r"[^\w.-]+", "_", _test_name(item)).strip("_")
    return item.path.parent / FOLDER / item.path.stem / f"{name}.csv"
