"""`mjrun fit` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from tests.fit.logs import noisy, simulate, write_log, write_model

if TYPE_CHECKING:
    from tests.conftest import Command

FREE = ("--free", "joint/hinge.damping=log:1e-3..1", "--free", "joint/hinge.armature=log:1e-3..1", "--starts", "1")


def prepared(mjrun: Command) -> tuple[str, str]:
    times, angles = simulate(1.5)
    write_log(mjrun.folder / "log.csv", {"time": times, "qpos/hinge": noisy(angles)})
    return str(write_model(mjrun.folder, frictionloss=0.02)), "log.csv"


def test_a_table_and_a_document_say_what_was_found(mjrun: Command) -> None:
    model, log = prepared(mjrun)
    done = mjrun("fit", model, log, *FREE, "--json", "-o", "fitted.xml")
    assert (done.returncode, done.stderr) == (0, b"")
    report = json.loads(done.stdout)
    assert report["schema"] == "mjrun-fit-1"
    assert [each["path"] for each in report["parameters"]] == ["joint/hinge.damping", "joint/hinge.armature"]
    assert abs(report["parameters"][0]["value"] - 0.05) < 0.01
    assert report["files"] == ["fitted.xml"]
    assert (mjrun.folder / "fitted.xml").is_file()


def test_what_cannot_be_told_exits_with_1_and_says_what_to_do(mjrun: Command) -> None:
    model, log = prepared(mjrun)
    done = mjrun("fit", model, log, *FREE, "--free", "actuator/motor.gear[0]=.5..2", "-o", "fitted.xml")
    assert done.returncode == 1
    assert b"say nothing of actuator/motor.gear[0]" in done.stderr
    assert b"--allow-unidentifiable" in done.stderr
    assert not (mjrun.folder / "fitted.xml").exists()


def test_wrong_usage_exits_with_2(mjrun: Command) -> None:
    model, log = prepared(mjrun)
    for arguments, message in (
        ((model,), b"Missing argument 'DATA...'"),
        ((model, log), b"--free says what is looked for"),
        ((model, log, "--free", "joint/hinge.dampin=0..1"), b"did you mean 'damping'"),
        ((model, log, *FREE, "-o", "fitted.mjb"), b"a fitted model is an .xml file"),
        ((model, log, *FREE, "--ranges", "ranges.json"), b"ranges are written as .yaml"),
        ((model, log, *FREE, "--comparison", "fit.xyz"), b"fit.xyz"),
        ((model, log, *FREE, "--html", "fit.pdf"), b"ends with .html"),
        ((model, "none.csv", *FREE), b"none.csv"),
    ):
        done = mjrun("fit", *arguments)
        assert done.returncode in (2, 7)
        assert message in done.stderr


def test_an_input_is_written_before_anything_is_measured(mjrun: Command) -> None:
    model, _ = prepared(mjrun)
    limits = ("--set", "actuator/motor.ctrlrange=-1,1", "--set", "actuator/motor.ctrllimited=true")
    done = mjrun("fit", model, *FREE, "--excite", "chirp.csv", *limits, "--duration", "2", "--json")
    assert (done.returncode, done.stderr) == (0, b"")
    report = json.loads(done.stdout)
    assert report["schema"] == "mjrun-excite-1"
    assert report["files"] == ["chirp.csv"]
    assert (mjrun.folder / "chirp.csv").read_bytes().startswith(b"time,ctrl/motor\n")
    done = mjrun("fit", model, "log.csv", *FREE, "--excite", "chirp.csv", *limits)
    assert done.returncode == 2
    assert b"comes before anything is measured" in done.stderr
