"""Files in the folder of a study that its table does not use, and that no process will need."""

import re
import secrets
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean
from mjrun.formats.folders import LocalFolder, folder_at
from mjrun.formats.temporary_output import left_behind, remove
from mjrun.platform import system
from mjrun.study.chunk_files import ChunkFiles
from mjrun.study.columnar_results import ResultColumns
from mjrun.study.leases import EXPIRY, SUFFIX, Lease, LeaseContent
from mjrun.study.range_folders import RangeFolders
from mjrun.study.slurm import FOLDER as SLURM
from mjrun.study.status import study_facts

RUN = re.compile(r"[0-9a-f]{8}")  # name of the folder of a run in that of Slurm


@dataclass(frozen=True)
class UnusedKind:
    """Unused files of one kind.

    Attributes:
      noun: name of one of them.
      files: their number.
      size: their size [bytes].
    """

    noun: str
    files: int
    size: int


@dataclass(frozen=True)
class UnusedFiles:
    """Unused files of a study.

    Attributes:
      path: folder of the study.
      is_removed: whether they have been removed.
      kinds: kinds of files of which any exist.
      missing: number of points without a result; parts of other versions stay until none is left, for they may have it.
    """

    path: str
    is_removed: bool
    kinds: Sequence[UnusedKind]
    missing: int


def remove_unused(folder: str | Path, *, dry_run: bool = False) -> UnusedFiles:
    """Removes the parts of other versions of a study, damaged parts, leases of ended processes, temporary files that
    ended processes have left, and logs of Slurm jobs. Files that mjrun has not written stay.

    Args:
      dry_run: only counts them.

    Raises:
      FileError: the folder is not that of a study, a process works on it, or a file cannot be removed.
    """
    place = folder_at(folder)
    points, metrics, study = study_facts(place)
    files, known = ChunkFiles(place, metrics, study, points), ResultColumns(range(points), len(metrics))
    leases = _ended_leases(files.ranges)
    files.update(known, 0, points - 1)
    missing = int(known.is_missing.sum())
    others, damaged = files.unused()
    names = {
        "outdated part": [] if missing else others,
        "damaged part": damaged,
        "abandoned lease": leases,
    }
    counts = [UnusedKind(noun, len(some), sum(map(files.folder.size, some))) for noun, some in names.items() if some]
    for name in () if dry_run else [name for some in names.values() for name in some]:
        files.folder.remove(name)
    if isinstance(place, LocalFolder):
        parts = [Path(folder.path()) for folder in files.ranges.folders()]
        counts += _remove_temporary(Path(place.path()), parts, dry_run=dry_run)
        if not dry_run:
            files.ranges.remove_empty()
    return UnusedFiles(place.path(), not dry_run, counts, missing if others else 0)


def _remove_temporary(folder: Path, parts: Sequence[Path], *, dry_run: bool) -> list[UnusedKind]:
    """Removes temporary files, and the logs of Slurm jobs.

    Raises:
      FileError: one cannot be removed.
    """
    runs = [path for path in (folder / SLURM).glob("*") if RUN.fullmatch(path.name) and path.is_dir()]
    with ExitStack() as stack:
        found = [path for place in (folder, *parts) for path in stack.enter_context(left_behind(place))]
        kinds = {"temporary file": found, "log folder": runs}
        counts = [UnusedKind(noun, len(paths), sum(map(_size, paths))) for noun, paths in kinds.items() if paths]
        for path in () if dry_run else [path for paths in kinds.values() for path in paths]:
            remove(path)
            if path.exists():
                raise FileError(path, "cannot be removed")
    if runs and not dry_run:
        with suppress(OSError):
            (folder / SLURM).rmdir()
    return counts


def _ended_leases(ranges: RangeFolders) -> list[str]:
    """Returns the leases of ended processes, of whatever version of the study.

    Raises:
      FileError: a process works on the study.
    """
    folder, names = ranges.folder, [name for name in ranges.names(SUFFIX) if Lease.of(name)]
    if not names:
        return []
    probe = f".{secrets.token_hex(8)}.probe"
    folder.create_file(probe, b"")  # the clock that has written the leases need not be that of this machine
    now = folder.age(probe)
    folder.remove(probe)
    ended = list[str]()
    for name in names:
        with suppress(OSError):  # its owner has released it
            content, silent = LeaseContent.read(folder, name), folder.age(name) - now
            if silent <= EXPIRY and not system.has_ended(content.process):
                host = clean(content.host) or "another machine"
                reason = f"belongs to a process on {host} that works on the study"
                raise FileError(folder.path(name), reason, "nothing is removed; try again when it has ended")
            ended.append(name)
    return ended


def _size(path: Path) -> int:
    """Returns the size of a file, or of all files in a folder [bytes]."""
    return sum(each.lstat().st_size for each in [path, *path.rglob("*")] if not each.is_dir())
