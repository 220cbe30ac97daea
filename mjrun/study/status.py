"""The progress of a study, as its folder shows it while processes on any machines work on it."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean, counted
from mjrun.formats.folders import Folder, folder_at
from mjrun.options.sweep import MANIFEST, MOST_POINTS
from mjrun.platform import system
from mjrun.plotting.html_page import Page, PageFactTable
from mjrun.plotting.page_writer import MAKER, PageWriter
from mjrun.study.chunk_files import ChunkFiles
from mjrun.study.columnar_results import ResultColumns
from mjrun.study.leases import EXPIRY, SUFFIX, Lease, LeaseContent

REFRESH = 5  # [s] between two versions of a page
HINT = "a study is a folder that mjrun sweep has written"


@dataclass(frozen=True)
class RunningRange:
    """Points that a process has leased.

    Attributes:
      first, last: the range, including its last point.
      left: number of points in it without a result.
      host: machine of the process; empty if unknown.
      process: number of the process on its machine; empty if unknown.
      silent: time since the lease was renewed, by the clock of this machine [s].
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
            return f"{seconds / size:.2g} {unit}" if seconds / size < 100 else f"{seconds / size:.0f} {unit}"
    return f"{seconds * 1e6:.2g} us" if seconds else "0 s"


def study_status(folder: str | Path) -> StudyStatus:
    """Reads the progress of a study from its folder, whose model and other inputs are not read.

    Raises:
      FileError: the folder is not that of a study, or cannot be read.
    """
    place = folder_at(folder, delays=())
    points, metrics, study = study_facts(place)
    files, known = ChunkFiles(place, metrics, study, points), ResultColumns(range(points), len(metrics))
    leases = [*_leases(files)]  # before the parts: a process publishes its results before it releases a lease
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
      FileError: the manifest cannot be read, or is of an older version of mjrun.
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


def _leases(files: ChunkFiles) -> "Iterator[tuple[Lease, LeaseContent, float]]":
    """Yields the leases of processes that have not ended, as far as this machine knows, and the age of each [s]."""
    for name in files.ranges.names(SUFFIX):
        try:
            lease = Lease.of(name)
            content, silent = LeaseContent.read(files.folder, name), files.folder.age(name)
        except OSError:  # its owner has released it
            continue
        if lease is None or lease.study != files.ranges.study or lease.is_request:
            continue
        if not system.has_ended(content.process):
            yield lease, content, max(0.0, silent)


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
    with PageWriter(path) as writer:
        writer.write(page)
        writer.publish()


def age(running: RunningRange) -> str:
    """Formats the time since a lease was renewed, where it is too long."""
    return f"not renewed for {span_of_time(running.silent)}" if running.silent > EXPIRY else ""
