"""Environments with other packages: some that are hidden, or that have another version."""

import os
import subprocess
import sys
from pathlib import Path

METADATA = "Metadata-Version: 2.1\nName: {}\nVersion: {}\n{}\n\nRequires-Dist: in a description\n"
HIDING = """
import sys
from importlib.machinery import PathFinder

class Hiding(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in {} else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = Hiding
"""


def hidden(folder: Path, *modules: str) -> Path:
    """The folder; where it is on the path, these modules are as if they were not installed."""
    (folder / "sitecustomize.py").write_text(HIDING.replace("{}", repr(set(modules))))
    return folder


def planted(folder: Path, name: str, version: str, requires: str = "", code: str | None = None) -> Path:
    """The folder, with a package that comes before the installed ones."""
    headers = f"Requires-Dist: {requires}" if requires else "Summary: nothing"
    (folder / f"{name}-{version}.dist-info").mkdir(parents=True)
    (folder / f"{name}-{version}.dist-info" / "METADATA").write_text(METADATA.format(name, version, headers))
    if code is not None:
        (folder / f"{name}.py").write_text(code)
    return folder


def run_with(packages: Path, *arguments: str, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Runs Python where the packages in a folder come first."""
    environment = {**os.environ, "PYTHONPATH": str(packages)}
    return subprocess.run([sys.executable, *arguments], env=environment, cwd=cwd, capture_output=True, text=True)
