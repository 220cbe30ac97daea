"""Facts about the machine that a benchmark runs on."""

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjrun.platform.cores import available_cores

CPU_INFO = Path("/proc/cpuinfo")
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
BUSY = 0.25  # load per core above which figures are unreliable


@dataclass(frozen=True)
class MachineInfo:
    """A machine and its load.

    Attributes:
      system: operating system and architecture.
      cpu: model name of the processor.
      cores, available: logical processors, and those that this process may use.
      governor: Linux' policy for the processor's frequency; None if it cannot be read.
      load: average number of running or waiting processes over the last minute; None if it cannot be read.
    """

    system: str
    cpu: str
    cores: int
    available: int
    governor: str | None
    load: float | None

    @property
    def disturbances(self) -> Sequence[str]:
        """Sentences on conditions that distort figures."""
        causes = list[str]()
        if self.load is not None and self.load > BUSY * self.cores:
            causes.append(f"other processes keep this machine busy: load average {self.load:.2f} on {self.cores} cores")
        if self.governor not in (None, "performance"):
            causes.append(f"the processor's governor is {self.governor}; performance makes figures steadier")
        return causes


def machine_info() -> MachineInfo:
    """Returns the facts about this machine."""
    return MachineInfo(
        system=f"{platform.system()} {platform.machine()}",
        cpu=_cpu(),
        cores=os.cpu_count() or 1,
        available=available_cores(),
        governor=_text(GOVERNOR),
        load=round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    )


def _cpu() -> str:
    for line in (_text(CPU_INFO) or "").splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine()


def _text(path: Path) -> str | None:
    try:
        return path.read_text("utf-8", "replace").strip() or None
    except OSError:
        return None
