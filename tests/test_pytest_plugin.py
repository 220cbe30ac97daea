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


def pytest_output(folder: Path, text: str, *options: str, where: Path | None = None) -> str:
    """Runs pytest on a module of this text, in its folder or in `where`."""
    (folder / "test_it.py").write_text(text)
    plugin = ["-p", pytest_plugin.__name__, "-p", "no:cacheprovider", "-q"]
    command = [sys.executable, "-m", "pytest", *plugin, *options, str(folder / "test_it.py")]
    # The plug-in would be registered twice where an installation has its entry point.
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_ADDOPTS": ""}
    return subprocess.run(command, cwd=where or folder, env=environment, capture_output=True, text=True).stdout


def test_a_trace_is_compared_with_the_golden_table_of_its_test(tmp_path: Path) -> None:
    shutil.copy(ROOT / "scenes/pendulum.xml", tmp_path / "pendulum.xml")

    def run(duration: float, *options: str) -> str:
        return pytest_output(tmp_path, TEST.format(duration=duration), *options)

    missing = run(0.1)
    assert "3 failed" in missing
    assert "golden/test_it/test_swing_1.csv: the golden table does not exist\n--mjrun-update creates it" in missing
    assert "3 passed" in run(0.1, "--mjrun-update")
    assert mjrun.read_table(tmp_path / "golden/test_it/test_swing_2.csv")["time"][-1] == 0.1
    assert "3 passed" in run(0.1)
    changed = run(0.2)
    assert "3 failed" in changed
    assert "pendulum.xml differs from the golden table" in changed
    assert "--mjrun-update replaces the golden table" in changed


TWICE = """
import pytest


def test_both(mjrun_simulation, assert_trace_golden):
    for mass, golden in ((1, {}), (2, {"golden": "other.csv"}), (3, {})):
        assert_trace_golden(mjrun_simulation("pendulum.xml", duration=0.1, set={"geom/bob.mass": mass}), **golden)


@pytest.mark.parametrize("name", ["a/b", "a b"])
def test_name(mjrun_simulation, assert_trace_golden, name):
    assert_trace_golden(mjrun_simulation("pendulum.xml", duration=0.1))
"""


def test_two_tables_cannot_have_one_name(tmp_path: Path) -> None:
    shutil.copy(ROOT / "scenes/pendulum.xml", tmp_path / "pendulum.xml")
    output = pytest_output(tmp_path, TWICE, "--mjrun-update")
    assert "3 failed" in output  # in separate processes, too, each of which would write the table
    assert not (tmp_path / "golden/test_it/test_name_a_b.csv").exists()
    assert "golden/test_it/test_both.csv is already the table of test_both; name another" in output
    for other in ("a/b", "a b"):
        assert f"golden/test_it/test_name_a_b.csv is already the table of test_name[{other}]; name another" in output


NAMED = """
def test_named(mjrun_simulation, assert_trace_golden):
    assert_trace_golden(mjrun_simulation("pendulum.xml", duration=0.1), golden="tables/named.csv")
"""


def test_a_named_table_is_beside_the_test_wherever_pytest_runs(tmp_path: Path) -> None:
    (tmp_path / "tests/tables").mkdir(parents=True)
    shutil.copy(ROOT / "scenes/pendulum.xml", tmp_path / "tests/pendulum.xml")
    assert "1 passed" in pytest_output(tmp_path / "tests", NAMED, "--mjrun-update", where=tmp_path)
    assert "1 passed" in pytest_output(tmp_path / "tests", NAMED)
    assert (tmp_path / "tests/tables/named.csv").exists()


def test_loading_the_plugin_imports_neither_mujoco_nor_numpy() -> None:
    code = "import sys, mjrun.pytest_plugin; print({'mujoco', 'numpy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
