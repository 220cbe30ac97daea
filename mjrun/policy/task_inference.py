"""Inference of a policy's task from the facts in its file.

Facts that the file lacks are listed, and never guessed.
"""

import json
from collections.abc import Mapping, Sequence
from fractions import Fraction

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, option, quoted
from mjrun.model.names import actuators_of, names
from mjrun.model.source import CollectionModelSource, ModelSource
from mjrun.options.option import is_given, options_of
from mjrun.options.task import CONTROL, POSITION, TORQUE, VELOCITY, ActionOptions, ObservationOptions
from mjrun.policy.policy import Numbers, ObservationFacts, Policy, PolicyFacts
from mjrun.policy.task_agreement import JOINTS, last_part
from mjrun.task.task import Action, Observation, Reset, Task

DURATION = Fraction(5)  # [s], the default duration of simulations
LAST_ACTION = ("actions", "last_action")  # mjlab's names
BODIES = {"state/body/rotation": "xquat", "state/body/position": "xpos"}  # by the kinds of LEAPP
PERIOD = "its control period"


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
