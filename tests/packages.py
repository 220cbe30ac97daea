"""Environments with other packages: some that are hidden, or that have another version."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

METADATA = "Metadata-Version: 2.1\nName: {}\nVersion: {}\n{}\n\nRequires-Dist: in a description\n"
HIDING = """
import sys

HIDDEN = {}

class Hiding:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in HIDDEN:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hiding)
"""


def hidden(folder: Path, *modules: str) -> Path:
    """Makes these modules appear not installed where the folder is on the path; returns the folder."""
    (folder / "sitecustomize.py").write_text(HIDING.replace("{}", repr(set(modules))))
    return folder


def run_without(arguments: list[str]) -> int:
    """Runs mjrun in a forked process without the modules that are hidden in the folder PYTHONPATH."""
    hiding: dict[str, Any] = {}
    exec(Path(os.environ["PYTHONPATH"], "sitecustomize.py").read_text(), hiding)
    assert not hiding["HIDDEN"] & {*sys.modules}, "imported before they were hidden"
    return import_module("mjrun.cli.main").run(arguments)


def planted(folder: Path, name: str, version: str, requires: str = "", code: str | None = None) -> Path:
    """Puts a package into the folder that precedes the installed ones; returns the folder."""
    headers = f"Requires-Dist: {requires}" if requires else "Summary: nothing"
    (folder / f"{name}-{version}.dist-info").mkdir(parents=True)
    (folder / f"{name}-{version}.dist-info" / "METADATA").write_text(METADATA.format(name, version, headers))
    if code is not None:
        (folder / f"{name}.py").write_text(code)
    return folder


def run_with(packages: Path, *arguments: str, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Runs Python with the packages of a folder before all others."""
    environment = {**os.environ, "PYTHONPATH": str(packages)}
    return subprocess.run([sys.executable, *arguments], env=environment, cwd=cwd, capture_output=True, text=True)
