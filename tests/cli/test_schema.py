"""`mjrun schema` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from mjrun.cli.main import COMMANDS
from mjrun.cli.schema import KINDS
from mjrun.document.json_schema import json_schema
from mjrun.document.schema_kinds import REPORTS
from tests.document.schema_oracle import fits

if TYPE_CHECKING:
    from tests.conftest import Command


MODEL = """
<mujoco><option timestep=".005"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".1"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/>
</body></worldbody><actuator><motor name="motor" joint="hinge" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>
"""


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "options"])
def test_each_kind_is_the_schema_of_the_library_as_json(mjrun_here: Command, kind: str) -> None:
    done = mjrun_here("schema", kind)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(done.stdout) == json.loads(json.dumps(json_schema(kind)))


LOG = "time,qpos/hinge\n" + "".join(f"{0.02 * k:g},{0.4 * 0.97**k:.9g}\n" for k in range(40))
FREE = ("--free", "joint/hinge.damping=log:1e-3..9", "--starts", "1", "--allow-unidentifiable")
PREPARATION: dict[str, list[tuple[str, ...]]] = {
    "diff": [("trace", "one.xml", "--steps", "3", "-o", f"{name}.csv") for name in "ab"],
    "plot": [("trace", "one.xml", "--steps", "3", "-o", "a.csv")],
    "verify": [("trace", "one.xml", "--steps", "3", "-o", "a.csv", "--recording", "r.npz")],
}
PRINTED: dict[str, tuple[str, ...]] = {
    "bench": ("bench", "one.xml", "--steps", "20", "--repeats", "2", "--budget", "0.1"),
    "diff": ("diff", "a.csv", "b.csv"),
    "eval": ("eval", "scene:pendulum_swing_up", "--policy", "zero", "--episodes", "2", "--jobs", "1", "-o", "e"),
    "excite": ("fit", "one.xml", *FREE, "--excite", "chirp.csv", "--duration", "0.5"),
    "fit": ("fit", "one.xml", "log.csv", *FREE),
    "plot": ("plot", "a.csv", "-o", "a.svg"),
    "sweep": ("sweep", "one.xml", "--steps", "3", "--vary", "qpos/hinge=0,1", "--metric", "m=max(time)", "-o", "s"),
    "verify": ("trace", "one.xml", "--replay", "r.npz", "--verify"),
    "view": ("view", "one.xml", "--duration", "0.02"),
}


@pytest.mark.gl
@pytest.mark.parametrize("kind", REPORTS)
def test_what_a_command_prints_as_json_fits_the_schema_of_its_kind(
    mjrun: Command, display: dict[str, str], kind: str
) -> None:
    (mjrun.folder / "one.xml").write_text(MODEL)
    (mjrun.folder / "log.csv").write_text(LOG)
    for command in PREPARATION.get(kind, []):
        assert mjrun(*command).returncode == 0
    done = mjrun(*PRINTED[kind], "--json", env=display)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["schema"] == f"mjrun-{kind}-1"
    assert fits(report, json_schema(kind), json_schema(kind))
    assert not fits({**report, "schema": "mjrun-other-1"}, json_schema(kind), json_schema(kind))


def test_the_help_says_what_prints_each_kind_of_report(mjrun_here: Command) -> None:
    text = " ".join(mjrun_here("schema", "--help").stdout.decode().split())
    for kind, command in REPORTS.items():
        assert (command == f"mjrun {kind}" and kind in COMMANDS) or command in text


def test_options_are_a_reference_in_markdown(mjrun_here: Command) -> None:
    done = mjrun_here("schema", "options")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"# Options of mjrun\n")


def test_another_kind_is_refused_with_those_there_are(mjrun_here: Command) -> None:
    done = mjrun_here("schema", "film")
    assert (done.returncode, done.stdout) == (2, b"")
    assert all(f"'{kind}'".encode() in done.stderr for kind in KINDS)
