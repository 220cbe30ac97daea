"""`mjrun info` of a file of demonstrations, and commands on one of them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from mjrun.cli.info_sections import demonstrations_page
from mjrun.hdf5.demonstration_list import DemonstrationFileOrigin, DemonstrationList, DemonstrationListEntry
from tests.cases import cases
from tests.demonstration_files import PLAIN, recorded_states, write_demonstrations

if TYPE_CHECKING:
    from tests.conftest import Command


def test_the_page_lists_the_demonstrations_and_a_command_for_one(mjrun_here: Command) -> None:
    images = {"agentview_image": np.zeros((5, 2, 2, 3), np.uint8)}
    write_demonstrations(mjrun_here.folder / "d.hdf5", {"demo_1": recorded_states()}, observations=images)
    done = mjrun_here("info", "d.hdf5")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode().splitlines() == [
        "d.hdf5",
        "  task          Lift",
        "  made with     robosuite 1.4.1",
        "  control rate  20 Hz",
        "  cameras       agentview",
        "",
        "demonstrations  1",
        "  name    states  duration  images",
        "                       [s]",
        "  demo_1       5       0.2  agentview_image",
        "",
        "mjrun video d.hdf5:demo_1 --camera agentview",
    ]
    document = json.loads(mjrun_here("info", "d.hdf5", "--json").stdout)
    assert document["demonstrations"][0]["images"] == ["agentview_image"]


def test_texts_in_the_file_are_cleaned() -> None:
    hostile = "\x1b]0;owned\x07"
    episode = DemonstrationListEntry(hostile, 1, None, hostile, None, [hostile])
    origin = DemonstrationFileOrigin(hostile, hostile, hostile, hostile)
    page = demonstrations_page(DemonstrationList("d.hdf5", origin, [hostile], {hostile: 1}, [episode]))
    assert "\x1b" not in page
    assert page.count(r"\x1b]0;owned\x07") >= 7


@cases("line, code, message")
def test_mistakes_are_answered(mjrun_here: Command, line: str, code: int, message: str) -> None:
    write_demonstrations(mjrun_here.folder / "d.hdf5")
    done = mjrun_here(*line.split())
    assert (done.returncode, message in done.stderr.decode()) == (code, True)
    assert not (mjrun_here.folder / "t.csv").exists()


def test_a_corrected_copy_of_a_model_replays_the_states(mjrun_here: Command) -> None:
    old = PLAIN.replace("<visual>", '<option collision="all"/><visual>')
    write_demonstrations(mjrun_here.folder / "d.hdf5", model=old)
    done = mjrun_here("trace", "d.hdf5:demo_1", "-o", "t.csv")
    assert (done.returncode, b"`mjrun info d.hdf5:demo_1 --xml > fixed.xml` writes its MJCF" in done.stderr) == (
        3,
        True,
    )
    (mjrun_here.folder / "fixed.xml").write_bytes(mjrun_here("info", "d.hdf5:demo_1", "--xml").stdout)
    assert mjrun_here("check", "fixed.xml", "--fix", "--fail-on", "error").returncode == 0
    done = mjrun_here("trace", "fixed.xml", "--replay", "d.hdf5:demo_1", "--rate", "20", "-o", "t.csv")
    assert done.returncode == 0, done.stderr
    assert len((mjrun_here.folder / "t.csv").read_text().splitlines()) == 6


def test_a_file_is_exported_as_a_dataset(mjrun_here: Command) -> None:
    write_demonstrations(mjrun_here.folder / "d.hdf5")
    done = mjrun_here("export", "d.hdf5", "--jobs", "1", "--json", "-o", "set")
    assert done.returncode == 0, done.stderr
    assert {"episodes": 2, "rows": 9, "format": "lerobot"}.items() <= json.loads(done.stdout).items()
    assert b"d.hdf5:demo_1 does not state its version of MuJoCo" in done.stderr
    manifest = mjrun_here.folder / "set/mjrun/dataset.json"
    made = json.loads(manifest.read_bytes())["episodes"]
    assert [each["demonstration"] for each in made] == ["d.hdf5:demo_1", "d.hdf5:demo_2"]
    assert mjrun_here("export", "d.hdf5", "--jobs", "1", "-o", "set").returncode == 0
    assert json.loads(manifest.read_bytes())["episodes"] == made


def test_documents_name_demonstrations_relative_to_themselves(mjrun_here: Command) -> None:
    (mjrun_here.folder / "inner").mkdir()
    write_demonstrations(mjrun_here.folder / "inner/d.hdf5")
    document = "{model: d.hdf5:demo_1, replay: d.hdf5:demo_2, traces: [{output: t.csv, rate: 20}]}"
    (mjrun_here.folder / "inner/run.yaml").write_text(document)
    done = mjrun_here("run", "inner/run.yaml", "-o", "out")
    assert done.returncode == 0, done.stderr
    assert len((mjrun_here.folder / "out/t.csv").read_text().splitlines()) == 5
    printed = mjrun_here("trace", "inner/d.hdf5:demo_1", "-o", "t.csv", "--print-document").stdout.decode()
    assert "model: inner/d.hdf5:demo_1" in printed
