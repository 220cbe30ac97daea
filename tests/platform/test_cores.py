"""The number of cores under control groups of both versions, made of files as the kernel shows them."""

import ast
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import mjrun
from mjrun.platform import cores
from mjrun.platform.cores import available_cores
from tests.cases import cases

PACKAGE = Path(mjrun.__file__).parent

Machine = Callable[..., None]


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Machine:
    """Makes this process one of a machine with 64 cores, all in its affinity, that has these files.

    `{point}` in a file stands for the folder in which control groups are mounted.
    """

    def make(groups: str | None, mounts: str | None = None, **files: str) -> None:
        point = tmp_path / "control groups"
        for name, text in {"cgroup": groups, "mountinfo": mounts}.items():
            if text is not None:
                escaped = str(point).replace(" ", "\\040")
                (tmp_path / name).write_text(text.format(point=escaped))
        for path, text in files.items():
            (point / path).parent.mkdir(parents=True, exist_ok=True)
            (point / path).write_text(f"{text}\n")
        monkeypatch.setattr(cores, "PROCESS", tmp_path)
        monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(64)), raising=False)

    return make


V2 = "25 1 0:22 / {point} rw,nosuid shared:4 - cgroup2 cgroup rw,nsdelegate\n"
V1 = """\
33 24 0:30 / {point}/cpu rw shared:9 - cgroup cgroup rw,cpu,cpuacct
35 24 0:32 / {point}/memory rw - cgroup cgroup rw,memory
"""
V1_GROUPS = "12:memory:/elsewhere\n4:cpu,cpuacct:{path}\n1:name=systemd:/x\n"


@cases("quota, expected")
def test_a_quota_of_version_2_limits_the_cores(machine: Machine, quota: str, expected: int) -> None:
    machine("0::/\n", V2, **{"cpu.max": quota})
    assert available_cores() == expected


@pytest.mark.parametrize(
    ("quota", "period", "expected"),
    [("-1", "100000", 64), ("250000", "100000", 3), ("25000", "50000", 1), ("200000", "", 64)],
)
def test_a_quota_of_version_1_limits_the_cores(machine: Machine, quota: str, period: str, expected: int) -> None:
    files = {"cpu/cpu.cfs_quota_us": quota, "cpu/cpu.cfs_period_us": period, "memory/cpu.max": "1 1"}
    machine(V1_GROUPS.format(path="/"), V1, **files)
    assert available_cores() == expected


@pytest.mark.parametrize(
    ("outer", "inner", "expected"),
    [("max", "max", 64), ("300000", "max", 3), ("max", "500000", 5), ("300000", "500000", 3), ("700000", "500000", 5)],
)
def test_the_smallest_quota_of_nested_groups_counts(machine: Machine, outer: str, inner: str, expected: int) -> None:
    below = {"a/cpu.max": f"{outer} 100000", "a/b/c/cpu.max": f"{inner} 100000", "other/cpu.max": "100000 100000"}
    machine("0::/a/b/c\n", V2, **below)
    assert available_cores() == expected

    values = {"a": outer, "a/b/c": inner, "other": "100000"}
    files = {f"cpu/{path}/cpu.cfs_quota_us": value.replace("max", "-1") for path, value in values.items()}
    periods = {f"cpu/{path}/cpu.cfs_period_us": "100000" for path in values}
    machine(V1_GROUPS.format(path="/a/b/c"), V1, **files, **periods)
    assert available_cores() == expected


def test_quotas_of_both_versions_count_on_a_hybrid_machine(machine: Machine) -> None:
    mounts = V1 + V2.replace("{point}", "{point}/unified")
    files = {"cpu/cpu.cfs_quota_us": "700000", "cpu/cpu.cfs_period_us": "100000"}
    machine("1:cpu:/\n0::/\n", mounts, **files, **{"unified/cpu.max": "500000 100000"})
    assert available_cores() == 5
    machine("1:cpu:/\n0::/\n", mounts, **files, **{"unified/cpu.max": "900000 100000"})
    assert available_cores() == 7


@pytest.mark.parametrize("group", ["/docker/4f2", "/docker/4f2/inner", "/elsewhere", "/../../system.slice"])
def test_groups_are_found_where_a_container_mounts_its_own_as_the_top(machine: Machine, group: str) -> None:
    mounts = V2.replace(" / {point}", " /docker/4f2 {point}")
    machine(f"0::{group}\n", mounts, **{"cpu.max": "300000 100000", "docker/4f2/cpu.max": "100000 100000"})
    assert available_cores() == 3


def test_groups_above_the_mount_point_are_none(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "cpu.max").write_text("100000 100000")  # a file that happens to be called so
    machine("0::/a\n", V2, **{"a/cpu.max": "300000 100000"})
    assert available_cores() == 3


@pytest.mark.parametrize(
    ("groups", "mounts"),
    [(None, None), ("0::/\n", None), (None, V2), ("", ""), ("0::/\n", "no mount\n"), ("what\n", V2), ("\0", "\xff\n")],
)
def test_without_control_groups_that_can_be_read_the_affinity_counts(
    machine: Machine, groups: str | None, mounts: str | None
) -> None:
    machine(groups, mounts, **{"cpu.max": "300000 100000"} if groups == "" else {})
    assert available_cores() == 64


def test_the_affinity_limits_the_cores_below_a_quota(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    machine("0::/\n", V2, **{"cpu.max": "300000 100000"})
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 9})
    assert available_cores() == 2


@pytest.mark.parametrize(("cores", "expected"), [(8, 3), (2, 2), (None, 1)])
def test_where_there_is_no_affinity_the_cores_of_the_machine_count(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, cores: int | None, expected: int
) -> None:
    machine("0::/\n", V2, **{"cpu.max": "300000 100000"})
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    assert available_cores() == expected


def test_this_process_has_as_many_cores_as_the_system_says() -> None:
    allowed = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    assert 1 <= available_cores() <= allowed


def test_nothing_else_counts_cores() -> None:
    counts = {"cpu_count", "process_cpu_count", "sched_getaffinity"}
    homes = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if any(name in (text := path.read_text("utf-8")) for name in counts)
        for node in ast.walk(ast.parse(text))
        if getattr(node, "attr", getattr(node, "name", getattr(node, "value", None))) in counts
    }
    assert homes == {"platform/cores.py", "bench/results.py"}  # the latter tells of the machine
