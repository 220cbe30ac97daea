"""Writes a model's XML with one more keyframe, and checks with MuJoCo that it loads from its new place."""

import os
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import BrokenModelError, FileError, clean
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile
from mjrun.formats.temporary_output import temporary_file
from mjrun.model import state
from mjrun.model.compilation import compile_model
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.keyframe_text_edits import ATTRIBUTES, with_key
from mjrun.model.names import identify

ELSEWHERE = "relative paths in it start from the folder of the model: write it there"
NOT_STATE = ("qacc_warmstart",)  # fields that help the solver, whose loss is not reported
QUATERNIONS = ("qpos", "mocap_quat")  # MuJoCo normalizes those of keyframes


class KeyframeWriter(OutputWriter):
    """Writes a model's XML with a key.

    Opening it compiles the model, with a preliminary key, from the folder of the output: assets and includes must be
    found from there, and be the same.

    Args:
      path: an .xml file; it may be the model's.
      source: main file of the model.
      xml: content of that file.
      name: name of the key.
      model: the model, compiled without overrides.

    Raises:
      FileError: the output cannot be written, or would not be the same model there.
    """

    def __init__(self, path: str, source: Path, xml: bytes, name: str, model: mujoco.MjModel) -> None:
        super().__init__(StagedFile(Path(path)))
        self._source = source
        self._xml = xml
        self._name = name
        self._in_place = os.path.realpath(path) == os.path.realpath(source)
        with self.opening():
            first = _fields(model, state.save(model, mujoco.MjData(model)))
            compiled = self._compiled(with_key(xml, name, first))
            if physics_fingerprint(compiled) != physics_fingerprint(model):
                raise FileError(
                    path, f"would be another model than {clean(str(source))}: files beside it differ", ELSEWHERE
                )

    def write(self, model: mujoco.MjModel, last: np.ndarray) -> list[str]:
        """Writes the key of the integration state `last` `(nstate,)` of `model`, and loads it to compare.

        Returns:
          A sentence for each field of the state that a start from the key does not reproduce.

        Raises:
          FileError: the disk is full, or the model's file has changed in the meantime and would be overwritten.
        """
        if self._in_place and self._source.read_bytes() != self._xml:
            raise FileError(self._source, "has changed since it was read, and is left unchanged")
        text = with_key(self._xml, self._name, _fields(model, last))
        loaded = self._compiled(text)
        data = mujoco.MjData(loaded)
        mujoco.mj_resetDataKeyframe(loaded, data, identify(loaded, "keyframe", self._name))
        self.write_file(text)
        return _differences(model, last, state.save(loaded, data))

    def _compiled(self, text: bytes) -> mujoco.MjModel:
        shown = self.destination.shown
        beside = Path(self.destination.path).with_name(shown.name)
        with self.writing(), temporary_file(beside, text, ".xml") as path:
            try:
                return compile_model(lambda: mujoco.MjSpec.from_file(str(path)), (), shown)[1]
            except BrokenModelError as error:
                reason = str(error).removeprefix(f"{clean(str(shown))}:").lstrip()
                reason = f"line {reason}" if error.line else reason
                raise FileError(shown, f"would not load: {reason}", ELSEWHERE) from None


def _fields(model: mujoco.MjModel, last: np.ndarray) -> Mapping[str, np.ndarray]:
    """Returns the fields of a state that a key holds."""
    slices = state.fields(state.sizes(model))
    return {name: last[slices.get(name, slice(0, 0))] for name in ATTRIBUTES.values()}


def _differences(model: mujoco.MjModel, last: np.ndarray, loaded: np.ndarray) -> list[str]:
    """Returns a sentence for each field that differs in `loaded`, the state of a start from the key."""
    texts: list[str] = []
    for name, part in state.fields(state.sizes(model)).items():
        if name in NOT_STATE or np.array_equal(last[part], loaded[part]):
            continue
        if name in QUATERNIONS:
            texts.append(f"MuJoCo normalizes quaternions of keyframes: {name} differs in its last bits")
        elif name in ATTRIBUTES.values():
            raise AssertionError(f"{name} of the key is not that of the state")
        else:
            texts.append(f"a keyframe does not hold {name}: its value at this instant is lost")
    return texts
