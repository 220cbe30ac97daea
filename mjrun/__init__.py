"""MuJoCo models to films, pictures, tables and timing reports.

Everything the command line does is callable:

    import mjrun

    top = mjrun.load("scenes/tippe_top.xml")
    spin = mjrun.Simulation(top, key="spinning", duration=7)
    mjrun.Video(spin, "tippe_top.mp4", camera="closeup").run()
    mjrun.Image(spin, "tippe_top.png", at=3.7, view=["rgb", "depth"]).run()
    mjrun.Trace(spin, "tippe_top.npz", probes=["xpos[stem]", "energy"]).run()

Names are imported when first used, so `import mjrun` itself costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from mjrun.version import __version__

if TYPE_CHECKING:
    from mjrun.document.camera import read_camera as read_camera
    from mjrun.job.bench import Bench as Bench
    from mjrun.job.check import Check as Check
    from mjrun.job.check import CheckResult as CheckResult
    from mjrun.job.image import Image as Image
    from mjrun.job.image import ImageResult as ImageResult
    from mjrun.job.info import Info as Info
    from mjrun.job.info import InfoResult as InfoResult
    from mjrun.job.measuring.results import BenchResult as BenchResult
    from mjrun.job.plot import Plot as Plot
    from mjrun.job.plot import PlotResult as PlotResult
    from mjrun.job.record import Record as Record
    from mjrun.job.record import RecordResult as RecordResult
    from mjrun.job.simulation import Simulation as Simulation
    from mjrun.job.trace import Trace as Trace
    from mjrun.job.trace import TraceResult as TraceResult
    from mjrun.job.video import Video as Video
    from mjrun.job.video import VideoResult as VideoResult
    from mjrun.job.work import perform as perform
    from mjrun.model.load import load as load
    from mjrun.render.visual import Visual as Visual

_HOMES = {
    "Image": "mjrun.job.image",
    "ImageResult": "mjrun.job.image",
    "Bench": "mjrun.job.bench",
    "BenchResult": "mjrun.job.measuring.results",
    "Check": "mjrun.job.check",
    "CheckResult": "mjrun.job.check",
    "Info": "mjrun.job.info",
    "InfoResult": "mjrun.job.info",
    "Plot": "mjrun.job.plot",
    "PlotResult": "mjrun.job.plot",
    "Record": "mjrun.job.record",
    "RecordResult": "mjrun.job.record",
    "Simulation": "mjrun.job.simulation",
    "Trace": "mjrun.job.trace",
    "TraceResult": "mjrun.job.trace",
    "Video": "mjrun.job.video",
    "VideoResult": "mjrun.job.video",
    "Visual": "mjrun.render.visual",
    "load": "mjrun.model.load",
    "perform": "mjrun.job.work",
    "read_camera": "mjrun.document.camera",
}

__all__ = [
    "Bench",
    "BenchResult",
    "Check",
    "CheckResult",
    "Image",
    "ImageResult",
    "Info",
    "InfoResult",
    "Plot",
    "PlotResult",
    "Record",
    "RecordResult",
    "Simulation",
    "Trace",
    "TraceResult",
    "Video",
    "VideoResult",
    "Visual",
    "__version__",
    "load",
    "perform",
    "read_camera",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'mjrun' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
