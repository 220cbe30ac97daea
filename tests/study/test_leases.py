"""Processes share the points of a study: each point is simulated once, and those of an ended process once more."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import FileError
from mjrun.platform import system
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from mjrun.study.leases import BEAT, EXPIRY, POLL, Leases, PointLeaser
from mjrun.study.part_files import PartFiles
from mjrun.study.prepared import PreparedStudy
from mjrun.study.range_folders import SIZES, RangeFolders
from mjrun.study.results import ResultColumns, ResultRows
from mjrun.study.spec import PointResult, Status
from mjrun.study.study import Study

STUDY = "ab" * 32
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}


class Clock:
    """A clock that a test sets, in place of the system's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        monkeypatch.setattr("mjrun.study.leases.time.monotonic", lambda: self.now)
        monkeypatch.setattr("mjrun.study.leases.time.sleep", lambda _: None)


class Unrenewed(Leases):
    """Leases of a process that does not come round to renew them."""

    def _renew(self) -> None:
        pass


class Process:
    """One of several processes that simulate all points of a study, in chunks of `size`."""

    def __init__(self, folder: Path, count: int, size: int, *, retry: bool = False) -> None:
        self._files = PartFiles(folder, ["square"], STUDY, count)
        self._files.create()
        self.known: ResultColumns = self._files.read(range(count), lambda _: [])
        missing = np.flatnonzero(~self.known.is_final if retry else self.known.is_missing)
        self.leases, self._size = Unrenewed(self._files.ranges), size
        self.points = PointLeaser(missing, self.known, self._files, self.leases, ahead=2)
        self._chunks = list[np.ndarray]()

    def begin(self) -> bool:
        """Begins a chunk; returns whether any point was left."""
        chunk = self.points.take(lambda places: self._size)
        self._chunks += [chunk] if len(chunk) else []
        return bool(len(chunk))

    def give_back(self, count: int) -> None:
        """Gives back the last chunks."""
        given, self._chunks = self._chunks[-count:], self._chunks[:-count]
        self.points.give_back([point for chunk in given for point in chunk.tolist()])

    def end(self, status: Status = "ok", wall: float = 0.0) -> list[int]:
        """Publishes the results of all chunks that it has begun; returns their points."""
        points = [point for chunk in self._chunks for point in chunk.tolist()]
        self._chunks.clear()
        if points:
            rows = [PointResult(point, status, (point**2.0,), 1, wall=wall) for point in points]
            results = ResultRows.of(rows, 1)
            self._files.write(points, [f"{point:032x}" for point in points], results)
            self.known.put_points(np.array(points), results)
            self.leases.publish(points)
        return points


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@given(
    st.integers(1, 80),
    st.lists(st.integers(1, 9), min_size=1, max_size=4),
    st.sampled_from([SIZES, (20, 8)]),
    st.randoms(use_true_random=False),
)
@settings(deadline=None, max_examples=16)
def test_each_point_is_simulated_once_and_known_to_all(
    tmp_path_factory: pytest.TempPathFactory,
    count: int,
    sizes: list[int],
    folders: tuple[int, ...],
    order: random.Random,
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mjrun.study.range_folders.SIZES", folders)
        clock, folder, done = Clock(patch), tmp_path_factory.mktemp("study"), Counter[int]()
        processes = [Process(folder, count, size) for size in sizes]
        while any(process.points.left for process in processes):
            process = order.choice(processes)
            process.begin()
            if order.random() > 0.8:
                process.give_back(1 + order.randrange(3))
            done.update(process.end() if order.random() < 0.5 else [])
            clock.now += POLL * order.random()
        for process in processes:
            done.update(process.end())
    assert done == dict.fromkeys(range(count), 1)
    assert sum(process.points.elsewhere for process in processes) == count * (len(sizes) - 1)
    for process in processes:
        assert process.known.metrics[:, 0].tolist() == [point**2 for point in range(count)]
    assert not [*folder.rglob("*.lease")]


def test_points_that_a_process_has_not_begun_go_to_one_that_asks(tmp_path: Path, clock: Clock) -> None:
    slow, idle = Process(tmp_path, 8, 1), Process(tmp_path, 8, 1)
    for _ in range(8):
        assert slow.begin()
    assert not slow.points.is_wanted
    assert not idle.begin()
    assert not slow.points.is_wanted  # it has just looked
    clock.now += BEAT
    assert slow.points.is_wanted
    slow.give_back(5)
    assert not slow.begin()  # at first
    assert not slow.points.is_waiting
    clock.now += POLL
    assert idle.begin()
    taken = idle.end()
    assert len(taken) == 1
    assert 3 <= taken[0] < 8
    clock.now += BEAT
    assert not slow.points.is_wanted
    while slow.begin():
        pass
    assert sorted([*slow.end(), *taken]) == [*range(8)]
    assert not idle.begin()
    assert (slow.points.left, idle.points.left, idle.points.elsewhere) == (0, 0, 7)
    assert not [*tmp_path.rglob("*.lease")]


def test_failed_points_that_two_processes_retry_are_shared(tmp_path: Path, clock: Clock) -> None:
    first = Process(tmp_path, 8, 8)
    assert first.begin()
    assert len(first.end("timeout", 1.0)) == 8
    one, other = Process(tmp_path, 8, 2, retry=True), Process(tmp_path, 8, 3, retry=True)
    done = list[int]()
    while one.points.left or other.points.left:
        for number, process in enumerate([one, other]):
            process.begin()
            done += process.end("timeout", 2.0 + number)  # again
            clock.now += POLL
    assert sorted(done) == [*range(8)]


def test_a_lease_that_is_not_renewed_expires_whatever_its_time(tmp_path: Path, clock: Clock) -> None:
    dead = Process(tmp_path, 6, 2)
    assert dead.begin()
    (lease,) = tmp_path.rglob("*.lease")
    future = time.time() + 7200  # its clock is two hours ahead
    os.utime(lease, (future, future))
    other = Process(tmp_path, 6, 4)
    done = list[int]()
    while other.begin():
        done += other.end()
    assert sorted(done) == [2, 3, 4, 5]
    assert other.points.is_waiting
    clock.now += EXPIRY - 2 * BEAT
    assert not other.begin()
    clock.now += 2 * BEAT
    assert other.begin()
    assert other.end() == [0, 1]
    assert dead.end() == [0, 1]  # it was only suspended, and its results are the same
    assert [*PartFiles(tmp_path, ["square"], STUDY).read(range(6), lambda _: []).counts] == ["ok"]
    assert not [*tmp_path.rglob("*.lease")]


def test_a_renewed_lease_stays_though_the_clock_of_its_owner_stands_still(tmp_path: Path, clock: Clock) -> None:
    assert Process(tmp_path, 2, 2).begin()
    (lease,) = tmp_path.rglob("*.lease")
    content, other = json.loads(lease.read_text()), Process(tmp_path, 2, 2)
    for beat in range(20):
        lease.write_text(json.dumps({**content, "beat": beat}))
        os.utime(lease, (0, 0))
        clock.now += BEAT
        assert not other.begin()
    assert other.leases.hosts() == [content["host"]]


@pytest.mark.parametrize("text", ["", "x", "[]", '{"host": 1}', '{"beat": 1e999}'])
def test_a_lease_that_mjrun_never_writes_expires_too(tmp_path: Path, clock: Clock, text: str) -> None:
    process = Process(tmp_path, 1, 1)
    (tmp_path / "parts" / f"{STUDY[:16]}-0-0-01234567.lease").write_text(text)
    (tmp_path / "parts" / f"{'cd' * 8}-0-0-01234567.lease").write_text(text)  # of another study
    assert not process.begin()
    clock.now += EXPIRY
    assert process.begin()


@pytest.mark.skipif(not system.process_identity(), reason="the system does not identify processes")
def test_points_of_an_ended_process_of_this_machine_are_free_at_once(tmp_path: Path, clock: Clock) -> None:
    assert Process(tmp_path, 2, 2).begin()
    (lease,) = tmp_path.rglob("*.lease")
    _, pid, start = system.process_identity().split()
    lease.write_text(lease.read_text().replace(f"{pid} {start}", f"{pid} {int(start) - 1}"))  # a reused number
    assert Process(tmp_path, 2, 2).begin()


def test_a_range_begins_and_ends_with_a_block_of_a_task(tmp_path: Path, clock: Clock) -> None:
    process = Process(tmp_path, 100, 8)
    process._files.bounds = np.array([10, 20])
    leases = Leases(process._files.ranges)
    points = PointLeaser([*range(5, 10), *range(20, 30)], process.known, process._files, leases, 1)
    assert [points.take(lambda _: 8).tolist() for _ in range(3)] == [[*range(5, 10)], [*range(20, 28)], [28, 29]]


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"):
        Leases(PartFiles(tmp_path / "missing", [], STUDY).ranges).claim(0, 1, 2)


@pytest.mark.skipif(not system.process_identity(), reason="the system does not identify processes")
@pytest.mark.parametrize(("earlier", "simulated"), [("1,2,3", 0), ("1,2", 1)])
def test_leases_of_known_points_that_a_killed_process_has_left_are_removed(
    ball: Simulation, tmp_path: Path, earlier: str, simulated: int
) -> None:
    def study(seeds: str) -> Study:
        return Study(ball, str(tmp_path), vary={"seed": seeds}, metric={"low": "min(qpos/ball/z)"}, jobs=1)

    study(earlier).run()
    now = study("1,2,3")
    ranges = PreparedStudy(now, now.spec).files.ranges
    machine, pid, start = system.process_identity().split()
    for owner, process in (("aaaaaaaa", f"{machine} {pid} {int(start) - 1}"), ("bbbbbbbb", system.process_identity())):
        content = {"host": "here", "process": process, "beat": 0, "points": 2, "seconds": 1}
        (tmp_path / "parts" / ranges.new_name(0, 1, f"{owner}.lease")).write_text(json.dumps(content))
    assert now.run().simulated == simulated
    assert [path.name[-14:] for path in tmp_path.rglob("*.lease")] == ["bbbbbbbb.lease"]


CUT_OFF = """
import resource, signal, sys
from mjrun.study.leases import Leases
from mjrun.study.part_files import PartFiles

signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
Leases(PartFiles(sys.argv[1], ["square"], sys.argv[2], 2).ranges).claim(0, 1, 2)
"""


def test_a_process_that_is_killed_while_it_writes_a_lease_leaves_none(tmp_path: Path, clock: Clock) -> None:
    PartFiles(tmp_path, ["square"], STUDY, 2).create()
    process = subprocess.run([sys.executable, "-c", CUT_OFF, str(tmp_path), STUDY], env=ENVIRONMENT, check=False)
    assert process.returncode == -signal.SIGXFSZ
    other = Process(tmp_path, 2, 2)
    assert other.begin()
    assert other.end() == [0, 1]
    assert {path.suffix for path in tmp_path.rglob("*") if path.is_file()} == {".parquet"}


STUCK = """
import sys, time
from mjrun.study import executors, leases, study
from mjrun.simulation.simulation import Simulation

executors.INTERVAL = 0  # a part for each point
take = leases.PointLeaser.take

def stuck(points, size):
    if points.points[0] + 24 - points.left > 5:
        print("stuck", flush=True)
        time.sleep(600)
    return take(points, size)

leases.PointLeaser.take = stuck
options = dict(vary={"perturb": "uniform(0,2)"}, samples=24, metric={"low": "min(qpos/ball/z)"}, jobs=1, chunk=1)
study.Study(Simulation(sys.argv[1], steps=20), sys.argv[2], **options).run()
"""


@pytest.mark.slow
@pytest.mark.skipif(not system.process_identity(), reason="the system does not identify processes")
def test_two_processes_share_a_study_and_one_finishes_it_when_the_other_is_killed(
    ball: Simulation, tmp_path: Path
) -> None:
    def study(folder: str) -> Study:
        vary, metric = {"perturb": "uniform(0,2)"}, {"low": "min(qpos/ball/z)"}
        return Study(ball, str(tmp_path / folder), vary=vary, samples=24, metric=metric, jobs=1, chunk=1)

    class Killer(PythonApiReporter):
        """Kills the other process once this one waits for it."""

        def note(self, text: str) -> None:
            if text.startswith("waiting for "):
                process.kill()
                process.wait()

    study("alone").run()
    command = [sys.executable, "-c", STUCK, str(ball.model), str(tmp_path / "shared")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT) as process:
        assert process.stdout
        assert process.stdout.readline() == "stuck\n"
        assert [*tmp_path.rglob("*.lease")]
        result = study("shared").run(Killer())
        assert process.returncode == -signal.SIGKILL
    assert 18 < result.simulated < 24
    assert [*(tmp_path / "shared" / "parts").glob("*.lease")] == []
    tables = [(tmp_path / folder / "results.parquet").read_bytes() for folder in ("alone", "shared")]
    assert tables[0] == tables[1]


def test_a_lease_survives_that_another_process_removes_its_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process, other = (Process(tmp_path, 2 * SIZES[-1], 8) for _ in range(2))
    ranges, new_name = process.leases._ranges, RangeFolders.new_name

    def interrupted(self: RangeFolders, first: int, last: int, end: str) -> str:
        name = new_name(self, first, last, end)
        other.leases._ranges.remove_empty()  # as at the end of a run
        return name

    monkeypatch.setattr(RangeFolders, "new_name", interrupted)
    with process.leases:
        assert process.leases.claim(0, 7, 8)
        assert len(ranges.names(".lease")) == 1
