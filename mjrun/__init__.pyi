"""MuJoCo models to videos, images, tables and timing reports; written by scripts/make_stubs.py."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from mujoco import MjModel

from mjrun.bench.bench import Bench as _Bench
from mjrun.bench.results import BenchResult as BenchResult
from mjrun.camera.script import CameraScript, Event
from mjrun.check.check import CheckResult as CheckResult
from mjrun.diff.result import DiffResult as DiffResult
from mjrun.document.check import Check as _Check
from mjrun.document.task import read_task as read_task
from mjrun.document.value_forms import read_camera as read_camera
from mjrun.evaluation.evaluation import Evaluation as _Evaluation
from mjrun.evaluation.evaluation import EvaluationResult as EvaluationResult
from mjrun.fitting.result import FitResult as FitResult
from mjrun.formats.video_reader import read_video as read_video
from mjrun.formats.video_writer import write_video as write_video
from mjrun.model.info import Info as Info
from mjrun.model.info import InfoResult as InfoResult
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike
from mjrun.model.sources import load as load
from mjrun.options.push import Push
from mjrun.outputs.image import Image as _Image
from mjrun.outputs.image import ImageResult as ImageResult
from mjrun.outputs.keyframe import Keyframe as _Keyframe
from mjrun.outputs.keyframe import KeyframeResult as KeyframeResult
from mjrun.outputs.perform import perform as perform
from mjrun.outputs.plot import Plot as _Plot
from mjrun.outputs.plot import PlotResult as PlotResult
from mjrun.outputs.recording import Recording as _Recording
from mjrun.outputs.recording import RecordingResult as RecordingResult
from mjrun.outputs.result_comparison import Diff as _Diff
from mjrun.outputs.trace import Trace as _Trace
from mjrun.outputs.trace import TraceResult as TraceResult
from mjrun.outputs.video import Video as _Video
from mjrun.outputs.video import VideoResult as VideoResult
from mjrun.plotting.table import Figure as Figure
from mjrun.plotting.table import Table as Table
from mjrun.plotting.table import read_table as read_table
from mjrun.plotting.table_and_study_plot import TablePlot as _TablePlot
from mjrun.plotting.table_and_study_plot import TablePlotResult as TablePlotResult
from mjrun.policy.load import load_policy as load_policy
from mjrun.policy.policy import ActionSpace as ActionSpace
from mjrun.policy.policy import Policy as Policy
from mjrun.rendering.segment_ids import Segmentation as Segmentation
from mjrun.rendering.single_render import render as render
from mjrun.rendering.visual import Visual as Visual
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.simulation import Simulation as _Simulation
from mjrun.simulation.verification import VerificationResult as VerificationResult
from mjrun.simulation.verification import verify as verify
from mjrun.study.study import Study as _Study
from mjrun.study.study import StudyResult as StudyResult
from mjrun.task.task import Action as _Action
from mjrun.task.task import Command as _Command
from mjrun.task.task import Observation as _Observation
from mjrun.task.task import Reset as _Reset
from mjrun.task.task import Reward as _Reward
from mjrun.task.task import Task as Task
from mjrun.task.task import Termination as _Termination
from mjrun.version import __version__ as __version__
from mjrun.viewer.viewer import Viewer as _Viewer
from mjrun.viewer.viewer import ViewerResult as ViewerResult

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
    "Figure",
    "FitResult",
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
    "Segmentation",
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
    "evaluate",
    "fit",
    "frames",
    "load",
    "load_policy",
    "perform",
    "read_camera",
    "read_table",
    "read_task",
    "read_video",
    "render",
    "sweep",
    "trace",
    "verify",
    "write_video",
]
_HOMES: dict[str, str]

class Action(_Action):
    """A group of numbers of the action."""
    def __init__(
        self,
        *,
        actuators: str | Sequence[str] | None = ...,
        joints: str | Sequence[str] | None = ...,
        target: Literal["control", "position", "velocity", "torque"] | None = ...,
        kp: float | Sequence[float] | None = ...,
        kd: float | Sequence[float] | None = ...,
        squash: Literal["none", "tanh"] = ...,
        clip: Sequence[float | Sequence[float]] | None = ...,
        scale: float | Sequence[float] = ...,
        offset: float | str | Sequence[float] = ...,
    ) -> None: ...

class Bench(_Bench):
    """A benchmark of a model. Its options are keywords."""
    def __init__(
        self,
        model: MjModel | Source | str | PathLike[str],
        *,
        save: str | PathLike[str] | None = ...,
        compare: str | PathLike[str] | None = ...,
        fail_above: float | None = ...,
        force: bool = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        render: bool = ...,
        size: Sequence[int] | Sequence[Sequence[int]] = ...,
        camera: str | None = ...,
        view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
        quality: Literal["draft", "model", "high"] | Sequence[Literal["draft", "model", "high"]] = ...,
        renderer: Literal["classic", "filament"] | Sequence[Literal["classic", "filament"]] = ...,
        integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
        timestep: float | str | Fraction | None = ...,
        ground: float | None = ...,
        set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        key: str | int | None = ...,
        steps: int | None = ...,
        noise_std: float = ...,
        noise_rate: float = ...,
        engine: Literal["c", "warp"] = ...,
        worlds: int | None = ...,
        device: str | None = ...,
        nconmax: int | None = ...,
        njmax: int | None = ...,
        budget: float | str | Fraction = ...,
        repeats: int | None = ...,
        threads: int | Literal["auto"] | Sequence[int | Literal["auto"]] = ...,
        scan: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        accuracy: bool = ...,
        horizon: float | str | Fraction | None = ...,
        reference: float | str | Fraction | None = ...,
        whole: bool = ...,
        command: str = ...,
    ) -> None: ...

class Check(_Check):
    """A check of models and tasks for errors, and for likely causes of later errors."""
    def __init__(
        self,
        models: Sequence[str | Path],
        *,
        select: str | Sequence[str] = ...,
        ignore: str | Sequence[str] = ...,
        ignore_in: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        severity: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        threshold: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        fail_on: Literal["error", "warning", "note"] = ...,
        baseline: str | PathLike[str] | None = ...,
        update_baseline: bool = ...,
        changed_since: str | None = ...,
        fix: bool = ...,
        unsafe_fixes: bool = ...,
        dry_run: bool = ...,
        skip_other: bool = ...,
        steps: int = ...,
        timeout: float | str | Fraction = ...,
        memory: int = ...,
        jobs: int | Literal["auto"] = ...,
        cache: bool = ...,
        trust: bool = ...,
        policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        normalize: str | PathLike[str] | None = ...,
    ) -> None: ...

class Command(_Command):
    """A command to the policy."""
    def __init__(
        self,
        *,
        constant: float | Sequence[float] | None = ...,
        table: str | PathLike[str] | None = ...,
        interpolation: Literal["hold", "linear"] = ...,
        schedule: Sequence[Sequence[object]] | None = ...,
        random: str | float | Mapping[str, object] | Sequence[str | float | Mapping[str, object]] | None = ...,
        size: int | None = ...,
        every: float | str | Fraction | None = ...,
    ) -> None: ...

class Diff(_Diff):
    """A comparison of two tables, recordings, videos, images or models: its options are keywords."""
    def __init__(
        self,
        a: MjModel | Source | str | PathLike[str],
        b: MjModel | Source | str | PathLike[str],
        *,
        min_psnr: float | None = ...,
        min_ssim: float | None = ...,
        max_changed: float | None = ...,
        output: str | PathLike[str] | None = ...,
        atol: float = ...,
        rtol: float = ...,
        tol: Mapping[str, float | Sequence[float]] = ...,
        columns: str | Sequence[str] = ...,
        align: str | None = ...,
        common: bool = ...,
        model: str | PathLike[str] | None = ...,
    ) -> None: ...

class Evaluation(_Evaluation):
    """Seeded episodes of `task` under a policy. Its options are keywords."""
    def __init__(
        self,
        task: Source,
        output: str | PathLike[str],
        *,
        jobs: int | Literal["auto"] = ...,
        integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
        timestep: float | str | Fraction | None = ...,
        ground: float | None = ...,
        set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        trust: bool = ...,
        policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        normalize: str | PathLike[str] | None = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        points: str | PathLike[str] | None = ...,
        design: Literal["grid", "zip"] = ...,
        samples: int = ...,
        sampler: Literal["sobol", "lhs", "random"] = ...,
        repeats: int = ...,
        where: str | Sequence[str] = ...,
        videos: int = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        size: Sequence[int] = ...,
        quality: Literal["draft", "model", "high"] = ...,
        fps: float | str | Fraction = ...,
        speed: float | str | Fraction = ...,
        episodes: int = ...,
        seed: int = ...,
        compare: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        compare_normalize: str | PathLike[str] | None = ...,
        metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        require: str | Sequence[str] = ...,
        fail_below: Mapping[str, float | Sequence[float]] = ...,
        confidence: float = ...,
        command: str = ...,
        rewritten: Callable[[Mapping[str, str]], Source] | None = ...,
    ) -> None: ...

class Image(_Image):
    """An image of one instant of a simulation: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        quality: Literal["draft", "model", "high"] = ...,
        renderer: Literal["classic", "filament"] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
        layout: Literal["row", "column", "grid"] = ...,
        separate: bool = ...,
        captions: bool = ...,
        style: Literal["color", "exact"] | None = ...,
        depth_range: Sequence[float] | None = ...,
        seg_by: str = ...,
        stage: Literal["auto", "none", "floor", "light", "sky"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky"]] = ...,
        geoms: Literal["visual", "collision", "both"] | None = ...,
        show: str | Sequence[str] = ...,
        hide: str | Sequence[str] = ...,
        geomgroup: Sequence[int] | str | None = ...,
        sitegroup: Sequence[int] | str | None = ...,
        jointgroup: Sequence[int] | str | None = ...,
        tendongroup: Sequence[int] | str | None = ...,
        actuatorgroup: Sequence[int] | str | None = ...,
        flexgroup: Sequence[int] | str | None = ...,
        skingroup: Sequence[int] | str | None = ...,
        frame_axes: str = ...,
        label: str = ...,
        trail: str | Sequence[str] = ...,
        trail_span: float | str | Fraction | None = ...,
        ghost: str | Sequence[str] = ...,
        text: str | None = ...,
        text_corner: Literal["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"] | None = ...,
        calibration: str | PathLike[str] | None = ...,
        calibration_format: Literal["mjrun", "nerfstudio", "bop", "ros"] = ...,
        time: float | str | Fraction | Event | None = ...,
        step: int | None = ...,
        format: str | None = ...,
        legend: bool = ...,
        pointcloud: str | PathLike[str] | None = ...,
    ) -> None: ...

class Keyframe(_Keyframe):
    """A keyframe with an instant of a simulation, saved in the model's XML: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        name: str = ...,
        time: float | str | Fraction | None = ...,
        step: int | None = ...,
    ) -> None: ...

class Observation(_Observation):
    """A term of the observation."""
    def __init__(
        self,
        *,
        name: str,
        probe: str | Sequence[str] | None = ...,
        joints: str | Sequence[str] | None = ...,
        of: Literal["qpos", "qvel"] = ...,
        action: Literal["previous"] | None = ...,
        command: str | None = ...,
        phase: float | str | Fraction | None = ...,
        value: str | None = ...,
        frame: str = ...,
        noise: str | float | Mapping[str, object] | None = ...,
        offset: float | Sequence[float] = ...,
        scale: float | Sequence[float] = ...,
        clip: Sequence[float | Sequence[float]] | None = ...,
        delay: int = ...,
        history: int = ...,
    ) -> None: ...

class Plot(_Plot):
    """A plot of values measured in a simulation: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        every: int = ...,
        rate: float | str | Fraction | None = ...,
        format: str | None = ...,
        y: str | Sequence[str] = ...,
        x: str | None = ...,
        log: str | Sequence[str] = ...,
        xlim: Sequence[float] | None = ...,
        ylim: str | Sequence[str] = ...,
        mark: str | Sequence[str] = ...,
        mark_event: str | Sequence[str] = ...,
        title: str | None = ...,
        style: Literal["light", "dark", "print"] = ...,
        size: Sequence[int] | None = ...,
        columns: int | None = ...,
        probe: str | Sequence[str] = ...,
    ) -> None: ...

class Recording(_Recording):
    """A recording of the states of all steps of a simulation: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        keep_partial: bool = ...,
    ) -> None: ...

class Reset(_Reset):
    """The initial state of an episode, and its random parts."""
    def __init__(
        self,
        *,
        key: str | int | None = ...,
        qpos: Mapping[str, float | Sequence[float]] = ...,
        qvel: Mapping[str, float | Sequence[float]] = ...,
        ctrl: Mapping[str, float | Sequence[float]] = ...,
        noise: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    ) -> None: ...

class Reward(_Reward):
    """A term of the reward."""
    def __init__(
        self,
        *,
        value: str,
        weight: float = ...,
    ) -> None: ...

class Simulation(_Simulation):
    """A model, its state at time 0, its inputs, and its duration."""
    def __init__(
        self,
        model: MjModel | Source | str | PathLike[str],
        *,
        integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
        timestep: float | str | Fraction | None = ...,
        ground: float | None = ...,
        set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        controller: Callable[..., object] | None = ...,
        control_dt: float | str | Fraction | None = ...,
        trust: bool = ...,
        policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        normalize: str | PathLike[str] | None = ...,
        key: str | int | None = ...,
        qpos: Mapping[str, float | Sequence[float]] = ...,
        qvel: Mapping[str, float | Sequence[float]] = ...,
        ctrl: Mapping[str, float | Sequence[float]] = ...,
        ctrl_from: str | PathLike[str] | None = ...,
        ctrl_interpolation: Literal["hold", "linear"] = ...,
        ctrl_noise: float = ...,
        ctrl_noise_time: float = ...,
        push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
        replay: str | PathLike[str] | None = ...,
        replay_mode: Literal["states", "controls"] = ...,
        replay_rate: float | str | Fraction | None = ...,
        replay_interpolation: Literal["hold", "linear"] = ...,
        replay_unwrap: bool = ...,
        map: str | PathLike[str] | Mapping[str, object] | Sequence[str] = ...,
        quat: Literal["wxyz", "xyzw"] = ...,
        perturb: float = ...,
        seed: int = ...,
        duration: float | str | Fraction | None = ...,
        steps: int | None = ...,
        snapshot: InputSnapshot | None = ...,
    ) -> None: ...

class Study(_Study):
    """Many simulations: `simulation` with the values of each point. Its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        jobs: int | Literal["auto"] = ...,
        engine: str = ...,
        chunk: int | None = ...,
        time_limit: float | str | Fraction | None = ...,
        retry_failed: bool = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        points: str | PathLike[str] | None = ...,
        design: Literal["grid", "zip"] = ...,
        samples: int = ...,
        sampler: Literal["sobol", "lhs", "random"] = ...,
        repeats: int = ...,
        where: str | Sequence[str] = ...,
        keep: Literal["trace", "recording", "video"] | Sequence[Literal["trace", "recording", "video"]] = ...,
        keep_where: str | Sequence[str] = ...,
        keep_lowest: str | Sequence[str] = ...,
        keep_highest: str | Sequence[str] = ...,
        contact_sheet: str | PathLike[str] | None = ...,
        probe: str | Sequence[str] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        size: Sequence[int] = ...,
        quality: Literal["draft", "model", "high"] = ...,
        fps: float | str | Fraction = ...,
        speed: float | str | Fraction = ...,
        metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        every: int = ...,
        require: str | Sequence[str] = ...,
        command: str = ...,
        controllers: Mapping[str, Callable[..., object]] = ...,
        document: Mapping[str, object] | None = ...,
    ) -> None: ...

class TablePlot(_TablePlot):
    """A plot of tables: its options are keywords."""
    def __init__(
        self,
        tables: Sequence[str | Path] | str | Path,
        output: str | PathLike[str] | None = ...,
        *,
        y: str | Sequence[str] = ...,
        x: str | None = ...,
        log: str | Sequence[str] = ...,
        xlim: Sequence[float] | None = ...,
        ylim: str | Sequence[str] = ...,
        mark: str | Sequence[str] = ...,
        mark_event: str | Sequence[str] = ...,
        title: str | None = ...,
        style: Literal["light", "dark", "print"] = ...,
        size: Sequence[int] | None = ...,
        columns: int | None = ...,
        html: str | PathLike[str] | None = ...,
        embed_up_to: float = ...,
        format: str | None = ...,
        assert_: str | Sequence[str] = ...,
        label: str | Sequence[str] = ...,
        include: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
    ) -> None: ...

class Termination(_Termination):
    """A condition that ends an episode."""
    def __init__(
        self,
        *,
        when: str,
        as_: Literal["success", "failure", "timeout"],
    ) -> None: ...

class Trace(_Trace):
    """A trace of a simulation, a table of measured values: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str] = ...,
        *,
        atol: float = ...,
        rtol: float = ...,
        tol: Mapping[str, float | Sequence[float]] = ...,
        golden: str | PathLike[str] | None = ...,
        update: bool = ...,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        every: int = ...,
        rate: float | str | Fraction | None = ...,
        format: str | None = ...,
        probe: str | Sequence[str] = ...,
        assert_: str | Sequence[str] = ...,
        keep_partial: bool = ...,
        contacts: str | PathLike[str] | None = ...,
        written: bool = ...,
    ) -> None: ...

class Video(_Video):
    """A video of a simulation: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        quality: Literal["draft", "model", "high"] = ...,
        renderer: Literal["classic", "filament"] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
        layout: Literal["row", "column", "grid"] = ...,
        separate: bool = ...,
        captions: bool = ...,
        style: Literal["color", "exact"] | None = ...,
        depth_range: Sequence[float] | None = ...,
        seg_by: str = ...,
        stage: Literal["auto", "none", "floor", "light", "sky"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky"]] = ...,
        geoms: Literal["visual", "collision", "both"] | None = ...,
        show: str | Sequence[str] = ...,
        hide: str | Sequence[str] = ...,
        geomgroup: Sequence[int] | str | None = ...,
        sitegroup: Sequence[int] | str | None = ...,
        jointgroup: Sequence[int] | str | None = ...,
        tendongroup: Sequence[int] | str | None = ...,
        actuatorgroup: Sequence[int] | str | None = ...,
        flexgroup: Sequence[int] | str | None = ...,
        skingroup: Sequence[int] | str | None = ...,
        frame_axes: str = ...,
        label: str = ...,
        trail: str | Sequence[str] = ...,
        trail_span: float | str | Fraction | None = ...,
        ghost: str | Sequence[str] = ...,
        text: str | None = ...,
        text_corner: Literal["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"] | None = ...,
        calibration: str | PathLike[str] | None = ...,
        calibration_format: Literal["mjrun", "nerfstudio", "bop", "ros"] = ...,
        fps: float | str | Fraction | None = ...,
        speed: float | str | Fraction = ...,
        format: str | None = ...,
        codec: str | None = ...,
        crf: int | None = ...,
        preset: str | int | None = ...,
        plot: str | Sequence[str] = ...,
        plot_side: Literal["under", "beside"] = ...,
        jobs: int | Literal["auto"] = ...,
    ) -> None: ...

class Viewer(_Viewer):
    """A live view of a simulation: its options are keywords."""
    def __init__(
        self,
        simulation: _Simulation,
        *,
        speed: float | str | Fraction = ...,
        paused: bool = ...,
        browser: bool | None = ...,
        port: int | None = ...,
        recording: str | PathLike[str] | None = ...,
        command: str = ...,
    ) -> None: ...

def evaluate(
    task: Source | str,
    *,
    output: str | PathLike[str] = ...,
    episodes: int = ...,
    seed: int = ...,
    compare: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    compare_normalize: str | PathLike[str] | None = ...,
    metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    require: str | Sequence[str] = ...,
    fail_below: Mapping[str, float | Sequence[float]] = ...,
    confidence: float = ...,
    videos: int = ...,
    camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
    size: Sequence[int] = ...,
    quality: Literal["draft", "model", "high"] = ...,
    fps: float | str | Fraction = ...,
    speed: float | str | Fraction = ...,
    vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    points: str | PathLike[str] | None = ...,
    design: Literal["grid", "zip"] = ...,
    samples: int = ...,
    sampler: Literal["sobol", "lhs", "random"] = ...,
    repeats: int = ...,
    where: str | Sequence[str] = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    jobs: int | Literal["auto"] = ...,
) -> EvaluationResult:
    """Plays episodes of a task with a policy, as `mjrun eval` does; `result.table` has a row for each episode."""

def fit(
    model: ModelLike | Task | _Simulation,
    data: str | PathLike[str] | Sequence[str | PathLike[str]],
    *,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
    ctrl_noise: float = ...,
    ctrl_noise_time: float = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    replay: str | PathLike[str] | None = ...,
    replay_mode: Literal["states", "controls"] = ...,
    replay_rate: float | str | Fraction | None = ...,
    replay_interpolation: Literal["hold", "linear"] = ...,
    replay_unwrap: bool = ...,
    map: str | PathLike[str] | Mapping[str, object] | Sequence[str] = ...,
    quat: Literal["wxyz", "xyzw"] = ...,
    perturb: float = ...,
    seed: int = ...,
    duration: float | str | Fraction | None = ...,
    steps: int | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    free: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    output: str | PathLike[str] | None = ...,
    comparison: str | PathLike[str] | None = ...,
    ranges: str | PathLike[str] | None = ...,
    html: str | PathLike[str] | None = ...,
    video: str | PathLike[str] | None = ...,
    camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
    size: Sequence[int] = ...,
    noise: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    holdout: float = ...,
    holdout_data: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
    starts: int = ...,
    confidence: float = ...,
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = ...,
    allow_unidentifiable: bool = ...,
    keep_partial: bool = ...,
    excite: str | PathLike[str] | None = ...,
    excite_noise: float = ...,
    velocity_limit: float | None = ...,
) -> FitResult:
    """Estimates parameters of a model from measurements, as `mjrun fit` does."""

def frames(
    model: ModelLike | Task | _Simulation,
    *,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
    ctrl_noise: float = ...,
    ctrl_noise_time: float = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    replay: str | PathLike[str] | None = ...,
    replay_mode: Literal["states", "controls"] = ...,
    replay_rate: float | str | Fraction | None = ...,
    replay_interpolation: Literal["hold", "linear"] = ...,
    replay_unwrap: bool = ...,
    map: str | PathLike[str] | Mapping[str, object] | Sequence[str] = ...,
    quat: Literal["wxyz", "xyzw"] = ...,
    perturb: float = ...,
    seed: int = ...,
    duration: float | str | Fraction | None = ...,
    steps: int | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    fps: float | str | Fraction | None = ...,
    speed: float | str | Fraction = ...,
    plot: str | Sequence[str] = ...,
    plot_side: Literal["under", "beside"] = ...,
    jobs: int | Literal["auto"] = ...,
    size: Sequence[int] = ...,
    camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
    view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
    layout: Literal["row", "column", "grid"] = ...,
    captions: bool = ...,
    style: Literal["color", "exact"] | None = ...,
    depth_range: Sequence[float] | None = ...,
    seg_by: str = ...,
    stage: Literal["auto", "none", "floor", "light", "sky"]
    | Sequence[Literal["auto", "none", "floor", "light", "sky"]] = ...,
    geoms: Literal["visual", "collision", "both"] | None = ...,
    show: str | Sequence[str] = ...,
    hide: str | Sequence[str] = ...,
    geomgroup: Sequence[int] | str | None = ...,
    sitegroup: Sequence[int] | str | None = ...,
    jointgroup: Sequence[int] | str | None = ...,
    tendongroup: Sequence[int] | str | None = ...,
    actuatorgroup: Sequence[int] | str | None = ...,
    flexgroup: Sequence[int] | str | None = ...,
    skingroup: Sequence[int] | str | None = ...,
    frame_axes: str = ...,
    label: str = ...,
    trail: str | Sequence[str] = ...,
    trail_span: float | str | Fraction | None = ...,
    ghost: str | Sequence[str] = ...,
    text: str | None = ...,
    text_corner: Literal["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"] | None = ...,
    quality: Literal["draft", "model", "high"] = ...,
    renderer: Literal["classic", "filament"] = ...,
    gl: str | None = ...,
    require_gpu: bool = ...,
) -> Iterator[np.ndarray]:
    """Simulates a model, and yields the frames of the video that `mjrun video` makes, with the same pixels."""

def sweep(
    model: ModelLike | Task | _Simulation,
    *,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
    ctrl_noise: float = ...,
    ctrl_noise_time: float = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    replay: str | PathLike[str] | None = ...,
    replay_mode: Literal["states", "controls"] = ...,
    replay_rate: float | str | Fraction | None = ...,
    replay_interpolation: Literal["hold", "linear"] = ...,
    replay_unwrap: bool = ...,
    map: str | PathLike[str] | Mapping[str, object] | Sequence[str] = ...,
    quat: Literal["wxyz", "xyzw"] = ...,
    perturb: float = ...,
    seed: int = ...,
    duration: float | str | Fraction | None = ...,
    steps: int | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    output: str | PathLike[str] = ...,
    metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    every: int = ...,
    require: str | Sequence[str] = ...,
    keep: Literal["trace", "recording", "video"] | Sequence[Literal["trace", "recording", "video"]] = ...,
    keep_where: str | Sequence[str] = ...,
    keep_lowest: str | Sequence[str] = ...,
    keep_highest: str | Sequence[str] = ...,
    contact_sheet: str | PathLike[str] | None = ...,
    probe: str | Sequence[str] = ...,
    camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
    size: Sequence[int] = ...,
    quality: Literal["draft", "model", "high"] = ...,
    fps: float | str | Fraction = ...,
    speed: float | str | Fraction = ...,
    vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    points: str | PathLike[str] | None = ...,
    design: Literal["grid", "zip"] = ...,
    samples: int = ...,
    sampler: Literal["sobol", "lhs", "random"] = ...,
    repeats: int = ...,
    where: str | Sequence[str] = ...,
    jobs: int | Literal["auto"] = ...,
    engine: str = ...,
    chunk: int | None = ...,
    time_limit: float | str | Fraction | None = ...,
    retry_failed: bool = ...,
) -> StudyResult:
    """Simulates a model with varied parameters, as `mjrun sweep` does; `result.table` has a row for each point."""

def trace(
    model: ModelLike | Task | _Simulation,
    *,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
    ctrl_noise: float = ...,
    ctrl_noise_time: float = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    replay: str | PathLike[str] | None = ...,
    replay_mode: Literal["states", "controls"] = ...,
    replay_rate: float | str | Fraction | None = ...,
    replay_interpolation: Literal["hold", "linear"] = ...,
    replay_unwrap: bool = ...,
    map: str | PathLike[str] | Mapping[str, object] | Sequence[str] = ...,
    quat: Literal["wxyz", "xyzw"] = ...,
    perturb: float = ...,
    seed: int = ...,
    duration: float | str | Fraction | None = ...,
    steps: int | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    output: str | PathLike[str] = ...,
    probe: str | Sequence[str] = ...,
    assert_: str | Sequence[str] = ...,
    keep_partial: bool = ...,
    contacts: str | PathLike[str] | None = ...,
    every: int = ...,
    rate: float | str | Fraction | None = ...,
    format: str | None = ...,
    manifest: str | PathLike[str] | None = ...,
    golden: str | PathLike[str] | None = ...,
    update: bool = ...,
    atol: float = ...,
    rtol: float = ...,
    tol: Mapping[str, float | Sequence[float]] = ...,
) -> Table:
    """Simulates a model, and returns the table that `mjrun trace` writes, with the same numbers."""
