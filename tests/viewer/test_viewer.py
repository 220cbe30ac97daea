"""A live view from beginning to end, in Python: what it makes, what it refuses, and what it leaves."""

import shutil
import signal
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import NoWindowError, TerminatedError, UnstableError, UsageError
from mjrun.outputs.recording import Recording
from mjrun.shared_status import ProcessActivityMemory, record_status_in
from mjrun.simulation.simulation import Simulation
from mjrun.viewer import window as windows
from mjrun.viewer.actions import (
    Action,
    PullBodies,
    ResetSimulation,
    SetPaused,
    SetSpeed,
    SimulationStatus,
    TakeStep,
    UnsupportedAction,
)
from mjrun.viewer.viewer import WATCHED, Pacer, Viewer
from tests.conftest import Command
from tests.reporters import RecordingReporter


class ScriptedWindow:
    """A window whose users do what a script says, at each image.

    Args:
      script: what is done at each image, and None for closing the window.
    """

    kind = "window"

    def __init__(self, script: Sequence[Sequence[Action] | None], seen_at: int = 0) -> None:
        self._script, self._seen_at = list(script), seen_at
        self.statuses: list[SimulationStatus] = []
        self.positions: list[bytes] = []
        self.is_open, self.is_closed = True, False

    @property
    def is_seen(self) -> bool:
        return len(self.statuses) > self._seen_at

    def show(self, instant: mujoco.MjData, status: SimulationStatus) -> list[Action]:
        self.statuses.append(status)
        self.positions.append(instant.qpos.tobytes())
        actions = self._script.pop(0) if self._script else []
        self.is_open = self.is_open and actions is not None
        return list(actions or [])

    def close(self) -> None:
        self.is_closed = True


Opened = Callable[..., ScriptedWindow]


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Opened:
    """Opens a scripted window instead of MuJoCo's."""

    def scripted(*script: Sequence[Action] | None, seen_at: int = 0) -> ScriptedWindow:
        made = ScriptedWindow(script, seen_at)
        monkeypatch.setattr(windows, "native_obstacle", lambda: "")
        monkeypatch.setattr(windows, "NativeWindow", lambda model: made)
        return made

    return scripted


def test_it_ends_after_its_duration_with_the_recording_that_every_command_makes(
    window: Opened, swing: Path, tmp_path: Path
) -> None:
    shown, simulation = window(), Simulation(str(swing), duration=0.3)
    result = Viewer(simulation, speed=5, recording=str(tmp_path / "seen.npz")).run()
    Recording(simulation, str(tmp_path / "bare.npz")).run()
    seen, bare = np.load(tmp_path / "seen.npz"), np.load(tmp_path / "bare.npz")
    assert seen["states"].tobytes() == bare["states"].tobytes()
    assert seen["steps"].tolist() == bare["steps"].tolist()
    assert (result.steps, result.states, result.kind) == (150, 151, "window")
    assert shown.is_closed
    assert shown.positions[-1] == bare["states"][-1, 1:9].tobytes()  # the end is seen too
    assert all(status.time <= 0.3 + 1e-9 for status in shown.statuses)


def test_pause_step_speed_and_reset(window: Opened, swing: Path, tmp_path: Path) -> None:
    steps = [[TakeStep()]] * 3
    shown = window([], [SetPaused(True), ResetSimulation()], *steps, [SetSpeed(0.5)], [], None)
    result = Viewer(Simulation(str(swing)), paused=True, recording=str(tmp_path / "seen.npz")).run()
    times = [round(status.time / 0.002) for status in shown.statuses]
    assert times == [0, 0, 0, 1, 2, 3, 3, 3]
    assert [status.speed for status in shown.statuses] == [1] * 6 + [0.5] * 2
    assert all(status.paused for status in shown.statuses)
    assert (result.steps, result.states) == (3, 4)
    states = np.load(tmp_path / "seen.npz")["states"]
    data = mujoco.MjData(mujoco.MjModel.from_xml_path(str(swing)))
    mujoco.mj_step(mujoco.MjModel.from_xml_path(str(swing)), data, nstep=3)
    assert states[-1, 1:9].tobytes() == data.qpos.tobytes()


def test_nothing_happens_before_anybody_sees_it(window: Opened, swing: Path) -> None:
    shown = window(*[[]] * 9, seen_at=5)
    Viewer(Simulation(str(swing), steps=20), speed=10).run()
    assert [status.time for status in shown.statuses[:6]] == [0.0] * 6


def test_a_force_of_the_mouse_is_in_the_recording(window: Opened, swing: Path, tmp_path: Path) -> None:
    forces = np.zeros((3, 6))
    forces[2, 2] = 50  # the ball is lifted
    window([PullBodies(forces), TakeStep()], [TakeStep()], [PullBodies(0 * forces), TakeStep()], None)
    Viewer(Simulation(str(swing)), paused=True, recording=str(tmp_path / "seen.npz")).run()
    model = mujoco.MjModel.from_xml_path(str(swing))
    data, states = mujoco.MjData(model), np.load(tmp_path / "seen.npz")["states"]
    for row in states:
        assert row[: 1 + model.nq].tolist() == [data.time, *data.qpos]
        data.xfrc_applied[:] = forces if data.time < 0.003 else 0
        mujoco.mj_step(model, data)


def test_an_unstable_simulation_is_held_and_told_and_then_ends_with_its_error(
    window: Opened, exploding: Path, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    shown = window(*[[]] * 60, None)
    path = tmp_path / "seen.npz"
    with pytest.raises(UnstableError) as caught:
        Viewer(Simulation(str(exploding), key="fast"), speed=10, recording=str(path)).run()
    assert shown.statuses[-1].paused
    assert shown.statuses[-1].message == "unstable"
    assert shown.is_closed
    states = np.load(path)["states"]
    assert len(states) == caught.value.step + 1
    assert any("the view shows the state before it" in str(warning.message) for warning in recwarn)


def test_where_it_was_said_how_long_an_instability_ends_it(window: Opened, exploding: Path) -> None:
    shown = window()
    with pytest.raises(UnstableError):
        Viewer(Simulation(str(exploding), key="fast", duration=20), speed=100).run()
    assert shown.is_closed


def test_what_a_view_does_not_do_is_reported_once(window: Opened, swing: Path) -> None:
    window(
        [UnsupportedAction("not this"), UnsupportedAction("not this")],
        [UnsupportedAction("not this")],
        [UnsupportedAction("nor that")],
        None,
    )
    reporter = RecordingReporter()
    Viewer(Simulation(str(swing)), paused=True).run(reporter)
    assert reporter.texts == ["not this", "nor that"]


def test_whatever_ends_it_the_recording_is_kept_and_the_window_closed(
    window: Opened, swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = window()
    show = shown.show

    def interrupted(instant: mujoco.MjData, status: SimulationStatus) -> list[Action]:
        if len(shown.statuses) == 4:
            raise KeyboardInterrupt
        return [*show(instant, status), TakeStep()]

    monkeypatch.setattr(shown, "show", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Viewer(Simulation(str(swing)), paused=True, recording=str(tmp_path / "seen.npz")).run()
    assert shown.is_closed
    assert np.load(tmp_path / "seen.npz")["steps"].tolist() == [0, 1, 2, 3, 4]


def test_a_process_that_has_saved_its_recording_is_not_killed_before_it_says_so(
    window: Opened, swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, shown = ProcessActivityMemory(), window()
    is_completing = list[bool]()

    def interrupted(*_: object) -> list[Action]:
        raise KeyboardInterrupt

    monkeypatch.setattr(shown, "show", interrupted)
    monkeypatch.setattr(shown, "close", lambda: is_completing.append(memory.completing))
    record_status_in(memory)
    try:
        with pytest.raises(KeyboardInterrupt):
            Viewer(Simulation(str(swing)), recording=str(tmp_path / "seen.npz")).run()
    finally:
        record_status_in(None)
    assert is_completing == [True]
    assert not memory.completing


def test_a_port_without_a_browser_is_refused_by_both_names(swing: Path) -> None:
    with pytest.raises(UsageError, match=r"^port requires browser, but this view opens a window"):
        Viewer(Simulation(str(swing)), port=8090, browser=False)


def test_where_nothing_can_be_shown_both_reasons_are_given(monkeypatch: pytest.MonkeyPatch, swing: Path) -> None:
    monkeypatch.setattr(windows, "native_obstacle", lambda: "no display")
    monkeypatch.setattr(windows, "browser_obstacle", lambda: "no Studio")
    for browser, reasons in [
        (None, {"window": "no display", "browser": "no Studio"}),
        (True, {"browser": "no Studio"}),
        (False, {"window": "no display"}),
    ]:
        with pytest.raises(NoWindowError) as caught:
            Viewer(Simulation(str(swing)), browser=browser).run()
        assert caught.value.tried == reasons
        assert caught.value.exit_code == 5


def test_what_cannot_be_together_is_refused(swing: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="port"):
        Viewer(Simulation(str(swing)), browser=False, port=8080)
    copy = tmp_path / "copy.npz"
    Recording(Simulation(str(swing), steps=2), str(copy)).run()
    with pytest.raises(UsageError, match="which is read"):
        Viewer(Simulation(str(swing), replay=str(copy)), recording=str(copy)).run()


@given(st.integers(0, 1000), st.floats(0, 100), st.sampled_from([0.25, 1.0, 4.0]))
def test_the_step_that_is_due_is_the_last_whose_time_has_come(first: int, elapsed: float, speed: float) -> None:
    pace = Pacer(Fraction(1, 64), speed)  # exact in floats
    pace.start(first, 1024.0)
    due = pace.due(1024.0 + elapsed) - first
    assert due / 64 <= (1024.0 + elapsed - 1024.0) * speed < (due + 1) / 64


def test_what_is_given_up_is_not_caught_up_with() -> None:
    pace = Pacer(Fraction(1, 100), 1.0)
    pace.start(0, 10.0)
    assert pace.due(12.0) == 200
    pace.give_up(50, 12.0)
    assert pace.due(12.0) == 50
    assert pace.due(12.505) == 100


@pytest.mark.parametrize(("reached", "slow"), [(1000, False), (950, False), (400, True)])
def test_it_is_too_slow_when_a_good_share_was_given_up(reached: int, slow: bool) -> None:
    pace = Pacer(Fraction(1, 100), 1.0)
    pace.start(0, 0.0)
    pace.give_up(reached, 10.0)
    assert pace.is_too_slow(10.0) == slow
    assert pace.achieved(reached, 10.0) == reached / 1000


def test_nothing_is_reported_of_a_short_stall_at_the_beginning() -> None:
    pace = Pacer(Fraction(1, 100), 1.0)
    pace.start(0, 0.0)
    pace.give_up(0, WATCHED / 2)
    assert not pace.is_too_slow(WATCHED / 2)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("is_removed", [False, True], ids=["saved", "lost"])
def test_an_interrupted_session_reports_what_became_of_its_recording(
    window: Opened,
    swing: Path,
    mjrun_here: Command,
    monkeypatch: pytest.MonkeyPatch,
    is_removed: bool,
    number: signal.Signals,
) -> None:
    shown, folder = window(), Path("out")
    folder.mkdir()

    def interrupted(*_: object) -> list[Action]:
        if is_removed:
            shutil.rmtree(folder)
        raise KeyboardInterrupt if number == signal.SIGINT else TerminatedError(number)

    monkeypatch.setattr(shown, "show", interrupted)
    done = mjrun_here("view", str(swing), "-q", "--recording", "out/run.npz")
    outcome = (
        "the recording was not saved: out/run.npz: cannot be written: No such file or directory"
        if is_removed
        else "the recording up to there was saved: out/run.npz"
    )
    first = "mjrun: error: " + ("interrupted" if number == signal.SIGINT else "ended by SIGTERM")
    assert (done.returncode, done.stderr.decode()) == (128 + number, f"{first}\n  {outcome}\n")
    assert Path("out/run.npz").exists() is not is_removed
