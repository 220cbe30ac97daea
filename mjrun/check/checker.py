"""The base of checkers, which run in a process that may hang, explode or crash, and write each finding at once."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import mujoco

from mjrun.check.rule import Finding
from mjrun.check.rules import process_failures
from mjrun.check.worker_pool import WorkerTask
from mjrun.child_process import limit_this_process
from mjrun.errors import option

ARENAS = 20  # the number of MjData that a check makes; their arenas are hardly ever filled
MEMORY_REMEDY = f"raise {option('memory')}, or look for a size that is too large"


class Checker(ABC):
    """A check of one model or task, which writes its findings to `channel`."""

    def __init__(self, task: WorkerTask, channel: TextIO) -> None:
        self.task, self.channel = task, channel
        self.path = Path(task.path)

    def run(self) -> None:
        """Runs the check, and writes each finding at once."""
        try:
            self.check()
        except (MemoryError, mujoco.FatalError) as error:
            if isinstance(error, mujoco.FatalError) and "allocate" not in str(error):
                raise
            limit_this_process(memory=math.inf)
            message = "it needs more memory than allowed"
            self.write_findings([process_failures.OUT_OF_MEMORY.in_model(self.path, message, MEMORY_REMEDY)])
        self.write(done=True)

    @abstractmethod
    def check(self) -> None:
        """Runs the check."""

    def write_findings(self, findings: Iterable[Finding]) -> None:
        """Writes each of `findings`."""
        for finding in findings:
            self.write(finding=asdict(finding))

    def write(self, **message: Any) -> None:
        """Writes one message: `stage`, `finding`, `loaded` or `done`."""
        self.channel.write(json.dumps(message) + "\n")
        self.channel.flush()
