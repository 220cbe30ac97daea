"""`mjrun trace --list` and `mjrun info --columns` as a user runs them."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.conftest import Command


def test_the_names_are_those_that_a_trace_can_write(mjrun_here: Command, swing: Path) -> None:
    names = [line.split()[0] for line in mjrun_here("trace", swing, "--list").stdout.decode().splitlines()]
    assert names[0] == "time"
    written = mjrun_here(
        "trace", swing, "--duration", "0.01", *(f"--probe={name}" for name in names[1:])
    ).stdout.decode()
    assert next(csv.reader(io.StringIO(written))) == names


def test_every_line_and_every_object_has_the_unit_and_the_owner(mjrun_here: Command, swing: Path) -> None:
    columns = json.loads(mjrun_here("trace", swing, "--list", "--json").stdout)["columns"]
    by_name = {column["name"]: column for column in columns}
    assert (by_name["qpos/hinge"]["unit"], by_name["qpos/hinge"]["kind"]) == ("rad", "joint")
    lines = mjrun_here("info", swing, "--columns").stdout.decode().splitlines()
    assert len(lines) == len(columns)
    for line, column in zip(lines, columns, strict=True):
        assert line.split()[0] == column["name"]
        assert column["unit"] in line
        assert line.endswith(column["meaning"])
        assert line == line.rstrip()


def test_the_list_may_be_that_of_some_probes(mjrun_here: Command, swing: Path) -> None:
    lines = mjrun_here("trace", swing, "--list", "--probe", "qvel/hinge").stdout.decode().splitlines()
    assert [line.split()[0] for line in lines] == ["time", "qvel/hinge"]
