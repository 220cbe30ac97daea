"""`mjrun trace` as a user runs it."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

from mjrun.cli.commands.trace import verification_lines
from mjrun.simulation.verification import StateDifference, VerificationResult
from tests.cases import cases

if TYPE_CHECKING:
    from tests.conftest import Command

ROOT = Path(__file__).parents[3]
PENDULUM = ROOT / "scenes/pendulum.xml"


def test_the_head_of_a_trace_is_a_header_and_rows_and_nothing_else() -> None:
    command = f"'{sys.executable}' -m mjrun trace '{PENDULUM}' --csv | head -3; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True)
    *table, code = done.stdout.splitlines()
    assert done.stderr == ""
    assert code == "141"
    assert len(table) == 3
    names, first, second = (line.split(",") for line in table)
    assert names[0] == "time"
    assert len(names) == len(first) == len(second)
    assert (float(first[0]), float(second[0])) == (0, mujoco.MjModel.from_xml_path(str(PENDULUM)).opt.timestep)


def test_a_table_on_stdout_is_silent_on_stderr(mjrun_here: Command) -> None:
    done = mjrun_here("trace", PENDULUM, "--duration", "0.1")
    assert (done.returncode, done.stderr) == (0, b"")
    assert len(done.stdout.splitlines()) == 1 + 1 + round(0.1 / 0.001) or done.stdout.startswith(b"time,")


def test_a_table_in_a_file_is_reported_in_a_sentence(mjrun_here: Command) -> None:
    done = mjrun_here("trace", PENDULUM, "--steps", "10", "-o", "run.csv")
    assert done.returncode == 0
    assert done.stdout.decode().startswith("run.csv: 11 rows, ")
    assert mjrun_here.files() == ["run.csv"]


def test_every_format_holds_the_same_numbers(mjrun_here: Command) -> None:
    import numpy as np
    import pyarrow.feather
    import pyarrow.parquet
    import scipy.io

    for suffix in ("csv", "jsonl", "parquet", "feather", "npz", "mat", "h5"):
        assert mjrun_here("trace", PENDULUM, "--key", "level", "--steps", "50", "-o", f"t.{suffix}").returncode == 0
    lines = (mjrun_here.folder / "t.csv").read_text().splitlines()
    names = lines[0].split(",")
    table = np.array([line.split(",") for line in lines[1:]], float)
    rows = [json.loads(line) for line in (mjrun_here.folder / "t.jsonl").read_text().splitlines()]
    assert [list(row) for row in rows] == [names] * 51
    assert np.array_equal([list(row.values()) for row in rows], table)
    parquet = pyarrow.parquet.read_table(mjrun_here.folder / "t.parquet")
    feather = pyarrow.feather.read_table(mjrun_here.folder / "t.feather")
    npz = np.load(mjrun_here.folder / "t.npz")
    scipy.io.loadmat(mjrun_here.folder / "t.mat")
    for i, name in enumerate(names):
        assert np.array_equal(parquet[name].to_numpy(), table[:, i])
        assert np.array_equal(feather[name].to_numpy(), table[:, i])
        assert np.array_equal(npz[name], table[:, i])


def test_the_list_names_columns_units_and_objects(mjrun_here: Command) -> None:
    lines = mjrun_here("trace", ROOT / "scenes/pinata.xml", "--list", "--all").stdout.decode().splitlines()
    assert lines[0].split() == ["time", "s", "simulated", "time,", "exact"]
    swing = next(line for line in lines if line.startswith("qpos/swing "))
    assert swing.split() == ["qpos/swing", "rad", "joint", "0", "position"]
    document = json.loads(mjrun_here("trace", ROOT / "scenes/pinata.xml", "--list", "--json").stdout)
    assert [column["name"] for column in document["columns"]] == [line.split()[0] for line in lines]


def test_the_list_of_groups_counts_the_columns_of_each(mjrun_here: Command) -> None:
    scene = ROOT / "scenes/pinata.xml"
    every = json.loads(mjrun_here("trace", scene, "--list", "--json").stdout)["columns"]
    counts = Counter(column["name"].partition("/")[0] for column in every)
    _, _, *lines, _, hint = mjrun_here("trace", scene, "--list").stdout.decode().splitlines()
    assert [line.split()[:2] for line in lines] == [[name, str(count)] for name, count in counts.items()]
    qvel = next(line for line in lines if line.split()[0] == "qvel")
    assert qvel.split()[2:] == ["rad/s,", "m/s", "joint", "velocity"]
    assert hint == "--list --all lists every column, --list --probe NAME those of a group"
    done = mjrun_here("trace", scene, "--all")
    assert (done.returncode, done.stderr) == (2, b"mjrun: error: --all requires --list\n")


def test_an_assertion_that_fails_ends_with_one_and_says_where(mjrun_here: Command) -> None:
    done = mjrun_here("trace", PENDULUM, "--steps", "10", "-o", "t.csv", "--assert", "max(time) < 0")
    assert done.returncode == 1
    assert b"max(time) < 0" in done.stderr
    assert mjrun_here.files() == ["t.csv"]
    assert mjrun_here("trace", PENDULUM, "--steps", "10", "-o", "t.csv", "--assert", "max(time) > 0").returncode == 0


def test_an_assertion_over_rows_that_never_count_says_so(mjrun_here: Command) -> None:
    arguments = ("trace", PENDULUM, "--steps", "10", "-o", "t.csv", "--assert", "time < 4 or energy/total > 1e9")
    sentence = "it holds on all 11 rows: on 11 by time < 4 alone, on none by energy/total > 1e9 alone"
    assert f"assertion passed: {arguments[-1]}: {sentence}" in mjrun_here(*arguments).stdout.decode()
    (verdict,) = json.loads(mjrun_here(*arguments, "--json").stdout)["assertions"]
    assert verdict["rows"] == 11
    assert verdict["decided"] == [{"part": "time < 4", "rows": 11}, {"part": "energy/total > 1e9", "rows": 0}]
    assert verdict["message"].endswith(sentence)


def test_json_and_a_table_do_not_share_stdout(mjrun_here: Command) -> None:
    assert mjrun_here("trace", PENDULUM, "--json").returncode == 2
    found = json.loads(mjrun_here("trace", PENDULUM, "--json", "-o", "t.csv", "--steps", "3").stdout)
    assert (found["rows"], found["format"], found["steps"]) == (4, "csv", 3)


def test_a_wrong_probe_lists_near_names(mjrun_here: Command) -> None:
    done = mjrun_here("trace", PENDULUM, "--probe", "qpos,enrgy")
    assert done.returncode == 2
    assert b"no probe 'enrgy' (did you mean 'energy'?)" in done.stderr
    assert done.stdout == b""


def test_the_list_is_of_the_probes_that_are_given(mjrun_here: Command) -> None:
    lines = mjrun_here("trace", PENDULUM, "--list", "--probe", "energy/drift,time,qpos").stdout.decode().splitlines()
    assert [line.split()[0] for line in lines] == ["time", "energy/drift", "qpos/hinge"]
    every = mjrun_here("trace", PENDULUM, "--list", "--all").stdout.decode().splitlines()
    assert {" ".join(line.split()) for line in lines} < {" ".join(line.split()) for line in every}
    done = mjrun_here("trace", PENDULUM, "--list", "--probe", "qpos,bogus")
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"no probe 'bogus'" in done.stderr


@cases("options, said")
def test_what_cannot_be_meant_is_refused_and_nothing_is_written(
    mjrun_here: Command, options: list[str], said: str
) -> None:
    done = mjrun_here("trace", PENDULUM, "--steps", "3", *options)
    assert (done.returncode, done.stdout) == (2, b"")
    assert said in done.stderr.decode()
    assert mjrun_here.files() == []


def test_csv_is_the_format_said_shortly(mjrun_here: Command) -> None:
    tables = [
        mjrun_here("trace", PENDULUM, "--steps", "3", *options)
        for options in ([], ["--csv"], ["--format", "csv"], ["--csv", "--format", "csv"])
    ]
    assert {done.returncode for done in tables} == {0}
    assert len({done.stdout for done in tables}) == 1
    assert mjrun_here("trace", PENDULUM, "--steps", "3", "--csv", "-o", "t.dat").returncode == 0
    assert (mjrun_here.folder / "t.dat").read_bytes() == tables[0].stdout


def test_a_rate_above_that_of_the_steps_is_a_warning(mjrun_here: Command) -> None:
    done = mjrun_here("trace", PENDULUM, "--steps", "3", "--rate", "30000")
    assert done.returncode == 0
    assert b"warning: --rate 30000 exceeds the 500 steps of a simulated second" in done.stderr
    assert len(done.stdout.splitlines()) == 5


def test_the_last_instant_is_saved_as_a_keyframe_that_the_next_run_starts_from(mjrun_here: Command) -> None:
    arguments = ("--steps", "50", "--push", "pendulum=0.1/0/0@0.01+0.02")
    assert mjrun_here("trace", PENDULUM, *arguments, "-o", "a.csv", "--save-key", "p.xml:later").returncode == 0
    assert mjrun_here("trace", "p.xml", "--key", "later", "--steps", "1", "-o", "b.csv").returncode == 0
    before, after = ((mjrun_here.folder / name).read_text().splitlines() for name in ("a.csv", "b.csv"))
    assert before[-1].split(",")[1:3] == after[1].split(",")[1:3]

    assert mjrun_here("trace", PENDULUM, "--steps", "1", "-o", "a.csv", "--save-key", "q.xml").returncode == 0
    assert '<key name="end" ' in (mjrun_here.folder / "q.xml").read_text()
    printed = mjrun_here("trace", PENDULUM, *arguments, "--save-key", "p.xml:later", "--print-document").stdout.decode()
    assert "push: pendulum=0.1/0/0@0.01+0.02\n" in printed
    assert printed.endswith("keyframes:\n- {output: p.xml, name: later}\n")

    done = mjrun_here("trace", PENDULUM, "--steps", "1", "--save-key", "-")
    assert done.returncode == 2
    assert b"--save-key: '-' is not the name of a file" in done.stderr


def test_a_recording_is_verified_and_the_exit_code_is_the_verdict(mjrun_here: Command) -> None:
    assert mjrun_here("trace", PENDULUM, "--key", "level", "--steps", "100", "--recording", "r.npz").returncode == 0
    same = mjrun_here("trace", PENDULUM, "--replay", "r.npz", "--verify")
    assert (same.returncode, same.stderr) == (0, b"")
    assert same.stdout == b"r.npz: stepped again, and the same: 100 steps, bit for bit\n"

    other = mjrun_here("trace", PENDULUM, "--replay", "r.npz", "--verify", "--set", "opt.gravity=0,0,-9.80", "--json")
    assert other.returncode == 1
    document = json.loads(other.stdout)
    assert (document["agrees"], document["steps"]) == (False, 1)
    assert document["origins"][-1] == "overrides: recorded with none, verified with opt.gravity=0,0,-9.80"

    without = mjrun_here("trace", PENDULUM, "--verify")
    assert (without.returncode, without.stderr.decode()) == (
        2,
        "mjrun: error: --verify requires a recording: name it with --replay\n",
    )
    written = mjrun_here("trace", PENDULUM, "--replay", "r.npz", "--verify", "-o", "a.csv")
    assert written.returncode == 2
    assert b"--verify compares states and measures nothing: leave out --output" in written.stderr
    assert mjrun_here.files() == ["r.npz"]


def test_the_names_are_those_that_a_trace_can_write(mjrun_here: Command, swing: Path) -> None:
    names = [line.split()[0] for line in mjrun_here("trace", swing, "--list", "--all").stdout.decode().splitlines()]
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


SAME = VerificationResult("r.npz", True, 1001, 1000, 2.0, [], [])


def test_the_same_again_is_one_line_that_says_how_much_was_compared() -> None:
    assert list(verification_lines(SAME)) == ["r.npz: stepped again, and the same: 1000 steps, bit for bit"]
    some = VerificationResult("r\n.npz", True, 11, 1000, 2.0, [], ["MuJoCo: other"])
    assert list(verification_lines(some)) == [
        r"r\n.npz: stepped again, and the same: 1000 steps, bit for bit at its 11 states",
        "  MuJoCo: other",
    ]


def test_a_difference_has_its_step_its_places_and_what_is_not_as_it_was() -> None:
    differences = [
        StateDifference("qpos", "qpos/knee", 1.0, 1.25, 1),
        StateDifference("qvel", "qvel/root/vz", 0.0, -0.0, 6),
        StateDifference("act", "act/a\x1b", 2.0, None, 1),
    ]
    result = VerificationResult("r.npz", False, 3, 2, 0.004, differences, ["the physics differs"])
    assert list(verification_lines(result)) == [
        "r.npz: stepped again, and not the same: the first difference is at step 2, time 0.004 s",
        "  qpos/knee: recorded 1.0, stepped 1.25, 0.25 apart",
        "  qvel/root/vz: recorded 0.0, stepped -0.0, 0 apart (and 5 more of qvel)",
        r"  act/a\x1b: recorded 2.0, stepped to what is not finite",
        "  the physics differs",
    ]


def test_a_terminal_gets_the_range_of_each_column_and_a_pipe_the_rows(mjrun: Command) -> None:
    ours, theirs = os.openpty()
    line = ("trace", PENDULUM, "--key", "level", "--duration", "0.1", "--probe", "energy")
    done = mjrun(*line, env={"TERM": "dumb", "COLUMNS": "100"}, stdout=theirs)
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    assert done.returncode == 0

    rows = list(csv.DictReader(mjrun(*line).stdout.decode().splitlines()))
    assert f"{len(rows)} rows, 5 columns, 0.1 s in 50 steps" in shown
    words = {cells[0]: cells for cells in (line.split() for line in shown.splitlines()) if cells}
    for name in rows[0]:
        values = [float(row[name]) for row in rows]
        expected = [min(values), max(values), sum(values) / len(values), values[-1]]
        assert words[name][-4:] == [f"{value + 0:.5g}" for value in expected]
