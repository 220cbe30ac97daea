"""Defaults of `mjrun check` in mjrun.toml and pyproject.toml."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from mjrun.check.check import ModelCheck
from mjrun.confinement.confinement import is_readable
from mjrun.errors import FileError, UnknownNameError, UsageError, clean, option
from mjrun.formats.input_file import is_file, opened
from mjrun.options.check import CheckOptions
from mjrun.options.option import options_of

SECTIONS = {"mjrun.toml": ("check",), "pyproject.toml": ("tool", "mjrun", "check")}  # by file, in order of precedence
LARGEST = 2**20  # bytes
TOML = (".toml",)


def configured(config: str | None) -> dict[str, object]:
    """Returns the options in a file, by name; without one, in the nearest file that has some.

    Paths and patterns are relative to the folder of the file, which contains the baseline: a configuration is not
    trusted to name other files that are written.

    Raises:
      FileError: the file cannot be read, or contains an invalid option.
    """
    paths = _nearest() if config is None else iter([Path(config)])
    for path in paths:
        section = _section(path)
        if section is not None:
            return _options(path, section)
    if config is not None:
        raise FileError(config, f"has no section [{'.'.join(SECTIONS['pyproject.toml'])}] or [check]")
    return {}


def _nearest() -> Iterator[Path]:
    """Yields the files that may contain options, from the working folder upwards."""
    here = Path.cwd()
    for folder in (here, *here.parents):
        yield from (folder / name for name in SECTIONS if is_readable(folder / name) and is_file(folder / name))


def _section(path: Path) -> Mapping[str, object] | None:
    """Returns the section with options of check; None if the file has none."""
    import tomllib  # slow to import, and most folders have no such file

    with opened(path, "configuration", TOML) as file:
        text = file.read(LARGEST)
    try:
        document: object = tomllib.loads(text.decode())
    except (ValueError, RecursionError) as error:
        raise FileError(path, f"is not valid TOML: {error}") from error

    for name in SECTIONS.get(path.name, ("check",)):
        document = cast("dict[str, object]", document).get(name) if isinstance(document, dict) else None
    return cast("dict[str, object]", document) if isinstance(document, dict) else None


def _options(path: Path, section: Mapping[str, object]) -> dict[str, object]:
    """Returns the options in a section, by name, with paths relative to the working folder."""
    declared = {each.name: each.attribute for each in options_of(CheckOptions) if each.name != "changed_since"}
    folder = os.path.relpath(path.parent)
    values: dict[str, Any] = {}
    try:
        for key, value in section.items():
            name = key.replace("-", "_")
            if name == "changed_since":
                raise UsageError(f"{key} runs git, which runs programs that a repository names: give {option(name)}")
            if name not in declared:
                raise UnknownNameError("option", key, [each.replace("_", "-") for each in declared])
            values[name] = _relative(name, value, "" if folder == os.curdir else folder)
        if isinstance(baseline := values.get("baseline"), str):  # which may be replaced
            _require_inside(baseline, path)
        checked = ModelCheck((), **{declared[name]: value for name, value in values.items()})
    except UsageError as error:
        message, _, hint = str(error).partition("\n")
        raise FileError(path, message, hint) from error
    return {name: getattr(checked, declared[name]) for name in values}


def _require_inside(baseline: str, config: Path) -> None:
    """Raises UsageError for a baseline that is outside the folder of the configuration that names it."""
    try:
        is_inside = config.parent.resolve() in Path(baseline).resolve().parents
    except (OSError, RuntimeError):  # links in a circle
        is_inside = False
    if not is_inside:
        raise UsageError(f"{clean(baseline)} is outside the folder of {config.name}\n{option('baseline')} may name it")


def _relative(name: str, value: object, folder: str) -> object:
    """Returns the value of an option with its paths relative to the working folder."""
    if name == "baseline" and isinstance(value, str):
        return str(Path(folder, value))
    if name == "ignore_in" and isinstance(value, dict):
        patterns = cast("dict[str, object]", value)
        return {Path(folder, pattern).as_posix(): _joined(codes) for pattern, codes in patterns.items()}
    return value


def _joined(codes: object) -> object:
    """Returns a list of codes as one text."""
    return ",".join(map(str, cast("list[object]", codes))) if isinstance(codes, list) else codes
