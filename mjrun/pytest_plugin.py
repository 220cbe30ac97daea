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
TESTS = pytest.StashKey[dict[Path, str]]()  # by the golden table that is named after each


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option that replaces golden tables."""
    text = "create or replace the golden tables of assert_trace_golden"
    parser.getgroup("mjrun").addoption(UPDATE, action="store_true", help=text)


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

    Its arguments are the simulation; `golden`, the path of the table, by default `golden/MODULE/TEST.csv` beside the
    module of the test; and the options of `mjrun.Trace`, such as `probe`, `rate`, `atol` and `tol`. It returns the
    result of the trace. A second table of a test, or one of a test of a similar name, needs a path.
    """
    from mjrun.errors import FileError, GoldenDifferenceError
    from mjrun.outputs.trace import Trace

    test = request.node.nodeid.partition("::")[2]  # with its class
    name = re.sub(r"[^\w.-]+", "_", test).strip("_")
    usual = request.path.parent / FOLDER / request.path.stem / f"{name}.csv"
    update = bool(request.config.getoption(UPDATE))
    tests, used = request.config.stash.setdefault(TESTS, {}), list[Path]()

    def assert_golden(simulation: "Simulation", golden: str | Path | None = None, **options: Any) -> "TraceResult":
        if golden is None:
            if used or tests.setdefault(usual, test) != test:
                pytest.fail(f"{usual} is already the table of {tests[usual]}; name another: golden=…", pytrace=False)
            used.append(usual)
        path = str(golden or usual)
        try:
            return Trace(simulation, written=False, golden=path, update=update, **options).run()
        except (FileError, GoldenDifferenceError) as error:
            pytest.fail(error.spelled(lambda name: UPDATE if name == "update" else name), pytrace=False)

    return assert_golden
