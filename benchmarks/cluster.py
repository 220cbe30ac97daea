"""A model of a cluster that runs a study: how files, bytes and memory grow with points and nodes.

Discrete events drive the code of studies: the ranges of plan tasks, leases, sizes of chunks, parts, their merging and
reading. The clock is simulated, the files are real, and a folder counts what is done with them. Assumptions:

- A node has one process with one core, and executes one task of a plan of as many tasks as there are nodes; with
  `--shared`, it runs `mjrun sweep` in the folder that all share, which needs the results of all points.
- A simulation is replaced by its duration, which is log-normally distributed around `--seconds`.
- Nodes fail at random times, `--failures` of them while the study runs, which is 1 % an hour for a study of one hour.
  Nothing of a failed process is written or released; a scheduler starts its task again `RESTART` seconds after
  the chunk that is lost would have ended.
- File operations take no simulated time, and everything that is written can be read at once.

For each size, a row has the file operations of a task, the names in each list of a folder, of whatever kind, the bytes
that all tasks write and read per point, the memory of the arrays of a task and of the process that collects all
results, the points that were simulated twice, the opens and the CPU time of reading all results, and the files at the
end. With as many points for each task, nothing of a task should grow with the number of nodes. 1e7 points of 1000 nodes
take some five minutes of CPU time with `--seconds 0.002`: shorter chunks would take more, since each is a part.

    python benchmarks/cluster.py
    python benchmarks/cluster.py --points 1e4 --nodes 10 100
    python benchmarks/cluster.py --points 1e4 --nodes 4 16 --shared
    python benchmarks/cluster.py --points 1e5 --nodes 100 --seconds 0.2 --sizes 20000 2000 200
"""

import argparse
import heapq
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from unittest.mock import patch

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.local_and_remote_folders import LocalFolder
from mjrun.formats.output_writer import StagedFile
from mjrun.study import executors
from mjrun.study.job_plan import task_blocks, task_points
from mjrun.study.leases import BEAT, POLL, Leases, PointLeaser
from mjrun.study.part_files import PartFiles, PartWriter
from mjrun.study.range_folders import SIZES
from mjrun.study.spec import PointResult

STUDY = "ab" * 32
METRIC = "metric"
RESTART = 30.0  # [s] from a failure to the restart of its task


class Clock:
    """The simulated clock, in place of the module `time`."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        """Returns the simulated time [s]."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Returns at once."""


class CountingFolder(LocalFolder):
    """A folder that counts operations, and the bytes of files."""

    def __init__(self, path: Path, counts: Counter[str]) -> None:
        super().__init__(path)
        self._counts = counts

    def __truediv__(self, name: str) -> "CountingFolder":
        return CountingFolder(Path(self.path(name)), self._counts)

    def create(self, *, is_cleaned: bool = True) -> None:
        super().create(is_cleaned=is_cleaned)
        self._counts.update(folders=1)
        if is_cleaned:
            self._count_list()

    def names(self, suffix: str | tuple[str, ...]) -> list[str]:
        self._count_list()
        return super().names(suffix)

    def _count_list(self) -> None:
        with suppress(FileNotFoundError):
            self._counts.update(lists=1, listed=len(os.listdir(self.path())))  # noqa: PTH208

    def open(self, name: str) -> BinaryIO:
        stream = super().open(name)
        self._counts.update(opens=1, read=self.size(name))
        return stream

    def create_file(self, name: str, content: bytes) -> None:
        self._counts.update(opens=1, written=len(content))
        super().create_file(name, content)

    def rewrite(self, name: str, content: bytes) -> None:
        self._counts.update(opens=1, written=len(content))
        super().rewrite(name, content)

    def destination(self, name: str) -> StagedFile:
        counts = self._counts

        class Counted(StagedFile):
            def publish(self) -> list[Path]:
                counts.update(opens=1, written=Path(self.path).stat().st_size)
                return super().publish()

        return Counted(Path(self.path(name)))


class CountedLeases(Leases):
    """Leases that the model renews, since a thread would use the clock of the machine."""

    def _renew(self) -> None:
        pass


@dataclass(frozen=True)
class ClusterRun:
    """Figures of a study on the model of a cluster.

    Attributes:
      counts: file operations of all tasks, by kind.
      task_bytes, collect_bytes: memory of a task, and of the process that collects all results.
      twice: points that were simulated more than once.
      first: time to the first published result [s].
      resume: opens, and CPU time [s], of reading all results, as a resumed study does.
      files: files at the end.
      size: their bytes.
      end: time until all results were published [s].
      is_complete: whether all points have their results.
    """

    points: int
    nodes: int
    counts: Counter[str]
    task_bytes: int
    collect_bytes: int
    twice: int
    first: float
    resume: tuple[int, float]
    files: int
    size: int
    end: float
    is_complete: bool


class _Cluster:
    """A study of `points` points in as many tasks as nodes, of which a share fails; or in processes that share it."""

    def __init__(
        self, folder: Path, points: int, nodes: int, seconds: float, failures: float, seed: int, *, is_shared: bool
    ) -> None:
        self._is_shared = is_shared
        self.clock, self.counts, self.points, self.nodes = Clock(), Counter[str](), points, nodes
        self.folder = CountingFolder(folder, self.counts)
        self._random, self._seconds = np.random.default_rng(seed), seconds
        self.simulated, self.first, self.task_bytes = 0, np.inf, 0
        span = seconds * points / nodes
        fails = self._random.random(nodes) < failures
        self._failures = {int(node): float(self._random.uniform(0, span)) for node in np.flatnonzero(fails)}

    def run(self) -> float:
        """Executes all tasks, and returns the simulated time of their end [s]."""
        events = list[tuple[float, int, int]]()
        tasks = dict[int, Iterator[float]]()
        for node in range(self.nodes):
            tasks[node] = self._task(node)
            heapq.heappush(events, (0.0, node, 0))
        starts = Counter[int]()
        while events:
            self.clock.now, node, start = heapq.heappop(events)
            if start != starts[node]:
                continue
            failure = self._failures.get(node)
            if failure is not None and self.clock.now >= failure:
                del self._failures[node]
                starts[node] += 1
                tasks[node] = self._task(node)  # the failed one is dropped between two of its steps
                heapq.heappush(events, (self.clock.now + RESTART, node, starts[node]))
            elif (seconds := next(tasks[node], None)) is not None:
                heapq.heappush(events, (self.clock.now + seconds, node, start))
        return self.clock.now

    def _task(self, node: int) -> Iterator[float]:
        """Executes a task, and yields after each step how long it takes [s]."""
        files = PartFiles(self.folder, [METRIC], STUDY, self.points)
        if self._is_shared:
            points = np.arange(self.points)
        else:
            points = task_points([(0, self.points)], node + 1, self.nodes)
            files.bounds = task_blocks(points)
        if not len(points):
            return
        files.create()
        known = files.read(points, _keys)
        missing = known.points[known.is_missing]
        leases = CountedLeases(files.ranges)
        parts = PartWriter(files, executors.INTERVAL, leases.publish)
        leased = PointLeaser(missing, known, files, leases, executors.QUEUED)
        sizes, beat = executors.ChunkSizes(None, executors.QUEUED), self.clock.now
        self.task_bytes = max(self.task_bytes, _bytes(known) + _bytes(leased))
        steps = np.broadcast_to(np.int64(1), len(missing))

        while leased.left:
            part = leased.take(lambda places: sizes.next(steps[places[: executors.MOST]], leased.left)).tolist()
            if part:
                durations = self._seconds * self._random.lognormal(-0.125, 0.5, len(part))
                self.simulated += len(part)
                yield float(durations.sum())
                self.first = min(self.first, self.clock.now)
                walls = durations.tolist()
                results = [PointResult(i, "ok", (float(i),), 1, wall=wall) for i, wall in zip(part, walls, strict=True)]
                parts.add(part, _keys(part), results, f"node{node}")
                sizes.add(len(part), len(part), sum(walls))
            else:
                yield POLL
            parts.write_if_due()
            if self.clock.now - beat >= BEAT:
                beat = self.clock.now
                leases.renew()
        parts.__exit__()
        leases.__exit__()


def simulated(
    points: int,
    nodes: int,
    seconds: float = 0.02,
    failures: float = 0.01,
    seed: int = 0,
    folder: str | None = None,
    *,
    sizes: Sequence[int] = SIZES,
    is_shared: bool = False,
) -> ClusterRun:
    """Returns the figures of a study.

    Args:
      seconds: mean wall time of a point [s].
      failures: share of the nodes that fail while the study runs.
      folder: folder of the files, which are removed; by default that of temporary files.
      sizes: points in folders of each level; small ones show what large studies do.
      is_shared: whether each node runs `mjrun sweep` for all points, instead of a task of a plan.
    """
    with patch("mjrun.study.range_folders.SIZES", tuple(sizes)), tempfile.TemporaryDirectory(dir=folder) as root:
        cluster = _Cluster(Path(root), points, nodes, seconds, failures, seed, is_shared=is_shared)
        with patch("mjrun.study.leases.time", cluster.clock), patch("mjrun.study.part_files.time", cluster.clock):
            end = cluster.run()
        counts, start = cluster.counts.copy(), time.process_time()
        files = PartFiles(cluster.folder, [METRIC], STUDY, points)
        known = files.read(np.arange(points), _keys)
        cpu, names = time.process_time() - start, files.ranges.names(".parquet")
        expected = np.arange(points, dtype=float)
        return ClusterRun(
            points,
            nodes,
            counts,
            cluster.task_bytes,
            _bytes(known),
            cluster.simulated - points,
            cluster.first,
            (cluster.counts["opens"] - counts["opens"], cpu),
            len(names),
            files.size(),
            end,
            np.array_equal(known.metrics[:, 0], expected) and not files.ranges.names(".lease"),
        )


def _keys(points: Sequence[int] | np.ndarray) -> list[str]:
    return [f"{point:032x}" for point in points]


def _bytes(value: object) -> int:
    """Returns the memory of the arrays that an object has [bytes]."""
    return sum(each.nbytes for each in vars(value).values() if isinstance(each, np.ndarray))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=float, nargs="+", default=[1e5, 1e6, 1e7])
    parser.add_argument("--nodes", type=int, nargs="+", default=[10, 100, 1000])
    parser.add_argument("--seconds", type=float, default=0.02, help="mean wall time of a point [s]")
    parser.add_argument("--failures", type=float, default=0.01, help="share of the nodes that fail")
    parser.add_argument("--shared", action="store_true", help="processes that share all points instead of tasks")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="points in folders of each level")
    parser.add_argument("--folder", help="folder of the files, which are removed")
    arguments = parser.parse_args()
    heads = ("points", "nodes", "time [s]", "first [s]", "opens/task", "lists/task", "names/list", "written", "read")
    heads += ("task", "collect", "twice", "resume", "files", "file", "CPU [s]")
    print("  ".join(f"{head:>10}" for head in heads))
    for points in map(int, arguments.points):
        for nodes in arguments.nodes:
            start = time.process_time()
            run = simulated(
                points,
                nodes,
                arguments.seconds,
                arguments.failures,
                folder=arguments.folder,
                sizes=arguments.sizes,
                is_shared=arguments.shared,
            )
            assert run.is_complete
            count = run.counts
            cells = (
                f"{points:.0e}",
                f"{nodes}",
                f"{run.end:.0f}",
                f"{run.first:.2f}",
                f"{count['opens'] / nodes:.1f}",
                f"{count['lists'] / nodes:.1f}",
                f"{count['listed'] / count['lists']:.0f}",
                f"{count['written'] / points:.0f} B/pt",
                f"{count['read'] / points:.0f} B/pt",
                f"{run.task_bytes / 1e6:.1f} MB",
                f"{run.collect_bytes / 1e6:.1f} MB",
                f"{run.twice}",
                f"{run.resume[0]} {run.resume[1]:.1f}s",
                f"{run.files}",
                f"{run.size / run.files / 1e6:.2f} MB",
                f"{time.process_time() - start:.0f}",
            )
            print("  ".join(f"{cell:>10}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
