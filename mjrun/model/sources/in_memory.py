"""A compiled model in memory as a source, for Python callers."""

from dataclasses import dataclass

import mujoco

from mjrun.errors import CompiledOverrideError
from mjrun.model.source import Source


@dataclass(frozen=True)
class CompiledSource(Source):
    """A compiled model, which is used as it is."""

    model: mujoco.MjModel

    @property
    def text(self) -> str:
        return ""

    @property
    def stem(self) -> str:
        return "model"

    def compile(self) -> tuple[None, mujoco.MjModel]:
        if self.overrides:
            raise CompiledOverrideError("the model", [(s.option, s.option_value) for s in self.overrides])
        return None, self.model
