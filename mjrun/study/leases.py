"""Leases of ranges of points, by which processes on any machines share the work on one study.

A lease is a small file beside the parts of its points, named `STUDY-FIRST-LAST-OWNER.lease`. A process creates one, and
then lists the others of these points: of two processes whose ranges overlap, at least one sees both leases, and gives
up its own. It renews its leases by changing their content. Another process that sees the same content for `EXPIRY`
seconds on its clock takes the points; it does not wait for a process of the same machine that has ended. No clocks are
compared, and the file system needs no locks. A wrong guess costs time only: a point has the same result, whichever
process simulates it.

A process that finds all points leased asks for some by a lease of no points; others then give back those that they have
not begun, so that points that take much longer than expected do not wait for one process.
"""

import json
import random
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Self

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean
from mjrun.formats.local_and_remote_folders import Folder, LocalFolder
from mjrun.platform import system
from mjrun.study.part_files import PartFiles
from mjrun.study.range_folders import NAME, PointRange, RangeFolders
from mjrun.study.results import ResultColumns

SUFFIX = ".lease"
BEAT = 5.0  # [s] between two renewals
EXPIRY = 60.0  # [s] without a renewal, after which a lease is void: file systems of networks show changes late
POLL = 1.0  # [s] until a process that has found all points leased looks again
TRIES = 8  # attempts to lease a range while other processes lease overlapping ones
PAUSE = 0.05  # longest time between two such attempts [s]
MOST = 2**12  # bytes of a lease that are read
DEPTH = 4  # chunks in a range for each chunk in flight: they take some ten seconds
NONE = (10**18 - 1, 0)  # the range of no points
SHARES = 4  # ranges for each process, of the points that are free: ranges become smaller towards the end


@dataclass(frozen=True)
class Lease(PointRange):
    """A lease of a range of points, by the name of its file."""

    name: str
    owner: str

    @classmethod
    def of(cls, name: str) -> "Lease | None":
        """Returns the lease that a file represents; None if it is not a lease."""
        match = NAME.fullmatch(name.rpartition("/")[2])
        is_lease = match and match[4] and name.endswith(SUFFIX)
        return cls(match[1], int(match[2]), int(match[3]), name, match[4]) if match and is_lease else None

    @property
    def is_request(self) -> bool:
        """True for a lease of no points, by which a process asks for some."""
        return self.first > self.last


@dataclass(frozen=True)
class LeaseContent:
    """The content of a lease.

    Attributes:
      host: name of the owner's machine.
      process: identity of the owner's process; see `system.process_identity`.
      beat: number of renewals.
      points: number of points whose results the owner has published.
      seconds: wall time since the owner began [s].
      losses: number of lost Slurm jobs whose points the owner has submitted again.
    """

    host: str = ""
    process: str = ""
    beat: int = 0
    points: int = 0
    seconds: float = 0.0
    losses: int = 0

    @classmethod
    def read(cls, folder: Folder, name: str) -> "LeaseContent":
        """Reads a lease; one that is being written, or is not a lease, is empty.

        Raises:
          FileNotFoundError: its owner has released it.
        """
        try:
            with folder.open(name) as stream:
                values = json.loads(stream.read(MOST))
            host, process, losses = str(values["host"]), str(values["process"]), int(values.get("losses", 0))
            return cls(host, process, int(values["beat"]), int(values["points"]), float(values["seconds"]), losses)
        except FileNotFoundError:
            raise
        except (FileError, OSError, ValueError, TypeError, KeyError, OverflowError):
            return cls()


def running_leases(ranges: RangeFolders) -> Iterator[tuple[Lease, LeaseContent, float]]:
    """Yields the leases of processes that have not ended, as far as this machine knows, and the age of each [s]."""
    folder = ranges.folder
    is_corrected, ahead = not isinstance(folder, LocalFolder), 0.0  # in a store, that would leave a trace
    for name in ranges.names(SUFFIX):
        try:
            lease = Lease.of(name)
            content, silent = LeaseContent.read(folder, name), folder.age(name)
        except OSError:  # its owner has released it
            continue
        if lease is None or lease.study != ranges.study or lease.is_request:
            continue
        if not system.has_ended(content.process):
            if silent > EXPIRY and not is_corrected:
                is_corrected = True
                with suppress(FileError):  # of a folder that can only be read
                    ahead = folder.seconds_ahead()
            yield lease, content, max(0.0, silent - ahead)


@dataclass(frozen=True)
class _Seen:
    """A content of a lease of another process, since when it is unchanged, and when it was read last [s]."""

    content: LeaseContent
    since: float
    read: float


class Leases:
    """The leases of one study, and those of this process among them; a context manager that releases the latter.

    Args:
      ranges: folders of the leases, of which the outermost exists.

    Attributes:
      points, losses: as in the content of its leases.
    """

    def __init__(self, ranges: RangeFolders) -> None:
        self._ranges, self._folder, self._owner = ranges, ranges.folder, secrets.token_hex(4)
        self._own = dict[Lease, int]()  # the points of each that are not published
        self._seen = dict[Lease, _Seen]()  # of others
        self._host, self._process = system.machine_name(), system.process_identity()
        self._start, self._beat, self.points, self.losses = time.monotonic(), 0, 0, 0
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._renew, name="leases", daemon=True)

    def claim(self, first: int, last: int, points: int) -> bool:
        """Leases a range unless another process holds some of it.

        Args:
          points: number of points in the range to be published.

        Raises:
          FileError: the lease cannot be written.
        """
        lease = self._create(first, last, points)
        if self._thread.ident is None:
            self._thread.start()
        if self.others(lambda other: other.overlaps(first, last)):
            self._release(lease)
            return False
        return True

    def _create(self, first: int, last: int, points: int) -> Lease:
        name = self._ranges.new_name(first, last, f"{self._owner}{SUFFIX}")
        lease = Lease(self._ranges.study, first, last, name, self._owner)
        with self._lock:
            self._folder.create_file(name, self._content())
            self._own[lease] = points
        return lease

    def ask(self, *, is_idle: bool) -> None:
        """Asks other processes for points, unless another one asks already, or stops to."""
        own = [lease for lease in self._own if lease.is_request]
        if is_idle and not own and not self.requests():
            with suppress(FileError):
                self.claim(*NONE, 1)
        elif not is_idle:
            for lease in own:
                self._release(lease)

    def name_of(self, point: int) -> str:
        """Returns the name of the lease of a point that this process holds."""
        return next(lease.name for lease in self._own if lease.overlaps(point, point))

    def give_back(self, points: np.ndarray) -> None:
        """Releases points that this process has not begun, the last ones of their ranges."""
        for lease in [*self._own]:
            own = points[(points >= lease.first) & (points <= lease.last)]
            left = self._own[lease] - len(own)
            if len(own) and left > 0:
                self._create(lease.first, int(own.min()) - 1, left)
            if len(own):
                self._release(lease)

    def requests(self) -> list[Lease]:
        """Returns the valid leases by which other processes ask for points."""
        return self.others(lambda points: points.first > points.last)

    def others(self, is_relevant: Callable[[PointRange], bool]) -> list[Lease]:
        """Returns the leases of relevant points that other processes hold and that are still valid.

        Folders and files of other points are not read: if each of a thousand processes read the leases of all, the
        file system would do little else.
        """

        def is_wanted(points: PointRange) -> bool:
            return points.study == self._ranges.study and is_relevant(points)

        leases = {lease for name in self._ranges.names(SUFFIX, is_wanted) if (lease := Lease.of(name))}
        others = [lease for lease in leases if lease.owner != self._owner and is_wanted(lease)]
        now = time.monotonic()
        self._seen = {lease: seen for lease, seen in self._seen.items() if lease in leases or not is_relevant(lease)}
        return [lease for lease in others if self._is_valid(lease, now)]

    def hosts(self) -> list[str]:
        """Returns the machines of the leases of other processes."""
        return sorted({clean(seen.content.host) or "another machine" for seen in self._seen.values()})

    def publish(self, points: Sequence[int] | np.ndarray, *, is_own: bool = True) -> None:
        """Releases the ranges in which all results are published, now that those of `points` are.

        Args:
          is_own: whether this process has simulated them.
        """
        points = np.asarray(points, np.int64)
        self.points += len(points) * is_own
        for lease in [*self._own]:
            self._own[lease] -= int(((points >= lease.first) & (points <= lease.last)).sum())
            if self._own[lease] <= 0:
                self._release(lease)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        with self._lock, suppress(FileError):  # where one cannot be removed, others cannot, either: they will expire
            for lease in [*self._own]:
                self._folder.remove(lease.name)

    def _is_valid(self, lease: Lease, now: float) -> bool:
        """Returns whether a process still works on a range; removes the lease of one that does not."""
        before = self._seen.get(lease)
        if before and now - before.read < BEAT:
            return True
        try:
            content = LeaseContent.read(self._folder, lease.name)
        except FileNotFoundError:
            return False
        since = before.since if before and content == before.content else now
        self._seen[lease] = _Seen(content, since, now)
        if now - since < EXPIRY and not system.has_ended(content.process):
            return True
        with suppress(FileError):
            self._folder.remove(lease.name)
        return False

    def _release(self, lease: Lease) -> None:
        with self._lock:
            self._own.pop(lease, None)
            with suppress(FileError):  # it will expire
                self._folder.remove(lease.name)

    def _renew(self) -> None:
        while not self._closed.wait(BEAT):
            self.renew()

    def renew(self) -> None:
        """Renews the leases of this process, which a thread does every `BEAT` seconds."""
        with self._lock:
            self._beat += 1
            content = self._content()
            for lease in self._own:
                # Another process may have taken it, or the disk may be full.
                with suppress(FileError):
                    self._folder.rewrite(lease.name, content)

    def _content(self) -> bytes:
        seconds = round(time.monotonic() - self._start, 3)
        values = {"host": self._host, "process": self._process, "beat": self._beat, "points": self.points}
        return f"{json.dumps({**values, 'seconds': seconds, 'losses': self.losses})}\n".encode()


class PointLeaser:
    """A leaser of missing points, which takes one range after the other for this process.

    Args:
      points: numbers of the points, ascending.
      known: results, to which those of other processes are added.
      ahead: chunks in flight.

    Attributes:
      elsewhere: number of points that other processes have simulated.
      is_waiting: whether other processes have leased all points that are left.
    """

    def __init__(
        self,
        points: Sequence[int] | np.ndarray,
        known: ResultColumns,
        files: PartFiles,
        leases: Leases,
        ahead: int,
    ) -> None:
        self.points, self._known, self._files, self._leases = np.asarray(points, np.int64), known, files, leases
        self._most_chunks = DEPTH * ahead
        self._before = self._attempts()
        self._is_open = np.ones(len(self.points), bool)  # neither known nor leased by this process
        self._leased = np.array([], np.intp)  # leased places that are not in a chunk yet
        self._next = 0  # place after the last range
        self._owners = 1  # processes that share the points
        self._pause_end = self._asked = 0.0
        self._is_giving = False
        self.elsewhere, self.is_waiting = 0, False

    @property
    def left(self) -> int:
        """The number of points that are not in a chunk yet."""
        return int(self._is_open.sum()) + len(self._leased)

    @property
    def share(self) -> int:
        """The number of points that are not in a chunk yet, divided by the number of processes that share them."""
        return -(-self.left // self._owners)

    def take(self, size: Callable[[np.ndarray], int]) -> np.ndarray:
        """Returns the points of the next chunk; none while other processes have leased all that are left.

        Args:
          size: returns the number of points in a chunk from the places of the next ones.

        Raises:
          FileError: a lease cannot be written.
        """
        if not len(self._leased) and time.monotonic() >= self._pause_end:
            self._lease(size)
        self.is_waiting = not self._is_giving and not len(self._leased) and bool(self._is_open.any())
        self._leases.ask(is_idle=self.is_waiting)
        part = self._leased[: size(self._leased)] if len(self._leased) else self._leased
        self._leased = self._leased[len(part) :]
        return self.points[part]

    @property
    def is_wanted(self) -> bool:
        """True if another process has found all points leased; looks every `BEAT` seconds."""
        now = time.monotonic()
        if now < self._asked + BEAT:
            return False
        self._asked = now
        return bool(self._leases.requests())

    def give_back(self, points: Sequence[int]) -> None:
        """Releases leased points: those that are not in a chunk, and `points`, whose chunks have not begun."""
        places = np.concatenate([self._leased, np.searchsorted(self.points, points)])
        self._leased = self._leased[:0]
        if len(places):
            self._is_open[places] = True
            self._leases.give_back(self.points[places])
            self._pause_end, self._is_giving = time.monotonic() + 2 * POLL, True  # the others have the first choice

    def _lease(self, size: Callable[[np.ndarray], int]) -> None:
        """Leases a range of points, and reads the results in it that other processes have published."""
        self._is_giving = False
        windows = self._windows()
        for number, window in enumerate([*windows, *windows[:1]]):
            if self._lease_in(window, len(windows), size, shares=number > 0 or len(windows) == 1):
                return
        self._pause_end = time.monotonic() + POLL

    def _windows(self) -> list[PointRange]:
        """Returns ranges that contain all open points, in which leases are looked for one after the other.

        The first contains the next place; the others are in random order, so that processes spread.
        """
        size = self._files.ranges.window
        numbers = self.points[self._is_open] // size  # ascending
        numbers = numbers[np.diff(numbers, prepend=-1) > 0]
        if not len(numbers):
            return []
        here = self.points[min(self._next, len(self.points) - 1)] // size
        first = int(np.searchsorted(numbers, here)) % len(numbers)
        others = np.delete(numbers, first).tolist()
        random.shuffle(others)
        starts = [size * number for number in (int(numbers[first]), *others)]
        return [PointRange("", start, start + size - 1) for start in starts]

    def _lease_in(self, window: PointRange, windows: int, size: Callable[[np.ndarray], int], *, shares: bool) -> bool:
        """Leases a range of points in a window; returns False if none is free.

        Args:
          windows: number of windows with open points.
          shares: whether to lease points between those of other processes, too.
        """
        failures, within = 0, self._within(window)

        def has_open(points: PointRange) -> bool:
            return points.overlaps(window.first, window.last) and bool(self._is_open[self._within(points)].any())

        while failures < TRIES:
            others = self._leases.others(has_open)
            free = self._is_open.copy()
            for lease in others:
                free[self._within(lease)] = False
            places = within.start + np.flatnonzero(free[within])
            is_next = self._next < len(free) and bool(free[self._next])
            if not len(places) or not (shares or is_next or not others):
                return False
            self._owners = 1 + len({lease.owner for lease in others}) * windows
            start = self._start(places, is_alone=not others)
            run = self._run(places[start:], len(places) * windows, size)
            first, last = self.points[run[[0, -1]]].tolist()
            if not self._leases.claim(first, last, len(run)):
                self._next = len(self.points)  # two that begin at the same time do not meet again
                failures += 1
                time.sleep(PAUSE * secrets.randbelow(1000) / 1000)
                continue
            self._next = int(run[-1]) + 1
            self._read(first, last)
            self._leased = run[self._is_open[run]]
            self._leases.publish(self.points[run[~self._is_open[run]]], is_own=False)
            self._is_open[run] = False
            if len(self._leased):
                return True
        return False

    def _within(self, points: PointRange) -> slice:
        """Returns the places of a range of points."""
        first, stop = np.searchsorted(self.points, [points.first, points.last + 1]).tolist()
        return slice(first, stop)

    def _start(self, places: np.ndarray, *, is_alone: bool) -> int:
        """Returns where the next range begins among free places: after the last range, or anywhere between others."""
        after = int(np.searchsorted(places, self._next))
        if after < len(places) and (is_alone or places[after] == self._next):
            return after
        return 0 if is_alone else secrets.randbelow(len(places))

    def _run(self, places: np.ndarray, free: int, size: Callable[[np.ndarray], int]) -> np.ndarray:
        """Returns the first consecutive places in one block: a few chunks, and a fair share of the free points."""
        count = size(places)
        chunks = max(1, min(self._most_chunks, free // (SHARES * self._owners * count)))
        run = places[: count * chunks]
        is_next = run - run[0] == np.arange(len(run))
        blocks = np.searchsorted(self._files.bounds, self.points[run], "right")
        return run[is_next & (blocks == blocks[0])]

    def _read(self, first: int, last: int) -> None:
        """Reads new results of other processes in this range, and closes all points that are known now."""
        if self._files.update(self._known, first, last):
            is_new = self._is_open & (self._before != self._attempts())
            self.elsewhere += int(is_new.sum())
            self._is_open &= ~is_new

    def _attempts(self) -> np.ndarray:
        """Returns a number for each point that another attempt changes, `(n,)`: its wall time, or a negative one."""
        attempts = np.where(self._known.is_missing, -1, self._known.wall).astype(np.float32)
        if len(self.points) == len(attempts):
            return attempts
        return attempts[np.searchsorted(self._known.points, self.points)]
