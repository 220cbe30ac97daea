"""The metadata of mjlab in an ONNX file: lists separated by commas, numbers rounded to three decimals.

Source: `mjlab/rl/exporter_utils.py` of mjlab 1.6. Older versions wrote ranges as `[-1.0, 1.0]`, newer ones as `-1;1`.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NoReturn, TypeVar

from mjrun.errors import FileError, counted, quoted
from mjrun.options.task import POSITION
from mjrun.policy.policy import Numbers, ObservationFacts, PolicyFacts

KEYS = ("joint_names", "observation_names", "action_scale")  # always present in mjlab's files
ROUNDING = 5.1e-4  # the largest error of rounded numbers
T = TypeVar("T")


def is_mjlab(metadata: Mapping[str, str]) -> bool:
    """Returns whether the metadata has any of mjlab's keys; other tools write some of them too."""
    return any(key in metadata for key in KEYS)


def mjlab_facts(metadata: Mapping[str, str], path: Path) -> PolicyFacts:
    """Returns the facts in the metadata.

    Raises:
      FileError: the metadata is invalid.
    """
    lists = _Lists(metadata, path)
    joints = lists.names("joint_names")
    stiffness, damping = lists.numbers("joint_stiffness"), lists.numbers("joint_damping")
    scale = lists.numbers("action_scale")
    if stiffness is not None and damping is not None and len(stiffness) != len(damping):
        lists.refuse("joint_damping", f"has {counted(len(damping), 'number')}, and joint_stiffness {len(stiffness)}")
    default = lists.numbers("default_joint_pos")
    if joints and default is not None and len(default) != len(joints):
        lists.refuse("default_joint_pos", f"has {counted(len(default), 'number')}, and joint_names {len(joints)}")
    by_mjlab = all(key in metadata for key in KEYS)
    # Actions move the joints with actuators; the file identifies these only if all joints have one.
    all_move = joints is not None and stiffness is not None and len(stiffness) == len(joints)
    return PolicyFacts(
        observations=_observations(lists),
        joints=joints,
        default_position=default,
        action_joints=joints if all_move else None,
        action_size=None if stiffness is None else len(stiffness),
        action_target=POSITION if by_mjlab else None,  # mjlab writes metadata of position actions alone
        action_scale=scale,
        commands=lists.names("command_names"),
        stiffness=stiffness,
        damping=damping,
        quaternion_order="wxyz" if by_mjlab else None,  # MuJoCo's order
        rounding=ROUNDING,
    )


def _observations(lists: "_Lists") -> tuple[ObservationFacts, ...]:
    names = lists.names("observation_names") or ()
    scales = lists.entries("observation_terms_scale", len(names), _vector)
    clips = lists.entries("observation_terms_clip", len(names), _range)
    histories = lists.entries("observation_terms_history_length", len(names), _whole)
    return tuple(
        ObservationFacts(
            name, scale=scale, clip=_scaled(clip, scale), history=None if history is None else max(1, history)
        )
        for name, scale, clip, history in zip(names, scales, clips, histories, strict=True)
    )


def _scaled(clip: tuple[float, float] | None, scale: Numbers | None) -> tuple[float, float] | None:
    """Returns the clip after the scale, where mjlab clips before it; None if two numbers cannot express it."""
    factors = set(scale or (1.0,))
    if clip is None or len(factors) != 1:
        return None
    low, high = sorted(bound * next(iter(factors)) for bound in clip)
    return low, high


class _Lists:
    """The lists in the metadata."""

    def __init__(self, metadata: Mapping[str, str], path: Path) -> None:
        self._metadata, self._path = metadata, path

    def names(self, key: str) -> tuple[str, ...] | None:
        text = self._metadata.get(key)
        if text is None:
            return None
        names = (name.strip(" \"'") for name in text.strip("[] ").split(","))
        return tuple(name for name in names if name)

    def numbers(self, key: str) -> Numbers | None:
        text = self._metadata.get(key)
        if text is None:
            return None
        try:
            return tuple(map(float, text.strip("[] ").split(","))) if text else ()
        except ValueError:
            self.refuse(key, f"is {quoted(text[:60])}, not a list of numbers")

    def entries(self, key: str, count: int, parse: Callable[[str], T]) -> list[T | None]:
        """Returns an entry for each term of the observation; None if the file has no such entries."""
        text = self._metadata.get(key)
        if text is None:
            return [None] * count
        entries = re.findall(r"\[[^\]]*\]|[^,]+", text)
        if len(entries) != count:
            self.refuse(key, f"has {len(entries)} entries for {count} observations")
        try:
            return [parse(entry) for entry in entries]
        except ValueError:
            self.refuse(key, f"is {quoted(text[:60])}, which cannot be read")

    def refuse(self, key: str, message: str) -> NoReturn:
        raise FileError(self._path, f"the metadata {key} {message}")


def _whole(text: str) -> int:
    """Parses an integer, which newer versions write as `3.000` and older ones as `3`."""
    number = float(text)
    if not number.is_integer():
        raise ValueError(f"{text} is not a whole number")
    return int(number)


def _vector(text: str) -> Numbers:
    return tuple(float(part) for part in re.split("[;,]", text.strip("[]() ")))


def _range(text: str) -> tuple[float, float]:
    low, high = _vector(text)
    return low, high
