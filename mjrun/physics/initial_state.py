"""The initial state of a simulation: a keyframe, joint positions and velocities, controls, noise; all by name."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, ModelError, UnknownNameError, UsageError, clean, concerning, option, quoted
from mjrun.model import state
from mjrun.model.additions import servos
from mjrun.model.names import (
    KINDS,
    QPOS_COMPONENTS,
    QVEL_COMPONENTS,
    control_names,
    control_slices,
    identify,
    matching,
    names,
)
from mjrun.options.setting_kinds import AngleWithUnit, LengthWithUnit

Values = float | Sequence[float]
HINGE = mujoco.mjtJoint.mjJNT_HINGE
LENGTHS, ANGLES = ("length", "x", "y", "z", "vx", "vy", "vz"), ("angle", "wx", "wy", "wz")  # components of joints


@dataclass(frozen=True)
class InitialState:
    """The state at time 0.

    Args:
      key: keyframe name or index; the model's own `qpos0` when None.
      qpos, qvel: joints by name, wildcard or index, or `NAME/COMPONENT` (`root/z`, `root/wx`). A joint
        without a name has that of its body. Units [m, rad, m/s, rad/s], quaternions w first.
      ctrl: actuators by name, wildcard or index, held constant.
      perturb: standard deviation of Gaussian noise added to every initial velocity.
      seed: the seed of that noise; the same seed gives the same start.
      position_control: servos on joints hold the initial positions, unless `ctrl` sets their controls; None if not.
    """

    key: str | None = None
    qpos: Mapping[str, Values] = field(default_factory=dict[str, Values])
    qvel: Mapping[str, Values] = field(default_factory=dict[str, Values])
    ctrl: Mapping[str, Values] = field(default_factory=dict[str, Values])
    perturb: float = 0.0
    seed: int = 0
    position_control: str | None = None

    def data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Returns a new MjData in this state.

        Raises:
          UnknownNameError: a name is not in the model.
          BadValueError: the number of values does not fit the joint.
          ModelError: the keyframe, or the model's own pose, is not finite.
        """
        data = mujoco.MjData(model)
        self.reset(model, data)
        return data

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Puts `data` into this state, whatever it contained; raises the errors of `data`."""
        self._reset_to_source(model, data)
        for name, values in self.qpos.items():
            with concerning("qpos", name):
                _check_units(model, QPOS_COMPONENTS, name, values, "qpos")
                _set(data.qpos, _joint_slices(model, model.jnt_qposadr, QPOS_COMPONENTS, name), values, "qpos", name)
        for name, values in self.qvel.items():
            with concerning("qvel", name):
                _check_units(model, QVEL_COMPONENTS, name, values, "qvel")
                _set(data.qvel, _joint_slices(model, model.jnt_dofadr, QVEL_COMPONENTS, name), values, "qvel", name)
        if self.position_control is not None:
            for index in servos(model):
                position = data.qpos[model.jnt_qposadr[model.actuator_trnid[index, 0]]]
                gear = model.actuator_gear[model.actuator_outadr[index], 0]
                data.ctrl[model.actuator_ctrladr[index]] = gear * position
        for name, values in self.ctrl.items():
            with concerning("ctrl", name):
                _set(data.ctrl, control_slices(model, name), values, "ctrl", name)
        if self.seed < 0:
            raise BadValueError(option("seed"), self.seed, "a whole number of at least 0")
        if self.perturb:
            data.qvel += self.perturb * np.random.default_rng(self.seed).standard_normal(model.nv)
        numbers: np.ndarray = np.concatenate([*_vectors(data).values()])
        if not (abs(numbers) <= mujoco.mjMAXVAL).all():
            own = mujoco.MjData(model)
            self._reset_to_source(model, own)
            raise _fault(data, own, "the model's own pose" if self.key is None else f"keyframe {quoted(self.key)}")

    def without_each(self, model: mujoco.MjModel) -> Iterator[tuple[str, str, np.ndarray]]:
        """Yields the state without each of the positions and velocities: its option, its key, and the state."""
        for name, values in (("qpos", self.qpos), ("qvel", self.qvel)):
            for key in values:
                others = {each: numbers for each, numbers in values.items() if each != key}
                yield name, key, state.save(model, replace(self, **{name: others}).data(model))

    def _reset_to_source(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Puts `data` into the keyframe, or into the model's own pose."""
        if self.key is None:
            mujoco.mj_resetData(model, data)
        else:
            with concerning("key"):
                mujoco.mj_resetDataKeyframe(model, data, identify(model, "keyframe", self.key))

    def remarks(self, model: mujoco.MjModel) -> list[str]:
        """Returns a warning for each control that MuJoCo will clamp, and for angles that look like degrees."""
        return [*self._turns(model), *self._clamped(model)]

    def _turns(self, model: mujoco.MjModel) -> list[str]:
        """Returns a warning for each hinge that starts beyond a turn, if its angle has no unit."""
        texts: list[str] = []
        for name, values in self.qpos.items():
            hinges = [joint for joint, _ in _joints(model, QPOS_COMPONENTS, name) if model.jnt_type[joint] == HINGE]
            value = (values[0] if values else 0.0) if isinstance(values, Sequence) else values
            if hinges and abs(value) > 2 * np.pi and not isinstance(value, AngleWithUnit):
                turns = f"{abs(value) / (2 * np.pi):.3g} turns"
                texts.append(
                    f"{option('qpos')} {clean(name)}={value:g} is {turns}, as angles are in radians; {value:g}deg is "
                    f"{value:g} degrees, and {value:g}rad means the turns"
                )
        return texts

    def _clamped(self, model: mujoco.MjModel) -> list[str]:
        """Returns a warning for each control that MuJoCo will clamp."""
        data, controls = self.data(model), control_names(model)
        driven = {i for name in self.ctrl for part in control_slices(model, name) for i in range(part.start, part.stop)}
        clamps = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
        texts: list[str] = []
        for i in sorted(driven if clamps else ()):
            low, high = model.actuator_ctrlrange[i]
            if model.actuator_ctrllimited[i] and not low <= data.ctrl[i] <= high:
                value = f"{clean(controls[i])}={data.ctrl[i]:g}"
                limits = f"[{low:g}, {high:g}]"
                texts.append(f"{option('ctrl')} {value} is beyond the actuator's range; MuJoCo clamps it to {limits}")
        return texts


def _check_units(
    model: mujoco.MjModel, parts: dict[int, tuple[str, ...]], name: str, values: Values, what: str
) -> None:
    """Raises BadValueError if a value has the unit of a length where an angle is expected, or the other way round."""
    numbers = values if isinstance(values, Sequence) else [values]
    if not any(isinstance(number, AngleWithUnit | LengthWithUnit) for number in numbers):
        return
    for joint, component in _joints(model, parts, name):
        kind = int(model.jnt_type[joint])
        names_of = parts.get(kind, ("angle" if kind == HINGE else "length",))
        places = names_of if component is None else [names_of[component]]
        for number, place in zip(numbers, places, strict=False):
            fits = (isinstance(number, LengthWithUnit) and place in LENGTHS) or (
                isinstance(number, AngleWithUnit) and place in ANGLES
            )
            if isinstance(number, AngleWithUnit | LengthWithUnit) and not fits:
                unit = "a length" if place in LENGTHS else "an angle"
                wanted = unit if place in (*LENGTHS, *ANGLES) else "a number without a unit"
                given = "rad" if isinstance(number, AngleWithUnit) else "m"
                rate = "/s" if what == "qvel" else ""
                raise BadValueError(f"{option(what)} {clean(name)}", f"{number:g} {given}{rate}", wanted)


def _set(vector: np.ndarray, slices: Sequence[slice], values: Values, what: str, name: str) -> None:
    """Writes `values` into each of `slices`, the places of `name` in the option `what`."""
    numbers = np.atleast_1d(np.asarray(values, float))
    for part in slices:
        size = part.stop - part.start
        if numbers.shape != (size,):
            text = ",".join(f"{number:g}" for number in numbers.ravel())
            raise BadValueError(f"{option(what)} {clean(name)}", text, f"{size} number{'s' * (size > 1)}")
        vector[part] = numbers


def _joint_slices(
    model: mujoco.MjModel, addresses: np.ndarray, parts: dict[int, tuple[str, ...]], name: str
) -> list[slice]:
    """Returns the places in qpos or qvel of the joints, or the joint components, that `name` selects."""
    slices: list[slice] = []
    for joint, component in _joints(model, parts, name):
        start, size = int(addresses[joint]), len(parts.get(int(model.jnt_type[joint]), ("",)))
        slices.append(
            slice(start, start + size) if component is None else slice(start + component, start + component + 1)
        )
    return slices


def _joints(model: mujoco.MjModel, parts: dict[int, tuple[str, ...]], name: str) -> Iterator[tuple[int, int | None]]:
    """Yields the joint ids that `name` selects, each with the component that it names, if any."""
    exact = mujoco.mj_name2id(model, KINDS["joint"], name)
    if exact >= 0:  # as in each of many points of a study
        yield exact, None
        return
    owner, slash, part = name.rpartition("/")
    known = {*names(model, "joint"), *names(model, "body")}
    if name in known or owner not in known:
        try:
            yield from ((joint, None) for joint in _joints_named(model, name))
            return
        except UnknownNameError:
            if not slash:
                raise
    for joint in _joints_named(model, owner):
        valid = parts.get(int(model.jnt_type[joint]), ())
        if part not in valid:
            raise UnknownNameError("component", part, valid, where=f"joint {owner}")
        yield joint, valid.index(part)


def _joints_named(model: mujoco.MjModel, name: str) -> list[int]:
    bodies = names(model, "body")
    if name in bodies and name not in names(model, "joint"):
        body = bodies.index(name)
        if model.body_jntnum[body] == 1:
            return [int(model.body_jntadr[body])]
    return matching(model, "joint", name)


def _vectors(data: mujoco.MjData) -> dict[str, np.ndarray]:
    return {"qpos": data.qpos, "qvel": data.qvel, "act": data.act, "ctrl": data.ctrl}


def _fault(data: mujoco.MjData, own: mujoco.MjData, source: str) -> ModelError | UsageError:
    """Returns the error of the first number of an initial state that is not finite or too large.

    Args:
      own: the state of `source`, the keyframe or the model's own pose.
    """
    name, vector = next(
        (name, vector) for name, vector in _vectors(data).items() if not (abs(vector) <= mujoco.mjMAXVAL).all()
    )
    index = np.flatnonzero(~(abs(vector) <= mujoco.mjMAXVAL))[0]
    value = vector[index]
    limit = f"below {mujoco.mjMAXVAL:g}, MuJoCo's limit of a stable simulation"
    must = f"is {value:g}; it must be {limit if np.isfinite(value) else 'finite'}"
    if np.array_equal(value, _vectors(own)[name][index], equal_nan=True):
        return ModelError(f"{source}: {name}[{index}] {must}")
    return UsageError(f"the initial {name}[{index}] {must}")
