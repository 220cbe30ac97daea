"""`mjrun sweep`."""

from dataclasses import asdict

from mjrun.cli.click_command import MODEL, CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import failures_in_json, import_mujoco, simulation, stem
from mjrun.errors import MjrunError
from mjrun.options.messages import MessageOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import ExecutionOptions, StudyOptions


@command("sweep", StudyOptions, ExecutionOptions, SimulationOptions, arguments=[MODEL])
def sweep(console: Console, command_line: CommandLine) -> None:
    """Simulate MODEL for many values, and tell what happens: a table with a row for each point.

    \b
    mjrun sweep scene.xml --vary opt.timestep=log:1e-4..1e-2:9 --metric 'drift=max(abs(energy/drift))' -o study
    mjrun sweep scene.xml --vary 'geom/*.friction[0]=uniform(0.3,1)' --samples 256 --metric 'x=last(com/x)' -o study

    The folder keeps what is known: the same command again continues it. Exits with 8 when points failed.
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.cli.sweep_report import preview_report, study_report
    from mjrun.study.study import Study

    if command_line.value("output") is None:
        command_line = command_line.with_defaults(output=f"{stem(command_line)}_study")
    study = command_line.make(Study, simulation=simulation(command_line), command=console.command)
    as_json = command_line.make(MessageOptions).json
    if study.dry_run:
        preview = study.preview()
        if as_json:
            console.document(asdict(preview))
        else:
            console.result(preview_report(preview))
        return
    try:
        with failures_in_json(console, command_line, lambda results: asdict(results[0])):
            result = study.run(console)
    except MjrunError as error:
        if error.results and not as_json:
            console.result(study_report(error.results[0], study.simulation))
        raise
    if as_json:
        console.document(asdict(result))
    else:
        console.result(study_report(result, study.simulation))
