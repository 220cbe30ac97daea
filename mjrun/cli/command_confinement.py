"""Confinement of the process of a command line with `--untrusted` to the files that the line names."""

import math
import os
import signal
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager, suppress
from dataclasses import field
from pathlib import Path
from typing import cast

import click

from mjrun import shared_status
from mjrun.child_process import limit_this_process
from mjrun.cli.click_command import CommandDeclaration, DeclaredCommand, DeclaredOption, ModelArgument
from mjrun.confinement.confinement import Confinement
from mjrun.confinement.self_confinement import confine, with_temporary
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, FileError, OutOfMemoryError, UnknownNameError, UsageError, clean, option
from mjrun.formats.input_file import exists, is_file, is_folder
from mjrun.formats.temporary_output import ParentFolders
from mjrun.options.bench import SUMMARY
from mjrun.options.every_command import DEFAULT_LIMITS, FILE, MEMORY, TIME, ConfinementOptions
from mjrun.options.kinds import AnyKind, OneOrMoreKind, PathKind
from mjrun.options.sweep import MANIFEST
from mjrun.platform import system
from mjrun.platform.cores import available_cores
from mjrun.shared_status import ConfinementPromise
from mjrun.suffixes import REFERRING, is_hdf5, split_episode

MIB = 2**20
LEAST = {MEMORY: 256}  # the thread that loads models takes half of it
MOST = 10**9  # of any limit; the system has no timers and sizes of files beyond
SCENE = "scene"  # the collection in mjrun; the packages of others run code


@dataclass
class _Paths:
    """The paths that a command line names."""

    roots: dict[str, None] = field(default_factory=dict[str, None])
    files: dict[str, None] = field(default_factory=dict[str, None])
    written: dict[str, str] = field(default_factory=dict[str, str])  # resolved path → path as named


@contextmanager
def confined(context: click.Context, options: ConfinementOptions) -> Generator[Confinement, None, None]:
    """Confines this process permanently to the files on its command line; its parent removes its temporary files.

    Raises:
      UsageError: this system confines nothing, no parent process monitors this one, or a limit is invalid.
      FileError: an output folder cannot be created.
    """
    from mjrun.cli.simulation_command import import_mujoco

    if not system.CAN_FORK:
        reason = "cannot confine anything on this system; run mjrun on Linux, or in a container"
        raise UsageError(f"{option('untrusted')} {reason}")
    if not shared_status.is_monitored():
        raise UsageError(f"{option('untrusted')} works only for mjrun as a command, which runs in a separate process")
    assert isinstance(context.command, DeclaredCommand)
    command = context.command.declaration
    limits = _limits(options, command)
    paths = _named_paths(context)
    # The confined process cannot create them. They are never released here: its parent removes the empty ones.
    for folder, name in paths.written.items():
        if not exists(folder):
            ParentFolders(Path(name), Path(folder))
    wanted = with_temporary(_confinement(paths))
    shared_status.make_promise(ConfinementPromise(wanted.temporary, [*wanted.written], limits[TIME]))
    made = confine(wanted, serves=command.is_endless)
    import_mujoco()  # not counted by the limit of memory
    limit_this_process(
        memory=limits[MEMORY] * MIB,
        cpu=limits[TIME] * available_cores(),
        file_size=limits[FILE] * MIB,
        core=0,
        hard=True,
    )
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores it and would report a failed write
    try:
        yield made
    except (MemoryError, OutOfMemoryError) as error:
        failure = error if isinstance(error, OutOfMemoryError) else OutOfMemoryError(str(error))
        failure.add_note(f"{option('untrusted')} allows {limits[MEMORY]:g} MiB; {option('limit')} memory=… allows more")
        raise failure from None


def description(limits: Confinement) -> str:
    """Formats a sentence about the confinement of this process."""
    network = f"the network by {limits.network}" if limits.network else "the network by nothing: this system cannot"
    folders = ", ".join(clean(root) for root in limits.roots)
    models = f"models are read from {folders}" if folders else "no model is read"
    return f"untrusted: files are confined by {limits.by}, {network}; {models}"


def _limits(options: ConfinementOptions, command: CommandDeclaration) -> dict[str, float]:
    limits = {**DEFAULT_LIMITS, **({TIME: math.inf} if command.is_endless else {})}
    for name, values in options.limit.items():
        if name not in DEFAULT_LIMITS:
            raise UnknownNameError("limit", name, [*DEFAULT_LIMITS])
        if len(values) != 1 or values[0] <= 0 or values[0] < LEAST.get(name, 0):
            expected = f"at least {LEAST[name]}" if name in LEAST else "a number above 0"
            raise BadValueError(f"{option('limit')} {name}", ",".join(f"{v:g}" for v in values), expected)
        if values[0] > MOST:
            raise BadValueError(f"{option('limit')} {name}", f"{values[0]:g}", f"at most {MOST:,}")
        limits[name] = values[0]
    return limits


def confinement_of(context: click.Context) -> Confinement:
    """Returns the files that the process of a command line may read and write: those that the line names.

    Raises:
      FileError: the folder to read from does not exist.
    """
    return _confinement(_named_paths(context))


def _confinement(paths: _Paths) -> Confinement:
    return Confinement(tuple(paths.roots), tuple(paths.files), tuple(paths.written))


def _named_paths(context: click.Context) -> _Paths:
    paths = _Paths()
    for param in context.command.params:
        name, values = param.name or "", [*_texts(context.params.get(param.name or ""))]
        if isinstance(param, click.Argument):
            for text in values:
                _add_argument(paths, param, text)
        elif name == "save_key":
            _add_outputs(paths, [text.rpartition(".xml:")[0] or text for text in values])
        elif name == "summary" and values == [SUMMARY]:  # not its folder, which has other files of a CI system
            file = os.path.expandvars(SUMMARY)
            paths.written |= {_real(file): file} if Path(file).exists() else {}
        elif isinstance(param, DeclaredOption) and (path := _path_kind(param.declared.kind)) and path.written:
            if not values and param.declared.default not in (None, "-"):
                paths.written[_real(".")] = "."  # the default folder
            elif name == "output" and param.declared.kind.metavar == "DIR":  # of a folder that is continued
                paths.written |= {_real(text): text for text in values}
            else:
                _add_outputs(paths, values)
        elif isinstance(param, DeclaredOption) and name not in ConfinementOptions.__dataclass_fields__:
            for text in values:
                if _path_kind(param.declared.kind):
                    _add_file(paths, text)
                else:
                    _add_files_in(paths, text)

    if (root := context.params.get("root")) is not None:
        if not Path(root).is_dir():
            raise FileError(root, "is not a folder")
        paths.roots = {_real(root): None}
    if context.params.get("update"):  # golden tables, wherever they are
        folders = [*paths.roots, *(str(Path(file).parent) for file in paths.files)]
        paths.written |= {folder: folder for folder in folders}
    if context.params.get("fix"):  # of models, in their folders
        paths.written |= {folder: folder for folder in paths.roots}
    return paths


def _texts(value: object) -> Iterable[str]:
    """Yields all texts in the value of an option."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from _texts([*cast("Mapping[object, object]", value).values()])
    elif isinstance(value, Iterable):
        yield from (text for each in cast("Iterable[object]", value) for text in _texts(each))


def _add_argument(paths: _Paths, argument: click.Argument, text: str) -> None:
    prefix, colon, _ = text.partition(":")
    file, episode = split_episode(text)
    named = argument if isinstance(argument, ModelArgument) else None
    has_demonstration = bool(episode) or (is_hdf5(file) and named is not None and not named.tables)
    refers = prefix == SCENE or Path(text).suffix.lower() in REFERRING or has_demonstration
    model = named if named and (refers or not named.tables) else None
    if model and text == "-":
        paths.roots[_real(".")] = None
    elif model and colon and prefix == SCENE and not exists(text):
        from mjrun.platform.installation import scene_folder

        paths.roots[_real(scene_folder())] = None
    elif model and is_folder(text):
        paths.roots[_real(text)] = None
        if model.written:
            paths.written[_real(text)] = text
    else:
        _add_file(paths, text if exists(file) or "=" not in text else text.partition("=")[2])
        if named and named.tables and is_file(Path(file).parent / MANIFEST):  # a table of a study, which has others
            paths.files[_real(Path(file).parent)] = None
        if model and refers:
            paths.roots[_real(Path(file).parent)] = None
        if model and has_demonstration:
            from mjrun.model.model_files import installed_packages

            paths.files |= {_real(folder): None for folders in installed_packages().values() for folder in folders}


def _add_file(paths: _Paths, text: str) -> None:
    """Adds a file, which may be missing, with the files that formats write beside it, or a package."""
    try:
        path = Path(split_episode(text)[0])
        beside = [path.with_name(f"{path.name}.json"), path.with_name(f"{path.name}.data")] if path.is_file() else []
        paths.files |= {_real(each): None for each in (path, *beside) if text not in ("", "-")}
    except (OSError, ValueError):  # too long for a path, or with a null character
        return


def _add_files_in(paths: _Paths, text: str) -> None:
    """Adds the files that a value names: `FILE`, `@FILE`, or settings such as `trace=FILE,map=FILE`."""
    for each in (text.removeprefix("@"), *(part.rpartition("=")[2] for part in text.split(","))):
        with suppress(OSError, ValueError):
            path = Path(split_episode(each)[0])
            is_like_a_file = path.suffix[1:2].isalpha() or ("/" in each and path.parent.is_dir())
            if path.exists() or (is_like_a_file and not {",", "="} & {*each}):
                _add_file(paths, each)


def _add_outputs(paths: _Paths, texts: Iterable[str]) -> None:
    folders = [str(Path(text).parent) for text in texts if text != "-"]
    paths.written |= {_real(folder): folder for folder in folders}


def _path_kind(kind: AnyKind) -> PathKind | None:
    """Returns the kind of the paths that an option accepts; None if it accepts none."""
    while isinstance(kind, OneOrMoreKind):
        kind = kind.each
    return kind if isinstance(kind, PathKind) else None


def _real(path: str | Path) -> str:
    return os.path.realpath(path)
