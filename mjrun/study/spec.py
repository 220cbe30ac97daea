"""What processes and machines exchange about a study: its specification, points, results, and what it was run with."""

import hashlib
import math
import socket
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from mjrun.errors import clean
from mjrun.model.source import Source
from mjrun.model.sources import source_of
from mjrun.python_code import ModuleSource, Sealed, module_sources
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.simulation import Simulation
from mjrun.study.point_simulation import MODEL, simulation_at
from mjrun.version import __version__

Status = Literal["ok", "unstable", "failed", "timeout", "crashed", "missing"]


@dataclass(frozen=True)
class StudySpec:
    """What all points of a study have in common: a picklable value.

    Attributes:
      base: the simulation that points vary.
      names: what varies.
      metrics: the name and the text of each.
      every: steps from one row that metrics look at to the next.
      engine: what steps: `c`, or `warp`, in single precision.
      controllers: where the controller varies, what each of its values stands for.
    """

    base: Simulation
    names: tuple[str, ...]
    metrics: tuple[tuple[str, str], ...]
    every: int = 1
    engine: Literal["c", "warp"] = "c"
    controllers: tuple[tuple[str, Callable[..., object]], ...] = ()

    def varying(self, names: tuple[str, ...]) -> "StudySpec":
        """The same, with what varies."""
        return replace(self, names=names)

    def simulation(self, values: tuple[str, ...]) -> Simulation:
        """The simulation of the point with these values."""
        return simulation_at(self.base, self.names, values, dict(self.controllers))

    def models(self, points: Iterable[Sequence[str]]) -> list[Source]:
        """Returns the model of the base simulation, and those that the values of points name in its place."""
        place = self.names.index(MODEL) if MODEL in self.names else None
        texts = {} if place is None else dict.fromkeys(values[place] for values in points)
        return [source_of(self.base.model), *map(source_of, texts)]

    def with_files_in(self, root: Path) -> "StudySpec":
        """Returns the same, which reads its files in the folder `root`."""
        snapshot = self.base.snapshot and replace(self.base.snapshot, root=root)
        return replace(self, base=replace(self.base, snapshot=snapshot))

    @property
    def code(self) -> list[object]:
        """What the user has written in it."""
        return [*self.base.code, *(controller for _, controller in self.controllers)]


@dataclass(frozen=True)
class StudyPoint:
    """A point: its place in the study, and its values."""

    index: int
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)  # as there may be a million of them
class PointResult:
    """What has come of a point.

    Attributes:
      index: the point's place in the study.
      status: how it ended.
      metrics: in order; NaN where the simulation did not reach its end.
      steps: taken.
      exit_code: what `mjrun trace` of this point alone would exit with; 4, too, where that would go on with a warning.
      message: why it failed; empty if it did not.
      wall: wall time [s], that of its compilation included; of points that ran side by side, its share.
    """

    index: int
    status: Status
    metrics: tuple[float, ...]
    steps: int
    exit_code: int = 0
    message: str = ""
    wall: float = 0.0


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


@dataclass(frozen=True)
class ShippedStudy:
    """All that a process needs of a study, on whatever machine: a picklable value.

    Attributes:
      spec: with the user's code in it.
      metrics: their number.
      snapshot: copies of all files that its points read.
    """

    spec: Sealed
    metrics: int
    snapshot: InputSnapshot

    @classmethod
    def of(cls, spec: StudySpec) -> "ShippedStudy":
        """Returns a study that can be sent away; one that has no copies of its files yet gets them."""
        spec = replace(spec, base=spec.base.with_snapshot())
        assert spec.base.snapshot
        return cls(Sealed.of(spec, spec.code), len(spec.metrics), spec.base.snapshot)


@dataclass(frozen=True)
class Chunk:
    """Points that are simulated in one go: a picklable value, and all that a machine needs to know.

    Attributes:
      time_limit: wall time of a point [s].
      contents: of the study's files, for a machine that has no copies of them; None for one that should have.
      refusals: how often its results were refused.
    """

    study: ShippedStudy
    points: tuple[StudyPoint, ...]
    time_limit: float = math.inf
    contents: Mapping[str, bytes] | None = None
    refusals: int = 0

    def with_contents(self) -> "Chunk":
        """Returns the same chunk with the contents of all files."""
        return replace(self, contents=self.study.snapshot.contents())

    def failed(self, message: str) -> "ChunkResult":
        """Returns the results of points that failed with this message, outside of their processes."""
        nothing = (math.nan,) * self.study.metrics
        return ChunkResult([PointResult(point.index, "failed", nothing, 0, 70, message) for point in self.points])


@dataclass(frozen=True)
class ChunkResult:
    """The results of the points of a chunk, in their order.

    Attributes:
      proofs: what they were simulated with; nothing where no process came to its end.
      lacks_files: whether nothing was simulated, since this machine has no copies of the study's files.
      is_refused: whether what was simulated belongs to something else than the study.
    """

    results: Sequence[PointResult]
    proofs: tuple[Proof, ...] = ()
    lacks_files: bool = False
    is_refused: bool = False
