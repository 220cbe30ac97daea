"""Reports fit the schema that is derived from their dataclasses."""

import json
from dataclasses import asdict
from functools import partial
from typing import Any

import pytest

from mjrun.bench.bench import Bench
from mjrun.bench.results import BenchResult
from mjrun.document.json_schema import report_schema
from tests.document.schema_oracle import fits

FAILURE = {"kind": "FileError", "message": "a.csv: no such file", "exit_code": 7}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What `mjrun bench --json` reports of a grid with a point that fails, beside a base with another."""
    folder = tmp_path_factory.mktemp("bench")
    path, base = folder / "swing.xml", str(folder / "base.json")
    path.write_text(
        '<mujoco><worldbody><body><joint type="slide" stiffness="100"/><geom size=".1" mass="1"/></body></worldbody>'
        '<keyframe><key name="test" qpos=".3"/></keyframe></mujoco>'
    )
    job = partial(Bench, path, steps=20, repeats=2, budget=0.1)
    job(threads=(1, 2), scan={"timestep": [".01", ".02"]}, save=base).run()
    found = job(threads=(1,), scan={"timestep": [".01", "1"]}, accuracy=True, horizon=100, compare=base).run()
    return json.loads(json.dumps(asdict(found)))


def test_a_report_fits_its_schema_as_long_as_nothing_is_missing_and_nothing_is_of_another_kind(report: Any) -> None:
    made = report_schema("bench", "mjrun bench", BenchResult)
    assert report["rows"][1]["failure"]
    assert report["comparison"]["gone"]
    assert fits(report, made, made)
    for key, value in report.items():
        without = {name: inner for name, inner in report.items() if name != key}
        assert not fits(without, made, made)
        assert fits({**without, "error": FAILURE}, made, made)
        assert not fits({**report, key: [1] if isinstance(value, str) else "x"}, made, made)
    assert fits({**report, "new": 1}, made, made)
    del report["rows"][0]["step"]["median"]
    assert not fits(report, made, made)
