"""`mjrun info` of a task document as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mjrun.cli.commands.schema import schema_of
from mjrun.task.description import SECTIONS
from tests.document.schema_oracle import fits

if TYPE_CHECKING:
    from tests.conftest import Command

SCENES = Path(__file__).parents[2] / "scenes"
TASKS = [path for path in sorted(SCENES.glob("*.yaml")) if "control_dt:" in path.read_text("utf-8")]


@pytest.mark.parametrize("path", TASKS, ids=lambda path: path.stem)
def test_the_page_names_what_the_document_names(mjrun_here: Command, path: Path) -> None:
    document = json.loads(mjrun_here("info", path, "--json").stdout)
    assert [*document] == [*SECTIONS, "schema"]
    schema = schema_of("info-task")
    assert fits(document, schema, schema)
    page = mjrun_here("info", path, *SECTIONS).stdout.decode()
    for section in SECTIONS[1:]:
        assert f"\n{section}  {len(document[section]) or 'none'}\n" in page
        assert all(row["name"] in page for row in document[section])
    for section, key in (("observations", "source"), ("rewards", "value"), ("terminations", "when")):
        assert all(row[key] in page for row in document[section])


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_line_is_wider_than_the_terminal(mjrun_here: Command, width: int) -> None:
    done = mjrun_here("info", SCENES / "humanoid_stand.yaml", env={"COLUMNS": str(width)})
    assert max(map(len, done.stdout.decode().splitlines())) <= width


def test_a_section_alone_is_shown_whole(mjrun_here: Command) -> None:
    done = mjrun_here("info", SCENES / "car_drive.yaml", "actions")
    assert done.stdout.decode().splitlines() == [
        "actions  2",
        "  index  name     target   squash  ctrlrange",
        "      0  forward  control  tanh        -1..1",
        "      1  turn     control  tanh        -1..1",
    ]


def test_long_vectors_are_cut_unless_they_are_asked_for(mjrun_here: Command, tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(
        "model: scene:humanoid\ncontrol_dt: 0.02\nduration: 1\nobservations: [{name: all, probe: [qpos, qvel]}]\n"
        "actions: [{actuators: '*', scale: 0.5, clip: [-1, 1]}]"
    )
    page = mjrun_here("info", path).stdout.decode()
    assert f"… 33 more: mjrun info {path} observations" in page
    assert "no room" not in page
    whole = mjrun_here("info", path, "observations").stdout.decode()
    assert "observations  57\n" in whole
    assert "all/qvel/right_ankle_roll" in whole or "right_ankle_roll" in whole


def test_mistakes_are_reported_at_their_lines(mjrun_here: Command, tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text((SCENES / "car_drive.yaml").read_text().replace("car.xml", "scene:car").replace("turn]", "tern]"))
    done = mjrun_here("info", path)
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if "tern]" in text)
    assert done.returncode == 2
    assert f"t.yaml:{line}:".encode() in done.stderr
    assert b"no actuator 'tern' (did you mean 'turn'?)" in done.stderr
    assert b"rewars" in mjrun_here("info", SCENES / "car_drive.yaml", "rewars").stderr
