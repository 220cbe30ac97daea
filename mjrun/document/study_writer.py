"""From a study back to the document that makes it, without what only reads documents: pydantic and its models."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.run_writer import plain_options, simulation_document, text_of
from mjrun.document.tree import Mapped, Plain
from mjrun.errors import UsageError
from mjrun.options.policy import NONE, is_policy_file
from mjrun.options.variations import with_paths
from mjrun.study.study import Study

FILES = ("ctrl_from", "replay", "points")


def study_text(study: Study, command: str = "") -> str:
    """The study document of `study`; it holds what is not the default, and not how this machine runs it.

    Args:
      command: what made the study, for a comment.

    Raises:
      UsageError: a document cannot hold this: code, a compiled model, a folder outside of the current one.
    """
    return text_of(study_document(study), command)


def study_document(study: Study) -> Mapped:
    """The same as plain values."""
    return {**simulation_document(study.simulation), **plain_options(study)}


def portable_document(study: Study, folder: Path) -> Mapped:
    """The study as a document in `folder`, without its output.

    Raises:
      UsageError: no document can hold it.
    """
    document = study_document(replace(study, output="study"))
    if document["model"] == "-":
        raise UsageError("a model from standard input is gone when its study is read again; give a file")
    folders = Folders(Path(os.path.relpath(Path.cwd(), folder)), OutputFolder(folder), lexical=True)
    ways = {"model": folders.model, **dict.fromkeys(FILES, folders.input), "map": _map_way(folders)}
    ways |= {
        "policy": lambda text: folders.input(text) if is_policy_file(text) else text,
        "normalize": lambda text: text if text == NONE else folders.input(text),
    }
    moved = {key: _moved(value, ways[key]) if key in ways else value for key, value in document.items()}
    if isinstance(vary := moved.get("vary"), dict):
        moved["vary"] = {name: _varied(value, ways.get(name)) for name, value in vary.items()}
    return {key: value for key, value in moved.items() if key != "output"}


def _moved(value: Plain, convert: Callable[[str], str]) -> Plain:
    if isinstance(value, list):
        return [_moved(part, convert) for part in value]
    return convert(value) if isinstance(value, str) else value


def _map_way(folders: Folders) -> Callable[[str], str]:
    return lambda text: f"@{folders.input(text[1:])}" if text.startswith("@") else text


def _varied(value: Plain, convert: Callable[[str], str] | None) -> Plain:
    return with_paths(value, convert) if convert and isinstance(value, str) else value
