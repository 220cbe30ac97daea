"""MuJoCo models to videos, images, tables and timing reports.

Everything the command line does is callable:

    import mjrun

    top = mjrun.load("scenes/tippe_top.xml")
    spin = mjrun.Simulation(top, key="spinning", duration=7)
    mjrun.Video(spin, "tippe_top.mp4", camera="closeup").run()
    mjrun.Image(spin, "tippe_top.png", time=3.7, view=["rgb", "depth"]).run()
    mjrun.Trace(spin, "tippe_top.npz", probe=["xpos[stem]", "energy"]).run()

Names are imported when first used, so `import mjrun` itself costs nothing.
"""

import sys
from importlib import import_module

from mjrun.version import __version__

TYPE_CHECKING = False  # importing typing would take as long as all that a command does until it heeds signals
if TYPE_CHECKING:
    from mjrun.bench.bench import Bench as Bench
    from mjrun.bench.results import BenchResult as BenchResult
    from mjrun.check.check import CheckResult as CheckResult
    from mjrun.diff.result import DiffResult as DiffResult
    from mjrun.document.camera import read_camera as read_camera
    from mjrun.document.check import Check as Check
    from mjrun.document.task import read_task as read_task
    from mjrun.evaluation.evaluation import Evaluation as Evaluation
    from mjrun.evaluation.result import EvaluationResult as EvaluationResult
    from mjrun.formats.table import Table as Table
    from mjrun.formats.table_reader import read_table as read_table
    from mjrun.formats.video_reader import read_video as read_video
    from mjrun.formats.video_writer import write_video as write_video
    from mjrun.job.diff import Diff as Diff
    from mjrun.job.image import Image as Image
    from mjrun.job.image import ImageResult as ImageResult
    from mjrun.job.keyframe import Keyframe as Keyframe
    from mjrun.job.keyframe import KeyframeResult as KeyframeResult
    from mjrun.job.perform import perform as perform
    from mjrun.job.plot import Plot as Plot
    from mjrun.job.plot import PlotResult as PlotResult
    from mjrun.job.recording import Recording as Recording
    from mjrun.job.recording import RecordingResult as RecordingResult
    from mjrun.job.simulation import Simulation as Simulation
    from mjrun.job.trace import Trace as Trace
    from mjrun.job.trace import TraceResult as TraceResult
    from mjrun.job.verification import VerificationResult as VerificationResult
    from mjrun.job.verification import verify as verify
    from mjrun.job.video import Video as Video
    from mjrun.job.video import VideoResult as VideoResult
    from mjrun.model.info import Info as Info
    from mjrun.model.info import InfoResult as InfoResult
    from mjrun.model.load import load as load
    from mjrun.plotting.table_plot import TablePlot as TablePlot
    from mjrun.plotting.table_plot import TablePlotResult as TablePlotResult
    from mjrun.policy.load import load_policy as load_policy
    from mjrun.policy.policy import ActionSpace as ActionSpace
    from mjrun.policy.policy import Policy as Policy
    from mjrun.rendering.render import render as render
    from mjrun.rendering.visual import Visual as Visual
    from mjrun.study.study import Study as Study
    from mjrun.study.study import StudyResult as StudyResult
    from mjrun.task.task import Task as Task
    from mjrun.task.terms import Action as Action
    from mjrun.task.terms import Command as Command
    from mjrun.task.terms import Observation as Observation
    from mjrun.task.terms import Reset as Reset
    from mjrun.task.terms import Reward as Reward
    from mjrun.task.terms import Termination as Termination
    from mjrun.viewer.viewer import Viewer as Viewer
    from mjrun.viewer.viewer import ViewerResult as ViewerResult

_HOMES = {
    "Action": "mjrun.task.terms",
    "ActionSpace": "mjrun.policy.policy",
    "Bench": "mjrun.bench.bench",
    "BenchResult": "mjrun.bench.results",
    "Check": "mjrun.document.check",
    "CheckResult": "mjrun.check.check",
    "Command": "mjrun.task.terms",
    "Diff": "mjrun.job.diff",
    "DiffResult": "mjrun.diff.result",
    "Evaluation": "mjrun.evaluation.evaluation",
    "EvaluationResult": "mjrun.evaluation.result",
    "Image": "mjrun.job.image",
    "ImageResult": "mjrun.job.image",
    "Info": "mjrun.model.info",
    "InfoResult": "mjrun.model.info",
    "Keyframe": "mjrun.job.keyframe",
    "KeyframeResult": "mjrun.job.keyframe",
    "Observation": "mjrun.task.terms",
    "Plot": "mjrun.job.plot",
    "PlotResult": "mjrun.job.plot",
    "Policy": "mjrun.policy.policy",
    "Recording": "mjrun.job.recording",
    "RecordingResult": "mjrun.job.recording",
    "Reset": "mjrun.task.terms",
    "Reward": "mjrun.task.terms",
    "Simulation": "mjrun.job.simulation",
    "Study": "mjrun.study.study",
    "StudyResult": "mjrun.study.study",
    "Table": "mjrun.formats.table",
    "TablePlot": "mjrun.plotting.table_plot",
    "TablePlotResult": "mjrun.plotting.table_plot",
    "Task": "mjrun.task.task",
    "Termination": "mjrun.task.terms",
    "Trace": "mjrun.job.trace",
    "TraceResult": "mjrun.job.trace",
    "VerificationResult": "mjrun.job.verification",
    "Video": "mjrun.job.video",
    "VideoResult": "mjrun.job.video",
    "Viewer": "mjrun.viewer.viewer",
    "ViewerResult": "mjrun.viewer.viewer",
    "Visual": "mjrun.rendering.visual",
    "load": "mjrun.model.load",
    "load_policy": "mjrun.policy.load",
    "perform": "mjrun.job.perform",
    "read_camera": "mjrun.document.camera",
    "read_table": "mjrun.formats.table_reader",
    "read_task": "mjrun.document.task",
    "read_video": "mjrun.formats.video_reader",
    "render": "mjrun.rendering.render",
    "verify": "mjrun.job.verification",
    "write_video": "mjrun.formats.video_writer",
}

__all__ = [
    "Action",
    "ActionSpace",
    "Bench",
    "BenchResult",
    "Check",
    "CheckResult",
    "Command",
    "Diff",
    "DiffResult",
    "Evaluation",
    "EvaluationResult",
    "Image",
    "ImageResult",
    "Info",
    "InfoResult",
    "Keyframe",
    "KeyframeResult",
    "Observation",
    "Plot",
    "PlotResult",
    "Policy",
    "Recording",
    "RecordingResult",
    "Reset",
    "Reward",
    "Simulation",
    "Study",
    "StudyResult",
    "Table",
    "TablePlot",
    "TablePlotResult",
    "Task",
    "Termination",
    "Trace",
    "TraceResult",
    "VerificationResult",
    "Video",
    "VideoResult",
    "Viewer",
    "ViewerResult",
    "Visual",
    "__version__",
    "load",
    "load_policy",
    "perform",
    "read_camera",
    "read_table",
    "read_task",
    "read_video",
    "render",
    "verify",
    "write_video",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'mjrun' has no attribute {name!r}")
    try:
        value = getattr(import_module(_HOMES[name]), name)
    except Exception as error:
        from mjrun.packages import cause_of

        raise cause_of(error) or error from None
    if "mujoco" in sys.modules:
        from mjrun.packages import require_computing

        require_computing()
    globals()[name] = value  # so that this function is called once for each name
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
