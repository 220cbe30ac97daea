"""Render labelled images of many variations of a model."""

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import ON_FILES, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import (
    import_mujoco,
    is_study,
    refuse_assignments,
    reported_failures,
    simulation,
    stem,
)
from mjrun.errors import UsageError, clean, counted, option
from mjrun.options.datasets import DatasetOptions
from mjrun.options.option import values_of
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import ExecutionOptions, VariationOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjrun.study.image_dataset import Dataset, DatasetResult

SHOWN = 10  # reasons of failures


@command(
    DatasetOptions,
    ExecutionOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=(
        ModelArgument("model", metavar="MODEL|STUDY.yaml"),
        click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
    ),
    python="Dataset",
    reports={"dataset": "mjrun.study.image_dataset:DatasetResult"},
)
def dataset(console: Console, command_line: ParsedCommandLine) -> None:
    """Render labelled images of MODEL for training vision models: colours, depth, masks of objects and parts, boxes,
    keypoints, 6D poses and calibrated cameras, while anything varies.

    \b
    mjrun dataset table.xml --samples 1000 --objects 'mug*=mug' --vary 'camera.azimuth=uniform(0,360)' \\
        --vary 'camera.distance=uniform(0.5,1.5)' --vary 'light:0.diffuse[0]=uniform(0.2,1)' --format coco,yolo -o mugs
    mjrun dataset arm.xml --samples 200 --vary 'qpos/elbow=uniform(-1,1)' --keypoints 'tip,elbow' --format coco -o arms
    mjrun dataset scene.xml --samples 100 --vary 'qvel/box=uniform(-1,1)' --times 0,0.5,1 --format bop -o throws

    Every parameter of mjrun sweep can vary, and every setting of the camera. STUDY.yaml is a study document, of whose
    model, simulation and parameters the images are made; KEY=VALUE changes a value in it. Repeating a command continues
    its dataset. Exits with 8 if points failed, and with 1 if --accept omits all images.
    """
    import_mujoco()
    job, located = _dataset(console, command_line)
    with located, reported_failures(console, _report):
        result = job.run(console)
        console.answer(_report([result]))


def _dataset(console: Console, command_line: ParsedCommandLine) -> "tuple[Dataset, AbstractContextManager[None]]":
    """Returns the dataset of a command line, or of the study of a document, and the context that locates its errors."""
    from mjrun.study.image_dataset import Dataset

    model, assignments = command_line.argument("model"), command_line.arguments("assignments")
    if command_line.value("output") is None:
        command_line = command_line.with_defaults(output=f"{stem(command_line)}_dataset")
    if not is_study(model):
        refuse_assignments(model, assignments)
        made = command_line.make(Dataset, simulation=simulation(command_line), command=console.command)
        return made, nullcontext()
    from mjrun.document.study import read_study

    request = read_study(model, assignments, command=console.command)
    if given := command_line.explicit(VariationOptions, SimulationOptions):
        name = next(iter(given))
        raise UsageError(f"{option(name)} cannot accompany {clean(model)}; write {name}=VALUE instead")
    study = request.made
    varied = values_of(study, VariationOptions)
    made = command_line.make(Dataset, simulation=study.simulation, command=console.command, **varied)
    return made, request.located()


def _report(results: "Sequence[DatasetResult]") -> CommandReport:
    return CommandReport("dataset", results[0], summary=lambda: _summary(results[0]))


def _summary(result: "DatasetResult") -> str:
    lines = [
        f"{group.status}: {counted(group.count, 'point')}, the first is {group.point}: {_first_line(group.message)}"
        for group in result.failures[:SHOWN]
    ]
    parts = ", ".join(f"{count:,} {clean(part)}" for part, count in result.images.items())
    facts = [f"{counted(sum(result.images.values()), 'image')} ({parts})"]
    if result.rejected:
        facts.append(f"{result.rejected:,} rejected")
    known = result.points - result.rendered
    if known:
        facts.append(f"{counted(known, 'point')} known before")
    facts.append(f"{counted(len(result.objects), 'object')}; {result.wall:.1f} s")
    return "\n".join([*lines, f"{clean(result.path)}: {', '.join(facts)}"])


def _first_line(text: str) -> str:
    return clean(text.partition("\n")[0])
