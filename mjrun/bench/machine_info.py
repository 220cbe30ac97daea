"""The machine that a benchmark runs on, as far as it can be known."""

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjrun.platform.cores import available_cores

CPU_INFO = Path("/proc/cpuinfo")
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
BUSY = 0.25  # share of the cores that others keep busy, above which figures cannot be trusted


@dataclass(frozen=True)
class MachineInfo:
    """A machine, and how busy it is.

    Attributes:
      system: operating system and architecture.
      cpu: model of the processor, by its own name.
      cores, available: logical processors, and those that this process may use.
      governor: Linux' policy for the processor's frequency; None where it cannot be read.
      load: processes that ran or waited, averaged over the last minute; None where it cannot be read.
    """

    system: str
    cpu: str
    cores: int
    available: int
    governor: str | None
    load: float | None

    @property
    def disturbances(self) -> Sequence[str]:
        """What makes figures worse than they need be."""
        causes = []
        if self.load is not None and self.load > BUSY * self.cores:
            causes.append(f"other processes keep this machine busy: load average {self.load:.2f} on {self.cores} cores")
        if self.governor not in (None, "performance"):
            causes.append(f"the processor's governor is {self.governor}; performance makes figures steadier")
        return causes


def machine_info() -> MachineInfo:
    """The machine that this runs on."""
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
