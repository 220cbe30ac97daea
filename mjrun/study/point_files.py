"""The files that are kept of a point, each made by the ordinary job of its kind, in a process of their own."""

import contextlib
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from mjrun.errors import MjrunError
from mjrun.formats.atomic_output import written_file
from mjrun.formats.study_folder import NAME, read_point
from mjrun.options.option import options_of
from mjrun.options.sweep import KeepOptions
from mjrun.outputs.output import Job, OutputResult
from mjrun.python_code import Sealed
from mjrun.simulation.manifest import plain
from mjrun.simulation.simulation import Simulation
from mjrun.worker import Worker, WorkerEndedError

FOLDER = "points"
NAMES = {"trace": "trace.parquet", "recording": "recording.npz", "video": "video.mp4"}


@dataclass(frozen=True)
class PointOutputs:
    """What is kept of a point: a picklable value.

    Attributes:
      folder: of the point.
      simulation: of the point; up to the last good step where it became unstable.
      key: of the point, and of all that decides its results.
      kinds: of the files, as `NAMES` has them.
      options: of the files.
      every: steps from one row of a trace to the next.
      facts: what else the manifest says.
    """

    folder: Path
    simulation: Simulation
    key: str
    kinds: tuple[str, ...]
    options: KeepOptions
    every: int
    facts: Mapping[str, object]

    def jobs(self, kinds: Sequence[str]) -> list[Job[OutputResult]]:
        """The jobs that make files of some kinds."""
        return [self._job(kind, str(self.folder / NAMES[kind])) for kind in kinds]

    def missing(self) -> list[str]:
        """The kinds whose files are not there, or of another simulation or other options."""
        known = read_point(self.folder)
        same = known.get("key") == self.key
        files = known.get("files") if same else {}
        files = files if isinstance(files, dict) else {}
        return [
            kind
            for kind in self.kinds
            if files.get(NAMES[kind]) != self._digest(kind) or not (self.folder / NAMES[kind]).is_file()
        ]

    def make(self) -> None:
        """Makes the files that are missing, and the manifest; what an older simulation has left is removed.

        Raises:
          MjrunError: one could not be made; none of them is there then, unless it was before.
        """
        from mjrun.outputs.perform import perform

        kinds, known = self.missing(), read_point(self.folder)
        files = known.get("files") if known.get("key") == self.key else None
        files = dict(files) if isinstance(files, dict) else {}
        if kinds:
            perform(self.jobs(kinds))
        files |= {NAMES[kind]: self._digest(kind) for kind in kinds}
        for name in NAMES.values():
            if name not in files:
                (self.folder / name).unlink(missing_ok=True)
        document = {"key": self.key, **self.facts, "files": files}
        with written_file(self.folder / NAME, f"{json.dumps(document, indent=2)}\n".encode()) as output:
            output.publish()

    def _job(self, kind: str, path: str) -> Job[OutputResult]:
        options = self.options
        match kind:
            case "trace":
                from mjrun.outputs.trace import Trace

                return Trace(self.simulation, path, probe=options.probe, every=self.every)
            case "recording":
                from mjrun.outputs.recording import Recording

                return Recording(self.simulation, path)
            case "video":
                from mjrun.outputs.video import Video

                return Video(
                    self.simulation,
                    path,
                    camera=options.camera,
                    size=options.size,
                    quality=options.quality,
                    fps=options.fps,
                    speed=options.speed,
                    jobs=1,
                )
            case _:
                raise ValueError(f"no output {kind} can be kept")

    def _digest(self, kind: str) -> str:
        """What decides the content of a file, besides the simulation."""
        job = plain(self._job(kind, NAMES[kind]))
        assert isinstance(job, dict)
        del job["simulation"]
        return hashlib.sha256(json.dumps(job, sort_keys=True).encode()).hexdigest()[:16]


class PointFileServer:
    """Makes files of points in a process of their own."""

    def make(self, sealed: Sealed) -> None:
        """Makes what is missing of a sealed `PointOutputs`."""
        outputs = cast("PointOutputs", sealed.open())
        snapshot = outputs.simulation.snapshot
        with snapshot.original_names_in_errors() if snapshot else contextlib.nullcontext():
            outputs.make()


def make_isolated(outputs: PointOutputs) -> str:
    """Makes the files of a point in a process of its own, and returns why it failed: nothing if it did not."""
    with Worker("mjrun.study.point_files:PointFileServer", environment={}) as worker:
        try:
            worker.ask("make", Sealed.of(outputs, outputs.simulation.code))
        except WorkerEndedError as error:
            return f"the process that simulated it {error}"
        except MjrunError as error:
            return str(error)
    return ""


def up_to(simulation: Simulation, steps: int) -> Simulation:
    """The same simulation, which ends after so many steps."""
    return replace(simulation, steps=steps, duration=None)


def keep_options(options: KeepOptions) -> KeepOptions:
    """These options alone, of whatever class they are part of."""
    values = {each.attribute: getattr(options, each.attribute) for each in options_of(KeepOptions)}
    return KeepOptions(**values)
