"""The number of processor cores that this process may use: its affinity, and the CPU quotas of its control groups.

Containers limit a process by a quota of CPU time, which neither `os.cpu_count` nor the affinity shows. With more busy
processes than the quota allows, the kernel stops all of them for the rest of each period.
"""

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

PROCESS = Path("/proc/self")
CONTROLLER = "cpu"


def available_cores() -> int:
    """Returns the number of cores that this process may use; a quota of part of a core counts as a whole one."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, min([cores, *map(math.ceil, _quotas())]))


def _quotas() -> Iterator[float]:
    """Yields the limits of this process's control groups and of those above them, of version 1 and 2 [cores]."""
    with suppress(OSError, ValueError):  # other systems have neither file
        groups = list(_groups((PROCESS / "cgroup").read_text()))
        mounts = list(_mounts((PROCESS / "mountinfo").read_text()))
        for version, group in groups:
            for mounted, root, point in mounts:
                if mounted == version:
                    yield from _quotas_up(_folder(group, root, point), point, version)


def _groups(text: str) -> Iterator[tuple[int, str]]:
    """Yields version and path of the control groups in `/proc/self/cgroup` that may limit CPU time."""
    for line in text.splitlines():
        hierarchy, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if hierarchy == "0" and not controllers:
            yield 2, path
        elif CONTROLLER in controllers.split(","):
            yield 1, path


def _mounts(text: str) -> Iterator[tuple[int, str, Path]]:
    """Yields version, root and mount point of the file systems of control groups in `/proc/self/mountinfo`."""
    for line in text.splitlines():
        before, _, after = line.partition(" - ")
        kind, _, options = after.split(" ", 2)
        if kind == "cgroup2" or (kind == "cgroup" and CONTROLLER in options.split(",")):
            root, point = (_unescaped(field) for field in before.split(" ")[3:5])
            yield 2 if kind == "cgroup2" else 1, root, Path(point)


def _unescaped(field: str) -> str:
    for character in " \t\n\\":
        field = field.replace(f"\\{ord(character):03o}", character)
    return field


def _folder(group: str, root: str, point: Path) -> Path:
    """Returns the folder of a group, or the mount point where the group is outside of what is mounted there."""
    path = PurePosixPath(group)
    if ".." in path.parts or not path.is_relative_to(root):
        return point
    return point / path.relative_to(root)


def _quotas_up(folder: Path, top: Path, version: int) -> Iterator[float]:
    """Yields the quotas of the group in `folder` and of those above it, up to the group in `top`."""
    for each in (folder, *folder.parents):
        with suppress(OSError, ValueError):  # the root has no files, and "max" is no number
            quota, period = _quota_and_period(each, version)
            if quota > 0 and period > 0:  # -1 is no limit
                yield quota / period
        if each == top:
            return


def _quota_and_period(folder: Path, version: int) -> tuple[int, int]:
    """Returns the CPU time that a group may use in each period, and the period [µs]."""
    if version == 2:
        quota, period = (folder / "cpu.max").read_text().split()
    else:
        quota, period = ((folder / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
    return int(quota), int(period)
