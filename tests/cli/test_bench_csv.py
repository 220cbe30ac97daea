"""Benchmarks as CSV: a line for each point, empty where nothing was measured."""

import csv
from itertools import count
from pathlib import Path

from mjrun.bench.bench import Bench
from mjrun.cli import bench_csv

MODEL = """
<mujoco>
  <option timestep=".01"/>
  <worldbody>
    <body><joint name="x" type="slide" axis="1 0 0" stiffness="100"/><geom size=".1" mass="1"/></body>
  </worldbody>
  <keyframe><key name="test" qpos=".3"/></keyframe>
</mujoco>
"""
SECOND = count(1.0).__next__  # a clock that advances by a second at every look


def test_every_point_is_a_line_of_the_same_columns(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    job = Bench(path, steps=20, repeats=8, threads=(1, 2), scan={"timestep": [".01", "1"]}, accuracy=True, horizon=100)
    result = job.run(clock=SECOND)
    good, bad = csv.DictReader(bench_csv.table(result).splitlines())
    assert [*good] == [*bad]
    assert (good["timestep"], good["step/n"], good["step/median"], good["steps_per_second"]) == (
        "0.01",
        "8",
        "1.0",
        "1.0",
    )
    assert float(good["energy_drift"]) == result.rows[0].accuracy.energy_drift  # pyright: ignore[reportOptionalMemberAccess]
    assert (bad["step/median"], bad["contacts"], bad["energy_drift"]) == ("", "", "")
    assert bad["failure"].startswith("the simulation became unstable at step")
