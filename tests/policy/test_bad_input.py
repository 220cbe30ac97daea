"""Policies that cannot be played, at the command line: one error, the right exit code, and nothing left behind."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Command
from tests.policy.networks import linear
from tests.policy.test_task_facts import DOCUMENT, METADATA, MODEL, MOTORS

WEIGHTS = np.full((2, 6), 0.5, np.float32)


def damaged(folder: Path) -> str:
    path = linear(folder / "p.onnx", WEIGHTS)
    path.write_bytes(path.read_bytes()[:100])
    return "p.onnx"


def wide(folder: Path) -> str:
    return linear(folder / "p.onnx", np.ones((2, 7), np.float32)).name


def nan(folder: Path) -> str:
    return linear(folder / "p.onnx", WEIGHTS, bias=np.nan).name


def permuted(folder: Path) -> str:
    return linear(folder / "p.onnx", WEIGHTS, metadata={**METADATA, "joint_names": "knee,hip"}).name


def archive(folder: Path) -> str:
    (folder / "p.zip").write_bytes(b"PK\3\4")
    return "p.zip"


def code(folder: Path) -> str:
    (folder / "p.py").write_text("def act(observation):\n    raise RuntimeError('no')\n")
    return "p.py:act"


@pytest.mark.parametrize(
    ("make", "exit_code", "message"),
    [
        (damaged, 7, "p.onnx: is not an ONNX model, or is damaged"),
        (wide, 2, "observations: the policy has 7 numbers; the task has 6: joint_pos (2), joint_vel (2), actions (2)"),
        (nan, 4, "p.onnx returned non-finite actions at step 0, time 0 s: hip = nan, knee = nan"),
        (permuted, 2, "order of joints in joint_pos: the policy has knee, hip; the task has hip, knee"),
        (archive, 2, "set --trust if you trust its origin"),
        (code, 2, "raised RuntimeError: no"),
        (lambda _: "nothing.onnx", 7, "nothing.onnx: no such file"),
        (lambda _: "walk", 2, "--policy walk: unknown policy format"),
    ],
)
def test_a_policy_that_cannot_be_played_leaves_nothing_behind(
    mjrun_here: Command, make: Callable[[Path], str], exit_code: int, message: str
) -> None:
    (mjrun_here.folder / "robot.xml").write_text(MODEL.format("", MOTORS.format("")))
    (mjrun_here.folder / "task.yaml").write_text(DOCUMENT)
    policy, before = make(mjrun_here.folder), mjrun_here.files()
    done = mjrun_here("trace", "task.yaml", "--policy", policy, "-o", "t.csv", "--recording", "r.npz")
    text = done.stderr.decode()
    assert (done.returncode, done.stdout) == (exit_code, b""), text
    assert text.startswith("mjrun: error: ")
    assert message in text
    assert {*mjrun_here.files()} - {*before} <= {"__pycache__"}


def test_a_document_names_no_code(mjrun_here: Command) -> None:
    (mjrun_here.folder / "robot.xml").write_text(MODEL.format("", MOTORS.format("")))
    (mjrun_here.folder / "run.yaml").write_text("model: robot.xml\npolicy: p.py:act\ntraces: [t.csv]\n")
    done = mjrun_here("run", "run.yaml")
    assert done.returncode == 2
    assert "run.yaml:2:9: policy: a document cannot contain code; give it on the command line" in done.stderr.decode()
