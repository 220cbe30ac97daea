"""The state of a study's folder: its progress while processes on any machines work on it, and its unused files.

Unused files are those that the table does not use, and that no process will need.
"""

import json
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean, counted
from mjrun.formats.local_and_remote_folders import Folder, LocalFolder, folder_at
from mjrun.formats.study_reader import HINT, point_folders
from mjrun.formats.temporary_output import left_behind, remove
from mjrun.options.sweep import MANIFEST, MOST_POINTS
from mjrun.platform import system
from mjrun.plotting.html_page import MAKER, Page, PageFactTable, write_page
from mjrun.study.clusters import FOLDER as SLURM
from mjrun.study.leases import EXPIRY, SUFFIX, Lease, LeaseContent, running_leases
from mjrun.study.part_files import PartFiles
from mjrun.study.range_folders import RangeFolders
from mjrun.study.results import ResultColumns

REFRESH = 5  # [s] between two versions of a page
RUN = re.compile(r"[0-9a-f]{8}")  # name of the folder of a run in that of Slurm


@dataclass(frozen=True)
class RunningRange:
    """Points that a process has leased.

    Attributes:
      first, last: the range, including its last point.
      left: number of points in it without a result.
      host: machine of the process; empty if unknown.
      process: number of the process on its machine; empty if unknown.
      silent: time since the lease was renewed [s].
      owner: identity of the process among all of the study.
    """

    first: int
    last: int
    left: int
    host: str
    process: str
    silent: float
    owner: str


@dataclass(frozen=True)
class StudyStatus:
    """The progress of a study.

    Attributes:
      path: folder of the study.
      points: number of points.
      done: number of points with a result.
      failed: number of these whose status is not `ok`.
      statuses: number of points by status.
      is_finished: whether all points have results.
      running: ranges that processes work on.
      rate: points per second of all these processes since each began [1/s]; None if it is unknown.
      remaining: estimated time until all points have results [s]; None if it is unknown.
      lost: number of lost Slurm jobs whose points these processes have submitted again.
      schema: name of this schema.
    """

    path: str
    points: int
    done: int
    failed: int
    statuses: Mapping[str, int]
    is_finished: bool
    running: Sequence[RunningRange]
    rate: float | None
    remaining: float | None
    lost: int = 0
    schema: str = "mjrun-sweep-status-1"

    @property
    def text(self) -> str:
        """The numbers of points, the rate and the remaining time in one line."""
        counts = ", ".join(f"{count:,} {status}" for status, count in self.statuses.items() if status != "missing")
        facts = [f"{self.done:,} of {self.points:,} points{f' ({counts})' if counts else ''}"]
        if self.is_finished:
            facts.append("finished")
        elif not self.running:
            facts.append("no process works on it")
        if self.rate:
            facts.append(f"{self.rate:,.0f} points/s" if self.rate >= 100 else f"{self.rate:.3g} points/s")
        if self.remaining:
            facts.append(f"about {span_of_time(self.remaining)} left")
        if self.lost:
            facts.append(f"{counted(self.lost, 'Slurm job')} lost and submitted again")
        return f"{clean(self.path)}: {', '.join(facts)}"


def span_of_time(seconds: float) -> str:
    """Formats a time in a suitable unit: `12 ms`, `3.4 s`, `5 min`, `2.5 h`."""
    for least, unit, size in ((7200, "h", 3600), (120, "min", 60), (1, "s", 1), (1e-3, "ms", 1e-3)):
        if seconds >= least:
            return f"{_two_digits(seconds / size)} {unit}"
    return f"{_two_digits(seconds * 1e6)} us" if seconds else "0 s"


def _two_digits(number: float) -> str:
    """Formats a number with two digits, or as a whole number where it has more."""
    return f"{number:.2g}" if number < 99.5 else f"{number:.0f}"


def study_status(folder: str | Path) -> StudyStatus:
    """Reads the progress of a study from its folder, whose model and other inputs are not read.

    Raises:
      FileError: the folder is not that of a study, or cannot be read.
    """
    place = folder_at(folder, delays=())
    points, metrics, study = study_facts(place)
    files, known = PartFiles(place, metrics, study, points), ResultColumns(range(points), len(metrics))
    # Leases before parts: a process publishes its results before it releases a lease.
    leases = [*running_leases(files.ranges)]
    files.update(known, 0, points - 1)
    running, rates, lost = list[RunningRange](), dict[str, float](), dict[str, int]()
    for lease, content, silent in leases:
        left = int(known.is_missing[lease.first : lease.last + 1].sum())
        pid = content.process.split()[1:2]
        running.append(
            RunningRange(lease.first, lease.last, left, clean(content.host), "".join(pid), silent, lease.owner)
        )
        lost[lease.owner] = content.losses
        rates[lease.owner] = content.points / content.seconds if content.seconds > 0 else 0.0
    missing, rate = int(known.is_missing.sum()), sum(rates.values()) or None
    return StudyStatus(
        path=place.path(),
        points=points,
        done=points - missing,
        failed=int((known.status != 0).sum()) - missing,
        statuses=known.counts,
        is_finished=not missing,
        running=sorted(running, key=lambda each: each.first),
        rate=rate,
        remaining=missing / rate if rate else None,
        lost=sum(lost.values()),
    )


def study_facts(folder: Folder) -> tuple[int, list[str], str]:
    """Returns the number of points of a study, its metrics and its hash.

    Raises:
      FileError: the manifest cannot be read, or is not that of a study.
    """
    path = folder.path(MANIFEST)
    try:
        with folder.open(MANIFEST) as stream:
            facts = json.loads(stream.read())
    except FileNotFoundError:
        raise FileError(folder.path(), f"has no {MANIFEST}", HINT) from None
    except ValueError:
        raise FileError(path, "is not the manifest of a study", HINT) from None
    match facts:
        case {"points": int(points), "metrics": dict(metrics), "digest": str(study)} if 0 < points <= MOST_POINTS:
            return points, [*map(str, metrics)], study
        case _:
            raise FileError(path, "does not describe a running study; continue the study with this version of mjrun")


def write_status_page(path: str, status: StudyStatus) -> None:
    """Writes a page of the progress, which loads itself again while processes work on the study.

    Raises:
      BadValueError: its name does not end with .html.
      FileError: it cannot be written.
    """
    rows = [
        (f"{each.first:,} … {each.last:,}", f"{each.left:,}", each.host, each.process, age(each))
        for each in status.running
    ]
    counts = [(name, f"{count:,}", f"{100 * count / status.points:.1f} %") for name, count in status.statuses.items()]
    tables = [PageFactTable("Points", "Points by status", ("Status", "Points", "Share"), counts, (1, 2))]
    if rows:
        heads = ("Points", "Left", "Machine", "Process", "Renewed")
        tables.append(PageFactTable("Running", "Ranges of points that processes work on", heads, rows, (1,)))
    page = Page(
        title=f"{clean(Path(status.path).name)}: progress",
        maker=MAKER,
        verdict=(not status.failed, f"{100 * status.done / status.points:.1f} % done"),
        facts=tables,
        notes=[status.text, time.strftime("%Y-%m-%d %H:%M:%S")],
        refresh=REFRESH if status.running and not status.is_finished else None,
    )
    write_page(path, page)


def age(running: RunningRange) -> str:
    """Formats the time since a lease was renewed, where it is too long."""
    return f"not renewed for {span_of_time(running.silent)}" if running.silent > EXPIRY else ""


@dataclass(frozen=True)
class UnusedFileGroup:
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
    kinds: Sequence[UnusedFileGroup]
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
    files, known = PartFiles(place, metrics, study, points), ResultColumns(range(points), len(metrics))
    leases = _ended_leases(files.ranges)
    files.update(known, 0, points - 1)
    missing = int(known.is_missing.sum())
    others, damaged = files.unused()
    names = {
        "outdated part": [] if missing else others,
        "damaged part": damaged,
        "abandoned lease": leases,
    }
    counts = [
        UnusedFileGroup(noun, len(some), sum(map(files.folder.size, some))) for noun, some in names.items() if some
    ]
    for name in () if dry_run else [name for some in names.values() for name in some]:
        files.folder.remove(name)
    if isinstance(place, LocalFolder):
        inner = [*(Path(folder.path()) for folder in files.ranges.folders()), *point_folders(place.path()).values()]
        counts += _remove_temporary(Path(place.path()), inner, dry_run=dry_run)
        if not dry_run:
            files.ranges.remove_empty()
    return UnusedFiles(place.path(), not dry_run, counts, missing if others else 0)


def _remove_temporary(folder: Path, inner: Sequence[Path], *, dry_run: bool) -> list[UnusedFileGroup]:
    """Removes temporary files, and the logs of Slurm jobs.

    Raises:
      FileError: one cannot be removed.
    """
    runs = [path for path in (folder / SLURM).glob("*") if RUN.fullmatch(path.name) and path.is_dir()]
    with ExitStack() as stack:
        found = [path for place in (folder, *inner) for path in stack.enter_context(left_behind(place))]
        kinds = {"temporary file": found, "log folder": runs}
        counts = [UnusedFileGroup(noun, len(paths), sum(map(_size, paths))) for noun, paths in kinds.items() if paths]
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
    ahead = folder.seconds_ahead()
    ended = list[str]()
    for name in names:
        with suppress(OSError):  # its owner has released it
            content, silent = LeaseContent.read(folder, name), folder.age(name) - ahead
            if silent <= EXPIRY and not system.has_ended(content.process):
                host = clean(content.host) or "another machine"
                reason = f"belongs to a process on {host} that works on the study"
                raise FileError(folder.path(name), reason, "nothing is removed; try again when it has ended")
            ended.append(name)
    return ended


def _size(path: Path) -> int:
    """Returns the size of a file, or of all files in a folder [bytes]."""
    return sum(each.lstat().st_size for each in [path, *path.rglob("*")] if not each.is_dir())
