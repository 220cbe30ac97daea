"""Export a simulation, or episodes of a policy, to a format of other programs."""

from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from mjrun.cli.click_command import MODEL, ON_FILES, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import (
    import_mujoco,
    make_outputs,
    payload_on_stdout,
    reported_failures,
    show,
    simulation,
    stem,
    with_camera_scripts,
)
from mjrun.cli.table_cells import number
from mjrun.errors import UsageError, clean, counted, option
from mjrun.options.datasets import EpisodeOptions
from mjrun.options.export import ExportOptions
from mjrun.options.option import options_of
from mjrun.options.output import SimulationCommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import ExecutionOptions
from mjrun.suffixes import is_hdf5

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjrun.outputs.exports import ExportFormat
    from mjrun.study.episode_dataset import EpisodeDatasetResult


@command(
    ExecutionOptions,
    EpisodeOptions,
    ExportOptions,
    SimulationCommandOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=[MODEL],
    python="Export",
    classes={EpisodeOptions: "EpisodeDataset", ExecutionOptions: "EpisodeDataset"},
    key="exports",
    reports={
        "export": "mjrun.outputs.export:ExportResult",
        "episodes": "mjrun.study.episode_dataset:EpisodeDatasetResult",
    },
)
def export(console: Console, command_line: ParsedCommandLine) -> None:
    """Export a simulation of MODEL, or episodes of a policy, to a format of other programs.

    \b
    mjrun export scene.xml
    mjrun export scene.xml -o scene.glb --fps 60 --camera orbit:azimuth=0..90
    mjrun export scene.xml -o pose.glb --key home --steps 1
    mjrun export scene.xml -o replay.html --plot energy --mark-event 'contact(ball, floor) > 0'
    mjrun export task.yaml --policy drive.onnx --episodes 200 --camera front --camera wrist --format lerobot -o drives
    mjrun export task.yaml --policy drive.onnx --episodes 1000 --format minari -o drive-v0
    mjrun export demo.hdf5 --camera agentview --camera robot0_eye_in_hand -o lift

    A dataset of episodes is a folder: repeating the command continues it. Exits with 8 if episodes failed.
    """
    payload_on_stdout(command_line)
    import_mujoco()
    from mjrun.outputs.export import Export
    from mjrun.outputs.exports import format_named

    command_line = with_camera_scripts(command_line)
    if is_hdf5(command_line.argument("model")) and not Path(str(command_line.value("output") or "")).suffix:
        command_line = command_line.with_defaults(format="lerobot")  # of all demonstrations in the file
    format_, suffix = format_named(str(command_line.value("format") or "glb"))
    if format_.product:
        _export_episodes(console, command_line, format_)
        return
    for name in command_line.explicit(EpisodeOptions, ExecutionOptions):
        if name not in {each.attribute for each in options_of(Export)}:
            raise UsageError(
                f"{option(name)} applies to datasets of episodes only\nadd {option('format')} lerobot or minari"
            )
    command_line = command_line.with_defaults(output=f"{stem(command_line)}{suffix}")
    request = command_line.make(Export, simulation=simulation(command_line), command=console.command)
    show(console, command_line, make_outputs(console, command_line, request))


def _export_episodes(console: Console, command_line: ParsedCommandLine, format_: "ExportFormat") -> None:
    product = resolve_name(format_.product)
    known = {each.attribute for each in options_of(product)}
    for name in command_line.explicit(ExportOptions, SimulationCommandOptions):
        if name not in known:
            raise UsageError(f"{option(name)} does not apply to {option('format')} {format_.name}")
    command_line = command_line.with_defaults(output=f"{stem(command_line)}_{format_.name}")
    made = command_line.make(product, simulation=simulation(command_line), command=console.command)
    with reported_failures(console, _report):
        console.answer(_report([made.run(console)]))


def _report(results: "Sequence[EpisodeDatasetResult]") -> CommandReport:
    return CommandReport("episodes", results[0], summary=lambda: _summary(results[0]))


def _summary(result: "EpisodeDatasetResult") -> str:
    facts = [
        f"{counted(result.episodes, 'episode')} ({result.format})",
        f"{counted(result.rows, 'row')} at {result.fps:g} Hz",
    ]
    if result.cameras:
        facts.append(f"images of {', '.join(map(clean, result.cameras))}")
    if result.mean_return is not None:
        facts.append(f"mean return {number(result.mean_return)}")
    if result.successes:
        facts.append(f"{result.successes} successful")
    if known := result.episodes - result.simulated:
        facts.append(f"{known} known before" if known > 0 else "")
    return f"{clean(result.path)}: {', '.join(filter(None, facts))}; {result.wall:.1f} s"
