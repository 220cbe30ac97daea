"""What commands that simulate share: one use of standard output, and options that exclude each other."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from mjrun.cli.click_command import ParsedCommandLine
from mjrun.cli.console import CommandReport, Console, flag
from mjrun.cli.simulation_command import payload_on_stdout, reported_failures, with_camera_scripts
from mjrun.errors import FailureReport, FileError, PartlyDoneError, UsageError
from mjrun.options.option import Options
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceOptions
from mjrun.options.video import ImageOptions, VideoOptions
from mjrun.platform import system


def test_standard_output_has_one_use() -> None:
    assert payload_on_stdout(ParsedCommandLine({"output": "-"}))
    assert payload_on_stdout(ParsedCommandLine({}), "-")
    assert not payload_on_stdout(ParsedCommandLine({"output": "a.csv", "json": True}), "-")
    with pytest.raises(UsageError) as error:
        payload_on_stdout(ParsedCommandLine({"output": "-", "json": True}))
    assert error.value.spelled(flag).startswith("--json and the output both print to standard output")


@pytest.mark.skipif(not system.CAN_FORK_LATE, reason="no copies of processes")
def test_a_process_that_has_imported_mujoco_can_be_copied_and_has_its_environment() -> None:
    code = """
import os
from mjrun.child_process import may_fork
from mjrun.cli.simulation_command import import_mujoco
before = {**os.environ}
import_mujoco()
assert may_fork()
assert {**os.environ} == before
"""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


def test_cameras_that_are_no_scripts_stay() -> None:
    command_line = with_camera_scripts(ParsedCommandLine({"camera": ("top", "orbit:azimuth=3")}))
    assert command_line.value("camera") == ("top", "orbit:azimuth=3")


@pytest.mark.parametrize(
    ("cls", "params"),
    [
        (SimulationOptions, {"duration": 1, "steps": 2}),
        (SimulationOptions, {"ctrl_from": "a.csv", "replay": "a.npz"}),
        (TraceOptions, {"every": 2, "rate": 10}),
        (ImageOptions, {"time": 1, "step": 2, "output": "a.png"}),
    ],
)
def test_exclusions_are_reported_with_flags(cls: type[Options], params: dict[str, Any]) -> None:
    values = {} if cls is SimulationOptions else {"simulation": None}
    with pytest.raises(UsageError) as error:
        ParsedCommandLine(params).make(cls, **values)
    names = {flag(name) for name in params if name != "output"}
    first, _, second, *_ = error.value.spelled(flag).split()
    assert {first, second} == names


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"plot_side": "beside"}, "--plot-side requires --plot, whose position it sets"),
        ({"depth_range": (0, 1), "view": ("seg",)}, "--depth-range requires --view depth, whose colours it sets"),
    ],
)
def test_requirements_are_reported_with_flags(params: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError) as error:
        ParsedCommandLine({**params, "output": "a.mp4"}).make(VideoOptions, simulation=None)
    assert error.value.spelled(flag) == message


def test_json_names_what_stays_of_an_output_that_could_not_be_published(capsys: pytest.CaptureFixture[str]) -> None:
    error = PartlyDoneError(["t.csv"], [("c.csv", FileError("c.csv", "cannot be written"))])
    console = Console(document_form="json")
    with pytest.raises(PartlyDoneError), reported_failures(console, lambda _: CommandReport("", None)):
        raise error
    console.report_failure(FailureReport.of(error))
    console.finish()
    told = json.loads(capsys.readouterr().out)["error"]
    assert (told["exit_code"], told["made"], told["failures"][0]["output"]) == (8, ["t.csv"], "c.csv")
    assert "made: t.csv" in told["message"]
