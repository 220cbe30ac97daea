"""Copy the models and documents of the documentation's examples into a folder."""

import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.errors import FileError, clean
from mjrun.platform.installation import scene_folder

LEFT_OUT = ("__pycache__", "pictures", "schema", "*.md", "*.webp")  # which only a checkout contains


@command(arguments=[click.Argument(["folder"], metavar="DIR")])
def examples(console: Console, command_line: ParsedCommandLine) -> None:
    """Copy the models and documents of the documentation's examples into DIR, a new folder.

    The examples in the documentation work beside a copy called scenes.

    \b
    mjrun examples scenes
    mjrun run scenes/car.yaml
    """
    target = Path(command_line.argument("folder"))
    if os.path.lexists(target):
        raise FileError(target, "exists already; name a new folder")

    def copy_file(source: str, copy: str) -> None:  # copytree collects the OSErrors of all files in one long message
        try:
            shutil.copy2(source, copy)
        except OSError as error:
            raise FileError(target, f"cannot be written: {error.strerror}") from error

    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=target.parent, prefix=".mjrun-") as temporary:
            copy = Path(temporary) / target.name
            shutil.copytree(scene_folder(), copy, ignore=shutil.ignore_patterns(*LEFT_OUT), copy_function=copy_file)
            copy.rename(target)
    except OSError as error:
        raise FileError(target, error.strerror or str(error)) from error
    count = sum(path.is_file() for path in target.rglob("*"))
    console.result(f"{clean(str(target))}: {count} files")
