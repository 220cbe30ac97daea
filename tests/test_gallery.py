"""The scenes' documents: whole lessons, each run at a small size."""

from __future__ import annotations

import csv
import json
import math
import re
import runpy
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mjrun.document.camera_and_ghost_forms import read_camera
from mjrun.document.json_schema import json_schema
from mjrun.document.model_and_task_check import Check
from mjrun.document.task import read_task
from mjrun.formats.table_reader import read_table
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace
from mjrun.task.worlds import TaskWorlds
from tests.processes import PATIENCE

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.conftest import Command

SCENES = Path(__file__).parents[1] / "scenes"
DOCUMENTS = sorted(path.with_suffix(".yaml") for path in SCENES.glob("*.xml"))
FITS = sorted(SCENES.glob("*_fit.yaml"))
TASKS = sorted(set(SCENES.glob("*.yaml")) - set(DOCUMENTS) - set(FITS))
STUDIES = sorted(SCENES.glob("studies/*.yaml"))
KINDS = {"cameras": "camera", "studies": "study"}
TEXTURED = ("arm", "tippe_top")  # are drawn as they are: a sky, materials and reflections
SMALL = ["videos[0].size=64x48", "videos[0].fps=1", "images[0].size=64x48", "plots[0].size=320x240"]


def test_every_scene_has_a_document_and_an_image_of_it_is_shown() -> None:
    names = [path.stem for path in DOCUMENTS]
    assert all(path.exists() for path in DOCUMENTS)
    page = (SCENES / "README.md").read_text("utf-8")
    assert sorted(re.findall(r"mjrun run scenes/(\w+)\.yaml", page)) == names
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page)
    assert sorted({Path(picture).stem for picture in pictures} - {"training", *(path.stem for path in TASKS)}) == names
    for picture in pictures:
        assert 5_000 < (SCENES / picture).stat().st_size < 200_000


@pytest.mark.parametrize("kind", ["camera", "run", "study", "task", "eval-document", "fit-document"])
def test_the_schemas_beside_the_scenes_are_those_that_mjrun_prints(kind: str) -> None:
    assert json.loads((SCENES / f"schema/{kind}.json").read_text("utf-8")) == json.loads(json.dumps(json_schema(kind)))


@pytest.mark.parametrize("path", sorted(SCENES.rglob("*.yaml")), ids=lambda path: path.stem)
def test_a_document_tells_editors_its_schema(path: Path) -> None:
    header = path.read_text("utf-8").splitlines()[0]
    found = re.fullmatch(r"# yaml-language-server: \$schema=(\S+)", header)
    assert found
    kind = "task" if path in TASKS else "fit-document" if path in FITS else KINDS.get(path.parent.name, "run")
    assert (path.parent / found[1]).resolve() == SCENES / f"schema/{kind}.json"


@pytest.mark.parametrize("path", sorted(SCENES.glob("cameras/*.yaml")), ids=lambda path: path.stem)
def test_a_camera_script_is_read(path: Path) -> None:
    assert read_camera(path).name == path.stem


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_a_lesson_makes_its_video_image_trace_plot_and_replay(
    mjrun_here: Command, path: Path, plain: Path, tmp_path: Path
) -> None:
    path = path if path.stem in TEXTURED else plain / path.name
    # The camera of the dominos looks for the throw at every step, and the other three have events later on.
    whole = {"dominos": ["timestep=0.002"], "friction_ramp": [], "free_body": ["duration=0.5"], "pinata": []}
    shorter = whole.get(path.stem, ["duration=0.2"])
    done = mjrun_here("run", path, *SMALL, *shorter, "-o", tmp_path / "out", "-q", "--quality", "draft")
    assert (done.returncode, done.stderr) == (0, b"")
    name = path.stem
    made = {"plot.png", f"{name}.mp4", f"{name}.jpg", f"{name}.csv", f"{name}.html"} | (
        {"hits.csv"} if name == "dominos" else set()
    )
    assert {file.name for file in (tmp_path / "out").iterdir()} == made


@pytest.mark.parametrize("path", TASKS, ids=lambda path: path.stem)
def test_a_task_fits_its_model_and_its_policy(path: Path) -> None:
    policy = SCENES / f"policies/{path.stem}.onnx"
    (found,) = Check([path], policy=str(policy) if policy.exists() else None, timeout=PATIENCE).run().models
    assert [finding for finding in found.findings if finding.severity != "note"] == []


@pytest.mark.parametrize(("name", "least"), [("car_drive", 15), ("humanoid_stand", 12), ("pendulum_swing_up", 15)])
def test_a_policy_does_what_the_page_says_it_does(name: str, least: int) -> None:
    """In 16 episodes, as a bare loop of worlds and of the network's own arithmetic finds them."""
    policy = load_policy(str(SCENES / f"policies/{name}.onnx"))
    worlds = TaskWorlds(read_task(SCENES / f"{name}.yaml"), 16)
    space = ActionSpace(worlds.action_names, worlds.actions.low, worlds.actions.high)
    actors = [policy.episode(seed, space) for seed in range(16)]
    seen, running, successes = worlds.reset(range(16)), np.arange(16), 0
    while len(running):
        step = worlds.step(np.array([actors[i](row) for i, row in zip(running, seen, strict=True)]), running)
        successes += sum(ending is not None and ending.kind == "success" for ending in step.ended)
        seen, running = step.observations[~step.over], running[~step.over]
    assert successes >= least


def test_training_repeats_by_its_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two generations of four networks make the same file twice, and another seed makes another."""
    small = ["--generations", "2", "--population", "4", "--episodes", "1", "--validate", "2"]
    task = tmp_path / "short.yaml"
    text = (SCENES / "pendulum_swing_up.yaml").read_text("utf-8")
    task.write_text(text.replace("duration: 10", "duration: 1").replace("pendulum.xml", str(SCENES / "pendulum.xml")))

    def trained(seed: str) -> bytes:
        file = tmp_path / "a.onnx"
        arguments = [str(task), "-o", str(file), *small, "--seed", seed]
        monkeypatch.setattr(sys, "argv", ["evolve.py", *arguments])
        runpy.run_path(str(SCENES / "training/evolve.py"), run_name="__main__")
        assert file.with_suffix(".csv").read_text().startswith("generation,population,return,success\n2,")
        return file.read_bytes()

    assert trained("1") == trained("1") != trained("2")


@pytest.mark.parametrize("path", sorted(SCENES.glob("policies/*.csv")), ids=lambda path: path.stem)
def test_the_curve_beside_a_policy_ends_where_the_page_says(path: Path) -> None:
    curve = read_table(path).columns
    assert np.all(np.diff(curve["generation"]) > 0)
    assert curve["success"][-1] == max(curve["success"]) or curve["return"][-1] == max(curve["return"])
    assert path.with_suffix(".onnx").exists()


def test_the_page_shows_every_study() -> None:
    page = (SCENES / "README.md").read_text("utf-8")
    assert sorted(re.findall(r"mjrun sweep scenes/studies/(\w+)\.yaml", page)) == [path.stem for path in STUDIES]


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_a_study_measures_every_point(mjrun_here: Command, path: Path) -> None:
    few = [f"vary.{name}=-3..3:3" for name in ("qpos/hinge", "qvel/hinge")] if path.stem == "pendulum_grid" else []
    few += ["samples=4"] if "samples:" in path.read_text() else []
    done = mjrun_here("sweep", path, "duration=0.2", *few, "--jobs", "1", "-o", "out", "--json")
    report = json.loads(done.stdout)
    assert done.returncode in ((0, 8) if path.stem == "divergence_by_timestep" else (0,))
    assert report["statuses"]["ok"] >= report["points"] / 2
    assert all(metric["count"] for name, metric in report["metrics"].items() if name != "fell")


def test_the_grid_of_pendulums_goes_over_the_top_with_more_energy_than_that_takes(mjrun_here: Command) -> None:
    study = SCENES / "studies/pendulum_grid.yaml"
    few = ("vary.qpos/hinge=-3.1..3.1:7", "vary.qvel/hinge=-8..8:9")
    table = mjrun_here("sweep", study, *few, "--jobs", "1", "-o", "out", "--csv").stdout.decode()
    rows = list(csv.DictReader(table.splitlines()))
    assert len(rows) == 63
    for row in rows:
        angle, speed = float(row["qpos/hinge"]), float(row["qvel/hinge"])
        spare = 1.004 * speed**2 / 2 + 9.81 * (1 - math.cos(angle)) - 2 * 9.81  # [J]
        assert abs(spare) > 1e-3  # none of them is on the border, where the way up takes for ever
        assert (float(row["over"]) >= 0) == (spare > 0), row


def test_the_fit_of_the_gallery_finds_what_its_measurements_were_made_with(mjrun_here: Command) -> None:
    """By a pendulum of damping 0.08, armature 0.03 and friction 0.05, whose motor is 12 ms late."""
    page = (SCENES / "README.md").read_text("utf-8").replace("\\\n", " ")
    (fit,) = (line for line in page.splitlines() if line.startswith("mjrun fit scenes/pendulum_fit.yaml"))
    (mjrun_here.folder / "out").mkdir()
    fit = re.sub(r" --(video|comparison) \S+", "", fit)  # of which other tests are
    arguments = fit.replace("scenes/", f"{SCENES}/").split()[2:]
    done = mjrun_here("fit", *arguments, "starts=1", "timestep=0.004", "--json")  # half of the steps
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert sorted(report["files"]) == sorted(re.findall(r" (out/\S+)", fit))
    found = {each["path"]: each for each in report["parameters"]}
    truth = {"joint/hinge.damping": 0.08, "joint/hinge.armature": 0.03, "joint/hinge.frictionloss": 0.05}
    for path, value in {**truth, "delay:ctrl/motor": 0.012}.items():
        assert found[path]["low"] <= value <= found[path]["high"]
    varied = (mjrun_here.folder / "out/pendulum_ranges.yaml").read_text()
    assert all(path in varied for path in truth)
