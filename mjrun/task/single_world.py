"""A single world of a task, stepped with the least possible overhead around the physics, by control or physics steps.

Where a physics step takes microseconds, NumPy calls on arrays of one world dominate. Here the measurements are selected
once, and expressions are compiled to Python. Every number is identical to that of `TaskWorlds`.
"""

import math
from collections.abc import Callable, Iterator
from contextvars import Context
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import SimulationError as BatchError

from mjrun.model import state
from mjrun.model.mujoco_globals import without_timers
from mjrun.model.state import is_bounded
from mjrun.options.task import LAGGED
from mjrun.physics.control import ControlSources
from mjrun.physics.stepper import SLEEP, STATE, PhysicsStepper
from mjrun.task.batch_columns import ACCELERATION, ALL, NONE, BatchColumns, MeasurementPlan, Rows, SingleMjData
from mjrun.task.episode import Actor, ControlInstant, Ending, EpisodeColumnNames, ask
from mjrun.task.expressions import RUNNING, ExpressionInputs, Fill, Judge
from mjrun.task.task import Task
from mjrun.task.worlds import TaskStep, TaskWorlds, action_array
from mjrun.timeline import rational

NO_COMMANDS = np.zeros(0)


class SingleWorld(TaskWorlds):
    """A single world of a task.

    Args:
      task: a task with its model.

    Attributes:
      holds_targets: whether controls change at every step, to hold positions or velocities.
      stage: the last stage that MuJoCo must compute for measurements in another MjData, `mjtStage`.
      whole_state: its integration state `(nstate,)`, which may be written.
      controls: the controls without noise `(nu,)`.

    Raises:
      UsageError, ModelError, FileError: as `TaskWorlds`.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task, 1, 1)
        self._action, self._target, self._only_observed = self._actions[0], self._targets[0], self._observed[0]
        self._only_motion, self._only_warnings = self._motion[0], self._warnings[0]
        self._without_timers = without_timers()
        self._shape, self.holds_targets = self._action.shape, self._torques.is_needed
        self.whole_state, self.controls = self._state[0], self.disturbances.controls[0]
        self._direct = self._torques.direct_controls
        self._has_commands = bool(self.commands.names)
        self._has_inputs = self._has_commands or self._observations.has_inputs
        self._commands_read = np.zeros(len(self.commands.names))  # by expressions
        plan = self._plan  # sensors that it appends are missing in another MjData
        self._plan_alone = MeasurementPlan(self.model(0), plan.names, can_sense=False) if plan.sensed else plan
        self.stage = max(self._plan_alone.stage, self._stage_of_frames)
        self._no_inputs = ExpressionInputs(0, self._action, NO_COMMANDS)
        self._ignoring = Context()  # `np.errstate` takes longer than small expressions
        self._ignoring.run(np.seterr, all="ignore")
        self._source: SingleMjData | None = None  # of another MjData that is read
        self._start_functions = self._functions_of(self._measurement, is_first=True)
        self._functions = self._own_functions = self._functions_of(self._measurement)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task,), self._saved()

    def start(self, seed: int) -> np.ndarray:
        """Begins the episode of `seed`; returns the first observation `(nobs,)`.

        Raises:
          UsageError, ModelError: the model of this episode cannot be loaded.
        """
        with self.task.located():
            self._load(seed, 0)
            self._set_models()
        self._instants[0] = 0
        self._action[:] = 0
        self._over[0] = self._failed[0] = False
        self._counters[0] = 0
        self._forward(self._stage_at_start)
        self._measurement.begin(ALL)
        self._functions, self._source = self._own_functions, None
        self._observations.rotations = self._rotations

        functions = self._start_functions
        if functions.update:
            functions.update()
        observed = self._ignoring.run(self._start, functions) if functions.uses_numpy else self._start(functions)
        self._only_observed[:] = observed
        return observed

    def act(self, action: np.ndarray) -> TaskStep:
        """Steps the world by a control period under `action` `(nact,)`; the results have no axis of worlds.

        Raises:
          ValueError: as `apply`.
        """
        self.apply(action)
        self._step(self.control_steps, self._stage)
        return self._results()

    # --- step by step ------------------------------------------------------------------------------

    def apply(self, action: np.ndarray) -> None:
        """Begins a control period under `action` `(nact,)`.

        Raises:
          ValueError: the action is not finite or has the wrong shape, or the episode is over or has not begun.
        """
        action = action_array(action, self._shape)
        if self._over[0] or not math.isfinite(sum(action.tolist())):
            self._begin(action[None], None)
            return
        self._action[:] = action
        if self._has_delays:
            action = self._arrived(action[None], ALL)[0]
        targets = self.actions.targets(action)
        if self._direct is None:
            self._target[:] = targets
            self._torques.apply(targets, self.disturbances.controls, 0)
        else:
            self.controls[self._direct] = targets

    def hold(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Updates the controls that hold position and velocity targets in this state, for the next step."""
        if self.holds_targets:
            self._torques.hold(self._targets, qpos[None], qvel[None], self.disturbances.controls, ALL)

    def advance(self, steps: int) -> None:
        """Takes physics steps under the present controls and forces."""
        self._step_alike(steps, NONE)

    def conclude(self) -> TaskStep:
        """Returns the results of the control period that ends with the last step, without an axis of worlds."""
        return self._results()

    def conclude_in(self, model: mujoco.MjModel, data: mujoco.MjData) -> TaskStep:
        """Returns the results of the control period that ends in the instant of `data`, as `conclude`.

        Args:
          model: the model of the world.
          data: an MjData that was stepped in place of the world, in which all fields up to `stage` are computed.
        """
        if self._source is None or self._source.data is not data:
            self._source = SingleMjData(model, data)
            columns = BatchColumns(self._source, self._plan_alone, lambda world: model)
            columns.begin_as(self._measurement)
            self._functions = self._functions_of(columns)
            self._observations.rotations = data.xmat[None]
        return self._results()

    def resume(self) -> None:
        """Lets a finished episode continue without a reset, unless it is unstable."""
        self._over[0] = False

    # --- within ------------------------------------------------------------------------------------

    def _start(self, functions: "_InstantFunctions") -> np.ndarray:
        """Returns the first observation, and remembers the termination that holds."""
        inputs = self._inputs_at(0) if self._has_inputs else self._no_inputs
        self._start_codes[0] = functions.judge(0.0)[2]
        return self._observation(functions.fill, 0.0, inputs, first=True)

    def _forward(self, stage: int) -> None:
        try:
            with self._without_timers:
                self._batch.forward(None, stage)
        except BatchError:
            self._failed[0] = self._has_failed = True

    def _step(self, steps: int, stage: int) -> None:
        """Takes steps, and computes derived quantities up to `stage`."""
        if self._are_steps_alike:
            self._step_alike(steps, stage)
        else:
            self._advance(steps, None, stage)

    def _step_alike(self, steps: int, stage: int) -> None:
        try:
            with self._without_timers:
                self._batch.step(None, steps, stage)
        except BatchError:
            self._failed[0] = self._has_failed = True

    def _results(self) -> TaskStep:
        """Measures the end of a control period."""
        functions = self._functions
        if functions.update:
            functions.update()
        instant = int(self._instants[0]) + 1
        self._instants[0] = instant
        if functions.uses_numpy:
            return self._ignoring.run(self._result, instant, functions)
        return self._result(instant, functions)

    def _result(self, instant: int, functions: "_InstantFunctions") -> TaskStep:
        """Returns the results of the control period that ended at an instant."""
        endings = self._expressions.endings
        time = self._expressions.time(instant) if self._expressions.reads_time else 0.0
        inputs = self._inputs_at(instant, instant - 1) if self._has_inputs else self._no_inputs
        reward, terms, code = functions.judge(time)
        if code == RUNNING and instant >= self._periods:
            code = endings.timeout

        inputs = self._inputs_at(instant) if self._has_commands else inputs
        observed = self._observation(functions.fill, time, inputs, first=False)
        if not self._is_surely_stable(ALL) and self._unstable(ALL)[0]:
            code, reward, terms = endings.unstable, 0.0, [0.0] * len(terms)
            observed = self._only_observed.copy()
        self._only_observed[:] = observed
        if code != RUNNING:
            self._over[0] = True
        return TaskStep(observed, reward, terms, code, endings)

    def _observation(self, fill: Fill, time: float, inputs: ExpressionInputs, first: bool) -> np.ndarray:
        """Returns the observation `(nobs,)`."""
        now = np.empty(self._observations.width)
        fill(now, time)
        if self._observations.has_inputs:
            self._observations.add_inputs(now, inputs)
        return self._observations.finish(now, 0, first)

    def _is_surely_stable(self, rows: Rows) -> bool:
        if self._has_failed or any(self._only_warnings.tolist()):
            return False
        return self._source is not None or is_bounded(self._only_motion)  # who steps another MjData checks its motion

    def _functions_of(self, columns: BatchColumns, is_first: bool = False) -> "_InstantFunctions":
        """Compiles the functions of a control instant.

        Args:
          columns: the columns of terms, then those of expressions.
          is_first: whether the functions are for the first control instant of an episode.
        """
        expressions, observations = self._expressions, self._observations
        sources, update = columns.alone()
        measured = dict(zip(observations.measured_places, sources, strict=False))
        read = dict(zip(expressions.measured, sources[self._of_terms :], strict=True))
        for names, array in (expressions.actions, self._action), (expressions.commands, self._commands_read):
            read |= {name: (array, place) for place, name in enumerate(names)}
        functions = expressions.alone(read, measured, observations.places_of_values, is_first)
        return _InstantFunctions(update, *functions)

    def _inputs_at(self, instant: int, commanded: int | None = None) -> ExpressionInputs:
        """Returns the inputs of the world up to a control instant; expressions read these commands from then on.

        Args:
          commanded: the instant of the commands, where it differs.
        """
        commands = NO_COMMANDS
        if self._has_commands:
            commands = self.commands.at(0, instant if commanded is None else commanded)
            self._commands_read[:] = commands
        return ExpressionInputs(instant, self._action, commands)


class _InstantFunctions(NamedTuple):
    """The functions that compute a control instant from the fields of an MjData.

    Attributes:
      update: updates numbers that are not in fields; called first. None if all are.
      judge, fill, uses_numpy: see `TaskExpressions.alone`.
    """

    update: Callable[[], None] | None
    judge: Judge
    fill: Fill
    uses_numpy: bool


class TaskStepper(PhysicsStepper):
    """A stepper through an episode of a task with the random seed `seed`, in which `actor` chooses the actions.

    The episode is bit for bit that of `TaskWorlds.step`. The policy is called on arrival at a control instant, so that
    the controls of the next control period are known at that instant. Beyond the end of the episode the simulation
    continues without a reset.

    Args:
      world: the world that measures the observations and rewards.
      policy: its name, for messages.

    Attributes:
      model: a copy of that of the episode.
      step: the current one.
      names: the names of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: completed control periods, up to the end of the episode.

    Raises:
      SimulationError: the policy failed.
    """

    def __init__(self, world: SingleWorld, actor: Actor, seed: int, policy: str = "") -> None:
        self._world, self._actor, self._policy = world, actor, policy
        self.control_steps, self.step = world.control_steps, 0
        self.names = EpisodeColumnNames(world.observation_names, world.action_names, world.reward_names)
        self.periods = 0
        self._ending: Ending | None = None

        observation = world.start(seed)
        model = world.model(0)
        self._timestep = model.opt.timestep
        action = self._ask(observation, 0)
        self._instant = (observation, action, 0.0, [0.0] * len(self.names.rewards), 0.0)
        self._now: ControlInstant | None = None  # made on demand
        # What the last step of a period computes is measured in the world, which takes that step in addition. A state
        # does not include bodies that sleep, nor what contacts of flexes carry from step to step: it then takes all.
        self._is_lagged = world.task.derived == LAGGED
        self._is_parallel = self._is_lagged and (bool(model.opt.enableflags & SLEEP) or model.nflex > 0)
        self._world_step = 0
        data = mujoco.MjData(model)
        state.restore(model, data, world.state(0))
        world.hold(data.qpos, data.qvel)
        data.ctrl[:] = world.controls
        noise, pushes = world.disturbances.noise(0), world.disturbances.pushes(0)
        control = ControlSources(rational(model.opt.timestep), world.controls, noise=noise)
        super().__init__(model, data, control, pushes)

    def steps_alike(self) -> int:
        if self._world.holds_targets or (self._is_parallel and self.control.noise):
            return 1
        left = self.control_steps - self.step % self.control_steps
        return min(super().steps_alike(), left - 1 if self._is_lagged and left > 1 else left)

    @property
    def _calls_within(self) -> bool:
        """True if the policy is the only source of inputs, and its observations need only positions and velocities."""
        return not (self._sources or self.control.varies or self._is_lagged) and self._is_measured_in_place

    @property
    def _is_measured_in_place(self) -> bool:
        return self._integrate is not None and self._world.stage < ACCELERATION

    def edit(self, values: np.ndarray, spec: int) -> None:
        """Changes parts of the state at this step; the policy sets the controls again at the next control instant.

        Args:
          values: the parts `(size,)` that `spec` names by `mjtState` bits.
        """
        super().edit(values, spec)
        if self._world.holds_targets:
            self._world.hold(self._data.qpos, self._data.qvel)
            self._data.ctrl[:] = self.control.rows(self.step, 1)[0]
        self._lead()

    def now(self) -> ControlInstant:
        if self._now is None:
            observation, action, reward, terms, total = self._instant
            self._now = ControlInstant(observation, action, reward, np.array(terms), total, self._ending)
        return self._now

    def _apply_inputs(self) -> None:
        """Applies the inputs of this step; measurements at the end of a period belong to the forces before it."""
        if self._is_parallel and self.step:
            self._world.advance(self.step - self._world_step)
            self._world_step = self.step
        if self.step and self.step % self._call_steps == 0 and not self._repeats():
            self._act(self.step)
        super()._apply_inputs()
        self._lead()

    @property
    def _call_steps(self) -> int:
        """The number of steps from a change of the controls to the next."""
        return 1 if self._world.holds_targets else self.control_steps

    def _calls_after(self, step: int) -> Iterator[int]:
        period = self._call_steps
        return count(step - step % period + period, period)

    def _caller(self) -> Callable[[int], bool | None]:
        return partial(self._act, is_computed=True)

    def _copier(self) -> Callable[[], Any]:
        controls = self._world.controls
        return lambda: (controls.copy(), self._instant, self.periods, self._ending)

    def _put_back(self, copied: Any) -> None:
        controls, self._instant, self.periods, self._ending = copied
        self._world.controls[:] = self._data.ctrl[:] = controls
        self._now = None

    def _act(self, step: int, is_computed: bool = False) -> None:
        """Sets the controls of a step: those of a new action, or those that hold the targets of the last one.

        Args:
          is_computed: whether positions and velocities are computed in the data of the step.
        """
        if step % self.control_steps == 0:
            self._finish_period(step, is_computed)
        if self._world.holds_targets:
            self._world.hold(self._data.qpos, self._data.qvel)
        self._data.ctrl[:] = self._world.controls

    def _lead(self) -> None:
        """Prepares the world for the next step, once all inputs of this one are known."""
        if self._is_parallel:
            self._put()
        elif self._is_lagged and (self.step + 1) % self.control_steps == 0:
            self._put()
            self._world.advance(1)

    def _put(self) -> None:
        mujoco.mj_getState(self.model, self._data, self._world.whole_state, state.STATE)

    def _finish_period(self, step: int, is_computed: bool) -> None:
        """Computes the control instant at the end of a period; after the end of the episode the return stays."""
        world = self._world
        if self._is_lagged:
            result = world.conclude()
        else:
            result = world.conclude_in(self.model, self._data if is_computed else self._measured())
        reward, total = result.rewards, self._instant[-1]
        if self._ending is None:
            self.periods, total = self.periods + 1, total + reward
            if result.codes != RUNNING:
                self._ending = result.endings[result.codes]
        world.resume()
        action = self._ask(result.observations, step)
        self._instant, self._now = (result.observations, action, reward, result.reward_terms, total), None

    def _measured(self) -> mujoco.MjData:
        """Returns an MjData in which all fields that the world measures belong to this step."""
        if self._world.stage == NONE:
            return self._data
        if self._is_measured_in_place:
            self._derive_motion()
            return self._data
        instant = self._copied_instant()
        self._computed = STATE  # as the controls change
        return instant

    def _ask(self, observation: np.ndarray, step: int) -> np.ndarray:
        """Calls the policy, and applies its action to the world."""
        action = ask(self._actor, observation, self.names.actions, step, step * self._timestep, self._policy)
        self._world.apply(action)
        return action
