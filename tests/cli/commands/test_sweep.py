"""`mjrun sweep` as a user runs it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import pandas as pd
import pyarrow.parquet as pq
import pytest

from tests.cases import cases
from tests.study.models import BALL

if TYPE_CHECKING:
    from tests.conftest import Command

METRIC = ("--metric", "low=min(qpos/ball/z)", "--jobs", "1")


@pytest.fixture
def ball(mjrun_here: Command) -> str:
    (mjrun_here.folder / "ball.xml").write_text(BALL)
    return "ball.xml"


def test_the_report_and_the_table_say_what_has_come_of_the_points(mjrun_here: Command, ball: str) -> None:
    done = mjrun_here("sweep", ball, "--steps", "30", "--vary", "qpos/ball/z=0.2..1:5", *METRIC, "-o", "study")
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode()
    assert "median" in text
    assert "study: 5 points (5 ok)" in text
    assert text.count("where") == 1
    assert "qpos/ball/z=0.2" in text
    rows = pd.read_csv(mjrun_here.folder / "study" / "results.csv")
    assert rows["qpos/ball/z"].tolist() == [0.2, 0.4, 0.6, 0.8, 1]

    again = mjrun_here(
        "sweep", ball, "--steps", "30", "--vary", "qpos/ball/z=0.2..1:5", *METRIC, "-o", "study", "--json"
    )
    report = json.loads(again.stdout)
    assert (again.returncode, report["simulated"], report["metrics"]["low"]["count"]) == (0, 0, 5)
    assert b"5 of 5 points are known already" in again.stderr


def test_failures_are_reported_by_reason_with_a_command_that_shows_them(mjrun_here: Command, ball: str) -> None:
    options = ("--steps", "30", "--vary", "qvel/ball/vz=0,-1e9", *METRIC)
    done = mjrun_here("sweep", ball, *options, "-o", "study")
    assert done.returncode == 8
    told, error = done.stderr.decode().splitlines()
    assert told.startswith("mjrun: point 1 (qvel/ball/vz=-1e9): the simulation became unstable at step 1, ")
    assert error == "mjrun: error: 1 unstable, of 2 points; the table has the others"
    assert b"unstable at step" in done.stdout
    line = next(line for line in done.stdout.decode().splitlines() if "mjrun trace" in line)
    alone = line.split()
    assert mjrun_here(*alone[1:]).returncode == 4

    done = mjrun_here("sweep", ball, *options, "-o", "study", "--json")
    report = json.loads(done.stdout)
    assert (done.returncode, report["statuses"], report["error"]["exit_code"]) == (8, {"ok": 1, "unstable": 1}, 8)


@pytest.mark.slow
def test_a_study_that_was_interrupted_is_continued_by_its_folder(mjrun_here: Command, ball: str) -> None:
    options = ("--steps", "5", "--vary", "seed=1..8:8", *METRIC, "-o", "ball_study")
    assert mjrun_here("sweep", ball, *options, "--plan", "plan.jsonl").returncode == 0
    for task in range(1, 5):  # each writes a part, or two on a slow machine
        assert mjrun_here("sweep", "plan.jsonl", "--task", f"{task}/4", "--jobs", "1").returncode == 0
    folder = mjrun_here.folder / "ball_study"
    parts = sorted((folder / "parts").iterdir())
    known = 8 - sum(pq.read_metadata(part).num_rows for part in parts[:2])
    parts[0].unlink()
    parts[1].write_bytes(parts[1].read_bytes()[:99])

    plot = mjrun_here("plot", "ball_study", "-o", "x.png")
    assert b"mjrun sweep ball_study --collect" in plot.stderr
    done = mjrun_here("sweep", "ball_study")
    assert f"{known} of 8 points are known".encode() in done.stderr
    assert f"{parts[1].name} is damaged" in done.stderr.decode()
    assert done.returncode == 0
    assert len(pd.read_csv(folder / "results.csv").dropna(subset="low")) == 8


def test_of_a_study_that_was_run_more_may_be_required(mjrun_here: Command, ball: str) -> None:
    assert mjrun_here("sweep", ball, "--steps", "5", "--vary", "seed=1..3:3", *METRIC, "-o", "study").returncode == 0
    table = (mjrun_here.folder / "study" / "results.csv").read_text()
    assert table.splitlines()[1].startswith("0,1,")  # seeds are whole numbers
    held = mjrun_here("sweep", "study", "--require", "max(low) < 99")
    assert (held.returncode, b"3 of 3 points are known already" in held.stderr) == (0, True)
    assert mjrun_here("sweep", "study", "--require", "max(low) < 0.01", "-q").returncode == 1
    refused = mjrun_here("sweep", "study", "--samples", "9")
    assert b"--samples: study sets it already; for another study, give its model or its document" in refused.stderr


def test_the_status_of_a_study_is_that_of_its_folder(mjrun_here: Command, ball: str) -> None:
    study = ("sweep", ball, "--steps", "5", "--vary", "seed=1..3:3", *METRIC)
    assert mjrun_here(*study).returncode == 0
    done = mjrun_here(*study, "--status")  # of the folder that the same command writes
    assert (done.returncode, done.stdout) == (0, b"ball_study: 3 of 3 points (3 ok), finished\n")
    for part in mjrun_here.folder.glob("ball_study/parts/*"):
        part.unlink()
    done = mjrun_here("sweep", "ball_study", "--status", "--json", "--html", "page.html")
    status = json.loads(done.stdout)
    assert (done.returncode, status["done"], status["is_finished"], status["running"]) == (1, 0, False, [])
    assert "no process works on it" in (mjrun_here.folder / "page.html").read_text()
    assert mjrun_here("sweep", "ball_study", "--gc", "--dry-run").stdout == b"ball_study: would remove nothing\n"
    nowhere = mjrun_here("sweep", "nowhere", "--status")
    assert (nowhere.returncode, nowhere.stderr.startswith(b"mjrun: error: nowhere: has no study.json")) == (7, True)
    refused = mjrun_here("sweep", "study.yaml", "--status")
    assert (refused.returncode, b"--status requires the folder of the study" in refused.stderr) == (2, True)


@pytest.mark.slow
def test_a_study_that_changed_says_what_has(mjrun_here: Command, ball: str) -> None:
    options = ("--vary", "seed=1,2", *METRIC)
    assert b"changed" not in mjrun_here("sweep", ball, "--steps", "5", *options).stderr
    assert b"changed" not in mjrun_here("sweep", ball, "--steps", "5", *options).stderr
    assert b"changed since the last run: steps\n" in mjrun_here("sweep", ball, "--steps", "6", *options).stderr
    heavier = BALL.replace("<worldbody>", '<option gravity="0 0 -50"/><worldbody>')
    (mjrun_here.folder / ball).write_text(heavier)
    assert b"changed since the last run: model, files\n" in mjrun_here("sweep", ball, "--steps", "6", *options).stderr


@pytest.mark.slow
def test_a_camera_script_is_part_of_the_study(mjrun_here: Command, ball: str) -> None:
    script = mjrun_here.folder / "turn.yaml"
    script.write_text("shots:\n  - orbit: {lookat: ball, distance: 2, azimuth: 10}\n")
    options = ("--keep", "video", "--camera", "turn.yaml", "--size", "32x32", "--fps", "10", "-o", "study")
    made = mjrun_here("sweep", ball, "--duration", "0.1", "--vary", "qpos/ball/z=1", *METRIC, *options)
    video = mjrun_here.folder / "study" / "points" / "000000" / "video.mp4"
    assert (made.returncode, video.is_file()) == (0, True)
    before = video.stat().st_mtime_ns
    script.unlink()
    assert mjrun_here("sweep", "study").returncode == 0
    assert video.stat().st_mtime_ns == before


def test_a_folder_that_is_no_study_is_refused(mjrun_here: Command) -> None:
    (mjrun_here.folder / "empty").mkdir()
    refused = mjrun_here("sweep", "empty")
    assert (refused.returncode, b"empty: has no study.json" in refused.stderr) == (7, True)


def test_a_study_that_was_moved_without_its_model_says_so(mjrun_here: Command, ball: str) -> None:
    assert mjrun_here("sweep", ball, "--steps", "5", "--vary", "seed=1", *METRIC, "-o", "deep/study").returncode == 0
    (mjrun_here.folder / "deep/study").rename(mjrun_here.folder / "study")
    moved = mjrun_here("sweep", "study")
    assert moved.returncode == 3
    assert b"no such model file\n" in moved.stderr
    assert b"study/study.json names it by its path from this folder: move both together" in moved.stderr


def test_the_folder_is_called_by_the_model(mjrun_here: Command, ball: str) -> None:
    assert mjrun_here("sweep", ball, "--steps", "5", "--vary", "seed=1,2").returncode == 0
    assert (mjrun_here.folder / "ball_study" / "results.csv").exists()


@cases("options, code, expected")
def test_mistakes_are_reported_and_nothing_is_simulated(
    mjrun_here: Command, ball: str, options: tuple[str, ...], code: int, expected: str
) -> None:
    done = mjrun_here("sweep", ball, "--steps", "5", *options)
    assert done.returncode == code
    assert expected in done.stderr.decode()
    assert not list(mjrun_here.folder.rglob("results.*"))


@pytest.mark.slow
def test_a_dry_run_says_what_would_be_done_and_writes_nothing(mjrun_here: Command, ball: str) -> None:
    options = (ball, "--steps", "30", "--vary", "qpos/ball/z=0.2..1:9", *METRIC, "-o", "study", "--dry-run")
    done = mjrun_here("sweep", *options)
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode()
    assert re.search(r"to simulate  9 in about \d chunks, 270 steps", text)
    assert ["…", "…"] in [line.split() for line in text.splitlines()]
    report = json.loads(mjrun_here("sweep", *options, "--json").stdout)
    assert (report["points"], report["missing"], report["names"]) == (9, 9, ["qpos/ball/z"])
    assert [each["point"] for each in report["sample"]] == [0, 1, 2, 6, 7, 8]
    assert sorted(path.name for path in mjrun_here.folder.iterdir()) == ["ball.xml"]


@pytest.mark.slow
def test_four_tasks_make_the_table_of_one(mjrun: Command, mjrun_here: Command, ball: str) -> None:
    options = (ball, "--steps", "30", "--vary", "qpos/ball/z=uniform(0.2,1)", "--samples", "8", *METRIC, "--chunk", "1")
    assert mjrun_here("sweep", *options, "-o", "alone", "-q").returncode == 0
    planned = mjrun_here("sweep", *options, "-o", "study", "--plan", "plan.jsonl")
    assert (planned.returncode, planned.stdout) == (0, b"plan.jsonl: 8 points\n")

    def task(here: Command, i: int) -> subprocess.CompletedProcess[bytes]:
        return here("sweep", "plan.jsonl", "--task", f"{i}/4", "--jobs", "1")

    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(task, mjrun, 1)  # in another process, at the same time as the second
        others = [task(mjrun_here, i) for i in (2, 3, 4)]
        tasks = [first.result(), *others]
    for number, done in enumerate(tasks, 1):
        expected = f"study: task {number} of 4: 2 points simulated (2 ok); "
        assert (done.returncode, done.stdout.decode()[: len(expected)]) == (0, expected)
    assert mjrun_here("sweep", "study", "--collect", "-q").returncode == 0
    alone, study = (mjrun_here.folder / name / "results.parquet" for name in ("alone", "study"))
    assert study.read_bytes() == alone.read_bytes()


@pytest.mark.slow
def test_a_task_that_was_killed_is_run_again(mjrun_here: Command, ball: str) -> None:
    options = (
        ball,
        "--steps",
        "200",
        "--vary",
        "perturb=uniform(0,1)",
        "--samples",
        "40",
        *METRIC,
        "--chunk",
        "1",
        "-q",
    )
    assert mjrun_here("sweep", *options, "-o", "alone").returncode == 0
    assert mjrun_here("sweep", *options, "-o", "study", "--plan", "plan.jsonl").returncode == 0
    late = mjrun_here("sweep", "plan.jsonl", "--task", "1/1", "--time-budget", "1us")
    assert (late.returncode, b"0 points simulated, 40 left; " in late.stdout) == (8, True)
    command = [sys.executable, "-m", "mjrun", "sweep", "plan.jsonl", "--task", "1/1", "--jobs", "1"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, cwd=mjrun_here.folder, env=environment, stdout=subprocess.DEVNULL) as task:
        while not [*mjrun_here.folder.glob("study/parts/*.parquet")]:
            time.sleep(0.01)
        task.kill()
    for left in mjrun_here.folder.rglob(".*.part"):  # which another process might still write, as far as anybody knows
        left.unlink()
    assert mjrun_here("sweep", "plan.jsonl", "--task", "1/1", "-q").returncode == 0
    assert mjrun_here("sweep", "plan.jsonl", "--collect", "-q").returncode == 0
    alone, study = (mjrun_here.folder / name / "results.parquet" for name in ("alone", "study"))
    assert study.read_bytes() == alone.read_bytes()


def test_the_table_goes_to_stdout_on_request(mjrun_here: Command, ball: str) -> None:
    options = (ball, "--steps", "5", "--vary", "seed=1,2", *METRIC, "-o", "study", "--csv")
    done = mjrun_here("sweep", *options)
    assert done.stdout == (mjrun_here.folder / "study" / "results.csv").read_bytes()
    assert b"study: 2 points (2 ok)" in done.stderr
    assert mjrun_here("sweep", "study", "--csv", "-q").stdout == done.stdout
    assert mjrun_here("sweep", *options, "--json").returncode == 2


def test_a_document_and_what_belongs_into_it(mjrun_here: Command, ball: str) -> None:
    text = f"model: {ball}\nsteps: 5\nvary: {{seed: [1, 2]}}\nmetrics: {{end: last(time)}}\n"
    (mjrun_here.folder / "kicks.yaml").write_text(text)
    assert mjrun_here("sweep", "kicks.yaml", "vary.seed=1..3:3").returncode == 0
    assert pd.read_csv(mjrun_here.folder / "kicks" / "results.csv")["seed"].tolist() == [1, 2, 3]


@cases("words, expected")
def test_what_does_not_go_together_is_reported(
    mjrun_here: Command, ball: str, words: tuple[str, ...], expected: str
) -> None:
    (mjrun_here.folder / "k.yaml").write_text(f"model: {ball}\nsteps: 5\n")
    (mjrun_here.folder / "r.yaml").write_text(f"model: {ball}\ntraces: [{{output: t.csv}}]\n")
    (mjrun_here.folder / "p.jsonl").write_text("")
    done = mjrun_here("sweep", *words)
    assert done.returncode == 2
    assert expected in done.stderr.decode()


@pytest.mark.slow
def test_a_model_on_standard_input_is_swept(mjrun: Command, ball: str) -> None:
    text = (mjrun.folder / ball).read_bytes()
    varied = ("--vary", "seed=1..3:3", "--steps", "5", "--metric", "t=last(time)", "--jobs", "1")
    command = [sys.executable, "-m", "mjrun", "sweep", "-", *varied]
    done = subprocess.run(command, cwd=mjrun.folder, input=text, capture_output=True)
    assert done.returncode == 0
    assert b"model_study: 3 points (3 ok)" in done.stdout


@pytest.mark.slow
def test_an_untrusted_model_is_swept_from_copies_and_reads_nothing_else(mjrun: Command, ball: str) -> None:
    varied = ("--untrusted", "--vary", "seed=1..3:3", "--steps", "5", "--metric", "t=last(time)", "--jobs", "1")
    assert mjrun("sweep", ball, *varied).returncode == 0
    (mjrun.folder / "nosy.xml").write_text('<mujoco><asset><mesh file="/etc/hostname"/></asset></mujoco>')
    refused = mjrun("sweep", "nosy.xml", *varied)
    assert refused.returncode == 3
    assert b"nosy.xml:1: '/etc/hostname' is outside the folder that files are read from" in refused.stderr


def test_failed_points_are_repeated_if_the_controller_changed_and_on_request_if_a_file_that_it_opens_did(
    mjrun_here: Command,
) -> None:
    (mjrun_here.folder / "m.xml").write_text(
        "<mujoco><worldbody><body><joint name='j'/><geom size='1'/></body></worldbody>"
        "<actuator><motor joint='j'/></actuator></mujoco>"
    )
    code, gain = mjrun_here.folder / "code.py", mjrun_here.folder / "gain.txt"
    code.write_text(f"def act(model, data):\n    return [float(open({str(gain)!r}).read()) if data.time else 0]\n")
    gain.write_text("strong")

    def ended(*options: str) -> tuple[int, bytes]:
        vary = ("--vary", "qvel/j=1,2", "--steps", "3", "--controller", "code.py:act", "-o", "study", "--jobs", "1")
        done = mjrun_here("sweep", "m.xml", *vary, *options)
        return done.returncode, done.stdout.splitlines()[-1].partition(b";")[0]

    assert ended() == (8, b"study: 2 points (2 failed)")
    gain.write_text("1")
    assert ended() == (
        8,
        b"study: 2 points (2 failed), 2 of them known before: --retry-failed repeats those that failed",
    )
    gain.write_text("weak")
    code.write_text(code.read_text().replace("else 0", "else 1"))
    assert ended() == (8, b"study: 2 points (2 failed)")
    code.write_text("def act(model, data):\n    return [1]\n")
    assert ended() == (0, b"study: 2 points (2 ok)")
    assert ended() == (0, b"study: 2 points (2 ok), 2 of them known before")
