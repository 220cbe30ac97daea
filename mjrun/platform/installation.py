"""The installation of mjrun: the folder of its scenes, and the commands that install packages for it."""

import shlex
import sys
from functools import cache
from pathlib import Path

from mjrun.platform import system

OWN = "mjrun["  # of a requirement of mjrun with extras


def install_command(requirement: str) -> str:
    """Returns the command that installs a requirement, such as `torch` or `mjrun[plot]`, beside this mjrun."""
    environment, word = Path(sys.prefix), shlex.quote(requirement)
    is_own = requirement.startswith(OWN)
    if environment.parent.name.startswith("archive-v"):  # a temporary environment of uvx
        return f"uvx --from {word} mjrun" if is_own else f"uvx --with {word} mjrun"
    if (environment / "uv-receipt.toml").exists():
        return f"uv tool install {word}" if is_own else f"uv tool install --with {word} mjrun"
    if (environment / "pipx_metadata.json").exists():
        return f"pipx install --force {word}" if is_own else f"pipx inject mjrun {word}"
    return f"{pip('install')} {word}"


def pip(action: str) -> str:
    """Returns the beginning of a pip command that changes the environment of this process."""
    import shutil
    from importlib.machinery import PathFinder

    if PathFinder.find_spec("pip") is None:  # an environment that uv has made
        return f"uv pip {action} --python {shlex.quote(sys.prefix)}"
    program = shutil.which("pip")
    if program and Path(program).parent == Path(sys.executable).parent:
        return f"pip {action}"
    return f"{shlex.quote(sys.executable)} -m pip {action}"


def as_root(command: str) -> str:
    """Returns a shell command whose programs, joined by `&&`, run as root; containers often lack `sudo`."""
    import shutil

    if system.effective_user() == 0:
        return command
    if shutil.which("sudo"):
        return " && ".join(f"sudo {each}" for each in command.split(" && "))
    return f"as root: {command}"


@cache
def scene_folder() -> Path:
    """Returns the folder of the scenes, which is inside the package in a wheel and beside it in a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "scenes"
    return installed if installed.is_dir() else package.parent / "scenes"
