"""A demonstration to replay: its motion, its actions, and how far poses differ from those recorded with it."""

import math
import re
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, option
from mjrun.model.names import names
from mjrun.model.sources.demonstration import is_demonstration_file, open_demonstrations
from mjrun.physics.kinematic_samples import FIELDS, Interpolation, KinematicMotion, KinematicSamples
from mjrun.probe.fields import field_probe, offered
from mjrun.suffixes import is_hdf5, split_episode
from mjrun.timeline import nearest, rational, seconds

if TYPE_CHECKING:
    from mjrun.hdf5.demonstrations import DemonstrationFile

COMPARED = 50  # states whose poses are compared
NOTABLE = 1e-2  # a difference of poses that is reported in any case [m]
HAND = re.compile(r"robot(\d+)_(?:(left|right)_)?eef_pos")  # observations of a hand, of robosuite
HANDS = {"ee_pos": ("0", "")}  # those of LIBERO
POSITION = re.compile(r"(\w+)_pos")  # observations of an object
UNEVEN = 0.01  # share of the time between two states by which others may differ
SUCCESS = 1.0  # reward of a completed task
DENOMINATOR = 1000  # of a rate [Hz], or of the time between states if that is more than a second


def names_demonstration(path: Path) -> bool:
    """Returns whether a path names a demonstration: one in a file, or a file that contains demonstrations."""
    file, episode = split_episode(path)
    return bool(episode) or (is_hdf5(file) and is_demonstration_file(Path(file)))


def read_demonstrated_motion(
    path: Path,
    model: mujoco.MjModel,
    start: mujoco.MjData,
    rate: Fraction | None = None,
    interpolation: Interpolation | None = None,
) -> KinematicMotion:
    """Reads the motion of `model` from a demonstration, which `path` names as in `demo.hdf5:demo_3`.

    Args:
      start: state of everything that the demonstration does not contain.
      rate: states per second [Hz], instead of their times.
      interpolation: interpolation between states.

    Raises:
      FileError: the demonstration is missing or cannot be read.
      UsageError: its states are those of another model, or their times do not ascend.
    """
    source, episode = split_episode(path)
    with open_demonstrations(Path(source)) as file:
        name = file.named(episode)
        states = file.states(name)
        samples = _samples(model, states, f"{source}:{name}", rate)
        motion = KinematicMotion(model, start, samples, interpolation)
        motion.remarks.extend(_on_origin(file, name, model, states))
    return motion


def _samples(model: mujoco.MjModel, states: np.ndarray, source: str, rate: Fraction | None) -> KinematicSamples:
    """Splits states into time, positions, velocities and activations."""
    sizes = {"qpos": model.nq, "qvel": model.nv, "act": model.na}
    expected = 1 + model.nq + model.nv
    if states.shape[1] not in (expected, expected + model.na):
        activations = f" (+ na {model.na})" if model.na else ""
        raise UsageError(
            f"{clean(source)} is a demonstration of another model: its states have {states.shape[1]} numbers\n"
            f"those of this model have {expected}{activations}: time, {model.nq} positions, {model.nv} velocities"
        )
    times = states[:, 0] if rate is None else np.array(seconds(np.arange(len(states)), 1 / rate), float)
    known = offered(model)
    # Controls are left out: no demonstration has them, so that nothing is missing.
    named = [field for field in sizes if field in known]
    columns = {field: [c.name for c in field_probe(model, field).columns] if field in named else [] for field in FIELDS}
    values: dict[str, dict[int, np.ndarray]] = {}
    begin = 1
    for field, size in sizes.items():
        if begin + size <= states.shape[1]:
            values[field] = {index: states[:, begin + index] for index in range(size)}
        begin += size
    return KinematicSamples(source, times, columns, values)


def _on_origin(file: "DemonstrationFile", name: str, model: mujoco.MjModel, states: np.ndarray) -> Iterator[str]:
    """Yields a remark if another MuJoCo made the demonstration, or may have, or if poses differ."""
    origin, ours = file.origin(name), mujoco.mj_versionString()
    differences = dict(_differences(file, name, model, states))
    worst = max(differences, key=lambda key: differences[key], default="")
    if origin.mujoco == ours and differences.get(worst, 0) < NOTABLE:
        return
    made = f"was recorded with MuJoCo {clean(origin.mujoco)}"
    if not origin.mujoco:
        program = f" (robosuite {clean(origin.robosuite)})" if origin.robosuite else ""
        made = f"does not state its version of MuJoCo{program}"
    agreement = "it has no observations to compare them with"
    if worst:
        agreement = f"they differ from its observations by up to {differences[worst]:.2g} m, in {clean(worst)}"
    yield f"{clean(f'{file.path}:{name}')} {made}, and poses are computed by MuJoCo {ours}: {agreement}"


def _differences(
    file: "DemonstrationFile", name: str, model: mujoco.MjModel, states: np.ndarray
) -> Iterator[tuple[str, float]]:
    """Yields the largest distance [m] of each observed position from that of the model in the same state.

    Observations are those before an action or, in LIBERO, those after it: the smaller distance counts.
    """
    shape = (len(states), 3)
    observed = [key for key, own in file.observations(name).items() if own == shape]
    places = {key: place for key in observed if (place := _place(model, key))}
    if not places:
        return
    rows = np.unique(np.linspace(0, len(states) - 1, COMPARED).astype(int))
    data = mujoco.MjData(model)
    here, later = (_positions(model, data, states[np.minimum(rows + shift, len(states) - 1)]) for shift in (0, 1))
    for key, (kind, index) in places.items():
        recorded = file.array(name, "obs", key)[rows]
        distances = [np.linalg.norm(recorded - poses[kind][:, index], axis=1) for poses in (here, later)]
        distances[1] = distances[1][rows + 1 < len(states)]
        largest = [float(each.max()) for each in distances if each.size and np.isfinite(each).all()]
        if largest:
            yield key, min(largest)


def _place(model: mujoco.MjModel, key: str) -> tuple[str, int] | None:
    """Returns the kind and the id of the object whose position an observation is; None if it is not known."""
    hand = HAND.fullmatch(key)
    number, arm = (hand[1], hand[2]) if hand else HANDS.get(key, ("", None))
    candidates = [("site", f"gripper{number}_{arm or 'right'}_grip_site"), ("site", f"gripper{number}_grip_site")]
    if not number:
        position = POSITION.fullmatch(key)
        candidates = [("body", f"{position[1]}{end}") for end in ("", "_main")] if position else []
    for kind, name in candidates:
        if name in (known := names(model, kind)):
            return kind, known.index(name)
    return None


def _positions(model: mujoco.MjModel, data: mujoco.MjData, states: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the positions [m] of all sites and bodies in each state, `(n, objects, 3)` by kind."""
    positions = {"site": np.empty((len(states), model.nsite, 3)), "body": np.empty((len(states), model.nbody, 3))}
    for row, state in enumerate(states):
        data.qpos[:] = state[1 : 1 + model.nq]
        mujoco.mj_kinematics(model, data)
        positions["site"][row], positions["body"][row] = data.site_xpos, data.xpos
    return positions


@dataclass(frozen=True)
class DemonstratedEpisode:
    """A recorded episode of T rows: action t was taken in state t.

    Attributes:
      source: the demonstration as users write it.
      task: the instruction in natural language, or else the name of the environment.
      robot: the name of the robot, or those of several; empty if the file states none.
      times: the time of each state since the first one [s], `(T,)`.
      actions: the inputs of the controller that recorded it `(T, n)`.
      rewards: the reward of each action `(T,)`; None if the file has none.
      success: whether the task was completed, according to the rewards; None without rewards.
      stated_rate: the number of states per second [Hz] that replaces their times; None for none.
    """

    source: str
    task: str
    robot: str
    times: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray | None
    success: bool | None
    stated_rate: Fraction | None = None

    @property
    def action_names(self) -> Sequence[str]:
        """The names of the numbers of an action."""
        return [f"action_{index}" for index in range(self.actions.shape[1])]

    @property
    def rate(self) -> Fraction:
        """The number of states per second [Hz].

        Raises:
          UsageError: the states are not evenly spaced.
        """
        if self.stated_rate is not None:
            return self.stated_rate
        gaps = np.diff(self.times)
        if not len(gaps):
            raise UsageError(
                f"{clean(self.source)} has one state, and therefore no rate; {option('replay_rate')} states one"
            )
        usual = float(np.median(gaps))
        if not usual > 0:
            raise UsageError(f"{clean(self.source)}: its times do not ascend; {option('replay_rate')} replaces them")
        uneven = np.flatnonzero(abs(gaps - usual) > UNEVEN * usual)
        if len(uneven):
            row = int(uneven[0])
            raise UsageError(
                f"{clean(self.source)}: state {row + 1} is {gaps[row]:.6g} s after the one before, and others "
                f"{usual:.6g} s; a dataset has a constant rate"
            )
        if usual > 1:
            return 1 / Fraction(usual).limit_denominator(DENOMINATOR)
        return Fraction(1 / usual).limit_denominator(DENOMINATOR)

    def steps(self, timestep: Fraction) -> list[int]:
        """Returns the step of each state, in timesteps [s] of the model."""
        return [nearest(rational(time) / timestep) for time in self.times.tolist()]


def read_demonstration(text: str | Path, rate: Fraction | None = None) -> DemonstratedEpisode:
    """Reads the demonstration that `text` names.

    Args:
      rate: states per second [Hz], instead of their times.

    Raises:
      FileError: it is missing, cannot be read, or has no action for each state.
    """
    path, episode = split_episode(text)
    with open_demonstrations(Path(path)) as file:
        name = file.named(episode)
        times, actions, origin = file.states(name)[:, 0], file.array(name, "actions"), file.origin(name)
        rewards = file.array(name, "rewards") if "rewards" in file.datasets(name) else None
    source = f"{path}:{name}"
    actions = actions.reshape(len(actions), math.prod(actions.shape[1:])) if actions.ndim else actions
    for what, values in (("actions", actions), ("rewards", rewards)):
        if values is not None and (values.shape[:1] != times.shape or not np.isfinite(values).all()):
            reason = f"its {what} have the shape {values.shape}, and its states {times.shape}"
            raise FileError(source, reason if values.shape[:1] != times.shape else f"its {what} are not all finite")
    return DemonstratedEpisode(
        source=source,
        task=clean(origin.instruction or origin.task or name),
        robot=clean(", ".join(origin.robots)),
        times=times - times[0] if rate is None else np.arange(len(times)) / float(rate),
        actions=actions,
        rewards=rewards,
        success=None if rewards is None else bool((rewards >= SUCCESS).any()),
        stated_rate=rate,
    )
