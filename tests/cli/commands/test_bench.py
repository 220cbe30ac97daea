"""`mjrun bench` as a user runs it."""

from __future__ import annotations

import csv
import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.cases import cases
from tests.physics import test_warp_engine

if TYPE_CHECKING:
    from tests.conftest import Command

ROOT = Path(__file__).parents[3]
PENDULUM = ROOT / "scenes/pendulum.xml"
WORKLOAD = "reference_workload"
QUICK = ("--steps", "20", "--repeats", "8", "--threads", "1,2", "--budget", "0.1")


def lines_of(text: bytes) -> list[str]:
    return text.decode().splitlines()


def test_the_report_is_legible_in_80_columns_and_says_what_was_measured(mjrun_here: Command) -> None:
    done = mjrun_here("bench", PENDULUM, *QUICK, "--accuracy")
    assert (done.returncode, done.stderr) == (0, b"")
    lines = lines_of(done.stdout)
    assert lines[0].startswith("pendulum.xml: 1 dof, 1 actuator, ")
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    for part in (
        "median of 8 rollouts of 20 steps",
        "times real time",
        "iterations (newton)",
        "the first time",
        "after 1 s, ",
    ):
        assert part in text
    table = [line.split() for line in lines]
    assert ["threads", "steps/s", "real", "time", "scaling"] in table
    assert ["2"] in [row[:1] for row in table]
    names = [row[0] for row in table if len(row) == 5 and row[4] == "%" and row[1][0].isdigit()]
    assert names[:5] == ["step", "position", "kinematics", "inertia", "collision"]
    assert mjrun_here.files() == []


def test_sections_of_a_page_name_the_point_of_a_grid(mjrun_here: Command) -> None:
    done = mjrun_here("bench", PENDULUM, *QUICK, "--scan", "timestep=.001,.002", "--html", "a.html")
    assert done.returncode == 0
    page = (mjrun_here.folder / "a.html").read_text("utf-8")
    assert "<h2>Threads, timestep=.001</h2>" in page
    assert "<h2>Threads, timestep=.002</h2>" in page


def test_a_grid_is_one_table_in_80_columns(mjrun_here: Command) -> None:
    grid = ("--scan", "integrator=implicitfast,rk4", "--scan", "timestep=.001,.002", "--scan", "opt.cone=elliptic")
    done = mjrun_here("bench", PENDULUM, *QUICK[:4], *grid, "--accuracy", "--horizon", ".1")
    assert done.returncode == 0
    lines = lines_of(done.stdout)
    assert max(map(len, lines)) <= 80
    header = next(i for i, line in enumerate(lines) if "integrator" in line)
    assert lines[header].split()[:5] == ["integrator", "timestep", "cone", "step", "±"]
    assert [line.split()[:2] for line in lines[header + 1 : header + 5]] == [
        ["implicitfast", ".001"],
        ["implicitfast", ".002"],
        ["rk4", ".001"],
        ["rk4", ".002"],
    ]


def test_json_is_the_document_and_nothing_else(mjrun_here: Command) -> None:
    done = mjrun_here("bench", PENDULUM, *QUICK, "--set", "opt.gravity=0,0,-5", "--json")
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert found["schema"] == "mjrun-bench-1"
    assert found["command"].startswith("mjrun bench")
    assert found["options"]["settings"] == ["opt.gravity=0,0,-5"]
    assert (found["options"]["noise_std"], found["options"]["noise_rate"]) == (0.01, 0.1)
    assert [threads["threads"] for threads in found["rows"][0]["threads"]] == [1, 2]
    assert found["rows"][0]["steps"] == 20


def test_csv_has_a_line_for_each_point(mjrun_here: Command) -> None:
    done = mjrun_here("bench", PENDULUM, *QUICK, "--scan", "timestep=.001,.002", "--csv")
    rows = list(csv.DictReader(lines_of(done.stdout)))
    assert [(row["timestep"], row["steps"], row["step/n"]) for row in rows] == [
        ("0.001", "20", "8"),
        ("0.002", "20", "8"),
    ]
    assert all(float(row["step/low"]) <= float(row["step/median"]) <= float(row["step/high"]) for row in rows)
    assert all(float(row["threads/2/steps_per_second"]) > 0 and float(row["phase/step"]) > 0 for row in rows)
    assert {row["failure"] for row in rows} == {""}


def test_markdown_is_appended_to_a_summary_where_ci_wants_it(mjrun_here: Command) -> None:
    (mjrun_here.folder / "given.md").write_text("before\n")
    done = mjrun_here("bench", PENDULUM, *QUICK, "--markdown", "--summary", "given.md")
    given = (mjrun_here.folder / "given.md").read_text()
    assert given.startswith("before\n### mjrun bench: pendulum.xml")
    assert given.removeprefix("before\n") == done.stdout.decode()
    assert "| threads | steps/s | real time | scaling |\n| :-- | --: | --: | --: |\n| 1 | " in given
    done = mjrun_here("bench", PENDULUM, *QUICK, "--summary", env={"GITHUB_STEP_SUMMARY": "env.md"})
    assert done.returncode == 0
    assert "### mjrun bench" in (mjrun_here.folder / "env.md").read_text()


def test_a_summary_that_cannot_be_written_is_refused_at_once(mjrun_here: Command) -> None:
    done = mjrun_here("bench", PENDULUM, "--summary", env={"GITHUB_STEP_SUMMARY": ""})
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"--summary: name a file, since $GITHUB_STEP_SUMMARY does not" in done.stderr
    done = mjrun_here("bench", PENDULUM, "--summary", "/dev/null/summary.md")
    assert (done.returncode, done.stdout) == (7, b"")
    done = mjrun_here("bench", PENDULUM, "--summary", "-")
    assert (done.returncode, done.stdout, mjrun_here.files()) == (2, b"", [])


def slowed(path: Path, factor: float) -> None:
    """Makes a baseline of which this build is `factor` times as slow, on the same machine."""

    def scale(value: Any) -> Any:
        if isinstance(value, dict):
            return {
                key: [v / factor for v in item] if key == "samples" else item if key == WORKLOAD else scale(item)
                for key, item in value.items()
            }
        return [scale(item) for item in value] if isinstance(value, list) else value

    path.write_text(json.dumps(scale(json.loads(path.read_text()))))


def test_a_slower_build_fails_only_with_a_limit_and_an_incomparable_one_is_refused(mjrun_here: Command) -> None:
    base = mjrun_here.folder / "base.json"
    assert mjrun_here("bench", PENDULUM, *QUICK, "--save", "base.json").returncode == 0
    assert mjrun_here.files() == ["base.json"]
    slowed(base, 1000)
    done = mjrun_here("bench", PENDULUM, *QUICK, "--compare", "base.json", "--fail-above", "10%")
    assert done.returncode == 1
    assert "verdict: slower" in lines_of(done.stdout)
    assert "against base.json; slower is above 1.1" in lines_of(done.stdout)
    assert mjrun_here("bench", PENDULUM, *QUICK, "--compare", "base.json").returncode == 0
    assert any(line.startswith("relative to a reference workload, which took ") for line in lines_of(done.stdout))
    slowed(base, 1e-6)
    assert mjrun_here("bench", PENDULUM, *QUICK, "--compare", "base.json", "--fail-above", "10%").returncode == 0
    done = mjrun_here("bench", PENDULUM, *QUICK, "--noise-std", "0", "--compare", "base.json")
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"noise_std: 0.01 there, 0.0 here" in done.stderr
    assert b"--force" in done.stderr
    done = mjrun_here("bench", PENDULUM, *QUICK, "--noise-std", "0", "--compare", "base.json", "--force")
    assert done.returncode == 0
    assert b"compared in spite of a difference: noise_std" in done.stdout


@cases("options, code, said")
def test_what_cannot_be_meant_ends_with_its_code_and_no_output(
    mjrun_here: Command, swing: Path, options: list[str], code: int, said: str
) -> None:
    done = mjrun_here("bench", swing, *QUICK, *options)
    assert (done.returncode, bool(done.stdout)) == (code, "--json" in options)
    assert said in done.stderr.decode()
    assert "Traceback" not in done.stderr.decode()


def test_an_unstable_model_names_its_step_once_and_a_grid_continues_without_it(
    mjrun_here: Command, exploding: Path
) -> None:
    fast = ("bench", exploding, "--key", "fast", "--steps", "200", "--repeats", "2")
    done = mjrun_here(*fast)
    assert (done.returncode, done.stdout) == (4, b"")
    assert lines_of(done.stderr)[0].startswith("mjrun: error: the simulation became unstable at step ")
    # With noise and without it, it fails at different steps.
    exploding.write_text(
        exploding.read_text().replace("<keyframe>", '<actuator><motor joint="a" gear="9"/></actuator><keyframe>')
    )
    grid = (*fast, "--scan", "timestep=.0001,.03", "--accuracy")
    failed = json.loads(mjrun_here(*grid, "--json").stdout)["rows"][1]
    assert failed["failure"] != failed["accuracy"]["failure"]
    done = mjrun_here(*grid)
    assert (done.returncode, done.stderr) == (8, b"")
    lines = lines_of(done.stdout)
    assert [line.split()[1] == "failed" for line in lines if line.startswith(("  .0001", "  .03"))] == [False, True]
    assert "note: timestep=.03: the simulation became unstable at step" in done.stdout.decode()
    assert done.stdout.decode().count("note: timestep=.03") == 1


def test_a_point_that_became_unstable_is_a_loss_against_its_base(mjrun_here: Command, exploding: Path) -> None:
    grid = ("bench", exploding, *QUICK, "--steps", "40", "--scan", "timestep=.0001,.03")
    assert mjrun_here(*grid, "--save", "base.json").returncode == 0
    fast = exploding.read_text().replace("<key ", '<key name="test" qvel="100 0"/><key ')
    exploding.write_text(fast)
    # Another model, which is as good as another MuJoCo in which the same one explodes.
    now = (*grid, "--compare", "base.json", "--force")
    assert mjrun_here(*now).returncode == 8
    done = mjrun_here(*now, "--fail-above", "10000%")
    assert done.returncode == 1
    row = next(line for line in lines_of(done.stdout) if line.startswith("  step timestep=.03"))
    assert row.split()[-1] == "failed"
    assert "verdict: failed" in lines_of(done.stdout)
    one = mjrun_here(*now[:-5], "--scan", "timestep=.0001", *now[-3:])
    assert one.returncode == 0
    row = next(line for line in lines_of(one.stdout) if line.startswith("  step timestep=.03"))
    assert row.split()[-2:] == ["not", "measured"]


def test_names_from_a_model_reach_neither_terminal_nor_markdown_as_they_are(mjrun_here: Command) -> None:
    model = mjrun_here.folder / "a\x1b[31m|b.xml"
    model.write_text('<mujoco><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>')
    for form in ((), ("--markdown",), ("--csv",)):
        done = mjrun_here("bench", model, *QUICK, *form)
        assert done.returncode == 0
        assert b"\x1b" not in done.stdout
    assert r"a\\x1b\[31m\|b.xml" in mjrun_here("bench", model, *QUICK, "--markdown").stdout.decode()


def test_an_engine_that_is_not_installed_is_named_with_its_extra(mjrun_here: Command, swing: Path) -> None:
    if importlib.util.find_spec("mujoco_warp"):
        pytest.skip("it is installed")
    done = mjrun_here("bench", swing, "--engine", "warp")
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"pip install 'mjrun[warp]'" in done.stderr


@pytest.mark.warp
def test_many_worlds_are_timed_and_standard_output_is_the_document_alone(mjrun_here: Command) -> None:
    pytest.importorskip("mujoco_warp")
    model = mjrun_here.folder / "model.xml"
    model.write_text(test_warp_engine.MODEL.format(integrator="Euler"))  # whose kernels are compiled anyway
    few = ("--device", "cpu", "--worlds", "2", "--steps", "2", "--repeats", "1", "--budget", ".1")
    # Warp leaves a temporary folder to the interpreter, and tells on stderr where there is no driver.
    done = mjrun_here("bench", model, "--engine", "warp", *few, "--json", env={"PYTHONWARNINGS": ""})
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    found = json.loads(done.stdout)
    assert (found["engine"]["name"], found["engine"]["device"], found["engine"]["worlds"]) == ("warp", "cpu", 2)
    assert found["rows"][0]["steps_per_second"] > 0
    assert found["rows"][0]["first_step"] > 0


@pytest.mark.gl
def test_drawing_is_timed_for_each_view_and_quality(mjrun_here: Command, swing: Path) -> None:
    what = ("--render", "--size", "64x48", "--view", "rgb", "--view", "seg", "--quality", "draft")
    done = mjrun_here("bench", swing, *QUICK, *what, "--json")
    frames = json.loads(done.stdout)["frames"]
    assert [(frame["view"], frame["size"], frame["quality"]) for frame in frames] == [
        ("rgb", [64, 48], "draft"),
        ("seg", [64, 48], "draft"),
    ]
    assert all(frame[part]["median"] > 0 for frame in frames for part in ("update", "draw", "read", "total"))
    lines = lines_of(mjrun_here("bench", swing, *QUICK, *what).stdout)
    title = next(i for i, line in enumerate(lines) if line.startswith("a frame, by "))
    assert lines[title + 1].split()[3:] == ["update", "draw", "read", "compose", "encode", "first"]
    assert max(len(line) for line in lines[title + 1 : title + 4]) <= 80


@pytest.mark.gl
def test_where_nothing_draws_it_says_so_before_it_measures(mjrun_here: Command, swing: Path) -> None:
    for option in ("--render", "--whole"):
        done = mjrun_here("bench", swing, *QUICK, option, env={"MUJOCO_GL": "off"})
        assert (done.returncode, done.stdout) == (5, b"")
    # Where nothing is to be drawn, what the environment says of drawing does not matter.
    assert mjrun_here("bench", swing, *QUICK, env={"MUJOCO_GL": "off"}).returncode == 0
