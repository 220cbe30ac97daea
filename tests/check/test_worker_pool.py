"""Theorems about the processes that check models."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mjrun.check import worker_pool
from mjrun.check.check import ModelCheck
from mjrun.check.worker_pool import FIX_TIME, CheckProcess, CheckProcessPool, CheckQueue, CheckRequest
from mjrun.platform import system
from mjrun.worker import Reply, Request
from tests.check.models import PASSIVE, checked, write
from tests.processes import PATIENCE

pytestmark = pytest.mark.usefixtures("new_interpreters")


def test_nothing_is_written_and_nothing_is_read_from_stdin() -> None:
    write("nan.xml", PASSIVE.format('damping="nan"'))
    before = sorted(Path().iterdir())
    code = "from mjrun.check.check import ModelCheck; print(ModelCheck(['nan.xml']).run().models[0].findings[0].code)"
    done = subprocess.run([sys.executable, "-c", code], input="unread", capture_output=True, text=True)
    assert done.stdout == "MJ110\n"
    assert sorted(Path().iterdir()) == before


def test_a_folder_of_models_is_no_place_for_modules() -> None:
    for name in ("json.py", "mujoco.py", "numpy.py", "mjrun.py"):
        write(name, "raise SystemExit(9)")
    assert checked(write("fine.xml", PASSIVE.format(""))).code == 0


def test_a_thread_goes_on_with_the_folder_of_its_last_model_and_each_model_is_taken_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    thread = SimpleNamespace(Lock=worker_pool.threading.Lock, get_ident=lambda: number)
    monkeypatch.setattr(worker_pool, "threading", thread)
    queue = CheckQueue([CheckRequest(path, (), 0, 1, 1) for path in ("a/1", "a/2", "b/3", "a/4", "c", "b/6")])
    taken = [[], []]
    for number in (0, 1, 0, 1, 1, 0):
        place, task = queue.take()
        taken[number].append(task.path)
        assert task.path.endswith(str(place + 1)) or task.path == "c"
    assert taken == [["a/1", "a/2", "a/4"], ["b/3", "b/6", "c"]]


def test_workers_that_were_ended_start_no_more() -> None:
    workers = CheckProcessPool()
    workers.end()
    assert workers.run(CheckRequest("a.xml", (), 0, 1, 1)).messages == ()


@pytest.mark.parametrize(
    ("ready", "done", "left", "pays"),
    [
        ([0.0], 0, 9, False),  # it is still starting
        ([8.0], 0, 9, True),  # the first model takes longer than the start
        ([9.95], 0, 9, False),
        ([8.0], 10, 4, False),  # 0.2 s each: 0.8 s are left, but a start takes 1 s
        ([8.0], 10, 6, True),
        ([8.0, 0.0], 10, 6, False),  # a second process starts already
        ([8.0, 0.0], 10, 11, True),
    ],
)
def test_another_process_starts_if_the_models_that_are_left_take_longer_than_its_start(
    monkeypatch: pytest.MonkeyPatch, ready: list[float], done: int, left: int, pays: bool
) -> None:
    monkeypatch.setattr(worker_pool, "time", SimpleNamespace(monotonic=lambda: 10.0))
    workers: Any = CheckProcessPool()
    assert workers._another_pays()
    workers._busy = [SimpleNamespace(created=each - 1, ready=each) for each in ready]
    workers._done, workers.left = done, left
    assert workers._another_pays() == pays


@pytest.mark.skipif(not system.CAN_FORK_LATE, reason="each process checks one model there")
def test_one_process_checks_models_until_one_crashes_it_and_says_why() -> None:
    write("a.xml", PASSIVE.format(""))
    task = CheckRequest("a.xml", (), 0, PATIENCE, 1024)
    workers = CheckProcessPool()
    broken = replace(task, path=write("a.yaml", ""), reader="missing_module:read")
    outputs = [workers.run(each) for each in (task, task, broken, task)]
    workers.end()
    first, second, unreadable, last = outputs
    assert [output.exit.code for output in outputs] == [0, 0, 1, 0]
    assert first.messages[-1] == second.messages[-1] == last.messages[-1] == {"done": True}
    assert "missing_module" in unreadable.stderr
    pids = [[message["pid"] for message in output.messages if "pid" in message] for output in outputs]
    assert [len(each) for each in pids] == [1, 0, 0, 1]


@pytest.mark.skipif(not system.CAN_FORK_LATE, reason="each process checks one model there")
def test_a_mesh_that_a_fix_has_changed_is_read_again() -> None:
    body = '<freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom type="mesh" mesh="m"/>'
    mesh = '<asset><mesh name="m" file="m.obj"/></asset>'
    write("a.xml", f"<mujoco>{mesh}<worldbody><body>{body}</body></worldbody></mujoco>")
    task = CheckRequest("a.xml", ("MJ207",), 0, PATIENCE, 1024, root=str(Path.cwd()), original="a.xml")
    workers, severities = CheckProcessPool(), list[str]()
    for size in ("1", ".01"):
        corners = f"v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 {size}"
        write("m.obj", f"{corners}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4")
        output = workers.run(task)
        assert output.exit.code == 0
        findings = [message["finding"] for message in output.messages if "finding" in message]
        severities += [finding["severity"] for finding in findings]
    workers.end()
    assert severities == ["note", "error"]


def test_a_slow_fix_is_reported_and_has_more_time_than_a_check() -> None:
    process, notes = CheckProcess(), list[str]()
    request = Request("check", ())
    for is_slow, seconds in ((True, PATIENCE + FIX_TIME), (False, PATIENCE)):
        item = Reply(request, {"stage": "decomposing mesh 'm'", "is_slow": is_slow}, is_last=False)
        process._worker.receive = iter([item, Reply(request, None)]).__next__  # type: ignore[method-assign]
        earliest = time.monotonic() + seconds
        task = CheckRequest("a.xml", (), 0, PATIENCE, 1024, model="a.xml")
        assert process.run(task, notes.append).exit.code == 0
        assert earliest <= process._deadline <= time.monotonic() + seconds
    assert notes == ["a.xml: decomposing mesh 'm'"]
    assert process.ready >= process.created
    process.end()


@pytest.mark.parametrize("value", [[1], "loaded", None, {"pid": "1"}, {"suppressed": "1"}, {"unknown": 1}])
def test_a_process_that_sends_an_invalid_message_has_failed_and_checks_no_other_model(value: object) -> None:
    process, request = CheckProcess(), Request("check", ())
    items = [Reply(request, each, is_last=False) for each in ({"stage": "loading it"}, value)]
    process._worker.receive = iter(items).__next__  # type: ignore[method-assign]
    output = process.run(CheckRequest("a.xml", (), 0, PATIENCE, 1024))
    assert (output.messages, output.exit.code, process.is_reusable) == ([{"stage": "loading it"}], 1, False)
    finding = ModelCheck(["a.xml"])._failure(Path("a.xml"), output)
    assert finding.message == "mjrun failed while loading it: its process sent an invalid message"
    process.end()


@pytest.mark.parametrize(("seconds", "memory", "cause"), [(-1, 2**40, "time"), (PATIENCE, 0, "memory")])
def test_a_process_that_is_silent_is_killed_if_it_exceeds_a_limit(seconds: float, memory: int, cause: str) -> None:
    process = CheckProcess()
    process._deadline = time.monotonic() + seconds
    looks = iter([False, True])
    process._watch(memory, cast("Any", SimpleNamespace(wait=lambda seconds: next(looks))))
    assert process._worker.process.wait().cause == cause
    process.end()
