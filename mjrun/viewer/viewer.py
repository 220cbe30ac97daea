"""A live view of a simulation: MuJoCo's native viewer in a window, or MuJoCo Studio in a browser."""

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import field, replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError, NoWindowError, SimulationError, UsageError, clean, concerning, option
from mjrun.formats.recording import RecordingWriter
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings, report_warnings
from mjrun.model.source import physics_fingerprint
from mjrun.options.option import options
from mjrun.options.viewer import ViewerOptions
from mjrun.outputs.output import ReservedFiles
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.stepper import EditableStepper, Stepper
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.shared_status import completing, uninterrupted
from mjrun.simulation.origin import origin
from mjrun.simulation.policy_episode import EpisodeResult
from mjrun.simulation.simulation import Simulation, require_simulation, require_whole
from mjrun.task.episode import Ending, EpisodeStepper
from mjrun.timeline import rational
from mjrun.viewer import window as windows
from mjrun.viewer.actions import (
    Action,
    PullBodies,
    ResetSimulation,
    SetPaused,
    SetSpeed,
    SetStateNumbers,
    SimulationStatus,
    TakeStep,
    UnsupportedAction,
)
from mjrun.viewer.window import Window

SCHEMA = "mjrun-view-1"
FRAME = 1 / 60  # [s] of wall time between images
PATIENCE = 1 / 15  # [s] maximum wall time for the steps between two images
FOREVER = Fraction(10**9)  # [s]
BREATH = 0.001  # [s] minimum left to other threads, which render
LATE = 0.1  # share of lost wall time above which a simulation is too slow
WATCHED = 3.0  # [s] of wall time before it is reported as too slow


class SessionRecording:
    """A recording that can be restarted; only the last one is published.

    Args:
      path: a .npz file, whose location is checked to be writable at once.
      size: numbers in a state.
      facts: facts about its origin; `steps`, of the simulation, is added at the end.

    Raises:
      UsageError: the path has another suffix.
      FileError: the file cannot be written.
    """

    def __init__(self, path: str, size: int, facts: Mapping[str, object]) -> None:
        self.path = path
        self._size, self._facts = size, dict(facts)
        self._writer = RecordingWriter(path, size, self._facts)

    @property
    def count(self) -> int:
        """The number of recorded states."""
        return self._writer.count

    def write(self, step: int, state: np.ndarray) -> None:
        """Adds the state `(size,)` at `step`, unless already recorded: 0 at first, then increasing."""
        if step > self._writer.last:
            self._writer.write(step, state)

    def restart(self) -> None:
        """Discards all states."""
        if self.count:
            with uninterrupted():
                self._writer.close()
                self._writer = RecordingWriter(self.path, self._size, self._facts)

    def publish(self) -> list[Path]:
        """Publishes the recording if it holds any state."""
        if not self.count:
            return []
        self._facts["steps"] = self._writer.last
        return self._writer.publish()

    def __enter__(self) -> "SessionRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()


class LiveSimulation:
    """An interactive simulation: users can perturb bodies, set controls and positions, and reset it.

    Without interaction it is bit for bit the simulation of every other command. A recording always holds true physics:
    the state of each step from time 0, with the inputs that act from then on. Forces of the mouse and controls are such
    inputs; positions set by hand are not, and are refused during a recording.

    Args:
      recording: receives the states of all steps, if set.

    Attributes:
      last: the last step; None if there is no end.
      ends_by_itself: whether the user set its duration.
      failure: the error that prevents further steps, if any.

    Raises:
      UsageError: the replayed recording lacks steps.
    """

    def __init__(
        self,
        simulation: Simulation,
        model: mujoco.MjModel,
        reporter: Reporter,
        recording: SessionRecording | None = None,
    ) -> None:
        self._simulation, self._model, self._reporter, self._recording = simulation, model, reporter, recording
        self._layout = state.fields(state.sizes(model))
        self._is_state = np.ones(state.size(model), bool)  # rather than an input
        for name in self._layout.keys() & INPUTS:
            self._is_state[self._layout[name]] = False
        self._reported: set[str] = set()
        self.ends_by_itself = simulation.duration is not None or simulation.steps is not None
        has_end = self.ends_by_itself or simulation.replay is not None  # an episode ends when it does
        self.last = simulation.timeline(model).steps if has_end else None
        self.reset()

    def reset(self, key: int | None = None) -> None:
        """Restarts from time 0, at the simulation's start or at the keyframe with this index."""
        simulation = self._simulation
        if key is not None and simulation.policy is not None:
            self.refuse(EPISODE)
        elif key is not None and simulation.replay is None:
            simulation = replace(simulation, key=self._model.key(key).name or str(key))
        self._stepper: Stepper = simulation.stepper(self._model)
        if isinstance(self._stepper, ReplayStepper) and self.last is not None:
            self._stepper.require(range(self.last + 1))
        self._pull: np.ndarray | None = None
        self.failure: SimulationError | None = None
        if self._recording:
            self._recording.restart()

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is stepped."""
        return self._stepper.model

    @property
    def step(self) -> int:
        """The current step."""
        return self._stepper.step

    @property
    def is_over(self) -> bool:
        """True if there is no next step."""
        return self.failure is not None or self.step == self.last or (self.ending is not None and self.last is None)

    @property
    def ending(self) -> Ending | None:
        """The ending of the policy's episode, if it has ended."""
        return self._stepper.now().ending if isinstance(self._stepper, EpisodeStepper) else None

    @property
    def episode(self) -> EpisodeResult | None:
        """The result of the policy's episode so far; None if there is no policy."""
        episode, stepper = self._simulation.episode, self._stepper
        return episode.result(stepper) if episode and isinstance(stepper, EpisodeStepper) else None

    def instant(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to the step; not to be stored or modified."""
        return self._stepper.instant()

    def take_step(self) -> None:
        """Takes a step unless the simulation is over; an error that prevents it becomes the `failure`."""
        if self.is_over:
            return
        try:
            if isinstance(self._stepper, EditableStepper) and self._pull is not None:
                self._take_step_under(self._stepper, self._pull)
            else:
                self.record_state()
                self._stepper.advance(self.step + 1)
        except SimulationError as error:
            self.failure = error

    def pull(self, action: PullBodies) -> None:
        """Applies the forces of the mouse to bodies from this step on."""
        if action.forces.any() and not isinstance(self._stepper, EditableStepper):
            self._refuse_hands()
            return
        self._pull = action.forces if action.forces.any() else None

    def edit(self, action: SetStateNumbers) -> None:
        """Applies an edit, if allowed."""
        if not isinstance(self._stepper, EditableStepper):
            self._refuse_hands()
        elif self._recording and (action.changed & self._is_state).any():
            self.refuse(RECORDED)
        else:
            values = self._stepper.state()
            values[action.changed] = action.state[action.changed]
            self._stepper.edit(values, state.STATE)

    def refuse(self, action: UnsupportedAction) -> None:
        """Reports an unsupported action, once."""
        if action.what not in self._reported:
            self._reported.add(action.what)
            self._reporter.note(action.what)

    def _refuse_hands(self) -> None:
        self.refuse(REPLAY if isinstance(self._stepper, ReplayStepper) else ENVIRONMENT)

    def record_state(self) -> None:
        """Adds the current state to the recording, if any."""
        if self._recording:
            self._recording.write(self.step, self._stepper.state())

    def _take_step_under(self, stepper: EditableStepper, pull: np.ndarray) -> None:
        """Takes a step with the forces of the mouse added to the others, and removes them afterwards."""
        spec, where = state.APPLIED_FORCES, self._layout["xfrc_applied"]
        own = stepper.state()[where]
        applied = own + pull.ravel()
        stepper.edit(applied, spec)
        self.record_state()
        try:
            stepper.advance(self.step + 1)
        finally:
            now = stepper.state()[where]  # a controller or a push may have changed some of them on arrival
            stepper.edit(np.where(now == applied, own, now), spec)


# Fields of MjData that are set from outside and affect the state.
INPUTS = {"ctrl", "qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat", "userdata"}
REPLAY = UnsupportedAction("a replay shows recorded states: bodies cannot be pulled or edited")
ENVIRONMENT = UnsupportedAction("an environment steps itself: bodies cannot be pulled or edited")
EPISODE = UnsupportedAction("an episode of a policy starts as its task defines, not at a keyframe")
RECORDED = UnsupportedAction(
    "positions and velocities cannot be edited during a recording, which holds only physics: "
    "pull bodies or set controls instead"
)


@options
class Viewer(ViewerOptions):
    """A live view of a simulation: its options are keywords.

    The simulation begins as soon as the view is visible, and lasts until the view is closed, or for its `duration` or
    `steps`; a replay stays at its last state. It is bit for bit the simulation that a trace measures, until a user
    perturbs or edits it.

    Args:
      simulation: the simulation to show.
      command: the command line, for the recording.
    """

    simulation: Simulation = field(kw_only=False)
    command: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)
        require_whole(self.simulation, "a view, which the user ends")
        if self.port is not None and self.browser is False:
            raise UsageError(f"{option('port')} requires {option('browser')}, but this view opens a window")

    def run(self, reporter: Reporter | None = None) -> "ViewerResult":
        """Shows the simulation until it ends; the recording is published in any case.

        Raises:
          SimulationError: the simulation became unstable.
          NoWindowError: neither a window nor a page can be opened.
          MjrunError: an input is invalid.
        """
        reporter = reporter or PythonApiReporter()
        start = time.perf_counter()
        with ExitStack() as completion, ExitStack() as stack:
            warnings = stack.enter_context(collected_warnings())
            model = self.simulation.load()
            for text in self._endless.remarks(model):
                reporter.warn(text)
            recording = stack.enter_context(self._open_recording(model)) if self.recording is not None else None
            live = LiveSimulation(self.simulation, model, reporter, recording)
            window = stack.enter_context(closing(self._open_window(live.model, reporter)))
            session = _Session(live, window, Pacer(rational(model.opt.timestep), float(self.speed)), reporter)
            try:
                session.run(self.paused)
                if live.failure:  # which describes it better than MuJoCo's warning
                    raise live.failure
            except BaseException as end:  # an interruption too, which an error of the recording would replace
                if recording:
                    completion.enter_context(completing())  # or else this process may be killed before it reports
                    _publish_after(end, live, recording)
                raise
            files = _publish(live, recording) if recording else []
        report_warnings(warnings, reporter)
        return ViewerResult(
            kind=window.kind,
            steps=live.step,
            simulated=float(live.step * rational(model.opt.timestep)),
            wall=time.perf_counter() - start,
            recording=self.recording if files else None,
            states=recording.count if recording else None,
            warnings=tuple(warnings),
            episode=live.episode,
        )

    @property
    def _endless(self) -> Simulation:
        """The simulation, with an endless duration unless it sets one."""
        simulation = self.simulation
        return simulation if simulation.has_end else replace(simulation, duration=FOREVER)

    def _open_recording(self, model: mujoco.MjModel) -> SessionRecording:
        assert self.recording is not None
        reserved = ReservedFiles()
        for what, path in self.simulation.inputs:
            reserved.reserve_input(path, f"the {what}, which is read")
        with concerning("recording"):
            reserved.reserve(self.recording, "the recording")
            timeline = self.simulation.timeline(model)
            facts = {
                **origin(self, self.simulation, model, timeline),
                **state.layout(model),
                "physics": physics_fingerprint(model),
            }
            return SessionRecording(self.recording, state.size(model), facts)

    def _open_window(self, model: mujoco.MjModel, reporter: Reporter) -> Window:
        """Opens the window or the page, whichever is requested and available."""
        reasons: dict[str, str] = {}
        if not self.browser and self.port is None:
            reasons["window"] = windows.native_obstacle()
            if not reasons["window"]:
                return windows.NativeWindow(model)
        if self.browser is not False:
            reasons["browser"] = windows.browser_obstacle()
            if not reasons["browser"]:
                page = windows.BrowserWindow(model, self.port, float(self.speed))
                why = f"{reasons['window']}; " if "window" in reasons else ""
                reporter.ask(f"{why}open {page.url} in a browser on this machine; the simulation begins then")
                return page
        raise NoWindowError(reasons)


def _publish(live: LiveSimulation, recording: SessionRecording) -> list[Path]:
    live.record_state()
    return recording.publish()


def _publish_after(end: BaseException, live: LiveSimulation, recording: SessionRecording) -> None:
    """Publishes the recording of a session that ended with an exception, which gets a note about it."""
    try:
        if _publish(live, recording):
            end.add_note(f"the recording up to there was saved: {clean(recording.path)}")
    except MjrunError as error:
        end.add_note(f"the recording was not saved: {error}")


@dataclass(frozen=True)
class ViewerResult:
    """The result of a live view.

    Attributes:
      kind: `window` or `browser`.
      steps: steps since the last reset.
      simulated: simulated time since then [s].
      wall: total wall time [s].
      recording: the path of the recording, or None.
      states: number of recorded states; None if there is no recording.
      warnings: MuJoCo's warnings.
      episode: result of the policy's episode since the last reset; None if there is no policy.
      schema: schema of this document.
    """

    kind: str
    steps: int
    simulated: float
    wall: float
    recording: str | None
    states: int | None
    warnings: Sequence[str]
    episode: EpisodeResult | None = None
    schema: str = SCHEMA


class Pacer:
    """A synchronizer of steps with the wall clock, as far as the machine is fast enough.

    Args:
      timestep: timestep of the simulation [s].
      speed: simulated seconds per second of wall time.

    Attributes:
      speed: current speed; after a change, call `start` again.
    """

    def __init__(self, timestep: Fraction, speed: float) -> None:
        self.speed = speed
        self._timestep = float(timestep)
        self.start(0, 0.0)

    def start(self, step: int, now: float) -> None:
        """Starts the count: `step` belongs to the wall time `now` [s]."""
        self._first, self._begin = step, now
        self._lost = 0.0  # [s] of wall time

    def due(self, now: float) -> int:
        """Returns the step due at `now` [s]."""
        return self._first + math.floor((now - self._begin - self._lost) * self.speed / self._timestep)

    def give_up(self, step: int, now: float) -> None:
        """Accepts that `step` is reached only at `now` [s]; lost time is never caught up."""
        self._lost = now - self._begin - (step - self._first) * self._timestep / self.speed

    def is_too_slow(self, now: float) -> bool:
        """Returns whether a considerable share of the wall time until `now` [s] was lost."""
        ran = now - self._begin
        return ran > WATCHED and self._lost > LATE * ran

    def achieved(self, step: int, now: float) -> float:
        """Returns simulated seconds per second of wall time since the start, when `step` is reached at `now` [s]."""
        ran = now - self._begin
        return (step - self._first) * self._timestep / ran if ran > 0 else self.speed


class _Session:
    """The loop of a live view, in time with the wall clock, image by image."""

    def __init__(self, live: LiveSimulation, window: Window, pace: Pacer, reporter: Reporter) -> None:
        self._live, self._window, self._pace, self._reporter = live, window, pace, reporter
        self._paused = self._warned_slow = False
        self._ends = live.ends_by_itself

    def run(self, paused: bool) -> None:
        """Runs until the window is closed or the simulation has reached its end."""
        self._pause(paused)
        while self._window.is_open and not (self._ends and self._live.is_over):
            start = time.perf_counter()
            self._show()
            if not self._window.is_seen:
                self._pace.start(self._live.step, time.perf_counter())
            elif not self._paused:
                self._advance()
            time.sleep(max(BREATH, start + FRAME - time.perf_counter()))
        if self._window.is_open:
            self._show()

    def _show(self) -> None:
        """Shows the current state, and performs the user's actions."""
        live, pace = self._live, self._pace
        now = time.perf_counter()
        achieved = 0.0 if self._paused else pace.achieved(live.step, now)
        message = "unstable" if live.failure else "ended" if live.ending else ""
        instant = live.instant()
        status = SimulationStatus(instant.time, self._paused, pace.speed, achieved, message)
        for action in self._window.show(instant, status):
            self._do(action)

    def _do(self, action: Action) -> None:
        live = self._live
        match action:
            case SetPaused(paused):
                self._pause(paused)
            case TakeStep():
                self._pause(True)
                live.take_step()
            case SetSpeed(speed):
                self._pace.speed = speed
                self._pause(self._paused)
            case ResetSimulation(key):
                live.reset(key)
                self._pause(self._paused)
            case PullBodies():
                live.pull(action)
            case SetStateNumbers():
                live.edit(action)
            case UnsupportedAction():
                live.refuse(action)

    def _pause(self, paused: bool) -> None:
        self._paused = paused
        self._pace.start(self._live.step, time.perf_counter())

    def _advance(self) -> None:
        """Takes the steps that are due; if that takes too long, the rest are dropped."""
        live, pace = self._live, self._pace
        start = now = time.perf_counter()
        due = pace.due(start)
        while live.step < due and not live.is_over and now - start < PATIENCE:
            live.take_step()
            now = time.perf_counter()
        if live.is_over:
            self._stop()
        elif live.step < due:
            pace.give_up(live.step, now)
            self._warn_if_slow(now)

    def _stop(self) -> None:
        """Holds the last state, which remains visible until the window is closed."""
        self._pause(True)
        if self._live.failure and not self._ends:
            first, *_ = str(self._live.failure).splitlines()
            self._reporter.warn(f"{first}; the view shows the state before it until it is closed or reset")
        elif (episode := self._live.episode) and episode.ending is not None:
            self._reporter.note(f"{episode.sentence}; a reset restarts it")

    def _warn_if_slow(self, now: float) -> None:
        if not self._warned_slow and self._pace.is_too_slow(now):
            self._warned_slow = True
            achieved = self._pace.achieved(self._live.step, now)
            self._reporter.warn(f"this machine simulates at a speed of {achieved:.2g}, not {self._pace.speed:g}")
