"""`mjrun export` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tests.cases import cases
from tests.evaluation.tasks import XML

if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import Command


def test_a_model_is_enough(mjrun_here: Command, swing: Path) -> None:
    done = mjrun_here("export", swing, "--duration", "0.1", "--hide", "static")
    assert (done.returncode, done.stderr) == (0, b"")
    assert mjrun_here.files() == ["swing.glb"]
    assert done.stdout.decode().startswith("swing.glb: glb, 3 frames, 0.1 s at 30 fps, ")


def test_the_format_gives_the_file_its_suffix(mjrun_here: Command, swing: Path) -> None:
    for name, start in (("usda", b"#usda 1.0"), ("usd", b"PXR-USDC"), ("mcap", b"\x89MCAP")):
        done = mjrun_here("export", swing, "--steps", "1", "--format", name)
        assert done.returncode == 0
        (made,) = mjrun_here.folder.glob(f"swing.{'usdc' if name == 'usd' else name}")
        assert made.read_bytes().startswith(start)


def test_a_file_in_a_pipe_is_the_same_and_alone_there(mjrun_here: Command, swing: Path) -> None:
    piped = mjrun_here("export", swing, "--steps", "1", "-o", "-", "--format", "glb")
    assert piped.returncode == 0
    assert int.from_bytes(piped.stdout[8:12], "little") == len(piped.stdout)


def test_the_document_of_a_command_makes_the_same(mjrun_here: Command, swing: Path) -> None:
    printed = mjrun_here("export", swing, "--steps", "10", "-o", "a.glb", "--print-document")
    (mjrun_here.folder / "run.yaml").write_bytes(printed.stdout)
    made = mjrun_here("run", "run.yaml", "--json")
    assert made.returncode == 0
    assert json.loads(made.stdout)["results"][0]["kind"] == "Export"
    assert "a.glb" in mjrun_here.files()


CART = """
model: cart.xml
control_dt: 0.02
duration: 0.4
observations: [{name: x, joints: [slider]}, {name: v, joints: [slider], of: qvel}]
actions: [{actuators: [push]}]
rewards: {near: -abs(qpos/slider)}
terminations: {lost: {when: abs(qpos/slider) > 1, as: failure}}
"""


@pytest.fixture
def cart(mjrun_here: Command) -> str:
    (mjrun_here.folder / "cart.xml").write_text(XML)
    (mjrun_here.folder / "cart.yaml").write_text(CART)
    return "cart.yaml"


def test_episodes_are_a_folder_that_a_second_run_continues(mjrun_here: Command, cart: str) -> None:
    options = (cart, "--policy", "zero", "--format", "lerobot", "--jobs", "1")
    done = mjrun_here("export", *options, "--episodes", "2", "--instruction", "stay")
    assert done.stdout.decode().startswith("cart_lerobot: 2 episodes (lerobot), 40 rows at 50 Hz, mean return 0; ")
    again = mjrun_here("export", *options, "--episodes", "3", "--instruction", "stay", "--json")
    report = json.loads(again.stdout)
    assert (report["episodes"], report["simulated"], report["seeds"]) == (3, 1, [0, 1, 2])
    assert again.stderr == b"mjrun: 2 of 3 episodes are known already\n"
    (mjrun_here.folder / cart).write_text(CART.replace("-abs(qpos/slider)", "-2 * abs(qpos/slider)"))
    edited = mjrun_here("export", *options, "--episodes", "3", "--instruction", "stay")
    assert (edited.returncode, edited.stdout) == (7, b"")
    assert b"cart_lerobot: has episodes of another task, policy, model, version or options" in edited.stderr


@cases("options, message")
def test_mistakes_in_episodes_are_explained_before_anything_is_written(
    mjrun_here: Command, cart: str, options: tuple[str, ...], message: str
) -> None:
    done = mjrun_here("export", cart, "-o", "set", *options)
    assert done.returncode == 2
    assert message in done.stderr.decode()
    assert not list(mjrun_here.folder.glob("set*"))


def test_a_run_document_cannot_export_episodes(mjrun_here: Command, swing: Path) -> None:
    (mjrun_here.folder / "run.yaml").write_text(f"{{model: {swing}, exports: [{{output: set, format: lerobot}}]}}")
    done = mjrun_here("run", "run.yaml")
    assert done.returncode == 2
    assert b"lerobot is a folder of episodes, which mjrun export and mjrun.EpisodeDataset write" in done.stderr
