"""What is said of a study, and the command that shows one point."""

import shlex
from dataclasses import replace
from typing import Any

import mujoco
import pytest

from mjrun.cli.click_command import ParsedCommandLine
from mjrun.cli.commands.trace import trace
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import simulation
from mjrun.cli.sweep_report import point_command, study_report
from mjrun.simulation.simulation import Simulation
from mjrun.study.point_files import KeptFiles
from mjrun.study.spec import simulation_at
from mjrun.study.study import MetricSummary, StudyResult


@pytest.mark.parametrize(
    "values",
    [
        {"seed": "3", "opt.timestep": "0.01", "qpos/hip": "0.5"},
        {"model": "other file.xml", "scale:geom/*.size": "1.1", "ctrl/motor": "2"},
        {"push": "hip=0/0/9@0+0.1", "ctrl_noise": "0.3", "duration": "0.2"},
        {},
    ],
)
def test_the_command_of_a_point_describes_its_simulation(values: dict[str, str]) -> None:
    pushes = ["hip=0/1/0@0+0.1", "site:toe=1/0/0@0.5+1"]
    settings = {"opt.gravity": "0,0,-1"}
    base = Simulation("a.xml", duration="0.1", qvel={"hip": (1, 2)}, set=settings, perturb=0.1, push=pushes, trust=True)
    words = shlex.split(point_command(base, values))
    assert words[:2] == ["mjrun", "trace"]
    with trace.make_context("trace", words[2:], obj=Console("mjrun")) as context:
        described = simulation(ParsedCommandLine(context.params))
    assert described == simulation_at(base, tuple(values), tuple(values.values()))


@pytest.mark.parametrize("values", [{}, {"controller": "c.py:Other"}])
def test_the_command_of_a_point_names_the_controller_as_the_user_did(values: dict[str, str]) -> None:
    command = point_command(Simulation("a.xml", controller=lambda model, data: None), values, "c.py:act")
    assert command == f"mjrun trace a.xml --controller {values.get('controller', 'c.py:act')}"


def test_names_from_models_cannot_steer_the_terminal() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert "\x1b" not in point_command(Simulation(model), {"geom/\x1b[31m.size": "1"})


@pytest.mark.parametrize(
    ("facts", "is_told"),
    [
        ({}, True),
        ({"metrics": {"low": MetricSummary(3, 1.0, 0.0, [1.0] * 7, 0, 0)}}, False),
        ({"kept": KeptFiles((1,))}, False),
        ({"statuses": {"unstable": 3}}, False),
    ],
)
def test_a_study_without_metrics_reports_that_nothing_was_measured(facts: dict[str, Any], is_told: bool) -> None:
    result = StudyResult("st", 3, 3, {"ok": 3}, {}, [], [], ["st/results.csv"], 0.1, ["seed"])
    text = study_report(replace(result, **facts), Simulation("a.xml"))
    assert ("nothing was measured: --metric" in " ".join(text.split())) == is_told
