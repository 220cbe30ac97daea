"""The types of mjrun: the stubs are those of the declarations, and the Python of the pages passes strict checks."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2]))

from scripts.make_stubs import STUB, stub
from tests.documentation import blocks

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]
CELLS = json.loads((ROOT / "docs/notebook.ipynb").read_text("utf-8"))["cells"]
NOTEBOOK = "\n".join("".join(cell["source"]) for cell in CELLS if cell["cell_type"] == "code")
# Lines of IPython, which are no Python, are omitted.
BLOCKS = [*(block for page in PAGES for block in blocks("python", page.read_text("utf-8")))]
BLOCKS.append(re.sub(r"(?m)^[%!].*$", "", NOTEBOOK))
# matplotlib and gymnasium leave some types open, and the last line of a cell is shown.
LENIENT = ("reportUnknownMemberType", "reportUnknownVariableType", "reportUnknownArgumentType")
LENIENT += ("reportUnknownLambdaType", "reportUnusedExpression")
STUBBED = "av.*,gymnasium.*,imageio.*,IPython.*,matplotlib.*,numpy.*,PIL.*"
ACCEPTED = """
from fractions import Fraction
from pathlib import Path
import mjrun

pendulum = mjrun.Simulation("scene:pendulum", duration=1, key=0, ctrl={"a": 1, "b": [1, 2]}, set={"opt.timestep": 0.01})
video = mjrun.Video(pendulum, Path("a.mp4"), fps=Fraction(30), camera=["orbit", 0], view="depth", jobs="auto")
result: mjrun.VideoResult = video.run()
mjrun.perform([video, mjrun.Trace(pendulum, "t.csv", probe="energy"), mjrun.Image(pendulum, "a.png", time="0.5")])
mjrun.Study(pendulum, "study", vary={"opt.timestep": [0.1]}, metric={"a": "last(time)"}).run()
mjrun.Simulation(mjrun.read_task("task.yaml"), policy=lambda observation: observation, seed=3)
"""
REFUSED = [
    'mjrun.Video("scene:car", "a.mp4")',
    'mjrun.Video(mjrun.Simulation("m.xml"), "a.mp4", quality="best")',
    'mjrun.Simulation("m.xml", ctrl="forward=1")',
    'mjrun.Trace(mjrun.Simulation("m.xml"), "a.csv", probes=["energy"])',
]


def test_the_stubs_are_those_of_the_declarations() -> None:
    assert STUB.read_text("utf-8") == stub(), "run scripts/make_stubs.py"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with correct modules, and one whose lines are all wrong except the first."""
    folder = tmp_path_factory.mktemp("typed")
    for index, block in enumerate([*BLOCKS, ACCEPTED]):
        (folder / f"right_{index}.py").write_text(block)
    (folder / "wrong.py").write_text("\n".join(["import mjrun", *REFUSED]) + "\n")
    settings = {"stubPath": str(ROOT / "typings"), "typeCheckingMode": "strict", **dict.fromkeys(LENIENT, False)}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings))
    return folder


def faults(project: Path, *checker: str) -> list[tuple[str, int]]:
    """Returns the files and lines in which a type checker finds errors."""
    done = subprocess.run([sys.executable, "-m", *checker], cwd=project, capture_output=True, text=True)
    matches = re.findall(r"(\w+\.py):(\d+)(?::\d+)?(?: -|:) error", done.stdout)
    return sorted({(name, int(line)) for name, line in matches})


WRONG = [("wrong.py", line) for line in range(2, len(REFUSED) + 2)]


@pytest.mark.slow
def test_mypy_accepts_what_is_right_and_finds_what_is_wrong(project: Path) -> None:
    # Types of libraries take most of the time, and pyright below reads them. Stubs are read unless they are named.
    settings = "[mypy]\nfollow_imports = skip\n[mypy-mjrun.*]\nfollow_imports = silent\n"
    settings += f"[mypy-{STUBBED}]\nfollow_imports = skip\nfollow_imports_for_stubs = true\n"
    (project / "mypy.ini").write_text(settings)
    options = ["--strict", "--ignore-missing-imports", "--cache-dir", os.devnull]
    files = sorted(path.name for path in project.glob("*.py"))
    assert faults(project, "mypy", *options, *files) == WRONG


@pytest.mark.slow
def test_pyright_accepts_what_is_right_and_finds_what_is_wrong(project: Path) -> None:
    assert faults(project, "pyright", "--pythonpath", sys.executable) == WRONG
