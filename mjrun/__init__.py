"""MuJoCo models to videos, images, tables and timing reports.

Everything the command line does is callable:

    import mjrun

    top = mjrun.load("scenes/tippe_top.xml")
    spin = mjrun.Simulation(top, key="spinning", duration=7)
    mjrun.Video(spin, "tippe_top.mp4", camera="closeup").run()
    mjrun.Image(spin, "tippe_top.png", time=3.7, view=["rgb", "depth"]).run()
    mjrun.Trace(spin, "tippe_top.npz", probe=["xpos[stem]", "energy"]).run()
    table = mjrun.trace(spin, probe=["xpos[stem]", "energy"])

Names are imported when first used, so `import mjrun` itself costs nothing. Type checkers and editors read __init__.pyi,
which `scripts/make_stubs.py` writes.
"""

import sys
from importlib import import_module

from mjrun.version import __version__

_HOMES = {
    "Action": "mjrun.task.task",
    "ActionSpace": "mjrun.policy.policy",
    "Bench": "mjrun.bench.bench",
    "BenchResult": "mjrun.bench.results",
    "Check": "mjrun.document.model_and_task_check",
    "CheckResult": "mjrun.check.check",
    "Command": "mjrun.task.task",
    "Dataset": "mjrun.study.image_dataset",
    "DatasetResult": "mjrun.study.image_dataset",
    "Diff": "mjrun.outputs.diff",
    "DiffResult": "mjrun.diff.result",
    "EpisodeDataset": "mjrun.study.episode_dataset",
    "EpisodeDatasetResult": "mjrun.study.episode_dataset",
    "Evaluation": "mjrun.evaluation.evaluation",
    "EvaluationResult": "mjrun.evaluation.evaluation",
    "ExcitationResult": "mjrun.fitting.excitation",
    "Export": "mjrun.outputs.export",
    "ExportResult": "mjrun.outputs.export",
    "Figure": "mjrun.plotting.table_figure",
    "Fit": "mjrun.fitting.fit",
    "FitResult": "mjrun.fitting.result",
    "Image": "mjrun.outputs.image",
    "ImageResult": "mjrun.outputs.image",
    "Info": "mjrun.model.info",
    "InfoResult": "mjrun.model.info",
    "Keyframe": "mjrun.outputs.keyframe",
    "KeyframeResult": "mjrun.outputs.keyframe",
    "Observation": "mjrun.task.task",
    "Plot": "mjrun.outputs.plot",
    "PlotResult": "mjrun.outputs.plot",
    "Policy": "mjrun.policy.policy",
    "Recording": "mjrun.outputs.recording",
    "RecordingResult": "mjrun.outputs.recording",
    "Reset": "mjrun.task.task",
    "Reward": "mjrun.task.task",
    "SegmentationIds": "mjrun.rendering.visual",
    "Simulation": "mjrun.simulation.simulation",
    "Study": "mjrun.study.study",
    "StudyResult": "mjrun.study.study",
    "Table": "mjrun.plotting.table_figure",
    "TablePlot": "mjrun.plotting.table_and_study_plot",
    "TablePlotResult": "mjrun.plotting.table_and_study_plot",
    "Task": "mjrun.task.task",
    "Termination": "mjrun.task.task",
    "Trace": "mjrun.outputs.trace",
    "TraceResult": "mjrun.outputs.trace",
    "VariedPlot": "mjrun.study.varied_plot",
    "VerificationResult": "mjrun.simulation.verification",
    "Video": "mjrun.outputs.video",
    "VideoResult": "mjrun.outputs.video",
    "Viewer": "mjrun.viewer.viewer",
    "ViewerResult": "mjrun.viewer.viewer",
    "Visual": "mjrun.rendering.visual",
    "evaluate": "mjrun.in_memory",
    "excite": "mjrun.fitting.excitation",
    "fit": "mjrun.in_memory",
    "frames": "mjrun.in_memory",
    "load": "mjrun.model.sources",
    "load_policy": "mjrun.policy.load",
    "perform": "mjrun.outputs.perform",
    "read_camera": "mjrun.document.camera_and_ghost_forms",
    "read_table": "mjrun.plotting.table_figure",
    "read_task": "mjrun.document.task",
    "read_video": "mjrun.formats.image_and_video_reader",
    "render": "mjrun.rendering.single_render",
    "sweep": "mjrun.in_memory",
    "trace": "mjrun.in_memory",
    "verify": "mjrun.simulation.verification",
    "write_video": "mjrun.formats.ffmpeg",
}

__all__ = ["__version__", *_HOMES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name == "errors":
        return import_module("mjrun.errors")
    if name not in _HOMES:
        raise AttributeError(f"module 'mjrun' has no attribute {name!r}")
    try:
        value = getattr(import_module(_HOMES[name]), name)
    except Exception as error:
        from mjrun.packages import cause_of

        raise cause_of(error) or error from None
    if "mujoco" in sys.modules:
        from mjrun.packages import require_core_versions

        require_core_versions()
    from mjrun.python_help import add_options

    add_options(name, value)
    globals()[name] = value  # so that this function is called once for each name
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
