"""Completion in a shell: the scripts that `mjrun completion` prints, of which Bash executes its own."""

import os
import subprocess
from pathlib import Path

import mujoco
import pytest

from mjrun.cli.commands import completion
from mjrun.cli.commands.completion import SHELLS
from mjrun.model.sources.bundled_scene import BundledSceneSource
from mjrun.options.rendering import RIG_EXAMPLES
from tests import prepared_interpreters
from tests.conftest import Command
from tests.demonstration_files import write_demonstrations
from tests.documentation import ROOT

CAR = str(ROOT / "scenes/car.xml")
# Completes a line as an interactive Bash does: $2 is what follows the last character at which it breaks words.
COMPLETE = r"""
compopt() { options+=("$@"); }
source /dev/stdin <<< "$(mjrun completion bash)"
COMP_LINE=$LINE COMP_POINT=${#LINE} COMP_WORDBREAKS=$' \t\n"\'><=;|&(:'
_mjrun_completion mjrun "${LINE##*[ =:]}" ""
printf '%s\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a program `mjrun` for the shell."""
    folder = tmp_path_factory.mktemp("bin")
    script = folder / "mjrun"
    script.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec {prepared_interpreters.program()} "$@"\n')
    script.chmod(0o755)
    return folder


def completed(program: Path, line: str, folder: Path) -> list[str]:
    environment = {**os.environ, "PATH": f"{program}:{os.environ['PATH']}", "LINE": line}
    done = subprocess.run(
        ["bash", "--norc", "-c", COMPLETE], env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    assert not done.stderr
    return [text for text in done.stdout.splitlines() if text]


def car() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(CAR)


def test_bash_completes_words_at_which_it_breaks(program: Path, tmp_path: Path) -> None:
    (tmp_path / "scenery.xml").touch()

    assert completed(program, "mjrun video s", tmp_path) == ["scene:", "scenery.xml"]
    assert completed(program, "mjrun video scene:", tmp_path) == [*BundledSceneSource.descriptions()]
    assert completed(program, f"mjrun video {CAR} --camera=fi", tmp_path) == ["fixed"]
    assert completed(program, "mjrun vid", tmp_path) == ["video"]


NAMES = ["plain", "größe", "two words", "$(touch ran)", "`touch ran`", "a;touch ran", "it's", '5"', "back\\slash", "*"]


@pytest.mark.parametrize("opening", ["", "'", '"'])
def test_names_of_a_model_are_words_for_bash_and_never_code(program: Path, tmp_path: Path, opening: str) -> None:
    spec = mujoco.MjSpec()
    for name in (*NAMES, "escape\x1b[2J", "line\nfile,x"):
        spec.worldbody.add_camera(name=name)
    (tmp_path / "m.xml").write_text(spec.to_xml())
    words = completed(program, f"mjrun video m.xml --camera {opening}", tmp_path)
    read = subprocess.run(
        ["bash", "--norc", "-c", "printf '%s\\n' " + " ".join(f"{opening}{word}{opening}" for word in words)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    unsafe = {"": "", "'": "'\\", '"': '"$`!\\'}[opening]
    if not opening:
        assert completed(program, "mjrun video m.xml --camera two\\ w", tmp_path) == ["two\\ words"]
    assert read == [*(name for name in NAMES if not set(unsafe) & set(name)), *(f"{kind}:" for kind in RIG_EXAMPLES)]
    assert not (tmp_path / "ran").exists()


def test_a_file_of_demonstrations_completes_to_their_names(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    values = [item.value for item in completion.model_values(f"{path}:d")]
    assert values == [f"{path}:demo_1", f"{path}:demo_2"]
    assert [item.type for item in completion.model_values(f"{tmp_path}/missing.hdf5:")] == ["file"]


def test_a_wrong_line_completes_to_nothing(program: Path, tmp_path: Path) -> None:
    assert completed(program, "mjrun scene.xml ", tmp_path) == []
    assert completed(program, "mjrun video missing.xml --key ", tmp_path) == []


@pytest.mark.parametrize(
    ("name", "kind", "suffix"),
    [
        ("camera", mujoco.mjtObj.mjOBJ_CAMERA, ""),
        ("ctrl", mujoco.mjtObj.mjOBJ_ACTUATOR, "="),
        ("qpos", mujoco.mjtObj.mjOBJ_JOINT, "="),
        ("trail", mujoco.mjtObj.mjOBJ_BODY, ""),
    ],
)
def test_values_are_names_in_the_model(name: str, kind: mujoco.mjtObj, suffix: str) -> None:
    model = car()
    objects = [mujoco.mj_id2name(model, kind, i) for i in range(64)]
    expected = [f"{each}{suffix}" for each in objects if each]

    values = [item.value for item in completion.option_values(name, "NAME", CAR, "")]

    assert values[: len(expected)] == expected
    rigs = {f"{kind}:" for kind in RIG_EXAMPLES} if name == "camera" else set[str]()
    assert rigs <= set(values[len(expected) :]) <= {*rigs, "joint:0="}


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("qpos,xp", ["qpos,xpos"]),
        ("xpos", ["xpos", "xpos["]),
        ("xpos[left", ["xpos[left_wheel]"]),
        ("qpos,xpos[car,left", ["qpos,xpos[car,left_wheel]"]),
    ],
)
def test_columns_complete_group_by_group(typed: str, expected: list[str]) -> None:
    assert [item.value for item in completion.option_values("probe", "NAME,…", CAR, typed)] == expected


@pytest.mark.parametrize("path", ["geom/chassis.friction", "opt.timestep", "vis.global.fovy", "body/car.pos"])
def test_paths_complete_part_by_part(path: str) -> None:
    """Following the completions from nothing leads to the path, which `--set` accepts."""
    typed = ""
    while typed != f"{path}=":
        values = [item.value for item in completion.option_values("set", "PATH=VALUE", CAR, typed)]
        (typed,) = [value for value in values if f"{path}=".startswith(value)]


def test_options_of_files_complete_to_files() -> None:
    assert [item.type for item in completion.option_values("manifest", "FILE", None, "")] == ["file"]
    assert [item.type for item in completion.option_values("root", "DIR", None, "")] == ["dir"]


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_register_a_function_for_the_program(shell: str, mjrun_here: Command) -> None:
    done = mjrun_here("completion", shell)

    assert done.returncode == 0, done.stderr
    assert f"_MJRUN_COMPLETE={shell}_complete".encode() in done.stdout


def test_other_shells_are_refused_with_those_there_are(mjrun_here: Command) -> None:
    done = mjrun_here("completion", "zhs")

    assert done.returncode == 2
    assert b"did you mean 'zsh'" in done.stderr
