"""The fixtures of the pytest plug-in, in a pytest of their own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import mjrun
from mjrun import pytest_plugin

ROOT = Path(__file__).parents[1]
TEST = """
import pytest


@pytest.mark.parametrize("mass", [1, 2])
def test_swing(mjrun_simulation, assert_trace_golden, mass):
    simulation = mjrun_simulation("pendulum.xml", duration={duration}, set={{"geom/bob.mass": mass}})
    assert assert_trace_golden(simulation, probe="energy", rate=50).rows > 1


class TestKicked:
    def test_swing_1(self, mjrun_simulation, assert_trace_golden):
        assert_trace_golden(mjrun_simulation("pendulum.xml", duration={duration}, qvel={{"hinge": 1}}), probe="qvel")
"""


def test_a_trace_is_compared_with_the_golden_table_of_its_test(tmp_path: Path) -> None:
    shutil.copy(ROOT / "scenes/pendulum.xml", tmp_path / "pendulum.xml")

    def run(duration: float, *options: str) -> str:
        (tmp_path / "test_swing.py").write_text(TEST.format(duration=duration))
        plugin = ["-p", pytest_plugin.__name__, "-p", "no:cacheprovider", "-q"]
        command = [sys.executable, "-m", "pytest", *plugin, *options, str(tmp_path / "test_swing.py")]
        # The plug-in would be registered twice where an installation has its entry point.
        environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_ADDOPTS": ""}
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True).stdout

    missing = run(0.1)
    assert "3 failed" in missing
    assert "golden/test_swing/test_swing_1.csv: the golden table does not exist\n--mjrun-update creates it" in missing
    assert "3 passed" in run(0.1, "--mjrun-update")
    assert mjrun.read_table(tmp_path / "golden/test_swing/test_swing_2.csv")["time"][-1] == 0.1
    assert "3 passed" in run(0.1)
    changed = run(0.2)
    assert "3 failed" in changed
    assert "pendulum.xml differs from the golden table" in changed
    assert "--mjrun-update replaces the golden table" in changed


def test_loading_the_plugin_imports_neither_mujoco_nor_numpy() -> None:
    code = "import sys, mjrun.pytest_plugin; print({'mujoco', 'numpy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
