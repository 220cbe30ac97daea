"""Leases of ranges of points, by which processes on any machines share the work on one study.

A lease is a small file beside the parts, named `STUDY-FIRST-LAST-OWNER.lease`. A process creates one, and then lists
the others: of two processes whose ranges overlap, at least one sees both leases, and gives up its own. It renews its
leases by changing their content. Another process that sees the same content for `EXPIRY` seconds on its clock takes
the points; it does not wait for a process of the same machine that has ended. No clocks are compared, and the file
system needs no locks. A wrong guess costs time only: a point has the same result, whichever process simulates it.

A process that finds all points leased asks for some by a lease of no points; others then give back those that they have
not begun, so that points that take much longer than expected do not wait for one process.
"""

import json
import re
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean
from mjrun.formats.folders import Folder, folder_at
from mjrun.platform import system
from mjrun.study.chunk_files import NAMED, ChunkFiles
from mjrun.study.result_columns import ResultColumns

SUFFIX = ".lease"
NAME = re.compile(rf"([0-9a-f]{{{NAMED}}})-(\d{{1,18}})-(\d{{1,18}})-([0-9a-f]{{8}})\.lease")
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
class Lease:
    """A lease of the points from `first` to `last`, which is included."""

    name: str
    first: int
    last: int
    owner: str

    @classmethod
    def of(cls, name: str, study: str) -> "Lease | None":
        """Returns the lease that a file represents; None if it is not a lease of this study."""
        match = NAME.fullmatch(name)
        return cls(name, int(match[2]), int(match[3]), match[4]) if match and match[1] == study[:NAMED] else None

    @property
    def is_request(self) -> bool:
        """True for a lease of no points, by which a process asks for some."""
        return self.first > self.last

    def overlaps(self, first: int, last: int) -> bool:
        """Returns whether any of these points is in the range."""
        return self.first <= last and first <= self.last


@dataclass(frozen=True)
class LeaseContent:
    """The content of a lease.

    Attributes:
      host: name of the owner's machine.
      process: identity of the owner's process; see `system.process_identity`.
      beat: number of renewals.
      points: number of points whose results the owner has published.
      seconds: wall time since the owner began [s].
    """

    host: str = ""
    process: str = ""
    beat: int = 0
    points: int = 0
    seconds: float = 0.0

    @classmethod
    def read(cls, folder: Folder, name: str) -> "LeaseContent":
        """Reads a lease; one that is being written, or is not a lease, is empty.

        Raises:
          FileNotFoundError: its owner has released it.
        """
        try:
            with folder.open(name) as stream:
                values = json.loads(stream.read(MOST))
            host, process = str(values["host"]), str(values["process"])
            return cls(host, process, int(values["beat"]), int(values["points"]), float(values["seconds"]))
        except FileNotFoundError:
            raise
        except (FileError, OSError, ValueError, TypeError, KeyError, OverflowError):
            return cls()


class Leases:
    """The leases of one study, and those of this process among them; a context manager that releases the latter.

    Args:
      folder: folder of the leases, which exists.
      study: hash of everything that determines the results of all points.
    """

    def __init__(self, folder: str | Path | Folder, study: str) -> None:
        self._folder, self._study, self._owner = folder_at(folder), study, secrets.token_hex(4)
        self._own = dict[Lease, int]()  # the points of each that are not published
        self._seen = dict[
            str, tuple[LeaseContent, float, float]
        ]()  # of others, since when it is the same, and when it was read
        self._host, self._process = system.machine_name(), system.process_identity()
        self._start, self._beat, self.points = time.monotonic(), 0, 0
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
        name = f"{self._study[:NAMED]}-{first}-{last}-{self._owner}{SUFFIX}"
        lease = Lease(name, first, last, self._owner)
        with self._lock:
            self._folder.create_file(name, self._content())
            self._own[lease] = points
        return lease

    def ask(self, *, is_idle: bool) -> None:
        """Asks other processes for points, or stops to."""
        own = [lease for lease in self._own if lease.is_request]
        if is_idle and not own:
            with suppress(FileError):
                self.claim(*NONE, 1)
        elif not is_idle:
            for lease in own:
                self._release(lease)

    def give_back(self, points: np.ndarray) -> None:
        """Releases points that this process has not begun, the last ones of their ranges."""
        for lease in [*self._own]:
            own = points[(points >= lease.first) & (points <= lease.last)]
            left = self._own[lease] - len(own)
            if len(own) and left > 0:
                self._create(lease.first, int(own.min()) - 1, left)
            if len(own):
                self._release(lease)

    def others(self, is_relevant: Callable[[Lease], bool] = lambda _: True) -> list[Lease]:
        """Returns the leases of other processes that are relevant and still valid; the files of no others are read.

        If each of a thousand processes read the leases of all, the file system would do little else.
        """
        leases = [lease for name in self._folder.names(SUFFIX) if (lease := Lease.of(name, self._study))]
        others = [lease for lease in leases if lease.owner != self._owner and is_relevant(lease)]
        names, now = {lease.name for lease in leases}, time.monotonic()
        self._seen = {name: seen for name, seen in self._seen.items() if name in names}
        return [lease for lease in others if self._is_valid(lease, now)]

    def hosts(self) -> list[str]:
        """Returns the machines of the leases that `others` has read last."""
        return sorted({clean(content.host) or "another machine" for content, _, _ in self._seen.values()})

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
        before, since, read = self._seen.get(lease.name, (None, now, -BEAT))
        if before is not None and now - read < BEAT:
            return True
        try:
            content = LeaseContent.read(self._folder, lease.name)
        except FileNotFoundError:
            return False
        if content != before:
            since = now
        self._seen[lease.name] = content, since, now
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
        values = {"host": self._host, "process": self._process, "beat": self._beat}
        return f"{json.dumps({**values, 'points': self.points, 'seconds': seconds})}\n".encode()


class LeasedPoints:
    """Missing points, of which this process leases one range after the other.

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
        files: ChunkFiles,
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
        return bool(self._leases.others(lambda lease: lease.is_request))

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
        failures, self._is_giving = 0, False
        while failures < TRIES:
            others = self._leases.others(lambda lease: bool(self._is_open[self._within(lease)].any()))
            free, owners = self._is_open.copy(), {"", *(lease.owner for lease in others)}
            for lease in others:
                free[self._within(lease)] = False
            places = np.flatnonzero(free)
            if not len(places):
                break
            self._owners = len(owners)
            run = self._run(places[self._start(places, is_alone=not others) :], len(places), size)
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
                return
        self._pause_end = time.monotonic() + POLL

    def _within(self, lease: Lease) -> slice:
        """Returns the places of the points of a lease."""
        return slice(*np.searchsorted(self.points, [lease.first, lease.last + 1]))

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
