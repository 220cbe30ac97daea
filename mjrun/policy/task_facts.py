"""Facts about a policy's task in the policy's file: compared with the values in a task, or made into a task.

Facts that the file lacks are not compared; of a task that is made, they are listed, and never guessed.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, counted, listing, option, quoted
from mjrun.model.names import JOINT_TRANSMISSIONS, actuators_of, names
from mjrun.model.source import CollectionModelSource, ModelSource
from mjrun.options.option import is_given, options_of
from mjrun.options.task import CONTROL, POSITION, TORQUE, VELOCITY, ActionOptions, ObservationOptions
from mjrun.policy.policy import Numbers, ObservationFacts, Policy, PolicyFacts
from mjrun.task.observation_plan import ObservedNumber
from mjrun.task.task import Action, Observation, Reset, Task
from mjrun.task.worlds import TaskWorlds

QUATERNIONS = {"wxyz": ["qw", "qx", "qy", "qz"], "xyzw": ["qx", "qy", "qz", "qw"]}
EQUAL = 1e-6  # relative: numbers of files are often float32
JOINT_POSITION = "joint_pos"  # mjlab's name of positions relative to the default pose
# Quantities of joints by their names in files: of mjlab, and the kinds of LEAPP.
JOINTS = {"joint_pos": "qpos", "joint_vel": "qvel", "state/joint/position": "qpos", "state/joint/velocity": "qvel"}
DURATION = Fraction(5)  # [s], the default duration of simulations
LAST_ACTION = ("actions", "last_action")  # mjlab's names
BODIES = {"state/body/rotation": "xquat", "state/body/position": "xpos"}  # by the kinds of LEAPP
PERIOD = "its control period"


def check_agreement(task: Task, policy: Policy) -> None:
    """Checks that nothing in the file of `policy` contradicts `task`; facts that the file lacks are not compared.

    Raises:
      UsageError: there are contradictions, all of which the message shows; or the task does not fit its model.
      ModelError: the model cannot be loaded.
    """
    if policy.facts == PolicyFacts():
        return
    contradictions = [*_Comparison(task, policy.facts).contradictions()]
    if contradictions:
        first = f"{option('policy')} {clean(policy.name)} contradicts {clean(task.text) or 'the task'}:"
        raise UsageError("\n".join([first, *(f"  {each}" for each in contradictions)]), ("policy",))


class _Comparison:
    """A comparison of a task and facts of a policy; names are compared without the prefix of a scene: `robot/knee`."""

    def __init__(self, task: Task, facts: PolicyFacts) -> None:
        self._task, self._facts = task, facts
        self._worlds = TaskWorlds(task, 1, threads=1)
        self._model = self._worlds.model(0)
        self._joints = tuple(map(last_part, facts.joints or ()))
        self._terms: dict[str, list[ObservedNumber]] = {}
        for number in self._worlds.observed:
            self._terms.setdefault(number.term, []).append(number)

    def contradictions(self) -> Iterator[str]:
        """Yields a sentence for each contradiction."""
        facts, observed, driven = self._facts, self._worlds.observed, self._worlds.action_names
        if facts.control_dt not in (None, self._task.control_dt):
            periods = [f"{float(period):g} s" for period in (facts.control_dt, self._task.control_dt) if period]
            yield f"{option('control_dt')}: {_both(*periods)}"
        yield from self._parts()
        commands = [*self._task.commands]
        if facts.commands is not None and commands and {*commands} != {*facts.commands}:
            yield f"commands: {_both(listing(facts.commands) or 'none', listing(commands))}"
        if facts.observation_size not in (None, len(observed)):
            terms = ", ".join(f"{clean(name)} ({len(numbers)})" for name, numbers in self._terms.items())
            yield f"observations: {_both(counted(facts.observation_size, 'number'), f'{len(observed)}: {terms}')}"
        for name, numbers in self._terms.items():
            yield from self._term_order(name, numbers)
        if facts.action_size not in (None, len(driven)):
            yield f"actions: {_both(counted(facts.action_size, 'number'), f'{len(driven)}: {listing(driven)}')}"
        else:
            yield from self._actions()

    # --- observations ------------------------------------------------------------------------------

    def _parts(self) -> Iterator[str]:
        """Compares the parts of the observation that the file names."""
        parts = self._facts.observations or ()
        shared = [part.name for part in parts if part.name in self._terms]
        in_task = [name for name in self._terms if name in shared]
        if shared != in_task:
            yield f"order of observations: {_both(listing(shared), listing(in_task))}"
        elif parts and not self._is_divided_alike(parts):
            in_file = ", ".join(clean(part.name) + (f" ({part.size})" if part.size else "") for part in parts)
            in_task_sized = ", ".join(f"{clean(name)} ({len(numbers)})" for name, numbers in self._terms.items())
            yield (
                f"parts of the observation: {_both(in_file, in_task_sized)}; "
                "name the observations of the task as the policy does, NAME, or NAME/… where a part has several"
            )
        else:
            for part, term in self._pairs(parts, shared):
                yield from self._part(part, term)

    def _pairs(
        self, parts: Sequence[ObservationFacts], shared: Sequence[str]
    ) -> Iterator[tuple[ObservationFacts, Observation]]:
        """Pairs parts with terms: in order if their numbers agree and no name contradicts it, else by name."""
        terms = self._task.observations
        if len(parts) == len(terms) and all(
            part.name == term.name or not {part.name, term.name} & {*shared}
            for part, term in zip(parts, terms, strict=True)
        ):
            yield from zip(parts, terms, strict=True)
            return
        for part in parts:
            yield from ((part, term) for term in terms if term.name == part.name or _is_within(term.name, part.name))

    def _is_divided_alike(self, parts: Sequence[ObservationFacts]) -> bool:
        """Returns whether each part is one term, or several whose names begin with its own.

        A part of unknown size may be a term of any name that no other part has.
        """
        terms, names = list(self._terms.items()), {part.name for part in parts}
        for part in parts:
            size, is_free = 0, part.size is None
            while terms and (terms[0][0] == part.name or _is_within(terms[0][0], part.name)):
                size, is_free = size + len(terms.pop(0)[1]), False
            if is_free and terms and terms[0][0] not in names:
                size, is_free = size + len(terms.pop(0)[1]), False
            if is_free or part.size not in (None, size):
                return False
        return not terms

    def _part(self, part: ObservationFacts, term: Observation) -> Iterator[str]:
        """Compares a part with its term."""
        label, numbers = clean(term.name), self._terms[term.name]
        if part.history not in (None, term.history):
            yield f"history of {label}: {_both(str(part.history), str(term.history))}"
        latest = [number for number in numbers if number.delay == term.delay]
        elements = [last_part(number.source) for number in latest]
        scales = [number.scale for number in latest]
        quantity = JOINTS.get(part.kind or part.name)
        groups = {number.source.partition("/")[0] for number in latest}
        if quantity and groups <= {*JOINTS.values()} and groups != {quantity}:
            yield f"quantity in {label}: {_both(quantity, listing(sorted(groups)))}"
            return
        if (
            quantity is None and term.joints is None and part.scale is not None
        ):  # another source may have the opposite sign
            signs = np.sign(np.broadcast_to(part.scale, len(scales)))
            scales = (np.abs(scales) * signs).tolist()
        for name, said, values in (
            ("offset", part.offset, [number.offset for number in latest]),
            ("scale", part.scale, scales),
            ("lower clip", part.clip and part.clip[:1], [number.low for number in latest]),
            ("upper clip", part.clip and part.clip[1:], [number.high for number in latest]),
        ):
            yield from self._numbers(f"{name} of {label}", said, values, elements)
        if part.name == JOINT_POSITION and self._defaults:
            defaults = [self._defaults.get(element) for element in elements]
            if None not in defaults:
                offsets = [number.offset for number in latest]
                yield from self._numbers(f"default pose in {label}", defaults, offsets, elements)
        if part.elements and len(part.elements) == len(elements):
            in_file = [last_part(element) for element in part.elements]
            if in_file != elements and (sorted(in_file) == sorted(elements) or term.joints is not None):
                yield f"order of {label}: {_both(listing(in_file), listing(elements))}"

    def _term_order(self, name: str, numbers: Sequence[ObservedNumber]) -> Iterator[str]:
        """Compares the order of joints and of quaternion components in a term of any name."""
        elements = [last_part(number.source) for number in numbers if number.delay == numbers[-1].delay]
        in_task = [element for element in elements if element in self._joints]
        in_file = [joint for joint in self._joints if joint in in_task]
        is_declared = any(part.name == name and part.elements for part in self._facts.observations or ())
        if in_task != in_file and sorted(in_task) == sorted(in_file) and not is_declared:
            yield f"order of joints in {clean(name)}: {_both(listing(in_file), listing(in_task))}"
        order = self._facts.quaternion_order
        runs = [elements[start : start + 4] for start in range(len(elements) - 3)]
        for written, components in QUATERNIONS.items():
            if order not in (None, written) and components in runs and not is_declared:
                yield f"quaternion in {clean(name)}: {_both(str(order), written)}"

    # --- actions -----------------------------------------------------------------------------------

    def _actions(self) -> Iterator[str]:
        facts, actions = self._facts, self._worlds.actions
        joints = self._driven_joints
        known = [*map(last_part, facts.action_joints or ())] or [joint for joint in self._joints if joint in joints]
        if len(known) == len(joints) and known != joints:
            yield f"order of actions: {_both(listing(known), listing(joints))}"
            return
        targets = {target for target in self._targets if target is not None}
        if facts.action_target is not None and targets - {facts.action_target}:
            yield f"target of actions: {_both(facts.action_target, listing(sorted(targets)))}"
            return
        if facts.action_scale is not None and actions.squashed.any():
            yield f"squash of actions: {_both('none', 'tanh')}"
        units = np.array([*self._units])
        yield from self._numbers("scale of actions", facts.action_scale, (units * actions.scale).tolist(), joints)
        yield from self._numbers("offset of actions", facts.action_offset, (units * actions.offset).tolist(), joints)
        if facts.action_scale is not None and all(joint in self._defaults for joint in joints):
            defaults = [self._defaults[joint] for joint in joints]
            yield from self._numbers("default pose in actions", defaults, (units * actions.offset).tolist(), joints)
        kp, kd = self._gains
        yield from self._numbers("kp", facts.stiffness, kp, joints)
        yield from self._numbers("kd", facts.damping, kd, joints)

    @cached_property
    def _driven_joints(self) -> list[str]:
        """The joints that the action moves; the names of actuators that do not move a joint."""
        joints = names(self._model, "joint")
        driven: list[str] = []
        for each in self._worlds.actions.driven:
            actuator = each.actuator(self._model)
            is_of_joint = each.joint < 0 and self._model.actuator_trntype[actuator] in JOINT_TRANSMISSIONS
            joint = int(self._model.actuator_trnid[actuator, 0]) if is_of_joint else each.joint
            driven.append(last_part(each.name if joint < 0 else joints[joint]))
        return driven

    @property
    def _targets(self) -> Iterator[str | None]:
        """The target of each action: a position, a velocity or a torque; None for other actuators."""
        model = self._model
        for each in self._worlds.actions.driven:
            actuator = each.actuator(model)
            kind, stiffness, damping = model.actuator_biastype[actuator], *model.actuator_biasprm[actuator, 1:3]
            if each.target != CONTROL:
                yield each.target
            elif kind == mujoco.mjtBias.mjBIAS_NONE:
                yield TORQUE
            elif kind == mujoco.mjtBias.mjBIAS_AFFINE and (stiffness or damping):
                yield POSITION if stiffness else VELOCITY
            else:
                yield None

    @property
    def _units(self) -> Iterator[float]:
        """The position, velocity or torque of a joint [SI] for one unit of the control of each action."""
        model = self._model
        for each in self._worlds.actions.driven:
            actuator = each.actuator(model)
            gear, gain = each.gear(model), model.actuator_gainprm[actuator, 0]
            kind, stiffness, damping = model.actuator_biastype[actuator], *-model.actuator_biasprm[actuator, 1:3]
            is_fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
            if each.target != CONTROL or not is_fixed or not gear:
                yield 1.0
            elif kind == mujoco.mjtBias.mjBIAS_NONE:
                yield float(gain * gear)
            elif kind == mujoco.mjtBias.mjBIAS_AFFINE and (stiffness or damping):
                yield float(gain / ((stiffness or damping) * gear))
            else:
                yield 1.0

    @property
    def _gains(self) -> tuple[list[float], list[float]]:
        """The gains kp and kd of all joints, in the task or in the model; 0 where a control is a torque."""
        actions, model = self._worlds.actions, self._model
        kp, kd = actions.kp.tolist(), actions.kd.tolist()
        for index, each in enumerate(actions.driven):
            actuator = each.actuator(model)
            is_servo = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
            if each.target == CONTROL and is_servo:
                kp[index] = float(model.actuator_gainprm[actuator, 0])
                kd[index] = -float(model.actuator_biasprm[actuator, 2])
        return kp, kd

    @cached_property
    def _defaults(self) -> dict[str, float]:
        """The default pose, by joint."""
        facts = self._facts
        if facts.joints is None or facts.default_position is None:
            return {}
        return dict(zip(self._joints, facts.default_position, strict=True))

    def _numbers(
        self, label: str, said: Sequence[float | None] | None, values: Sequence[float], elements: Sequence[str]
    ) -> Iterator[str]:
        """Compares numbers, one for each element or one for all."""
        if not said or len(said) not in (1, len(values)):
            return
        wanted = np.broadcast_to(np.array(said, float), len(values))
        differs = ~np.isclose(wanted, values, rtol=EQUAL, atol=self._facts.rounding)
        if differs.any():
            sides = [_listed(numbers, elements, differs) for numbers in (wanted, values)]
            yield f"{label}: {_both(*sides)}"


def _listed(numbers: Sequence[float] | np.ndarray, elements: Sequence[str], chosen: np.ndarray) -> str:
    """Formats the chosen numbers; as a single one if all are equal."""
    shown = [
        (element, float(number))
        for element, number, is_chosen in zip(elements, numbers, chosen, strict=True)
        if is_chosen
    ]
    if chosen.all() and len({number for _, number in shown}) == 1:
        return f"{shown[0][1]:g}"
    return listing([f"{element} {number:g}" for element, number in shown])


def _is_within(term: str, part: str) -> bool:
    """Returns whether a term of the task is one of several that a part consists of."""
    return term.startswith(f"{part}/")


def _both(policy: str, task: str) -> str:
    return f"the policy has {policy}; the task has {task}"


def last_part(name: str) -> str:
    """Returns a name without the prefix of a scene: `knee` of `robot/knee`."""
    return name.rpartition("/")[2]


def inferred_task(
    policy: Policy, source: ModelSource, control_dt: Fraction | None = None, duration: Fraction | None = None
) -> Task:
    """Returns the task for which `policy` was trained, on the model of `source`.

    Args:
      control_dt: the control period [s], if the file does not specify it.
      duration: the duration of an episode [s]; 5 when None.

    Raises:
      UsageError: the file lacks facts; the message lists them, and drafts a task document.
      ModelError: the model cannot be loaded.
    """
    draft = _Draft(policy.facts, source.load(), policy.facts.control_dt or control_dt)
    if draft.missing:
        is_period_alone = draft.missing == [PERIOD]
        advice = f"set {option('control_dt')}, or" if is_period_alone else "these are never guessed:"
        lines = [
            f"{option('policy')} {clean(policy.name)} does not specify {', '.join(draft.missing)}",
            f"{advice} write a task document, and play the policy on it instead of on {clean(source.text)}:",
            *draft.lines(source.text),
        ]
        if isinstance(source, CollectionModelSource) and source.NO_TASK:
            lines.append(source.NO_TASK)
        raise UsageError("\n".join(lines), ("policy",))
    assert draft.control_dt is not None
    return Task(
        source,
        control_dt=draft.control_dt,
        duration=duration or DURATION,
        observations=[each for each in draft.observations if isinstance(each, Observation)],
        actions=[each for each in (draft.action,) if each],
        reset=Reset(qpos=draft.start),
    )


@dataclass(frozen=True)
class _Unknown:
    """A part of the observation that is known by name alone."""

    name: str


class _Draft:
    """The known parts of a task.

    Attributes:
      missing: descriptions of the unknown ones.
    """

    def __init__(self, facts: PolicyFacts, model: mujoco.MjModel, control_dt: Fraction | None) -> None:
        self._facts, self._model, self.control_dt = facts, model, control_dt
        self._names = [name for name in names(model, "joint") if name]
        self.missing: list[str] = [] if control_dt else [PERIOD]
        self.observations = [self._observation(part) or _Unknown(part.name) for part in facts.observations or ()]
        unknown = [clean(each.name) for each in self.observations if isinstance(each, _Unknown)]
        if unknown:
            self.missing.append(f"the sources of these observations: {', '.join(unknown)}")
        if not self.observations:
            self.missing.append("its observations")
        self.action = self._action()
        if not self.action:
            self.missing.append("the targets of its actions")

    @property
    def start(self) -> Mapping[str, Numbers]:
        """The default pose, by joint."""
        joints, pose = self._facts.joints or (), self._facts.default_position or ()
        return {self._joint(joint): (position,) for joint, position in zip(joints, pose, strict=False)}

    def lines(self, model: str) -> list[str]:
        """Returns the lines of a task document with the known parts."""
        pose = {joint: position for joint, (position,) in self.start.items()}
        period = "# unknown" if self.control_dt is None else f"{float(self.control_dt):g}"
        return [
            f"  model: {clean(model)}",
            f"  control_dt: {period}",
            f"  duration: {float(DURATION):g}",
            *([f"  reset: {json.dumps({'qpos': pose})}"] if pose else []),
            "  observations:" + ("" if self.observations else "  # unknown"),
            *(
                f"    - {{name: {json.dumps(each.name)}}}  # from where?" if isinstance(each, _Unknown) else _line(each)
                for each in self.observations
            ),
            "  actions:" + ("" if self.action else "  # unknown"),
            *([_line(self.action)] if self.action else []),
        ]

    def _observation(self, part: ObservationFacts) -> Observation | None:
        """Returns the term of a part; None if its source is unknown."""
        changes = {
            "scale": part.scale or (1.0,),
            "clip": None if part.clip in (None, (float("-inf"), float("inf"))) else part.clip,
            "history": part.history or 1,
        }
        of = JOINTS.get(part.kind or part.name)
        joints = part.elements if part.kind else self._facts.joints
        if of and joints:
            offset = self._defaults(joints) if part.kind is None and of == "qpos" else (0.0,)
            chosen = [self._joint(joint) for joint in joints]
            return Observation(name=part.name, joints=chosen, of=of, offset=offset, **changes)  # type: ignore[arg-type]
        if part.kind is None and part.name in LAST_ACTION:
            return Observation(name=part.name, action="previous", **changes)  # type: ignore[arg-type]
        probe = BODIES.get(part.kind or "")
        if probe and part.elements and all("/" in element for element in part.elements):
            columns = [f"{probe}/{element}" for element in part.elements]
            return Observation(name=part.name, probe=columns, **changes)  # type: ignore[arg-type]
        return None

    def _action(self) -> Action | None:
        facts = self._facts
        joints = facts.action_joints or self._with_actuators()
        if joints is None or facts.action_target is None:
            return None
        values = {"joints": [self._joint(joint) for joint in joints], "scale": facts.action_scale or (1.0,)}
        offset = self._defaults(joints) if facts.action_target == POSITION and facts.default_position else (0.0,)
        if facts.action_target == TORQUE:
            return Action(target=TORQUE, **values)  # type: ignore[arg-type]
        if facts.action_target == POSITION and self._has_servos(joints):
            return Action(target=CONTROL, offset=offset, **values)  # type: ignore[arg-type]
        if facts.damping is None or (facts.stiffness is None and facts.action_target != VELOCITY):
            return None
        kp = {"kp": facts.stiffness} if facts.action_target == POSITION else {}
        return Action(target=facts.action_target, offset=offset, kd=facts.damping, **kp, **values)  # type: ignore[arg-type]

    def _with_actuators(self) -> tuple[str, ...] | None:
        """Returns the joints of the file that have actuators in the model, if their number is that of the actions."""
        driven = [joint for joint in self._facts.joints or () if self._actuator(joint) is not None]
        return tuple(driven) if driven and len(driven) == self._facts.action_size else None

    def _has_servos(self, joints: Sequence[str]) -> bool:
        """Returns whether the actuators of all joints hold positions by themselves."""
        actuators = [self._actuator(joint) for joint in joints]
        affine = mujoco.mjtBias.mjBIAS_AFFINE
        return all(each is not None and self._model.actuator_biastype[each] == affine for each in actuators)

    def _actuator(self, joint: str) -> int | None:
        """Returns the actuator of a joint; None if it has none, or several."""
        actuators = actuators_of(self._model, names(self._model, "joint").index(self._joint(joint)))
        return actuators[0] if len(actuators) == 1 else None

    def _defaults(self, joints: Sequence[str]) -> Numbers:
        facts = self._facts
        pose = dict(zip(facts.joints or (), facts.default_position or (), strict=False))
        return tuple(pose.get(joint, 0.0) for joint in joints)

    def _joint(self, name: str) -> str:
        """Returns the name of a joint in the model, where a scene may add a prefix: `robot/knee`."""
        alike = [each for each in self._names if last_part(each) == last_part(name)]
        if len(alike) == 1 or name in alike:
            return name if name in alike else alike[0]
        if alike:
            message = f"joint {quoted(name)} of the policy may be {' or '.join(map(quoted, alike))} of the model"
            raise UsageError(f"{message}; name it in a task document", ("policy",))
        raise UnknownNameError("joint", name, [*map(last_part, self._names)], where="the model, which the policy names")


def _line(term: Observation | Action) -> str:
    """Returns the line of a term in a document."""
    declared = ObservationOptions if isinstance(term, Observation) else ActionOptions
    given = [each for each in options_of(declared) if each.is_required or is_given(term, each.name)]
    pairs = [f"{each.key}: {json.dumps(each.kind.plain(vars(term)[each.attribute]))}" for each in given]
    return f"    - {{{', '.join(pairs)}}}"
