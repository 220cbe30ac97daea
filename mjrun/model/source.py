"""What stands where a model stands."""

from dataclasses import dataclass
from pathlib import Path

import mujoco

from mjrun.model.load import load
from mjrun.model.override import Setting


@dataclass(frozen=True)
class Source:
    """A model file and the overrides to load it with."""

    path: Path
    settings: tuple[Setting, ...] = ()

    def load(self) -> mujoco.MjModel:
        """The compiled model."""
        return load(self.path, overrides=self.settings)
