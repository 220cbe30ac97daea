"""What a worker simulates with, compared with what a study expects: a part of something else is refused."""

import hashlib
import socket
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.errors import clean
from mjrun.model.source import Source
from mjrun.python_code import ModuleSource, module_sources
from mjrun.version import __version__


def versions() -> dict[str, str]:
    """Returns the versions of all that decides the results of a simulation, beside its inputs."""
    return {"mjrun": __version__, "mujoco": mujoco.mj_versionString(), "numpy": np.__version__}


def code_hash(code: Iterable[object], known: Iterable[ModuleSource] = ()) -> str:
    """Returns the SHA-256 of the user's modules that hold `code`; empty if there are none.

    Args:
      known: see `module_sources`.
    """
    digest, count = hashlib.sha256(), 0
    for source in module_sources(code, known):
        digest.update(f"{source.name}\0{len(source.content)}\0".encode() + source.content)
        count += 1
    return digest.hexdigest() if count else ""


@dataclass(frozen=True)
class Proof:
    """What a process has simulated with.

    Attributes:
      versions: of libraries, by name.
      environments: packages of environments that models come from, by the model; see `Source.code`.
      host: the machine.
    """

    versions: Mapping[str, str]
    environments: Mapping[str, str]
    host: str

    @classmethod
    def here(cls, models: Iterable[Source]) -> "Proof":
        """Returns what this process simulates `models` with."""
        return cls(versions(), {model.text: code for model in models if (code := model.code)}, socket.gethostname())

    def difference(self, expected: "Proof") -> str:
        """Returns what differs from what is expected, for a message; empty if nothing does."""
        wanted = {**expected.versions, **expected.environments}
        differing = [
            f"{clean(name)} {clean(value)} instead of {clean(wanted[name])}"
            for name, value in {**self.versions, **self.environments}.items()
            if wanted.get(name, value) != value
        ]
        return ", ".join(differing)
