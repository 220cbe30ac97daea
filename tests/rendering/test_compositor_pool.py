"""Frames from several processes, and what is left of them."""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import DrawError, MjrunError, NoRendererError, UnstableError
from mjrun.platform import system
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.compositor_pool import SLOTS, CompositorPool, CompositorProcesses
from tests.processes import PATIENCE
from tests.processes import children as children_of

sys.path.append(str(Path(__file__).parent))  # drawing processes look where we look

from compositors import ASKED, HANG, OPENING, Adding, Drawing, Telling, Warner

HERE = Path(__file__).parent
SHAPE = (2, 3)
STATES = [np.array([10.0 * k, -k]) for k in range(20)]
FRAMES = [np.full(SHAPE, k + 9 * k) for k in range(20)]  # what Adding makes of them
FALLING = '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'


def drawn(compositor: Adding, jobs: int, states: list[np.ndarray] = STATES) -> list[np.ndarray]:
    with closing(CompositorPool(compositor, SHAPE, jobs, np.int64)) as pool:
        return [frame.copy() for frame in pool.frames(states)]


def alive(process: int) -> bool:
    """Whether there is such a process, and not just its exit code."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except OSError:
        return False


BEFORE = set[int]()  # children of this process that are no drawing processes of the test that runs


def children() -> list[int]:
    """Drawing processes of this one, ended ones that nobody waited for included."""
    return [child for child in children_of(os.getpid()) if child not in BEFORE and not is_prepared(child)]


def is_prepared(process: int) -> bool:
    """Whether it is an interpreter of which the tests make copies."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/comm").read_text() == "prepared\n"
    return False


def held() -> tuple[set[int], int, bool]:
    """What drawing might leave behind: processes, descriptors, memory."""
    mapped = "memfd:mjrun" in Path("/proc/self/maps").read_text()
    return {*children()}, len([*Path("/proc/self/fd").iterdir()]), mapped


@pytest.fixture(scope="module", autouse=True)
def _tests_have_started_what_they_keep() -> None:
    drawn(Adding(), 2)


@pytest.fixture(autouse=True)
def _nothing_is_left() -> Iterator[None]:
    BEFORE.clear()
    BEFORE.update(children_of(os.getpid()))
    processes, descriptors, mapped = held()

    def is_clean() -> bool:
        now = held()
        return now[0] <= processes and now[1] <= descriptors and now[2] <= mapped

    yield
    if not is_clean():
        gc.collect()  # tracebacks that hold a frame; to look for them takes a while
    assert is_clean()


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_frames_come_in_order_whoever_draws_them_and_however_long_it_takes(jobs: int) -> None:
    assert np.array_equal(drawn(Adding(delay=0.003), jobs), FRAMES)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_pool_draws_none_one_and_many_one_after_the_other(jobs: int) -> None:
    with closing(CompositorPool(Adding(), SHAPE, jobs, np.int64)) as pool:
        for count in (0, 1, 20, 3):
            made = [frame.copy() for frame in pool.frames(iter(STATES[:count]))]
            assert np.array_equal(made, FRAMES[:count])


def test_processes_that_were_started_before_draw_for_one_pool_after_another() -> None:
    with closing(CompositorProcesses(2)) as workers:
        started = set(children())
        for count in (1, len(STATES)):  # of one state, a process may have opened nothing when the next pool comes
            with closing(CompositorPool(Telling(delay=0.005), (2,), 2, np.int64, workers)) as pool:
                processes = {int(frame[0]) for frame in pool.frames(STATES[:count])}
            assert processes <= started
            with closing(CompositorPool(Adding(), SHAPE, 2, np.int64, workers)) as pool:
                assert np.array_equal([frame.copy() for frame in pool.frames(STATES)], FRAMES)
        assert processes == started == set(children())
    assert not children()
    workers.close()  # again


def drawn_by(workers: CompositorProcesses, compositor: Adding) -> list[np.ndarray]:
    with closing(CompositorPool(compositor, SHAPE, 2, np.int64, workers)) as pool:
        return [frame.copy() for frame in pool.frames(STATES)]


def test_a_pool_that_fails_leaves_workers_that_draw_for_the_next() -> None:
    with closing(CompositorProcesses(2)) as workers:
        for mischief in ("ends", "is unstable"):
            with pytest.raises(MjrunError):
                drawn_by(workers, Adding({3: mischief}))
            assert np.array_equal(drawn_by(workers, Adding()), FRAMES)
        assert len(children()) == 2


def test_leaving_a_pool_early_leaves_workers_that_draw_for_the_next() -> None:
    start = time.monotonic()
    with closing(CompositorProcesses(2)) as workers:
        with closing(CompositorPool(Adding({3: "hangs"}), SHAPE, 2, np.int64, workers)) as pool:
            next(pool.frames(STATES))
        assert np.array_equal(drawn_by(workers, Adding()), FRAMES)
    assert time.monotonic() - start < HANG / 10


def test_workers_that_cannot_open_a_compositor_open_the_next() -> None:
    with closing(CompositorProcesses(2)) as workers:
        with (
            pytest.raises(NoRendererError),
            closing(CompositorPool(Adding({OPENING: "has no renderer"}), SHAPE, 2, np.int64, workers)) as pool,
        ):
            list(pool.frames(STATES))
        with closing(CompositorPool(Adding(), SHAPE, 2, np.int64, workers)) as pool:
            assert np.array_equal([frame.copy() for frame in pool.frames(STATES)], FRAMES)


def test_workers_grow_to_as_many_as_are_asked_for() -> None:
    with closing(CompositorProcesses(1)) as workers:
        (first,) = children()
        with closing(CompositorPool(Telling(delay=0.005), (2,), 3, np.int64, workers)) as pool:
            processes = {int(frame[0]) for frame in pool.frames(STATES)}
        assert first in processes
        assert processes == set(children())
        assert len(processes) == 3


@pytest.mark.parametrize("wait", [0, 0.5])
def test_processes_that_are_not_needed_end_at_once(wait: float) -> None:
    crew = CompositorProcesses(2, "mjrun.rendering.compositor")
    time.sleep(wait)
    assert len(children()) == 2
    crew.close()
    assert not children()


COPIES = """
import sys, threading
from contextlib import closing
from pathlib import Path
import numpy as np
from compositors import Telling
from mjrun.rendering.compositor_pool import CompositorPool

{first}
with closing(CompositorPool(Telling(), (2,), 2, np.int64)) as pool:
    for frame in pool.frames([np.zeros(1)] * 9):
        assert frame[1] == 1  # thread of the driver
        command = Path(f"/proc/{{frame[0]}}/cmdline").read_bytes()
        assert (command == Path("/proc/self/cmdline").read_bytes()) is {is_copy}
"""


@pytest.mark.skipif(not system.CAN_FORK_LATE, reason="no copies of processes")
@pytest.mark.parametrize(
    ("first", "is_copy"),
    [
        ("", True),
        ("import OpenGL", False),
        ("threading.Thread(target=threading.Event().wait, daemon=True).start()", False),
    ],
)
def test_processes_are_copies_of_one_without_threads_and_opengl(first: str, is_copy: bool) -> None:
    code = COPIES.format(first=first, is_copy=is_copy)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


def test_processes_call_what_prepares_them_and_do_without_it_if_it_fails() -> None:
    with closing(CompositorProcesses(2)) as workers:
        workers.prepare(partial(exec, "import os; os.environ['LP_NUM_THREADS'] = '7'"))
        workers.prepare(partial(divmod, 1, 0))
        with closing(CompositorPool(Telling(), (2,), 2, np.int64, workers)) as pool:
            assert {int(frame[1]) for frame in pool.frames(STATES)} == {7}


def test_processes_import_no_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL")
    with (
        closing(CompositorProcesses(2, "mjrun.rendering.compositor")) as workers,
        closing(CompositorPool(Adding(), SHAPE, 2, np.int64, workers)) as pool,
    ):
        for _ in pool.frames(STATES):
            pool.ask(Adding.windows)
        assert pool.answer is False


def test_a_module_that_is_not_there_is_reported_with_the_compositor_s_own_words() -> None:
    with (
        closing(CompositorProcesses(2, "nowhere.at.all")) as workers,
        closing(CompositorPool(Adding(), SHAPE, 2, np.int64, workers)) as pool,
    ):
        assert len([*pool.frames(STATES)]) == len(STATES)


@pytest.mark.parametrize("jobs", [1, 2])
def test_frames_are_numbered_from_where_it_is_reported(jobs: int) -> None:
    with closing(CompositorPool(Adding(), SHAPE, jobs, np.int64)) as pool:
        made = [frame.copy() for first in (0, 13) for frame in pool.frames(STATES[first : first + 7], first)]
    assert np.array_equal(made, [*FRAMES[:7], *FRAMES[13:]])


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("when", [0, 7, len(STATES) - 1])
def test_a_question_is_answered_by_a_process_that_draws_and_disturbs_nothing(jobs: int, when: int) -> None:
    with closing(CompositorPool(Adding(delay=0.002), SHAPE, jobs, np.int64)) as pool:
        processes = set(children())
        assert pool.answer is None
        made = []
        for index, frame in enumerate(pool.frames(STATES)):
            made.append(frame.copy())
            if index == when:
                pool.ask(Adding.process)
        assert pool.answer in processes
    assert np.array_equal(made, FRAMES)


def test_a_question_that_fails_is_a_bug_of_mjrun() -> None:
    with closing(CompositorPool(Adding({ASKED: "divides"}), SHAPE, 2, np.int64)) as pool:
        frames = pool.frames(STATES)
        next(frames)
        pool.ask(Adding.process)
        with pytest.raises(MjrunError, match=r"a bug in mjrun, in a rendering process: ZeroDivisionError") as caught:
            list(frames)
    assert caught.value.exit_code == 70


@pytest.mark.parametrize("jobs", [1, 2])
def test_states_are_taken_only_as_frames_are_asked_for(jobs: int) -> None:
    taken = 0

    def states() -> Iterator[np.ndarray]:
        nonlocal taken
        for state in STATES:
            taken += 1
            yield state

    with closing(CompositorPool(Adding(), SHAPE, jobs, np.int64)) as pool:
        for index, frame in enumerate(pool.frames(states())):
            time.sleep(0.005)  # for the processes to run ahead
            assert taken <= index + SLOTS * jobs
            assert np.array_equal(frame, FRAMES[index])  # still what it was
    assert taken == len(STATES)


def test_every_process_is_one_of_its_own_with_one_thread_to_draw() -> None:
    environment = dict(os.environ)
    with closing(CompositorPool(Telling(delay=0.005), (2,), 2, np.int64)) as pool:
        told = {tuple(frame) for frame in pool.frames(STATES)}
    processes, threads = zip(*told, strict=True)
    assert len(set(processes)) == 2
    assert os.getpid() not in processes
    assert set(threads) == {1}
    assert os.environ == environment


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mischief", "how"),
    [
        ("is killed", "was killed by SIGKILL\nthe system does that when memory runs out; fewer jobs need less"),
        ("exits", "ended with code 4"),
    ],
)
def test_a_process_that_dies_is_reported_with_its_frame_and_its_end(mischief: str, how: str) -> None:
    with pytest.raises(DrawError) as caught:
        drawn(Adding({5: mischief}), 2)
    assert str(caught.value) == f"the process rendering frame 5 {how}"


def test_a_death_is_noticed_at_once_though_another_process_hangs() -> None:
    start = time.monotonic()
    with pytest.raises(DrawError, match="rendering frame 1 ended with code 3"):
        drawn(Adding({0: "hangs", 1: "ends"}), 2)
    assert time.monotonic() - start < HANG / 10


def limit_idleness(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    monkeypatch.setattr("mjrun.rendering.compositor_pool.IDLE", seconds)
    monkeypatch.setattr("mjrun.worker.IDLE_INTERVAL", 0.05)


def test_a_process_that_hangs_as_it_starts_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    limit_idleness(monkeypatch, 0.2)
    with pytest.raises(DrawError) as caught:
        drawn(Adding({OPENING: "stops"}), 2)
    assert str(caught.value) == (
        "a rendering process, as it started, did nothing any more\n"
        "the graphics driver may hang: try jobs 1, which needs no such process, or another gl"
    )
    assert caught.value.exit_code == 5


def test_a_process_that_hangs_as_it_renders_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(CompositorPool(Adding({3: "stops"}), SHAPE, 1, np.int64)) as pool:
        frames = pool.frames(STATES)
        made = [next(frames).copy() for _ in range(3)]
        limit_idleness(monkeypatch, 0.2)
        with pytest.raises(DrawError, match="the process rendering frame 3 did nothing any more\nthe graphics driver"):
            next(frames)
    assert np.array_equal(made, FRAMES[:3])


def test_a_process_that_hangs_as_it_starts_is_replaced_for_the_next_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(CompositorProcesses(1)) as workers:
        CompositorPool(Adding({OPENING: "stops"}), SHAPE, 1, np.int64, workers).close()
        (hanging,) = children()
        with monkeypatch.context() as patch:
            limit_idleness(patch, 0.2)
            pool = CompositorPool(Adding(), SHAPE, 1, np.int64, workers)
        with closing(pool):
            assert np.array_equal([frame.copy() for frame in pool.frames(STATES)], FRAMES)
        assert not alive(hanging)


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_what_a_compositor_raises_arrives_in_its_turn_as_it_was(jobs: int) -> None:
    made = []
    with closing(CompositorPool(Adding({7: "is unstable", 8: "divides"}, delay=0.002), SHAPE, jobs, np.int64)) as pool:
        frames = pool.frames(STATES)
        with pytest.raises(UnstableError) as caught:
            made.extend(frame.copy() for frame in frames)
    expected = UnstableError(7, 0.5, "qpos", "hinge", 0.002)
    assert (str(caught.value), caught.value.exit_code) == (str(expected), 4)
    assert (caught.value.step, caught.value.joint) == (7, "hinge")
    assert np.array_equal(made, FRAMES[:7])


def test_a_bug_in_a_process_is_a_bug_of_mjrun_and_keeps_its_traceback() -> None:
    with pytest.raises(MjrunError) as caught:
        drawn(Adding({3: "divides"}), 2)
    assert caught.value.exit_code == 70
    assert str(caught.value).startswith("a bug in mjrun, rendering frame 3: ZeroDivisionError: ")
    assert "in compose" in str(caught.value.__cause__)


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_compositor_that_cannot_be_opened_says_why(jobs: int) -> None:
    with pytest.raises(NoRendererError, match=r"egl: is not there\ninstall it") as caught:
        drawn(Adding({OPENING: "has no renderer"}), jobs)
    assert caught.value.tried == {"egl": "is not there"}


@pytest.mark.parametrize(
    ("mischief", "message"),
    [
        ("divides", r"a rendering process cannot start: ZeroDivisionError: .* \(compositors.py:\d+\)"),
        ("crashes", "a rendering process, as it started, was killed by SIGSEGV"),
    ],
)
def test_a_process_that_cannot_start_is_no_frame_s_fault(mischief: str, message: str) -> None:
    with pytest.raises(DrawError, match=message):
        drawn(Adding({OPENING: mischief}), 2)


def test_a_system_that_refuses_processes_is_reported_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(DrawError, match=r"several processes: .*/nowhere/python'\njobs 1"):
        CompositorPool(Adding(), SHAPE, 2)


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_whoever_takes_the_frames_ends_everything_at_once(jobs: int) -> None:
    start = time.monotonic()
    frames = iter([])
    with (
        contextlib.suppress(ZeroDivisionError),
        closing(CompositorPool(Adding({3: "hangs"}), SHAPE, jobs, np.int64)) as pool,
    ):
        frames = pool.frames(STATES)
        assert next(frames).size / 0
    with pytest.raises(ValueError, match="the pool is closed"):
        next(frames)
    assert time.monotonic() - start < HANG / 10


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_leaving_early_ends_everything_at_once(jobs: int) -> None:
    start = time.monotonic()
    frames = CompositorPool(Adding({3: "hangs"}), SHAPE, jobs, np.int64).frames(STATES)
    first = next(frames)
    del frames
    assert not children()
    assert np.array_equal(first, FRAMES[0])  # its memory lasts as long as it does
    assert time.monotonic() - start < HANG / 10


def test_states_of_different_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"a state must be float64 \(2,\), not float64 \(1,\)"):
        drawn(Adding(), 2, [STATES[0], np.zeros(1)])


def test_what_compositors_print_does_not_reach_standard_output(capfd: pytest.CaptureFixture[str]) -> None:
    assert np.array_equal(drawn(Adding({4: "prints"}), 2), FRAMES)
    assert capfd.readouterr() == ("", "from Python\nfrom a driver\n")


def test_mujoco_s_warnings_are_reported_once_by_the_parent(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(FALLING)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drawn(Warner(model=model), 2)
    assert len(caught) == 1
    assert "Nan, Inf or huge value in QPOS" in str(caught[0].message)
    assert caught[0].filename == __file__
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
SCRIPT = """
import sys
from contextlib import closing
import numpy as np
from mjrun.rendering.compositor_pool import CompositorPool
sys.path.append({here!r})
from compositors import Telling
with closing(CompositorPool(Telling({mischief}), (2,), 2, np.int64)) as pool:
    for frame in pool.frames(np.zeros(1) for _ in range({count})):
        print(frame[0], flush=True)
"""


def script(count: int, mischief: dict[int, str]) -> subprocess.Popen[str]:
    """A script without a main guard, read from standard input."""
    child = subprocess.Popen(
        [sys.executable, "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=ENVIRONMENT,
    )
    assert child.stdin
    child.stdin.write(SCRIPT.format(here=str(HERE), count=count, mischief=mischief))
    child.stdin.close()
    child.stdin = None
    return child


def test_a_script_from_standard_input_needs_no_main_guard() -> None:
    child = script(6, {})
    out, err = child.communicate(timeout=PATIENCE)
    assert (len(out.split()), err, child.returncode) == (6, "", 0)


def test_a_script_may_have_no_standard_input(tmp_path: Path) -> None:
    path = tmp_path / "script.py"
    path.write_text(SCRIPT.format(here=str(HERE), count=6, mischief={}))
    command = ["sh", "-c", 'exec "$0" "$1" <&-', sys.executable, str(path)]
    done = subprocess.run(command, capture_output=True, env=ENVIRONMENT, timeout=PATIENCE)
    assert (len(done.stdout.split()), done.stderr, done.returncode) == (6, b"", 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "number", "mischief"),
    [
        (os.kill, signal.SIGKILL, {20: "hangs"}),
        (os.killpg, signal.SIGINT, {}),
        (os.killpg, signal.SIGTERM, {20: "hangs"}),
    ],
)
def test_processes_end_with_their_parent_even_if_busy(
    end: Callable[[int, int], None], number: int, mischief: dict[int, str]
) -> None:
    child = script(10**9, mischief)
    assert child.stdout
    processes = {int(child.stdout.readline()) for _ in range(20)}
    assert len(processes) == 2
    end(child.pid, number)
    _, err = child.communicate(timeout=PATIENCE)
    assert child.returncode == -number
    assert err.count("Traceback") == (number == signal.SIGINT)
    deadline = time.monotonic() + HANG / 10
    while any(map(alive, processes)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(alive, processes))


def test_pixels_are_the_same_in_one_process_in_two_and_by_mujoco(
    swing: Path, backend: WorkingBackend, still: Callable[..., np.ndarray]
) -> None:
    size = (64, 48)
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    states, expected = [], []
    for angle in (0.0, 0.4, 0.8, 1.2):
        data.qpos[0] = angle
        mujoco.mj_forward(model, data)
        states.append(data.qpos.copy())
        expected.append(still(model, data, size, "side"))
    assert not np.array_equal(expected[0], expected[1])
    for jobs in (1, 2):
        with closing(CompositorPool(Drawing(model, backend, size), (size[1], size[0], 3), jobs)) as pool:
            assert np.array_equal([frame.copy() for frame in pool.frames(states)], expected)
