"""From the options of a command line to the values that jobs are made of."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli.console import Console
from mjrun.cli.controller_loader import controller
from mjrun.cli.options import GROUP_KINDS
from mjrun.errors import MjrunError

DOCUMENTS = (".yaml", ".yml")

if TYPE_CHECKING:
    from mjrun.job.simulation import Simulation
    from mjrun.model.source import Source
    from mjrun.rendering.visual import Visual


def import_mujoco() -> None:
    """Imports MuJoCo without an OpenGL backend: it would fix one by MUJOCO_GL, or fail at a bad name."""
    asked = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco  # noqa: F401

    if asked is None:
        del os.environ["MUJOCO_GL"]
    else:
        os.environ["MUJOCO_GL"] = asked


def source(given: dict[str, Any]) -> "Source":
    """The model that `model_argument` and `model_options` describe."""
    from mjrun.model.override import Override
    from mjrun.model.sources import parse_source

    settings = [Override(path, value) for path, value in given["settings"]]
    if given["integrator"]:
        settings.append(Override("opt.integrator", given["integrator"], "integrator"))
    if given["timestep"]:
        settings.append(Override("opt.timestep", repr(float(given["timestep"])), "timestep"))
    return parse_source(given["model"], settings)


def simulation(given: dict[str, Any]) -> "Simulation":
    """The simulation that `model_argument`, `model_options` and `simulation_options` describe."""
    from mjrun.job.simulation import Simulation

    return Simulation(
        source(given),
        key=given["key"],
        qpos=dict(given["qpos"]),
        qvel=dict(given["qvel"]),
        ctrl=dict(given["ctrl"]),
        ctrl_from=given["ctrl_from"],
        ctrl_interpolation=given["ctrl_interpolation"],
        ctrl_noise=given["ctrl_noise"],
        ctrl_noise_time=given["ctrl_noise_time"],
        controller=controller(given["controller"]) if given["controller"] else None,
        control_dt=given["control_dt"],
        replay=given["replay"],
        perturb=given["perturb"],
        seed=given["seed"],
        duration=given.get("duration"),
        steps=given.get("steps"),
    )


def perform(console: Console, given: dict[str, Any], job: Any) -> Any:
    """Does `job`, keeps a recording if one is asked for, and returns the job's result; or prints them, and stops."""
    from mjrun.job.perform import perform
    from mjrun.job.recording import Recording

    kept = []
    if given["recording"]:
        partial = given.get("keep_partial", False)
        kept.append(Recording(job.simulation, given["recording"], keep_partial=partial, command=console.command))
    if given["print_document"]:
        from mjrun.document.run_writer import document_text

        console.result(document_text([job, *kept], console.command).rstrip("\n"))
        raise click.exceptions.Exit(0)
    with answering(console, click.get_current_context().params["as_json"], lambda results: asdict(results[0])):
        return perform([job, *kept], console)[0]


@contextmanager
def answering(console: Console, as_json: bool, document: Callable[[Sequence[Any]], dict[str, Any]]) -> Iterator[None]:
    """Where JSON was asked for, tells of a failure in it too, beside the `document` of what was made all the same."""
    try:
        yield
    except MjrunError as error:
        if as_json and error.results:
            facts = {name: value for name, value in vars(error).items() if name != "results" and name[0] != "_"}
            told = {"kind": type(error).__name__, "message": str(error), "exit_code": error.exit_code, **facts}
            console.document({**document(error.results), "error": told})
        raise


def visual(given: dict[str, Any]) -> "Visual":
    """What `view_options` and `renderer_options` say is drawn."""
    from mjrun.rendering.visual import Visual

    groups = {kind: given[f"{kind}group"] for kind in GROUP_KINDS}
    return Visual(
        show=[flag for flags in given["show"] for flag in flags],
        hide=[flag for flags in given["hide"] for flag in flags],
        groups={kind: drawn for kind, drawn in groups.items() if drawn is not None},
        frame=given["frame_axes"],
        label=given["label"],
        quality=given["quality"],
    )


def _camera(text: str) -> Any:
    """What a camera does: a document is read, the rest is found in the model."""
    if Path(text).suffix.lower() not in DOCUMENTS:
        return text
    from mjrun.document.camera import read_camera

    return read_camera(text)


def drawing(given: dict[str, Any]) -> dict[str, Any]:
    """What films and stills have in common, as `view_options` and `renderer_options` say it."""
    same = ("layout", "separate", "captions", "style", "depth_range", "seg_by", "text", "text_corner", "size")
    same += ("calibration", "calibration_format")
    return {
        "camera": [_camera(text) for text in given["cameras"]] or "free",
        "view": given["views"] or "rgb",
        "visual": visual(given),
        "trail": given["trails"],
        "trail_span": None if given["trail_span"] is None else float(given["trail_span"]),
        "ghost": given["ghosts"],
        "renderer": given["renderer"],
        "gl": given["gl"] or "auto",
        "require_gpu": given["require_gpu"],
        "manifest": given["manifest"],
        **{name: given[name] for name in same},
    }
