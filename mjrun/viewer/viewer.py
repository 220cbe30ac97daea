"""A live view of a simulation: MuJoCo's native viewer in a window, or MuJoCo Studio in a browser."""

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import field, replace
from fractions import Fraction

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import NoWindowError, UsageError, concerning, option
from mjrun.model import state
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.options.option import options
from mjrun.options.viewer import ViewerOptions
from mjrun.outputs.output import ReservedFiles
from mjrun.reporter import Reporter, WarningReporter, pass_on
from mjrun.simulation.episode import EpisodeResult
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import Simulation, require_simulation, require_whole
from mjrun.timeline import rational
from mjrun.viewer import window as windows
from mjrun.viewer.live_simulation import LiveSimulation, SessionRecording
from mjrun.viewer.window import (
    Action,
    Edit,
    Pull,
    ResetSimulation,
    SetPaused,
    SetSpeed,
    Status,
    TakeStep,
    UnsupportedAction,
    Window,
)

SCHEMA = "mjrun-view-1"
FRAME = 1 / 60  # [s] of wall time between images
PATIENCE = 1 / 15  # [s] maximum wall time for the steps between two images
FOREVER = Fraction(10**9)  # [s]
BREATH = 0.001  # [s] minimum left to other threads, which render
LATE = 0.1  # share of lost wall time above which a simulation is too slow
WATCHED = 3.0  # [s] of wall time before it is reported as too slow


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
            raise UsageError(f"{option('port')} requires a browser, but this view opens a window")

    def run(self, reporter: Reporter | None = None) -> "ViewerResult":
        """Shows the simulation until it ends; the recording is published in any case.

        Raises:
          SimulationError: the simulation became unstable.
          NoWindowError: neither a window nor a page can be opened.
          MjrunError: an input is invalid.
        """
        reporter = reporter or WarningReporter()
        start = time.perf_counter()
        with ExitStack() as stack:
            warnings = stack.enter_context(collected_warnings())
            model = self.simulation.load()
            for text in self._endless.remarks(model):
                reporter.warn(text)
            recording = stack.enter_context(self._open_recording(model)) if self.recording is not None else None
            live = LiveSimulation(self.simulation, model, reporter, recording)
            window = stack.enter_context(closing(self._open_window(live.model, reporter)))
            try:
                _Session(live, window, Pace(rational(model.opt.timestep), float(self.speed)), reporter).run(self.paused)
            finally:
                live.record_state()
                files = recording.publish() if recording else []
        if live.failure:  # which describes it better than MuJoCo's warning
            if files:
                live.failure.add_note(f"kept, up to there: {self.recording}")
            raise live.failure
        pass_on(warnings, reporter)
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
                "sizes": state.sizes(model),
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


class Pace:
    """The synchronization of steps with the wall clock, as far as the machine is fast enough.

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

    def __init__(self, live: LiveSimulation, window: Window, pace: Pace, reporter: Reporter) -> None:
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
        status = Status(instant.time, self._paused, pace.speed, achieved, message)
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
            case Pull():
                live.pull(action)
            case Edit():
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
