"""`mjrun sweep` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pandas as pd
import pytest

from tests.study.models import BALL

if TYPE_CHECKING:
    from tests.conftest import Command

METRIC = ("--metric", "low=min(qpos/ball/z)")


@pytest.fixture
def ball(mjrun: Command) -> str:
    (mjrun.folder / "ball.xml").write_text(BALL)
    return "ball.xml"


def test_the_report_and_the_table_say_what_has_come_of_the_points(mjrun: Command, ball: str) -> None:
    done = mjrun("sweep", ball, "--steps", "30", "--vary", "qpos/ball/z=0.2..1:5", *METRIC, "-o", "study")
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode()
    assert "median" in text
    assert "study: 5 points (5 ok)" in text
    rows = pd.read_csv(mjrun.folder / "study" / "results.csv")
    assert rows["qpos/ball/z"].tolist() == [0.2, 0.4, 0.6, 0.8, 1]

    again = mjrun("sweep", ball, "--steps", "30", "--vary", "qpos/ball/z=0.2..1:5", *METRIC, "-o", "study", "--json")
    report = json.loads(again.stdout)
    assert (again.returncode, report["simulated"], report["metrics"]["low"]["count"]) == (0, 0, 5)
    assert b"5 of 5 points are known already" in again.stderr


def test_failures_are_told_by_reason_with_a_command_that_shows_them(mjrun: Command, ball: str) -> None:
    options = ("--steps", "30", "--vary", "qvel/ball/vz=0,-1e9", *METRIC)
    done = mjrun("sweep", ball, *options, "-o", "study")
    assert done.returncode == 8
    assert done.stderr == b"mjrun: error: 1 unstable, of 2 points; the others are in the table\n"
    line = next(line for line in done.stdout.decode().splitlines() if "unstable at step" in line)
    alone = line[line.index("mjrun trace") :].split()
    assert mjrun(*alone[1:]).returncode == 4

    done = mjrun("sweep", ball, *options, "-o", "study", "--json")
    report = json.loads(done.stdout)
    assert (done.returncode, report["statuses"], report["error"]["exit_code"]) == (8, {"ok": 1, "unstable": 1}, 8)


def test_the_folder_is_called_by_the_model(mjrun: Command, ball: str) -> None:
    assert mjrun("sweep", ball, "--steps", "5", "--vary", "seed=1,2").returncode == 0
    assert (mjrun.folder / "ball_study" / "results.csv").exists()


@pytest.mark.parametrize(
    ("options", "code", "expected"),
    [
        (("-o", "study", "--vary", "seed"), 2, "--vary"),
        (("-o", "study", "--vary", "sed=1"), 2, "did you mean 'seed'"),
        (("-o", "study", "--metric", "x=max(qpos/bal/z)"), 2, "qpos/ball/z"),
        (("-o", "study", "--vary", "seed=gauss(0,1)"), 2, "distributions: uniform(LOW, HIGH)"),
        (
            (
                "-o",
                "ball.xml/study",
            ),
            7,
            "cannot be made",
        ),
        (("-o", "study", "--require", "max(seed) <", "--vary", "seed=1"), 2, "--require, character"),
        (("-o", "study", "--engine", "ray", "--vary", "seed=1"), 2, "engines: local, dask"),
    ],
)
def test_mistakes_are_told_and_nothing_is_simulated(
    mjrun: Command, ball: str, options: tuple[str, ...], code: int, expected: str
) -> None:
    done = mjrun("sweep", ball, "--steps", "5", *options)
    assert done.returncode == code
    assert expected in done.stderr.decode()
    assert not list(mjrun.folder.rglob("results.*"))


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(mjrun: Command, ball: str) -> None:
    options = (ball, "--steps", "30", "--vary", "qpos/ball/z=0.2..1:9", *METRIC, "-o", "study", "--dry-run")
    done = mjrun("sweep", *options)
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode()
    assert "to simulate  9 in 5 chunks, 270 steps" in text
    assert ["…", "…"] in [line.split() for line in text.splitlines()]
    report = json.loads(mjrun("sweep", *options, "--json").stdout)
    assert (report["points"], report["missing"], report["names"]) == (9, 9, ["qpos/ball/z"])
    assert [each["point"] for each in report["sample"]] == [0, 1, 2, 6, 7, 8]
    assert sorted(path.name for path in mjrun.folder.iterdir()) == ["ball.xml"]
