"""`mjrun dataset` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.conftest import Command

MODEL = '<mujoco><worldbody><body name="ball"><freejoint name="ball"/><geom size=".1"/></body></worldbody></mujoco>'
SMALL = ("--size", "32x24", "--quality", "draft", "--jobs", "1")


@pytest.fixture
def ball(mjrun_here: Command) -> str:
    (mjrun_here.folder / "ball.xml").write_text(MODEL)
    return "ball.xml"


@pytest.mark.gl
def test_the_report_counts_images_and_running_again_renders_nothing(mjrun_here: Command, ball: str) -> None:
    options = (*SMALL, "--vary", "camera.azimuth=uniform(0,90)", "--samples", "4")
    done = mjrun_here("dataset", ball, *options)
    assert done.returncode == 0
    assert done.stdout.decode().startswith("ball_dataset: 4 images (3 train, 1 val), 1 object; ")
    assert done.stderr.decode().startswith("mjrun: a light and a sky added, which the model lacks")
    again = mjrun_here("dataset", ball, *options, "--accept", "pixels/ball > 1e6", "--json")
    report = json.loads(again.stdout)
    assert (report["rendered"], report["rejected"], report["images"]) == (4, 4, {"train": 0, "val": 0})
    last = mjrun_here("dataset", ball, *options, "--accept", "pixels/ball > 1e6", "--json")
    assert json.loads(last.stdout)["rendered"] == 0
    assert b"4 of 4 points are known already" in last.stderr


@pytest.mark.gl
def test_failed_points_are_listed_by_reason(mjrun_here: Command, ball: str) -> None:
    done = mjrun_here("dataset", ball, *SMALL, "--vary", "camera.lookat=ball,bal", "-o", "set")
    assert done.returncode == 8
    assert done.stdout.decode().startswith("failed: 1 point, the first is 1: no object 'bal'")
    assert "set: 1 image (1 train, 0 val), 1 object; " in done.stdout.decode()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--objects", "bal"), "no body 'bal' (did you mean 'ball'?)"),
        (("--format", "cocoa"), "'cocoa' is not one of"),
        (("--split", "train=2"), "names with shares that sum to 1"),
        (("--times", "0,9", "--duration", "1"), "--times: 9 s is after the end of the simulation at 1 s"),
        (("--accept", "pixel/ball > 3"), "no column 'pixel/ball'"),
    ],
)
def test_mistakes_are_explained_before_anything_is_written(
    mjrun_here: Command, ball: str, options: tuple[str, ...], message: str
) -> None:
    done = mjrun_here("dataset", ball, *options, "-o", "set")
    assert done.returncode == 2
    assert message in done.stderr.decode()
    assert not (mjrun_here.folder / "set").exists()


@pytest.mark.gl
def test_a_study_document_describes_what_varies(mjrun_here: Command, ball: str) -> None:
    (mjrun_here.folder / "images.yaml").write_text(
        "model: ball.xml\nsamples: 3\nvary:\n  camera.azimuth: {uniform: [0, 90]}\n  qpos/ball/z: {uniform: [0, 1]}\n"
    )
    done = mjrun_here("dataset", "images.yaml", "samples=2", *SMALL, "--json")
    assert (done.returncode, json.loads(done.stdout)["points"]) == (0, 2)
    options = (*SMALL, "--vary", "camera.azimuth=uniform(0,90)", "--vary", "qpos/ball/z=uniform(0,1)", "--samples", "2")
    assert mjrun_here("dataset", ball, *options, "-o", "same").returncode == 0
    paths = [mjrun_here.folder / name / "images/000001.png" for name in ("images_dataset", "same")]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    refused = mjrun_here("dataset", "images.yaml", *SMALL, "--samples", "4", "-o", "other")
    assert refused.returncode == 2
    assert b"--samples cannot accompany images.yaml; write samples=VALUE instead" in refused.stderr
