"""The pages that users read, README.md and those in docs/, the code in them, and its execution."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING

from tests import prepared_interpreters
from tests.processes import without_progress

if TYPE_CHECKING:
    from tests.conftest import Command

ROOT = Path(__file__).parents[1]
PAGES = {
    path: path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
}
TEXT = "\n".join(PAGES.values())
# Tests run side by side: how fast anything is must not decide one.
PATIENT = "--fail-above 100000%"
ELSEWHERE = r"[|<$]|--untrusted|dm:|menagerie:"  # these take a separate process


def blocks(language: str, text: str = TEXT) -> list[str]:
    """Returns the code blocks in a language, without those that others contain."""
    unique = dict.fromkeys(re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    return [block for block in unique if not any(block in other for other in unique if other != block)]


def commands(text: str = TEXT) -> list[str]:
    """Returns the shell commands, each once and on one line."""
    lines = "".join(blocks("sh", text)).replace("\\\n", " ").splitlines()
    return list(dict.fromkeys(line for line in lines if line.strip()))


def commands_in_tables(text: str) -> list[str]:
    """Returns the commands that are the last cell of a row."""
    return re.findall(r"^\|.*\| `(mjrun [^`]+)` \|$", text, re.MULTILINE)


@dataclass(frozen=True)
class Done:
    """The result of command lines."""

    returncode: int
    stdout: str
    stderr: str


@dataclass(frozen=True)
class Execution:
    """Executes command lines of the pages in a folder: mjrun in this process, everything else in a shell.

    Attributes:
      smaller: Options that are added to each command of mjrun, by its name, so that tests take less time.
    """

    folder: Path
    here: Command
    environment: Mapping[str, str]
    smaller: Mapping[str, str]

    def __call__(self, commands: str) -> Done:
        """Executes command lines until one of them fails."""
        done = [Done(0, "", "")]
        for command in re.split(
            r"\s&&\s|;\s(?=\w+ )|\n(?!$)", self._with_smaller_values(commands.replace("\\\n", " ").strip())
        ):
            is_simple = command.strip().startswith("mjrun ") and not re.search(ELSEWHERE, command)
            done.append(self._in_process(command) if is_simple else self.in_shell(command))
            if done[-1].returncode:
                break
        return Done(done[-1].returncode, "".join(d.stdout for d in done), "".join(d.stderr for d in done))

    def planned(self, command: str) -> Done:
        """Turns a video or an image into a document, and that into a plan, which finds all that the command names."""
        steps = f"{command} --print-document > document.yaml && mjrun run document.yaml --dry-run"
        return replace(self, smaller={})(steps)

    def in_shell(self, command: str) -> Done:
        """Executes a command line by a shell, whose `mjrun` is that of `shell_environment`."""
        arguments = ["sh", "-ec", command]
        done = subprocess.run(arguments, cwd=self.folder, env=dict(self.environment), capture_output=True)
        return Done(done.returncode, done.stdout.decode(), without_progress(done.stderr).decode())

    def _with_smaller_values(self, commands: str) -> str:
        """Gives options that are added later the same values before: mjrun warns of one that another replaces."""
        for name, options in self.smaller.items():
            for option, value in re.findall(r"(--[\w-]+) (\S+)", options):
                commands = re.sub(rf"(mjrun {name} [^|;&\n]*?{option} )\S+", rf"\g<1>{value}", commands)
        return commands

    def _in_process(self, command: str) -> Done:
        """Executes one `mjrun`, with the patterns and the redirection that the shell would resolve."""
        words, target = [], ""
        lexer = shlex.shlex(command, posix=True, punctuation_chars=">")
        lexer.whitespace_split, lexer.commenters = True, ""
        for word in lexer:
            if word == ">":
                target = next(lexer)
            else:
                words += sorted(glob(word)) or [word]  # noqa: PTH207 - as the shell does
        smaller = self.smaller.get(words[1], "").split() + PATIENT.split() * ("--fail-above" in words)
        done = self.here(*words[1:], *smaller)
        if target:
            Path(target).write_bytes(done.stdout)
        return Done(done.returncode, "" if target else done.stdout.decode(), done.stderr.decode())


def plain_scenes(folder: Path) -> Path:
    """Copies the scenes without their textures, for which a renderer compiles most of its shaders; returns the copy.

    tests/test_gallery.py renders the scenes as they are.
    """
    copied = Path(shutil.copytree(ROOT / "scenes", folder / "scenes"))
    for scene in copied.glob("*.xml"):
        text = re.sub(r'<texture .*?/>| texture="\w+"', "", scene.read_text(), flags=re.DOTALL)
        scene.write_text(re.sub(r'shadowsize="\d+"', 'shadowsize="64" offsamples="0"', text))
    return copied


def shell_environment(folder: Path, smaller: Mapping[str, str], scenes: Path = ROOT / "scenes") -> dict[str, str]:
    """Returns the environment of a shell in a folder with the scenes, where `mjrun` adds options to each command."""
    (folder / "bin").mkdir()
    (folder / "scenes").symlink_to(scenes)
    program = folder / "bin/mjrun"
    cases = " ".join(f'{name}) set -- "$@" {words};;' for name, words in smaller.items())
    path = f"{ROOT}:{models_of_others(folder / 'others')}"
    program.write_text(
        f'#!/bin/sh\ncase $1 in {cases} esac\nexport PYTHONPATH="{path}"\n'
        f'[ "$1" != view ] || exec "{sys.executable}" -m mjrun "$@" # a copy has loaded OpenGL without a display\n'
        f'exec {prepared_interpreters.program()} "$@"\n'
    )
    program.chmod(0o755)
    (folder / "bin/python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (folder / "bin/python").chmod(0o755)
    paths = {"PATH": f"{program.parent}:{os.environ['PATH']}", "MJRUN_MENAGERIE": str(folder / "others/menagerie")}
    return {**os.environ, **paths}


def models_of_others(folder: Path) -> Path:
    """Makes packages in dm_control's layout and a small menagerie, which tests do not install; returns the folder."""
    suite = folder / "dm_control/suite"
    scenes = [folder / "menagerie" / name for name in ("unitree_go2/scene.xml",)]
    for each in (suite, *(scene.parent for scene in scenes)):
        each.mkdir(parents=True)
    (folder / "dm_control/__init__.py").touch()
    (suite / "humanoid.py").write_text("@SUITE.add()\ndef walk(): ...\n")
    (suite / "humanoid.xml").write_text('<mujoco><worldbody><camera name="side"/></worldbody></mujoco>')
    for scene in scenes:
        body = '<body><joint name="hip"/><geom size=".1"/></body>'
        moved = '<actuator><motor joint="hip"/></actuator><keyframe><key name="home"/></keyframe>'
        scene.write_text(f"<mujoco><worldbody>{body}</worldbody>{moved}</mujoco>")
    return folder
