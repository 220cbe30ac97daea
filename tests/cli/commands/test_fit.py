"""`mjrun fit` as a user runs it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mjrun.cli.commands.fit import excitation_report, fit_report
from mjrun.fitting.excitation import ExcitationResult, ExpectedParameterInterval, MotionExtent
from mjrun.fitting.result import FitResult, FittedInertia, FittedParameter, FittedSignal, InertiaQuantity
from mjrun.model.sources.file import FileSource
from tests.fitting.logs import noisy, simulate, write_log, write_model
from tests.processes import PATIENCE

if TYPE_CHECKING:
    from tests.conftest import Command

RANGES = ("--free", "joint/hinge.damping=log:1e-3..1", "--free", "joint/hinge.armature=log:1e-3..1")
FREE = (*RANGES, "--starts", "1")


# Tells at once that it is at work, and then waits for a signal.
PATIENT = """
import time, mjrun.cli.console as console
console.EVERY, told = 0, console.Console.progress
console.Console.progress = lambda *arguments: (told(*arguments), time.sleep(7200))
from mjrun.__main__ import main
main()
"""


def prepared(mjrun: Command) -> tuple[str, str]:
    times, angles = simulate(1.5)
    write_log(mjrun.folder / "log.csv", {"time": times, "qpos/hinge": noisy(angles)})
    return str(write_model(mjrun.folder, frictionloss=0.02)), "log.csv"


@pytest.mark.slow
def test_a_table_and_a_document_say_what_was_found(mjrun_here: Command) -> None:
    model, log = prepared(mjrun_here)
    done = mjrun_here("fit", model, log, *FREE, "--json", "-o", "new/fitted.xml")
    assert (done.returncode, done.stderr) == (0, b"")
    report = json.loads(done.stdout)
    assert report["schema"] == "mjrun-fit-1"
    assert [each["path"] for each in report["parameters"]] == ["joint/hinge.damping", "joint/hinge.armature"]
    assert abs(report["parameters"][0]["value"] - 0.05) < 0.01
    assert report["files"] == ["new/fitted.xml"]
    assert (mjrun_here.folder / "new/fitted.xml").is_file()


def test_what_cannot_be_told_exits_with_1_and_says_what_to_do(mjrun_here: Command) -> None:
    model, log = prepared(mjrun_here)
    done = mjrun_here("fit", model, log, *FREE, "--free", "actuator/motor.gear[0]=.5..2", "-o", "fitted.xml")
    assert done.returncode == 1
    assert b"do not determine actuator/motor.gear[0]" in done.stderr
    assert b"--allow-unidentifiable" in done.stderr
    assert not (mjrun_here.folder / "fitted.xml").exists()


def test_wrong_usage_exits_with_2(mjrun_here: Command) -> None:
    model, log = prepared(mjrun_here)
    for arguments, message in (
        ((model,), b"Missing argument 'DATA...'"),
        ((model, log), b"name parameters with --free"),
        ((model, log, "--free", "joint/hinge.dampin=0..1"), b"did you mean 'damping'"),
        ((model, log, *FREE, "-o", "fitted.mjb"), b"a fitted model is an .xml file"),
        ((model, log, *FREE, "--ranges", "ranges.json"), b"ranges are written as .yaml"),
        ((model, log, *FREE, "--comparison", "fit.xyz"), b"fit.xyz"),
        ((model, log, *FREE, "--html", "fit.pdf"), b"ends with .html"),
        ((model, "none.csv", *FREE), b"none.csv"),
        ((log, model, *FREE), f"the model precedes the tables: mjrun fit {model} {log}".encode()),
    ):
        done = mjrun_here("fit", *arguments)
        assert done.returncode in (2, 7)
        assert message in done.stderr


@pytest.mark.slow
def test_an_input_is_written_before_anything_is_measured(mjrun_here: Command) -> None:
    model, _ = prepared(mjrun_here)
    limits = ("--set", "actuator/motor.ctrlrange=-1,1", "--set", "actuator/motor.ctrllimited=true")
    done = mjrun_here("fit", model, *RANGES, "--excite", "chirp.csv", *limits, "--duration", "2", "--json")
    assert (done.returncode, done.stderr) == (0, b"")
    report = json.loads(done.stdout)
    assert report["schema"] == "mjrun-excite-1"
    assert report["files"] == ["chirp.csv"]
    assert (mjrun_here.folder / "chirp.csv").read_bytes().startswith(b"time,ctrl/motor\n")
    done = mjrun_here("fit", model, "log.csv", *RANGES, "--excite", "chirp.csv", *limits)
    assert done.returncode == 2
    assert b"precedes measurements" in done.stderr


@pytest.mark.parametrize(("number", "keep"), [(signal.SIGTERM, True), (signal.SIGINT, False)])
@pytest.mark.slow
def test_an_interrupted_fit_leaves_the_best_so_far_if_asked_and_else_nothing(
    mjrun: Command, number: signal.Signals, keep: bool
) -> None:
    """A signal to the process, once it has told that it is at work."""
    model, log = prepared(mjrun)
    arguments = ["fit", model, log, *FREE, "-o", "fitted.xml", "--ranges", "ranges.yaml", "--json"]
    before = {path.name for path in mjrun.folder.iterdir()}
    command = [sys.executable, "-c", PATIENT, *arguments, *(["--keep-partial"] if keep else [])]
    with subprocess.Popen(
        command, cwd=mjrun.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr
        for line in process.stderr:
            if "stages of the fit" in line:
                break
        process.send_signal(number)
        out, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 128 + number, errors
    made = {path.name for path in mjrun.folder.iterdir()} - before
    if not keep:
        assert (made, [*json.loads(out)]) == (set(), ["error"])
        return
    assert made == {"fitted.xml"}
    report = json.loads(out)
    assert report["partial"]
    assert report["files"] == ["fitted.xml"]
    assert report["signals"][0]["fitted"] is None
    damping, armature = (each["value"] for each in report["parameters"])
    fitted = FileSource(mjrun.folder / "fitted.xml").load()
    assert (fitted.dof_damping[0], fitted.dof_armature[0]) == (damping, armature)


@pytest.mark.slow
def test_a_log_of_another_simulator_is_mapped_and_filmed(mjrun_here: Command) -> None:
    """Its names, units and clock are others; it has gaps, and commands of a lower rate."""
    model, _ = prepared(mjrun_here)
    commanded = np.repeat(np.sin(0.05 * np.arange(0, 150, 3)), 15)
    times, angles = simulate(1.5, controls=commanded)
    columns = {"ms": 1000 * times, "J1": np.degrees(noisy(angles)), "tau": 1000 * commanded[::5]}
    cells = np.column_stack(list(columns.values())).astype(str)
    cells[np.arange(150) % 3 > 0, 2] = ""
    cells[60:64, 1] = ""
    lines = [",".join(columns), *(",".join(row) for row in cells)]
    (mjrun_here.folder / "other.csv").write_text("\n".join(lines))
    texts = ("time=ms/1000", "qpos/hinge=J1*pi/180", "ctrl/motor=tau/1000")
    maps = [part for text in texts for part in ("--map", text)]
    done = mjrun_here("fit", model, "other.csv", *FREE, *maps, "--json", "--video", "fit.webp", "--size", "64x48")
    assert done.returncode == 0, done.stderr
    assert b"4 samples missing" in done.stderr
    assert b"100 commands missing and replaced by the one before" in done.stderr
    report = json.loads(done.stdout)
    assert [each["value"] for each in report["parameters"]] == pytest.approx([0.05, 0.01], rel=0.1)
    assert report["files"] == ["fit.webp"]
    assert (mjrun_here.folder / "fit.webp").read_bytes()[8:12] == b"WEBP"


PARAMETERS = [
    FittedParameter("joint/a.damping", 0.1, 0.25, 0.2, 0.3, 900.0, ""),
    FittedParameter("joint/a.armature", 0.1, 0.5, 0.4, 0.5, 900.0, "high", "kg·m²"),
]
SIGNALS = [FittedSignal("qpos/a", "rad", 0.002, 1.0, 0.5, 0.01, None, None)]


def report(**changes: object) -> str:
    values = {
        "parameters": PARAMETERS,
        "inertias": [],
        "signals": SIGNALS,
        "reduced_chi2": 1.0,
        "ways": ["whole segments"],
        "correlation": [[1.0, -0.97], [-0.97, 1.0]],
        "confidence": 0.95,
        "condition": 10.0,
        "rows": 1200,
        "segments": 1,
        "rollouts": 5000,
        "changes": ["a.xml:3: damping = 0.25"],
        "remarks": [],
        "files": ["fitted.xml"],
        "wall": 1.5,
    }
    return fit_report(FitResult(**{**values, **changes}))  # type: ignore[arg-type]


def test_it_says_what_was_found_and_how_well_it_is_known() -> None:
    text = report()
    for part in ("95 % interval", "0.2..0.3", "at its high bound", "-0.970", "a.xml:3: damping = 0.25", "1,200 rows"):
        assert part in text
    assert "joint/a.armature [kg·m²]" in text
    assert "held out" not in text


def test_errors_on_what_was_held_out_are_shown_if_something_was() -> None:
    text = report(signals=[FittedSignal("qpos/a", "rad", 0.002, 1.0, 0.5, 0.01, 0.6, 0.0123)])
    assert "held out, before" in text
    assert "1.23 %" in text


def test_inertias_are_shown_in_their_units() -> None:
    mass = InertiaQuantity("mass", "kg", 0.7, 1.4, 1.39, 1.42)
    moment = InertiaQuantity("moment/1", "kg·m²", 0.0028, 0.0028, 0.0028, 0.0028)
    text = report(inertias=[FittedInertia("payload", [mass, moment])])
    assert "1.39..1.42" in text
    assert "0.0028..0.0028" not in text  # it was not looked for
    assert "kg·m²" in text


def test_an_input_is_reported_with_what_to_expect_of_it() -> None:
    parameter = ExpectedParameterInterval("joint/a.damping", 0.1, 0.09, 0.12, 80.0)
    motion = [MotionExtent("qpos/a", "rad", -0.5, 0.7, -1.0, 1.0), MotionExtent("qpos/b", "m", 0.0, 0.1, None, None)]
    text = excitation_report(
        ExcitationResult([parameter], motion, 0.9, 0.001, 2.0, 10.0, 12, 4, [], ["chirp.csv"], 1.5),
    )
    for part in (
        "expected 90 % interval",
        "0.09..0.12",
        "-1..1",
        "chirp.csv",
        "the best of 12 inputs",
        "at 4 corners",
    ):
        assert part in text
