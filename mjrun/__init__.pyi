"""MuJoCo models to videos, images, tables and timing reports; written by scripts/make_stubs.py."""

from collections.abc import Callable, Generator, Mapping, Sequence
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from mujoco import MjModel

from mjrun import errors as errors
from mjrun.bench.bench import Bench as _Bench
from mjrun.bench.results import BenchResult as BenchResult
from mjrun.camera.script import CameraScript, ConditionEvent
from mjrun.check.check import CheckResult as CheckResult
from mjrun.diff.result import DiffResult as DiffResult
from mjrun.document.camera_and_ghost_forms import read_camera as read_camera
from mjrun.document.model_and_task_check import Check as _Check
from mjrun.document.task import read_task as read_task
from mjrun.evaluation.evaluation import Evaluation as _Evaluation
from mjrun.evaluation.evaluation import EvaluationResult as EvaluationResult
from mjrun.fitting.excitation import ExcitationResult as ExcitationResult
from mjrun.fitting.excitation import excite as excite
from mjrun.fitting.fit import Fit as _Fit
from mjrun.fitting.result import FitResult as FitResult
from mjrun.formats.ffmpeg import write_video as write_video
from mjrun.formats.image_and_video_reader import read_video as read_video
from mjrun.model.info import Info as Info
from mjrun.model.info import InfoResult as InfoResult
from mjrun.model.source import ModelSource
from mjrun.model.sources import ModelLike
from mjrun.model.sources import load as load
from mjrun.options.simulation import Push
from mjrun.outputs.diff import Diff as _Diff
from mjrun.outputs.export import Export as _Export
from mjrun.outputs.export import ExportResult as ExportResult
from mjrun.outputs.image import Image as _Image
from mjrun.outputs.image import ImageResult as ImageResult
from mjrun.outputs.keyframe import Keyframe as _Keyframe
from mjrun.outputs.keyframe import KeyframeResult as KeyframeResult
from mjrun.outputs.perform import perform as perform
from mjrun.outputs.plot import Plot as _Plot
from mjrun.outputs.plot import PlotResult as PlotResult
from mjrun.outputs.recording import Recording as _Recording
from mjrun.outputs.recording import RecordingResult as RecordingResult
from mjrun.outputs.trace import Trace as _Trace
from mjrun.outputs.trace import TraceResult as TraceResult
from mjrun.outputs.video import Video as _Video
from mjrun.outputs.video import VideoResult as VideoResult
from mjrun.plotting.table_and_study_plot import TablePlot as _TablePlot
from mjrun.plotting.table_and_study_plot import TablePlotResult as TablePlotResult
from mjrun.plotting.table_figure import Figure as Figure
from mjrun.plotting.table_figure import Table as Table
from mjrun.plotting.table_figure import read_table as read_table
from mjrun.policy.load import load_policy as load_policy
from mjrun.policy.policy import ActionSpace as ActionSpace
from mjrun.policy.policy import Policy as Policy
from mjrun.rendering.single_render import render as render
from mjrun.rendering.visual import SegmentationIds as SegmentationIds
from mjrun.rendering.visual import Visual as Visual
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.simulation import Simulation as _Simulation
from mjrun.simulation.verification import VerificationResult as VerificationResult
from mjrun.simulation.verification import verify as verify
from mjrun.study.episode_dataset import EpisodeDataset as _EpisodeDataset
from mjrun.study.episode_dataset import EpisodeDatasetResult as EpisodeDatasetResult
from mjrun.study.image_dataset import Dataset as _Dataset
from mjrun.study.image_dataset import DatasetResult as DatasetResult
from mjrun.study.study import Study as _Study
from mjrun.study.study import StudyResult as StudyResult
from mjrun.study.varied_plot import VariedPlot as _VariedPlot
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
    "Dataset",
    "DatasetResult",
    "Diff",
    "DiffResult",
    "EpisodeDataset",
    "EpisodeDatasetResult",
    "Evaluation",
    "EvaluationResult",
    "ExcitationResult",
    "Export",
    "ExportResult",
    "Figure",
    "Fit",
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
    "SegmentationIds",
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
    "VariedPlot",
    "VerificationResult",
    "Video",
    "VideoResult",
    "Viewer",
    "ViewerResult",
    "Visual",
    "__version__",
    "evaluate",
    "excite",
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
    """A group of numbers of the action.

    Raises:
      UsageError: it drives nothing, a gain is missing, or a gain does not apply to its target.

    Options:
      actuators: Actuators by name or wildcard, in this order.
      joints: Joints by name or wildcard, in this order, each with one actuator.
      target: Quantity that the action sets: control, of the actuator; position or velocity, a target q*
        or q̇* of the joint, reached by a torque kp (q* - q) - kd q̇ or kd (q̇* - q̇) that is computed
        at every step; or torque, of the joint. One of control, position, velocity, torque. [default:
        control with actuators]
      kp: Stiffness of a position target [N·m/rad, N/m].
      kd: Damping of a target [N·m·s/rad, N·s/m].
      squash: Function applied to the action first; tanh limits it to -1 … 1. One of none, tanh.
        [default: 'none']
      clip: Lowest and highest value, before scale and offset.
      scale: Factor to multiply by: one number, or one per component. [default: (1.0,)]
      offset: Value added last: one number, one per component, or the keyframe that contains the
        targets. [default: (0.0,)]
      delay: Delay of the action, in control periods; until the first one arrives, an action of zeros is
        in force.
    """
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
        delay: int = ...,
    ) -> None: ...

class Bench(_Bench):
    """A benchmark of a model. Its options are keywords.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model.
      command: command line.

    Rollouts have the length of those of testspeed by default: at most 10,000 steps, fewer if the budget requires it.
    All points of a `scan` are measured in turn, so that disturbances affect all of them.

    Raises:
      UsageError: a value is invalid, or would have no effect.

    Options:
      budget: Approximate wall time to spend [s]. [default: 3]
      repeats: Number of times to repeat each rollout. [default: 7 to 50]
      threads: Numbers of simulations to run side by side, each measured in turn: 1,2,auto. [default:
        1,auto; 1 with --scan]
      scan: Measure every combination of these settings: integrator=euler,rk4 timestep=.001,.002
        opt.solver=cg,newton, or any path of set. Separate values that contain commas by semicolons.
      accuracy: Add the energy drift, and the distance from a run with a smaller timestep.
      horizon: Simulated time after which accuracy is measured [s]. [default: 1]
      reference: Timestep of the run against which accuracy is measured [s]. [default: an eighth of the
        smallest]
      whole: Also time a complete trace and a complete video of 1 s.
      engine: Physics engine: c is MuJoCo; warp is MuJoCo Warp, which steps many worlds at once in
        single precision and requires the extra warp. One of c, warp. [default: 'c']
      worlds: Number of worlds that Warp steps at once. [default: 4096 on a GPU, 8 on a CPU]
      device: Warp device: cpu or cuda:N. [default: the first GPU, or cpu]
      nconmax: Maximum number of contacts per Warp world. [default: chosen by MuJoCo Warp]
      njmax: Maximum number of constraints per Warp world. [default: chosen by MuJoCo Warp]
      key: Keyframe to start from, by name or index. [default: test, if it exists]
      steps: Number of steps per rollout. [default: 10000, or what the budget allows]
      noise_std: Standard deviation of noise on the controls, as a share of half their range; 0 keeps
        the initial controls. [default: 0.01]
      noise_rate: Time constant [s] of the control noise around the keyframe's controls, or the middle
        of their ranges. [default: 0.1]
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      render: Also time rendering and encoding.
      size: Width and height of a view [pixels]. [default: 1280x720]
      camera: Camera, as for mjrun video. [default: free]
      view: Kind of image: colour, depth or segmentation. [default: rgb]
      quality: Rendering quality, as for mjrun video. [default: model]
      renderer: Renderer, as for mjrun video. [default: classic]
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      save: Save the result as a baseline.
      compare: Compare with a saved baseline.
      fail_above: Exit with code 1 if the result is certainly more than this much slower than the
        baseline, such as 10%, or if the simulation became unstable. A slowdown whose confidence
        interval contains the limit is inconclusive.
      force: Compare even if the model, the options or the machine differ.
    """
    def __init__(
        self,
        model: MjModel | ModelSource | str | PathLike[str],
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
    """A check of models and tasks for errors, and for likely causes of later errors.

    Args:
      models: files, including task documents, and folders, which represent all models in them.

    Raises:
      UsageError: a code, severity or number is invalid.

    Options:
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      select: Report only findings with these codes: MJ301, or MJ3 for all codes that begin with it.
      ignore: Do not report findings with these codes. Errors that prevent a model from loading are
        always reported.
      ignore_in: Do not report findings with these codes in files whose path matches a pattern; * also
        matches slashes.
      severity: Severity of findings with this code, or codes that begin with it: error, warning or
        note.
      threshold: Value beyond which a rule reports something: penetration=0.005. The explanation of a
        rule lists them.
      fail_on: Exit with code 1 if a finding has at least this severity. One of error, warning, note.
        [default: 'error']
      baseline: Report only findings that are not in this file of known findings; their lines and
        numbers may change. [default: none]
      update_baseline: Create or replace the baseline with the present findings.
      changed_since: Check only models of which a file, an include or an asset is changed or new in git
        since the branch began at REF. [default: all models]
      fix: Fix what is certain, in the text of the models, and report what is left. A model must load
        after that, and change only where it was at fault.
      unsafe_fixes: Include fixes that need a look, because they change how a model moves; with fix.
      dry_run: Only count what fix would change, and exit with code 1 if anything.
      skip_other: Skip XML files that are neither MJCF nor URDF, which folders may contain, instead of
        reporting them.
      steps: Number of steps to simulate from the initial state, to find out whether the model becomes
        unstable; 0 skips this check. [default: 200]
      timeout: Maximum wall time per model [s]. [default: 60]
      memory: Maximum memory per model [MiB]. [default: 4096]
      jobs: Number of models to check at once. [default: auto, one per core]
      cache: Reuse earlier results of models whose files, and the settings that affect them, have not
        changed. [default: True]
    """
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
    """A command to the policy.

    Raises:
      UsageError: it has no source of values or several, or an option that does not apply to its source.

    Options:
      constant: Constant values.
      table: Table with a column time [s] and one column per value.
      interpolation: Interpolation between the rows of the table. One of hold, linear. [default: 'hold']
      schedule: Values that change at given times [s]: [[0, [1, 0]], [2, [0, 1]]].
      random: Distribution of each value, or one for all: uniform(-1, 1).
      size: Number of random values. [default: one per distribution]
      every: Time after which new random values are drawn [s], a whole number of control periods.
        [default: once per episode]
    """
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

class Dataset(_Dataset):
    """Labelled images of `simulation` with the values of each point. Its options are keywords.

    Args:
      command: command line, for the manifest.

    Options:
      output: Folder for the dataset; running again with the same folder continues it.
      format: Formats: folder writes images, depths, masks and a JSON record for each image; coco writes
        annotations/instances_SPLIT.json; yolo writes labels of boxes, masks or keypoints, and
        data.yaml; nerfstudio writes transforms.json; bop writes scenes of 6D object poses. [default:
        ('folder',)]
      split: Parts of the dataset and their shares. Points keep their part when samples are added.
        [default: train=0.8,val=0.2]
      polygons: Write masks in COCO as polygons, which cannot have holes, instead of run lengths, which
        are exact.
      yolo_task: Labels of YOLO: boxes, polygons of masks, or keypoints. One of detect, segment, pose.
        [default: 'detect']
      size: Width and height of an image [pixels]. [default: (640, 480)]
      camera: Cameras and rigs, as for mjrun video, but no camera scripts. The settings of a rig can
        vary: vary 'camera.azimuth=uniform(0,360)', camera.distance, camera.lookat, camera.fovy, …
        [default: ('auto',)]
      times: Simulated times of the images of each point [s]. [default: (Fraction(0, 1),)]
      objects: Bodies, each with everything attached to it, and flexes to label, by name or wildcard,
        and their category: 'mug*=mug,robot'. [default: all bodies and flexes in the world, each a
        category]
      keypoints: Sites to label as keypoints of the object that they belong to, by name or wildcard.
      accept: Include only images for which this condition holds: visible/mug > 0.3 and pixels/mug >
        200. The values are pixels/OBJECT, visible/OBJECT and truncated/OBJECT (shares of its
        silhouette), and objects, the number of objects in view.
      stage: Surroundings to add: a floor that nothing collides with, light, sky, or none; auto adds the
        light and the sky that a model lacks. [default: ('auto',)]
      geoms: Geoms to show of bodies that have some for looks and others for collisions. One of visual,
        collision, both. [default: visual where both have about the same place]
      quality: Rendering quality: draft omits shadows, reflections and multisampling; model uses the
        model's settings; high adds supersampling. One of draft, model, high. [default: 'model']
      renderer: Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one,
        which requires Vulkan. One of classic, filament. [default: 'classic']
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      vary: Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1,
        opt.timestep=log:1e-4..1e-2:5, seed=1..40:40, qpos/hip=-1..1:21,
        scale:body/torso.mass=uniform(.8,1.2). Accepts any path of set; each:PATH, which varies all
        objects that match a wildcard separately; or an option of the simulation, such as
        controller=a.py:act,b.py:act.
      points: Table of points: one column per parameter, one row per point.
      design: How lists of values combine: grid makes all combinations, zip pairs them in order. One of
        grid, zip. [default: 'grid']
      samples: Number of points to draw from distributions such as uniform(0,1); of saltelli and morris,
        the number of groups of points. [default: 64]
      sampler: Sampling method: sobol, a scrambled Sobol sequence, which keeps its points when samples
        are added; halton, a scrambled Halton sequence, which keeps its points, too, for any number of
        samples; lhs, a Latin hypercube; random, independent random numbers; saltelli, N samples of
        parameters + 2 points each, for Sobol' indices of the metrics; morris, N trajectories of
        parameters + 1 points each, for the elementary effects on the metrics. One of sobol, halton,
        lhs, random, saltelli, morris. [default: 'sobol']
      correlate: Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its
        distribution.
      repeats: Number of simulations per point, each with the next seed; the table of means,
        repeats.csv, has confidence intervals. [default: 1]
      when: Condition on other parameters under which a parameter exists: kd=kp > 0,
        iterations=integrator == 'rk4'. Elsewhere the model keeps its own value, the cell is empty, and
        equal points are one.
      where: Include only points for which this condition holds: mass < 10, integrator != 'rk4'.
      jobs: Number of processes on this machine; on Slurm, largest number of jobs that run or wait, by
        default 1000, and as many as the cluster accepts. [default: 'auto']
      engine: Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision),
        dask, dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns
        a concurrent.futures.Executor. [default: 'local']
      slurm: Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos,
        constraint, and array=N, the largest number of jobs that run at once. Requires engine slurm.
        [default: time=5min, and what the cluster sets]
      chunk: Number of points or episodes per task of the engine. [default: a few seconds' worth]
      time_limit: Maximum wall time per point or episode [s]. [default: none]
      time_budget: Start no more points or episodes after this wall time [s], as in 2h or 50min; those
        that are running finish. Exits with code 8 if some are left; the same command continues.
        [default: none]
      max_failures: Start no more points or episodes once N of them have failed in this run; the same
        command continues. Exits with code 8. [default: none]
      retry_failed: Simulate again the points or episodes that failed before.
    """
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        jobs: int | Literal["auto"] = ...,
        engine: str = ...,
        slurm: str | Sequence[str] = ...,
        chunk: int | None = ...,
        time_limit: float | str | Fraction | None = ...,
        time_budget: float | str | Fraction | None = ...,
        max_failures: int | None = ...,
        retry_failed: bool = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        points: str | PathLike[str] | None = ...,
        design: Literal["grid", "zip"] = ...,
        samples: int = ...,
        sampler: Literal["sobol", "halton", "lhs", "random", "saltelli", "morris"] = ...,
        correlate: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        repeats: int = ...,
        when: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        where: str | Sequence[str] = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        quality: Literal["draft", "model", "high"] = ...,
        renderer: Literal["classic", "filament"] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        times: float | str | Fraction | Sequence[float | str | Fraction] = ...,
        objects: str | Sequence[str] = ...,
        keypoints: str | Sequence[str] = ...,
        accept: str | Sequence[str] = ...,
        stage: Literal["auto", "none", "floor", "light", "sky"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky"]] = ...,
        geoms: Literal["visual", "collision", "both"] | None = ...,
        format: Literal["folder", "coco", "yolo", "nerfstudio", "bop"]
        | Sequence[Literal["folder", "coco", "yolo", "nerfstudio", "bop"]] = ...,
        split: str | tuple[tuple[str, Fraction], ...] = ...,
        polygons: bool = ...,
        yolo_task: Literal["detect", "segment", "pose"] = ...,
        command: str = ...,
    ) -> None: ...

class Diff(_Diff):
    """A comparison of two tables, recordings, videos, images or models: its options are keywords.

    Args:
      a, b: the inputs, both of the same kind, which is detected from the files; a model may be compiled.
      command: the command line, for the page.

    Options:
      columns: Compare only these columns, by name or wildcard, such as 'qpos/*'. [default: all]
      align: How rows are paired: time pairs rows with equal times, row pairs rows with equal numbers,
        and column names pair rows with equal values in those columns, in any order. Points of studies
        are paired by their parameters, and episodes by their seeds. [default: time, if both have it]
      common: Compare only rows and columns that exist on both sides; the others are counted, but not
        treated as differences.
      model: Model of the two recordings, so that the report can name joints.
      atol: Absolute tolerance: numbers and pixels count as equal if |a - b| <= ATOL + RTOL·|b|. If both
        tolerances are 0, they must be identical bit for bit; NaN equals NaN.
      rtol: Relative tolerance.
      tol: Tolerances for single columns, by name or wildcard: 'qvel/*=1e-6', 'energy/*=0,1e-9'. If
        several match, the last one applies. The tolerance of the column time determines which times
        count as equal.
      min_psnr: Lowest peak signal-to-noise ratio at which frames count as equal [dB]; 40 is visually
        identical. [default: exact]
      min_ssim: Lowest structural similarity (SSIM) at which frames count as equal; 0.98 is visually
        identical. Requires the extra diff. [default: exact]
      max_changed: Largest share of changed pixels at which frames count as equal, such as 0.1%.
        [default: exact]
      output: Image (.png) of the most different frame: A, B and their difference side by side.
      html: Page about the result (.html): plots, images, videos, descriptions of columns, assertions
        and manifests.
      embed_up_to: Embed images and videos up to this size in the page; larger ones are linked.
        [default: 10.0]
    """
    def __init__(
        self,
        a: MjModel | ModelSource | str | PathLike[str],
        b: MjModel | ModelSource | str | PathLike[str],
        *,
        html: str | PathLike[str] | None = ...,
        embed_up_to: float = ...,
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
        command: str = ...,
    ) -> None: ...

class EpisodeDataset(_EpisodeDataset):
    """Episodes of `simulation`: of its policy or its random numbers, each with another seed, or of its recording.

    If its model is a file of demonstrations, these are the episodes.

    Its options are keywords.

    Args:
      command: command line, for the manifest.

    Options:
      output: Folder for the dataset; running again with the same folder continues it.
      format: Format: lerobot, LeRobot v3 with a video for each camera; or minari, for offline
        reinforcement learning, without images. One of lerobot, minari. [default: 'lerobot']
      fps: Rows and images per simulated second [Hz]. With a policy, the number of actions per second,
        or that divided by a whole number. [default: one row for each action of a policy or a
        demonstration, otherwise 30]
      probe: Values to observe, as in a trace: qpos, sensor/imu, xpos[hand], … [default: what the policy
        observes, otherwise qpos and qvel]
      camera: Camera of the images, as in a video; each use adds a camera. [default: none: a dataset
        without images]
      size: Width and height of an image [pixels]. [default: (640, 480)]
      episodes: Number of episodes, with consecutive seeds from seed on, as in mjrun eval; or of
        demonstrations. [default: 10 of a policy, all in a file of demonstrations, otherwise 1]
      instruction: The task in words, which language-conditioned policies are trained with: 'put the
        cube into the box'. [default: that of each demonstration, otherwise the name of the task]
      codec: Video codec of the images: h264 plays everywhere; h265 and av1 give smaller files. Every
        second frame is a keyframe, so that readers find any frame fast. One of h264, h265, av1.
        [default: 'h264']
      crf: Constant rate factor of the encoder: lower values give better quality and larger files.
        [default: 18; 20 with h265, 26 with av1]
      preset: Encoder preset, a trade-off between encoding speed and compression. [default: veryfast; 8
        with av1]
      stage: Surroundings to add to the image: a floor that nothing collides with, light, sky, a camera
        that frames the model closely, or none; auto adds what a model without a floor and a sky lacks.
        [default: ('auto',)]
      geoms: Geoms to show of bodies that have some for looks and others for collisions. One of visual,
        collision, both. [default: visual where both have about the same place]
      show: Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent,
        joint, …
      hide: Visual flags to switch off: shadow, skybox, texture, …
      geomgroup: Groups of geoms to show: 0,1,2, all or none.
      sitegroup: Groups of sites to show.
      jointgroup: Groups of joints to show.
      tendongroup: Groups of tendons to show.
      actuatorgroup: Groups of actuators to show.
      flexgroup: Groups of flexes to show.
      skingroup: Groups of skins to show.
      frame_axes: Objects whose axes are shown: body, geom, site, camera, light, contact or world.
        [default: 'none']
      label: Objects whose names are shown: body, joint, geom, site, camera, tendon, actuator, …
        [default: 'none']
      trail: Bodies, geoms or sites whose paths are drawn, wider and in warmer colours where the speed
        is higher.
      trail_span: Duration of the motion that a trail shows [s]. [default: all]
      ghost: Translucent copy of the model, without flexes and skins: offset=0/1/0, opacity=.3. It shows
        the pose of a keyframe, key=NAME; the motion of a recording, recording=FILE; or that of a table
        of positions, trace=FILE, with map=FILE or map.
      quality: Rendering quality: draft omits shadows, reflections and multisampling; model uses the
        model's settings; high adds supersampling. One of draft, model, high. [default: 'model']
      renderer: Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one,
        which requires Vulkan. One of classic, filament. [default: 'classic']
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      jobs: Number of processes on this machine; on Slurm, largest number of jobs that run or wait, by
        default 1000, and as many as the cluster accepts. [default: 'auto']
      engine: Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision),
        dask, dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns
        a concurrent.futures.Executor. [default: 'local']
      slurm: Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos,
        constraint, and array=N, the largest number of jobs that run at once. Requires engine slurm.
        [default: time=5min, and what the cluster sets]
      chunk: Number of points or episodes per task of the engine. [default: a few seconds' worth]
      time_limit: Maximum wall time per point or episode [s]. [default: none]
      time_budget: Start no more points or episodes after this wall time [s], as in 2h or 50min; those
        that are running finish. Exits with code 8 if some are left; the same command continues.
        [default: none]
      max_failures: Start no more points or episodes once N of them have failed in this run; the same
        command continues. Exits with code 8. [default: none]
      retry_failed: Simulate again the points or episodes that failed before.
    """
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        jobs: int | Literal["auto"] = ...,
        engine: str = ...,
        slurm: str | Sequence[str] = ...,
        chunk: int | None = ...,
        time_limit: float | str | Fraction | None = ...,
        time_budget: float | str | Fraction | None = ...,
        max_failures: int | None = ...,
        retry_failed: bool = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        quality: Literal["draft", "model", "high"] = ...,
        renderer: Literal["classic", "filament"] = ...,
        trail: str | Sequence[str] = ...,
        trail_span: float | str | Fraction | None = ...,
        ghost: str | Sequence[str] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        stage: Literal["auto", "none", "floor", "light", "sky", "camera"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky", "camera"]] = ...,
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
        episodes: int | None = ...,
        instruction: str | None = ...,
        codec: Literal["h264", "h265", "av1"] = ...,
        crf: int | None = ...,
        preset: str | int | None = ...,
        format: Literal["lerobot", "minari"] = ...,
        fps: float | str | Fraction | None = ...,
        probe: str | Sequence[str] = ...,
        command: str = ...,
    ) -> None: ...

class Evaluation(_Evaluation):
    """Seeded episodes of `task` under a policy. Its options are keywords.

    Args:
      command: command line, for the manifest.
      rewritten: function that creates the task with other values of its document, if something there varies.

    Options:
      output: Folder for the results; running again with the same folder continues an interrupted
        evaluation.
      episodes: Number of episodes for each policy and each point of a study. [default: 100]
      seed: Seed of the first episode; each later episode uses the next seed.
      compare: Second policy, evaluated on the same episodes; the report gives paired differences with
        confidence intervals.
      compare_normalize: Normalization statistics for the observations of the second policy.
      metric: Additional number per episode, computed from a trace with one row per control period:
        effort=mean(abs(ctrl/motor)), 'pace [km/h]=3.6*mean(speed/torso)'.
      require: Exit with code 1 unless this condition holds for the table of episodes: share(success) >
        0.9, quantile(return, 0.05) > 100.
      fail_below: Exit with code 1 if a value is below its threshold: the success rate, success=90%; the
        mean return, return=200; its interquartile mean, return_iqm=200; the mean of a metric; or the
        lower end of a confidence interval, success_low=0.8.
      videos: Number of episodes to record as videos, evenly spaced by return: 3 gives the worst, median
        and best; worst:3, those with the three lowest returns; failures, all episodes that end in a
        failure.
      camera: Camera of the videos: a camera of the model, or a rig. [default: ('auto',)]
      size: Width and height of the videos [pixels]. [default: (640, 360)]
      quality: Rendering quality of the videos. One of draft, model, high. [default: 'model']
      fps: Frames per second of the videos [Hz]. [default: 30]
      speed: Simulated seconds per second of video. [default: 1]
      html: Page about the result (.html): plots, images, videos, descriptions of columns, assertions
        and manifests.
      embed_up_to: Embed images and videos up to this size in the page; larger ones are linked.
        [default: 10.0]
      export_to: Also write the results as runs of MLflow, one for each point with its parameters and
        metrics, to this folder (mlruns), which is replaced as a whole.
      vary: Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1,
        opt.timestep=log:1e-4..1e-2:5, seed=1..40:40, qpos/hip=-1..1:21,
        scale:body/torso.mass=uniform(.8,1.2). Accepts any path of set; each:PATH, which varies all
        objects that match a wildcard separately; or an option of the simulation, such as
        controller=a.py:act,b.py:act.
      points: Table of points: one column per parameter, one row per point.
      design: How lists of values combine: grid makes all combinations, zip pairs them in order. One of
        grid, zip. [default: 'grid']
      samples: Number of points to draw from distributions such as uniform(0,1); of saltelli and morris,
        the number of groups of points. [default: 64]
      sampler: Sampling method: sobol, a scrambled Sobol sequence, which keeps its points when samples
        are added; halton, a scrambled Halton sequence, which keeps its points, too, for any number of
        samples; lhs, a Latin hypercube; random, independent random numbers; saltelli, N samples of
        parameters + 2 points each, for Sobol' indices of the metrics; morris, N trajectories of
        parameters + 1 points each, for the elementary effects on the metrics. One of sobol, halton,
        lhs, random, saltelli, morris. [default: 'sobol']
      correlate: Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its
        distribution.
      repeats: Number of simulations per point, each with the next seed; the table of means,
        repeats.csv, has confidence intervals. [default: 1]
      when: Condition on other parameters under which a parameter exists: kd=kp > 0,
        iterations=integrator == 'rk4'. Elsewhere the model keeps its own value, the cell is empty, and
        equal points are one.
      where: Include only points for which this condition holds: mass < 10, integrator != 'rk4'.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      confidence: Confidence level of all intervals. [default: 0.95]
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      jobs: Number of processes on this machine; on Slurm, largest number of jobs that run or wait, by
        default 1000, and as many as the cluster accepts. [default: 'auto']
      engine: Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision),
        dask, dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns
        a concurrent.futures.Executor. [default: 'local']
      slurm: Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos,
        constraint, and array=N, the largest number of jobs that run at once. Requires engine slurm.
        [default: time=5min, and what the cluster sets]
      chunk: Number of points or episodes per task of the engine. [default: a few seconds' worth]
      time_limit: Maximum wall time per point or episode [s]. [default: none]
      time_budget: Start no more points or episodes after this wall time [s], as in 2h or 50min; those
        that are running finish. Exits with code 8 if some are left; the same command continues.
        [default: none]
      max_failures: Start no more points or episodes once N of them have failed in this run; the same
        command continues. Exits with code 8. [default: none]
      retry_failed: Simulate again the points or episodes that failed before.
    """
    def __init__(
        self,
        task: ModelSource,
        output: str | PathLike[str],
        *,
        jobs: int | Literal["auto"] = ...,
        engine: str = ...,
        slurm: str | Sequence[str] = ...,
        chunk: int | None = ...,
        time_limit: float | str | Fraction | None = ...,
        time_budget: float | str | Fraction | None = ...,
        max_failures: int | None = ...,
        retry_failed: bool = ...,
        integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
        timestep: float | str | Fraction | None = ...,
        ground: float | None = ...,
        set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        trust: bool = ...,
        policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        normalize: str | PathLike[str] | None = ...,
        confidence: float = ...,
        ctrl_noise: float | None = ...,
        ctrl_noise_time: float | None = ...,
        push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        points: str | PathLike[str] | None = ...,
        design: Literal["grid", "zip"] = ...,
        samples: int = ...,
        sampler: Literal["sobol", "halton", "lhs", "random", "saltelli", "morris"] = ...,
        correlate: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        repeats: int = ...,
        when: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        where: str | Sequence[str] = ...,
        export_to: str | PathLike[str] | None = ...,
        html: str | PathLike[str] | None = ...,
        embed_up_to: float = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        size: Sequence[int] = ...,
        quality: Literal["draft", "model", "high"] = ...,
        fps: float | str | Fraction = ...,
        speed: float | str | Fraction = ...,
        videos: int | str = ...,
        episodes: int = ...,
        seed: int = ...,
        compare: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        compare_normalize: str | PathLike[str] | None = ...,
        metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        require: str | Sequence[str] = ...,
        fail_below: Mapping[str, float | Sequence[float]] = ...,
        command: str = ...,
        rewritten: Callable[[Mapping[str, str]], ModelSource] | None = ...,
    ) -> None: ...

class Export(_Export):
    """An export of a simulation: its options are keywords.

    Options:
      output: .glb (binary glTF with scene and motion), .html (a page that replays the simulation in 3D,
        without network), .mcap (log for Foxglove, Rerun and PlotJuggler), .usdc (OpenUSD with scene and
        motion, as binary, text or package). With a format of folders: the folder, which a second run
        continues.
      format: Format of the file, or of a folder: lerobot (LeRobot dataset v3 of episodes, for imitation
        learning), minari (Minari dataset of episodes, for offline reinforcement learning). [default:
        the output's suffix]
      fps: Frames per second of the export [Hz], such as 60 or 30000/1001; in episodes of a policy, its
        actions per second divided by a whole number. [default: 30; in episodes of a policy, its actions
        per second]
      speed: Simulated seconds per second of playback; 0.25 is slow motion. [default: 1]
      keep_partial: If the simulation becomes unstable, keep the frames from before.
      plot: Curves of measured values beside the scene, in formats that show curves: energy,
        qpos[left_*]. Each use adds a plot.
      mark_event: Mark the instants at which a condition becomes true, in formats with a time line:
        landed=contact(foot, floor) > 0.
      assert_: Exit with code 1 unless this condition holds at every step, and mark where it fails, in
        formats with a time line: max(abs(energy/drift)) < 1e-3.
      probe: Values to export with the scene, in formats that hold measured values, or to observe in
        episodes: qpos, energy, xpos[hand], … as in a trace. [default: those of a trace; in episodes,
        what the policy observes]
      rate: Rows of measured values per simulated second [Hz], at most one per step. [default: one row
        per frame]
      jobs: Number of processes that render images, in formats that hold them, or that play episodes.
        [default: 'auto']
      images: Encoding of the images of cameras, in MCAP: a video in H.264, or separate images. One of
        h264, jpeg, png. [default: h264]
      camera: Camera to add to those of the model: one of auto, free, orbit, track, look with settings
        after a colon: auto:azimuth=90 free:azimuth=90,elevation=-20
        orbit:lookat=box,azimuth=140..240,ease=cosine track:box,distance=.5 look:from=0/-2/1,at=box; or
        a camera script, camera.yaml, with a sequence of shots. In formats with images: a camera of the
        images, which may be one of the model. [default: free in glb]
      size: Width and height of images [pixels]; their ratio is that of cameras. [default: 1280x720;
        640x480 in episodes]
      stage: Surroundings to add to the image: a floor that nothing collides with, light, sky, a camera
        that frames the model closely, or none; auto adds what a model without a floor and a sky lacks.
        [default: ('auto',)]
      geoms: Geoms to show of bodies that have some for looks and others for collisions. One of visual,
        collision, both. [default: visual where both have about the same place]
      show: Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent,
        joint, …
      hide: Visual flags to switch off: shadow, skybox, texture, …
      geomgroup: Groups of geoms to show: 0,1,2, all or none.
      sitegroup: Groups of sites to show.
      jointgroup: Groups of joints to show.
      tendongroup: Groups of tendons to show.
      actuatorgroup: Groups of actuators to show.
      flexgroup: Groups of flexes to show.
      skingroup: Groups of skins to show.
      frame_axes: Objects whose axes are shown: body, geom, site, camera, light, contact or world.
        [default: 'none']
      label: Objects whose names are shown: body, joint, geom, site, camera, tendon, actuator, …
        [default: 'none']
      trail: Bodies, geoms or sites whose paths are drawn, wider and in warmer colours where the speed
        is higher.
      trail_span: Duration of the motion that a trail shows [s]. [default: all]
      ghost: Translucent copy of the model, without flexes and skins: offset=0/1/0, opacity=.3. It shows
        the pose of a keyframe, key=NAME; the motion of a recording, recording=FILE; or that of a table
        of positions, trace=FILE, with map=FILE or map.
      quality: Rendering quality: draft omits shadows, reflections and multisampling; model uses the
        model's settings; high adds supersampling. One of draft, model, high. [default: 'model']
      renderer: Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one,
        which requires Vulkan. One of classic, filament. [default: 'classic']
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
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
        trail: str | Sequence[str] = ...,
        trail_span: float | str | Fraction | None = ...,
        ghost: str | Sequence[str] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        stage: Literal["auto", "none", "floor", "light", "sky", "camera"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky", "camera"]] = ...,
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
        format: str | None = ...,
        fps: float | str | Fraction = ...,
        speed: float | str | Fraction = ...,
        keep_partial: bool = ...,
        plot: str | Sequence[str] = ...,
        mark_event: str | Sequence[str] = ...,
        assert_: str | Sequence[str] = ...,
        probe: str | Sequence[str] = ...,
        rate: float | str | Fraction | None = ...,
        jobs: int | Literal["auto"] = ...,
        images: Literal["h264", "jpeg", "png"] | None = ...,
    ) -> None: ...

class Fit(_Fit):
    """A fit of parameters of the model of `simulation` to measurements. Its options are keywords.

    Args:
      simulation: the model, with settings for everything that no log contains; its seed is that of the fit.

    Options:
      data: Tables of measurements, with columns such as time, qpos/knee and ctrl/motor.
      free: Parameter to estimate and its bounds: joint/hinge.damping=0.001..1, or log:1e-4..1 if its
        order of magnitude is unknown. Accepts any path of set, with scale: or wildcards to tie several
        values together; actuator/NAME.kp and .kv of position servos; delay:ctrl/* or delay:qpos/knee
        [s]; inertia:BODY.mass [kg], .center (of mass) [m] and .shape (factors for the spread of mass).
        Append ~normal(MEAN, STD) to add a prior.
      output: Fitted model (.xml): the original text with only the fitted attributes changed.
      comparison: Table of the measurements and of the predictions of the model before (/nominal) and
        after the fit (/fitted), for mjrun plot.
      ranges: Distributions of the fitted parameters (.yaml), for the key vary in documents of mjrun
        sweep.
      html: Self-contained page (.html) about the fit: parameters with confidence intervals, errors,
        correlations, and plots of the measurements with the model before and after the fit.
      video: Video of the fitted model with the measured motion as a ghost: mp4, mov, mkv, webm, gif,
        apng, webp.
      camera: Camera of the video: a camera of the model, or a rig. [default: ('auto',)]
      size: Width and height of the video [pixels]. [default: (640, 360)]
      noise: Standard deviation of the measurement noise of a signal, in its unit; accepts wildcards. By
        default, it is estimated from the high frequencies of the data.
      holdout: Share of each table, at its end, that is not used for the fit, but predicted to test
        whether the fit is an improvement. [default: 0.2]
      holdout_data: Table that is not used for the fit but only predicted, instead of the last part of
        each table.
      starts: Number of starting points: first the values of the model, then values spread evenly over
        the bounds, which are used if the fit does not reach the noise level. [default: 3]
      confidence: Confidence level of the intervals: the share of repeated fits whose intervals contain
        the true value. [default: 0.95]
      loss: Loss function of the residuals. All but linear are robust: they reduce the weight of
        outliers and estimate noise and errors by medians. One of linear, soft_l1, huber, cauchy.
        [default: 'linear']
      allow_unidentifiable: Continue even if the measurements do not determine some parameters or
        combinations of them.
      keep_partial: If the fit is interrupted, write the model with the best parameters so far and
        report them; by default nothing is written.
      excite: Instead of fitting, write a table of controls that excite the parameters: chirps of 0.1 to
        10 Hz within the ranges of controls, joints and forces. ctrl_from applies the table; duration
        sets its length.
      excite_noise: Expected standard deviation of the measured positions [rad, m], from which excite
        predicts confidence intervals. [default: 0.001]
      velocity_limit: Maximum joint velocity under excite [rad/s, m/s].
    """
    def __init__(
        self,
        simulation: _Simulation,
        *,
        data: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
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
    ) -> None: ...

class Image(_Image):
    """An image of one instant of a simulation: its options are keywords.

    The duration of the simulation matters only if the output waits for an event. Depth and segmentation are stored as
    numbers if the file format can hold them and the image shows nothing else.

    Options:
      output: png, jpg, webp, tiff; depth as png, npy, exr, tiff; segmentation as png, npy, json (COCO);
        or - for standard output.
      time: Time of the image [s]; documents also accept an event. [default: 0]
      step: Time of the image, as a step number.
      format: File format; palette stores a segmentation as colours. [default: the output's suffix; png
        in a pipe]
      legend: List the objects of a coloured segmentation beside it. [default: True]
      pointcloud: Point cloud (.ply) of all visible surfaces, with colours, in world coordinates [m];
        view seg adds labels.
      size: Width and height of one view [pixels]. [default: (1280, 720)]
      camera: Camera of the model, by name or index; or one of auto, free, orbit, track, look with
        settings after a colon: auto:azimuth=90 free:azimuth=90,elevation=-20
        orbit:lookat=box,azimuth=140..240,ease=cosine track:box,distance=.5 look:from=0/-2/1,at=box; or
        a camera script, camera.yaml, with a sequence of shots. [default: ('auto',)]
      stage: Surroundings to add to the image: a floor that nothing collides with, light, sky, a camera
        that frames the model closely, or none; auto adds what a model without a floor and a sky lacks.
        [default: ('auto',)]
      geoms: Geoms to show of bodies that have some for looks and others for collisions. One of visual,
        collision, both. [default: visual where both have about the same place]
      show: Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent,
        joint, …
      hide: Visual flags to switch off: shadow, skybox, texture, …
      geomgroup: Groups of geoms to show: 0,1,2, all or none.
      sitegroup: Groups of sites to show.
      jointgroup: Groups of joints to show.
      tendongroup: Groups of tendons to show.
      actuatorgroup: Groups of actuators to show.
      flexgroup: Groups of flexes to show.
      skingroup: Groups of skins to show.
      frame_axes: Objects whose axes are shown: body, geom, site, camera, light, contact or world.
        [default: 'none']
      label: Objects whose names are shown: body, joint, geom, site, camera, tendon, actuator, …
        [default: 'none']
      trail: Bodies, geoms or sites whose paths are drawn, wider and in warmer colours where the speed
        is higher.
      trail_span: Duration of the motion that a trail shows [s]. [default: all]
      ghost: Translucent copy of the model, without flexes and skins: offset=0/1/0, opacity=.3. It shows
        the pose of a keyframe, key=NAME; the motion of a recording, recording=FILE; or that of a table
        of positions, trace=FILE, with map=FILE or map.
      quality: Rendering quality: draft omits shadows, reflections and multisampling; model uses the
        model's settings; high adds supersampling. One of draft, model, high. [default: 'model']
      renderer: Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one,
        which requires Vulkan. One of classic, filament. [default: 'classic']
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      view: Kind of image: colour, depth [m] or segmentation. [default: ('rgb',)]
      layout: Arrangement of several views in one frame. One of row, column, grid. [default: 'row']
      separate: Write each view to a separate file, named NAME-CAMERA-VIEW.
      captions: Label each view with its camera and its kind.
      style: Pixel values of depth and segmentation: color writes colours for viewing; exact writes
        16-bit millimetres or ids. One of color, exact. [default: chosen by the file format]
      depth_range: Depths [m] shown in the first and the last colour. [default: the visible range]
      seg_by: Objects that a segmentation distinguishes: object, geom, site, …, body or root-body.
        [default: 'object']
      text: Text on the frame, with values in braces: '{time:.2f} s', '{speed}x', or any column of a
        trace as in '{qpos/knee:.1f}'.
      text_corner: Position of the text. One of top-left, top, top-right, bottom-left, bottom,
        bottom-right. [default: top-left; bottom-right with captions]
      calibration: File for the calibration of each frame: K, world from camera, near and far [m] and
        time [s], in OpenCV axes.
      calibration_format: Format of the calibration file. One of mjrun, nerfstudio, bop, ros. [default:
        'mjrun']
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
        layout: Literal["row", "column", "grid"] = ...,
        separate: bool = ...,
        captions: bool = ...,
        style: Literal["color", "exact"] | None = ...,
        depth_range: Sequence[float] | None = ...,
        seg_by: str = ...,
        text: str | None = ...,
        text_corner: Literal["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"] | None = ...,
        calibration: str | PathLike[str] | None = ...,
        calibration_format: Literal["mjrun", "nerfstudio", "bop", "ros"] = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        quality: Literal["draft", "model", "high"] = ...,
        renderer: Literal["classic", "filament"] = ...,
        trail: str | Sequence[str] = ...,
        trail_span: float | str | Fraction | None = ...,
        ghost: str | Sequence[str] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        stage: Literal["auto", "none", "floor", "light", "sky", "camera"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky", "camera"]] = ...,
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
        time: float | str | Fraction | ConditionEvent | None = ...,
        step: int | None = ...,
        format: str | None = ...,
        legend: bool = ...,
        pointcloud: str | PathLike[str] | None = ...,
    ) -> None: ...

class Keyframe(_Keyframe):
    """A keyframe with an instant of a simulation, saved in the model's XML: its options are keywords.

    Options:
      output: An .xml file, which may be the model itself. Apart from the keyframe, every byte of the
        XML is unchanged.
      name: Name of the keyframe; an existing keyframe with this name is replaced. [default: 'end']
      time: Time to save [s]. [default: the last instant]
      step: Time to save, as a step number.
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
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
    """A term of the observation.

    Raises:
      UsageError: it has no source or several, or an option that does not apply to its source.

    Options:
      name: Name of the term.
      probe: Columns of a trace, by name, group or wildcard, in the model's order: xpos/car,
        qvel[left_*].
      joints: Joints by name or wildcard, in this order.
      of: Quantity of the joints to observe. One of qpos, qvel. [default: 'qpos']
      action: Previous action of the policy, before any processing; zeros at the start. One of previous.
      command: Command of the task to observe.
      phase: Period [s]; the sine and the cosine of 2π t/period are observed.
      value: An expression over columns: qpos/root/z - 1.2.
      frame: Body into whose axes vectors of three components are rotated; world leaves them unchanged.
        [default: 'world']
      noise: Noise added to each number, drawn at every observation: normal(0, 0.01).
      offset: Value to subtract: one number, or one per component. [default: (0.0,)]
      scale: Factor to multiply by: one number, or one per component. [default: (1.0,)]
      clip: Lowest and highest value.
      delay: Delay of the observation, in control periods.
      history: Number of latest values to observe, oldest first. [default: 1]
    """
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
    """A plot of values measured in a simulation: its options are keywords.

    Options:
      output: The image to write: png, jpg, webp, tiff, svg, pdf.
      probe: Values to measure in a simulation and, without y, to plot: energy, qpos[left_*]. Each use
        adds a panel below the others; values with different units get separate panels. [default: the
        columns of y, or those of a trace]
      y: A panel and its curves: columns, qpos/knee; wildcards, qpos/*; or expressions over columns,
        contact_force/normal/z / 87.36. A curve may have a label and a unit: depth
        [mm]=penetration/deepest*1000. [default: a panel for each group of columns and each of its
        units]
      x: Column or expression on the x axis. [default: time]
      log: Logarithmic axes: y in all panels, or 2:y in the second panel only.
      xlim: Range of the x axis, of which the curves then show all details. [default: all values]
      ylim: Range of the y axis in all panels, -1..1, or in the second panel only, 2:-1..1. [default:
        all values]
      mark: Draw a horizontal line in all panels, m·g=87.356, or in the second panel only, 2:m·g=87.356;
        or a vertical line, x:impact=0.52.
      mark_event: Draw a vertical line wherever a condition over columns becomes true:
        landed=contact/ncon > 0.
      title: Title above all panels.
      legend_title: Title of the legend, such as the quantity that it lists.
      xlabel: Label of the x axis. [default: the column of the x axis]
      ylabel: Label of the y axis of all panels, force [N], or of the second panel only, 2:force [N];
        each panel has a title already.
      style: Colour scheme; print is meant for paper and also distinguishes lines by dash patterns. One
        of light, dark, print. [default: 'light']
      size: Width and height [pixels], or as on paper, 85mmx60mm; a pixel is 1/96 inch. [default: 1280
        to 1920 wide, and as high as the panels require]
      font_size: Size of letters [pt], for figures in papers. [default: chosen by the size]
      columns: Number of panels side by side. [default: chosen by the number of panels]
      every: Write a row every N steps. [default: 1]
      rate: Rows per simulated second [Hz], at most one per step, instead of every N steps.
      format: File format. [default: the output's suffix]
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
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
        legend_title: str | None = ...,
        xlabel: str | None = ...,
        ylabel: str | Sequence[str] = ...,
        style: Literal["light", "dark", "print"] = ...,
        size: Sequence[int] | None = ...,
        font_size: float | None = ...,
        columns: int | None = ...,
        probe: str | Sequence[str] = ...,
    ) -> None: ...

class Recording(_Recording):
    """A recording of the states of all steps of a simulation: its options are keywords.

    Options:
      output: An .npz file.
      keep_partial: If the simulation becomes unstable, keep the states from before.
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
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
    """The initial state of an episode, and its random parts.

    Options:
      key: Keyframe to start from, by name or index.
      qpos: Initial joint positions by name [m, rad]: hip, root/z, root.
      qvel: Initial joint velocities by name [m/s, rad/s].
      ctrl: Initial controls by actuator name or wildcard.
      noise: Noise added to the initial state, by column: {'qpos/*': 'uniform(-0.1, 0.1)', 'qvel/*':
        'normal(0, 0.1)'}. Quaternions are normalized afterwards.
      set: Random values that replace those of the initial state, by column: {qpos/slider: 'uniform(-1,
        1)'}.
      vary: Random values in the model for each episode: {'geom/floor.friction[0]': 'uniform(0.3, 1)'}.
    """
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
    """A term of the reward.

    Options:
      value: Expression over columns at the end of the period: exp(-norm(xpos/car/x, xpos/car/y)).
      weight: Weight of the term in the sum. [default: 1.0]
    """
    def __init__(
        self,
        *,
        value: str,
        weight: float = ...,
    ) -> None: ...

class Simulation(_Simulation):
    """A model, its state at time 0, its inputs, and its duration.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model, of which a copy is made at once.
      snapshot: copies of its input files, which are read instead.

    A controller is called with (model, data) every `control_dt`, at an instant whose fields are consistent: it writes
    `data.ctrl` or other inputs, or returns the controls `(nu,)`. If it has a method `reset`, that is called first.

    Raises:
      UsageError: a value is invalid, or values contradict each other.

    Options:
      key: Keyframe to start from, by name or index.
      qpos: Initial joint positions by name [m, rad]: hip=0.3, hip=20deg, root/z=1, root=0,0,1,1,0,0,0.
      qvel: Initial joint velocities by name [m/s, rad/s]: hip=2, hip=90deg/s, root/wx=1.
      ctrl: Constant controls by actuator name or wildcard, in the actuator's units: motor=20,
        left_*=0.5.
      ctrl_from: Table of controls over time, with a column time [s] and one for each actuator, which is
        named ctrl/ACTUATOR as in a trace, ACTUATOR or JOINT; one named hip [deg] contains degrees.
      ctrl_interpolation: Interpolation between the rows of the table of controls. One of hold, linear.
        [default: 'hold']
      replay: Recording (.npz) whose states are replayed instead of simulated, a demonstration in HDF5
        such as demo.hdf5:demo_3, or a table of joint positions over time, with columns such as
        qpos/hip: motion capture, a log, the output of another simulator.
      replay_mode: Replay mode: states plays back the recorded states; controls simulates again from the
        first state, with the recorded controls and forces. One of states, controls. [default: 'states']
      replay_rate: Rows per second of a table without a column time [Hz]. [default: from the column
        time]
      replay_interpolation: Interpolation between the rows of a replayed table and across gaps in it;
        linear interpolates quaternions along an arc. One of hold, linear. [default: 'linear']
      replay_unwrap: Unwrap hinge angles: treat a jump of more than half a turn between rows as a
        continued rotation.
      map: Column of mjrun and its value, an expression over the columns of a table that is replayed or
        that a ghost follows: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all matching
        columns 'qpos/{}={}_deg*pi/180'. @FILE reads such lines from a file.
      quat: Order of quaternion components in a replayed table whose columns number them instead of
        naming them qw … qz. One of wxyz, xyzw. [default: 'wxyz']
      perturb: Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].
      seed: Seed of all noise; with a policy, seed of the episode.
      duration: Simulated time [s]. [default: 5, or that of the recording or episode; unlimited in a
        view]
      steps: Number of steps, instead of a duration.
      until: End the simulation at the first step at which this condition on its columns holds, if that
        is before its duration: qpos/root/z < 0.3, contact(ball, floor).
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      controller: Python code that sets the controls: a function or class such as policy.py:act or
        package.module:Policy, called with (model, data). It writes data.ctrl or returns the controls; a
        class may have a method reset.
      control_dt: Time between two calls of the controller, or of a policy that has no task document
        [s]. [default: every step]
      position_control: Replace motors on joints by servos, whose controls are joint positions [rad, m],
        from the initial ones on; a model without actuators gets a servo on each joint. Gains that are
        left out follow from inertias, weights and force limits.
      assets: Folder with the meshes and textures that the model of a demonstration names by paths of
        another machine, which are looked up by their ends: DIR/robots/panda/link0.stl, or
        DIR/panda/link0.stl.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
    """
    def __init__(
        self,
        model: MjModel | ModelSource | str | PathLike[str],
        *,
        integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
        timestep: float | str | Fraction | None = ...,
        ground: float | None = ...,
        set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        position_control: str | None = ...,
        assets: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
        controller: Callable[..., object] | None = ...,
        control_dt: float | str | Fraction | None = ...,
        ctrl_noise: float | None = ...,
        ctrl_noise_time: float | None = ...,
        push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
        trust: bool = ...,
        policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
        normalize: str | PathLike[str] | None = ...,
        key: str | int | None = ...,
        qpos: Mapping[str, float | Sequence[float]] = ...,
        qvel: Mapping[str, float | Sequence[float]] = ...,
        ctrl: Mapping[str, float | Sequence[float]] = ...,
        ctrl_from: str | PathLike[str] | None = ...,
        ctrl_interpolation: Literal["hold", "linear"] = ...,
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
        until: str | None = ...,
        snapshot: InputSnapshot | None = ...,
    ) -> None: ...

class Study(_Study):
    """Many simulations: `simulation` with the values of each point. Its options are keywords.

    Args:
      command: command line, for the manifest.
      controllers: functions by the values of `controller`, where the controller varies.
      document: the study as a document, for the manifest; paths are relative to the folder of the study.
      with_csv: writes results.csv whatever the number of points.

    Options:
      output: Folder for the study, on this machine or in an object store: s3://bucket/study. Running
        again with the same folder continues the study.
      metric: Number computed from each simulation: drift=max(abs(energy/drift)), fell=first(time,
        xpos/torso/z < 0.8), 'pace [km/h]=3.6*max(speed/torso)' with a unit. Uses the same expressions
        as assert.
      every: Evaluate metrics at every N-th step. [default: 1]
      require: Exit with code 1 unless this condition holds over all points: share(failed) < 0.05.
      keep: Files to write for each kept point, in points/NUMBER in the study's folder: trace.parquet,
        recording.npz, video.mp4.
      keep_where: Keep the files of points for which this condition on parameters, metrics and statuses
        holds: unstable, drift > 1.
      keep_lowest: Keep the files of the N points with the lowest values of a metric: 4:drift.
      keep_highest: Keep the files of the N points with the highest values of a metric: 4:drift.
      contact_sheet: Video that shows the videos of all kept points side by side with their values: mp4,
        mov, mkv, webm, gif, apng, webp.
      probe: Values to measure in kept traces, in addition to the columns that the metrics read.
        [default: qpos,qvel,ctrl,act,energy,contact,sensor]
      camera: Camera of the videos: a camera of the model, or a rig. [default: ('auto',)]
      size: Width and height of the videos [pixels]. [default: (640, 360)]
      quality: Rendering quality of the videos. One of draft, model, high. [default: 'model']
      fps: Frames per second of the videos [Hz]. [default: 30]
      speed: Simulated seconds per second of video. [default: 1]
      html: Page about the result (.html): plots, images, videos, descriptions of columns, assertions
        and manifests.
      embed_up_to: Embed images and videos up to this size in the page; larger ones are linked.
        [default: 10.0]
      export_to: Also write the results as runs of MLflow, one for each point with its parameters and
        metrics, to this folder (mlruns), which is replaced as a whole.
      vary: Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1,
        opt.timestep=log:1e-4..1e-2:5, seed=1..40:40, qpos/hip=-1..1:21,
        scale:body/torso.mass=uniform(.8,1.2). Accepts any path of set; each:PATH, which varies all
        objects that match a wildcard separately; or an option of the simulation, such as
        controller=a.py:act,b.py:act.
      points: Table of points: one column per parameter, one row per point.
      design: How lists of values combine: grid makes all combinations, zip pairs them in order. One of
        grid, zip. [default: 'grid']
      samples: Number of points to draw from distributions such as uniform(0,1); of saltelli and morris,
        the number of groups of points. [default: 64]
      sampler: Sampling method: sobol, a scrambled Sobol sequence, which keeps its points when samples
        are added; halton, a scrambled Halton sequence, which keeps its points, too, for any number of
        samples; lhs, a Latin hypercube; random, independent random numbers; saltelli, N samples of
        parameters + 2 points each, for Sobol' indices of the metrics; morris, N trajectories of
        parameters + 1 points each, for the elementary effects on the metrics. One of sobol, halton,
        lhs, random, saltelli, morris. [default: 'sobol']
      correlate: Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its
        distribution.
      repeats: Number of simulations per point, each with the next seed; the table of means,
        repeats.csv, has confidence intervals. [default: 1]
      when: Condition on other parameters under which a parameter exists: kd=kp > 0,
        iterations=integrator == 'rk4'. Elsewhere the model keeps its own value, the cell is empty, and
        equal points are one.
      where: Include only points for which this condition holds: mass < 10, integrator != 'rk4'.
      confidence: Confidence level of all intervals. [default: 0.95]
      jobs: Number of processes on this machine; on Slurm, largest number of jobs that run or wait, by
        default 1000, and as many as the cluster accepts. [default: 'auto']
      engine: Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision),
        dask, dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns
        a concurrent.futures.Executor. [default: 'local']
      slurm: Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos,
        constraint, and array=N, the largest number of jobs that run at once. Requires engine slurm.
        [default: time=5min, and what the cluster sets]
      chunk: Number of points or episodes per task of the engine. [default: a few seconds' worth]
      time_limit: Maximum wall time per point or episode [s]. [default: none]
      time_budget: Start no more points or episodes after this wall time [s], as in 2h or 50min; those
        that are running finish. Exits with code 8 if some are left; the same command continues.
        [default: none]
      max_failures: Start no more points or episodes once N of them have failed in this run; the same
        command continues. Exits with code 8. [default: none]
      retry_failed: Simulate again the points or episodes that failed before.
    """
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        jobs: int | Literal["auto"] = ...,
        engine: str = ...,
        slurm: str | Sequence[str] = ...,
        chunk: int | None = ...,
        time_limit: float | str | Fraction | None = ...,
        time_budget: float | str | Fraction | None = ...,
        max_failures: int | None = ...,
        retry_failed: bool = ...,
        confidence: float = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        points: str | PathLike[str] | None = ...,
        design: Literal["grid", "zip"] = ...,
        samples: int = ...,
        sampler: Literal["sobol", "halton", "lhs", "random", "saltelli", "morris"] = ...,
        correlate: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        repeats: int = ...,
        when: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        where: str | Sequence[str] = ...,
        export_to: str | PathLike[str] | None = ...,
        html: str | PathLike[str] | None = ...,
        embed_up_to: float = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        size: Sequence[int] = ...,
        quality: Literal["draft", "model", "high"] = ...,
        fps: float | str | Fraction = ...,
        speed: float | str | Fraction = ...,
        keep: Literal["trace", "recording", "video"] | Sequence[Literal["trace", "recording", "video"]] = ...,
        keep_where: str | Sequence[str] = ...,
        keep_lowest: str | Sequence[str] = ...,
        keep_highest: str | Sequence[str] = ...,
        contact_sheet: str | PathLike[str] | None = ...,
        probe: str | Sequence[str] = ...,
        metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        every: int = ...,
        require: str | Sequence[str] = ...,
        command: str = ...,
        controllers: Mapping[str, Callable[..., object]] = ...,
        document: Mapping[str, object] | None = ...,
        with_csv: bool = ...,
    ) -> None: ...

class TablePlot(_TablePlot):
    """A plot of tables: its options are keywords.

    Args:
      command: the command line, for the page.

    Options:
      output: png, jpg, webp, tiff, svg, pdf, or - for standard output. [default: no image, with html]
      format: File format. [default: the output's suffix; png in a pipe]
      assert_: Exit with code 1 unless this condition holds for each table: max(abs(energy/drift)) <
        1e-3.
      label: Name of a table in the legend, one for each table in order. [default: the parts of the
        tables' names that differ]
      include: Also show this file on the page: an image, a video or a manifest (.json). Other files are
        linked.
      html: Page about the result (.html): plots, images, videos, descriptions of columns, assertions
        and manifests.
      embed_up_to: Embed images and videos up to this size in the page; larger ones are linked.
        [default: 10.0]
      y: A panel and its curves: columns, qpos/knee; wildcards, qpos/*; or expressions over columns,
        contact_force/normal/z / 87.36. A curve may have a label and a unit: depth
        [mm]=penetration/deepest*1000. [default: a panel for each group of columns and each of its
        units]
      x: Column or expression on the x axis. [default: time]
      log: Logarithmic axes: y in all panels, or 2:y in the second panel only.
      xlim: Range of the x axis, of which the curves then show all details. [default: all values]
      ylim: Range of the y axis in all panels, -1..1, or in the second panel only, 2:-1..1. [default:
        all values]
      mark: Draw a horizontal line in all panels, m·g=87.356, or in the second panel only, 2:m·g=87.356;
        or a vertical line, x:impact=0.52.
      mark_event: Draw a vertical line wherever a condition over columns becomes true:
        landed=contact/ncon > 0.
      title: Title above all panels.
      legend_title: Title of the legend, such as the quantity that it lists.
      xlabel: Label of the x axis. [default: the column of the x axis]
      ylabel: Label of the y axis of all panels, force [N], or of the second panel only, 2:force [N];
        each panel has a title already.
      style: Colour scheme; print is meant for paper and also distinguishes lines by dash patterns. One
        of light, dark, print. [default: 'light']
      size: Width and height [pixels], or as on paper, 85mmx60mm; a pixel is 1/96 inch. [default: 1280
        to 1920 wide, and as high as the panels require]
      font_size: Size of letters [pt], for figures in papers. [default: chosen by the size]
      columns: Number of panels side by side. [default: chosen by the number of panels]
    """
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
        legend_title: str | None = ...,
        xlabel: str | None = ...,
        ylabel: str | Sequence[str] = ...,
        style: Literal["light", "dark", "print"] = ...,
        size: Sequence[int] | None = ...,
        font_size: float | None = ...,
        columns: int | None = ...,
        html: str | PathLike[str] | None = ...,
        embed_up_to: float = ...,
        format: str | None = ...,
        assert_: str | Sequence[str] = ...,
        label: str | Sequence[str] = ...,
        include: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
        command: str = ...,
    ) -> None: ...

class Termination(_Termination):
    """A condition that ends an episode.

    Options:
      when: Condition on columns, evaluated after each period but not at the start: qpos/root/z < 0.8.
      as_: Outcome of an episode that ends this way. One of success, failure, timeout.
    """
    def __init__(
        self,
        *,
        when: str,
        as_: Literal["success", "failure", "timeout"],
    ) -> None: ...

class Trace(_Trace):
    """A trace of a simulation, a table of measured values: its options are keywords.

    Args:
      written: whether the table is written; one that is only compared with a golden table need not be.
      rows_to: a function called with the columns, which returns one to call with each block of rows, `(n, columns)`.

    Options:
      output: csv, feather, h5, jsonl, mat, npz, parquet, or - for standard output. [default: '-']
      probe: Values to measure: qpos, qvel, qacc, ctrl, act, energy, sensor, contact, xpos, speed,
        momentum, … or any field of MjData; values of some objects, qpos[left_*], xpos[hand]; or a
        column, xpos/hand/z. [default: qpos,qvel,ctrl,act,energy,contact,sensor]
      assert_: Exit with code 1 unless this condition holds: max(abs(energy/drift)) < 1e-3.
      units: Where a CSV file states its units: in a comment below the header, # units: s,rad, or in a
        file beside it, run.csv-metadata.json (CSV on the Web). Other formats hold their units. One of
        comment, metadata.
      keep_partial: If the simulation becomes unstable, keep the rows from before.
      contacts: Second table with one row per contact and instant: the geoms, position and depth [m],
        force [N] and torque [N m].
      every: Write a row every N steps. [default: 1]
      rate: Rows per simulated second [Hz], at most one per step, instead of every N steps.
      format: File format. [default: the output's suffix]
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
      golden: Table of an earlier run with which to compare, within the tolerances; the exit code is 1
        if they differ.
      update: Create or replace the golden table, and report what changed.
      atol: Absolute tolerance: numbers and pixels count as equal if |a - b| <= ATOL + RTOL·|b|. If both
        tolerances are 0, they must be identical bit for bit; NaN equals NaN.
      rtol: Relative tolerance.
      tol: Tolerances for single columns, by name or wildcard: 'qvel/*=1e-6', 'energy/*=0,1e-9'. If
        several match, the last one applies. The tolerance of the column time determines which times
        count as equal.
    """
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
        units: Literal["comment", "metadata"] | None = ...,
        keep_partial: bool = ...,
        contacts: str | PathLike[str] | None = ...,
        written: bool = ...,
    ) -> None: ...

class VariedPlot(_VariedPlot):
    """A plot of a simulation with varied parameters, with a curve for each point: its options are keywords.

    The numbers of a point are exactly those of its trace. A point that becomes unstable is drawn up to there.

    Args:
      controllers: functions by the values of `controller`, where the controller varies.

    Options:
      output: The image to write: png, jpg, webp, tiff, svg, pdf.
      vary: Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1,
        opt.timestep=log:1e-4..1e-2:5, seed=1..40:40, qpos/hip=-1..1:21,
        scale:body/torso.mass=uniform(.8,1.2). Accepts any path of set; each:PATH, which varies all
        objects that match a wildcard separately; or an option of the simulation, such as
        controller=a.py:act,b.py:act.
      points: Table of points: one column per parameter, one row per point.
      design: How lists of values combine: grid makes all combinations, zip pairs them in order. One of
        grid, zip. [default: 'grid']
      samples: Number of points to draw from distributions such as uniform(0,1); of saltelli and morris,
        the number of groups of points. [default: 64]
      sampler: Sampling method: sobol, a scrambled Sobol sequence, which keeps its points when samples
        are added; halton, a scrambled Halton sequence, which keeps its points, too, for any number of
        samples; lhs, a Latin hypercube; random, independent random numbers; saltelli, N samples of
        parameters + 2 points each, for Sobol' indices of the metrics; morris, N trajectories of
        parameters + 1 points each, for the elementary effects on the metrics. One of sobol, halton,
        lhs, random, saltelli, morris. [default: 'sobol']
      correlate: Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its
        distribution.
      repeats: Number of simulations per point, each with the next seed; the table of means,
        repeats.csv, has confidence intervals. [default: 1]
      when: Condition on other parameters under which a parameter exists: kd=kp > 0,
        iterations=integrator == 'rk4'. Elsewhere the model keeps its own value, the cell is empty, and
        equal points are one.
      where: Include only points for which this condition holds: mass < 10, integrator != 'rk4'.
      probe: Values to measure in a simulation and, without y, to plot: energy, qpos[left_*]. Each use
        adds a panel below the others; values with different units get separate panels. [default: the
        columns of y, or those of a trace]
      y: A panel and its curves: columns, qpos/knee; wildcards, qpos/*; or expressions over columns,
        contact_force/normal/z / 87.36. A curve may have a label and a unit: depth
        [mm]=penetration/deepest*1000. [default: a panel for each group of columns and each of its
        units]
      x: Column or expression on the x axis. [default: time]
      log: Logarithmic axes: y in all panels, or 2:y in the second panel only.
      xlim: Range of the x axis, of which the curves then show all details. [default: all values]
      ylim: Range of the y axis in all panels, -1..1, or in the second panel only, 2:-1..1. [default:
        all values]
      mark: Draw a horizontal line in all panels, m·g=87.356, or in the second panel only, 2:m·g=87.356;
        or a vertical line, x:impact=0.52.
      mark_event: Draw a vertical line wherever a condition over columns becomes true:
        landed=contact/ncon > 0.
      title: Title above all panels.
      legend_title: Title of the legend, such as the quantity that it lists.
      xlabel: Label of the x axis. [default: the column of the x axis]
      ylabel: Label of the y axis of all panels, force [N], or of the second panel only, 2:force [N];
        each panel has a title already.
      style: Colour scheme; print is meant for paper and also distinguishes lines by dash patterns. One
        of light, dark, print. [default: 'light']
      size: Width and height [pixels], or as on paper, 85mmx60mm; a pixel is 1/96 inch. [default: 1280
        to 1920 wide, and as high as the panels require]
      font_size: Size of letters [pt], for figures in papers. [default: chosen by the size]
      columns: Number of panels side by side. [default: chosen by the number of panels]
      every: Write a row every N steps. [default: 1]
      rate: Rows per simulated second [Hz], at most one per step, instead of every N steps.
      format: File format. [default: the output's suffix]
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
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
        legend_title: str | None = ...,
        xlabel: str | None = ...,
        ylabel: str | Sequence[str] = ...,
        style: Literal["light", "dark", "print"] = ...,
        size: Sequence[int] | None = ...,
        font_size: float | None = ...,
        columns: int | None = ...,
        probe: str | Sequence[str] = ...,
        vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        points: str | PathLike[str] | None = ...,
        design: Literal["grid", "zip"] = ...,
        samples: int = ...,
        sampler: Literal["sobol", "halton", "lhs", "random", "saltelli", "morris"] = ...,
        correlate: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        repeats: int = ...,
        when: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
        where: str | Sequence[str] = ...,
        controllers: Mapping[str, Callable[..., object]] = ...,
    ) -> None: ...

class Video(_Video):
    """A requested video of a simulation: its options are keywords, which are converted and checked on construction.

    Options:
      output: mp4, mov, mkv, webm, gif, apng, webp, a folder or pattern of PNGs (frames/,
        frame_%04d.png), or - for standard output.
      fps: Frames per second of the video [Hz], such as 60 or 30000/1001. [default: 30; 25 in a GIF]
      speed: Simulated seconds per second of video; 0.25 is slow motion. [default: 1]
      format: File format. [default: the output's suffix; mp4 in a pipe]
      codec: Video codec: h264, h265, av1, h264rgb, prores, vp9, ffv1, ffv1-gray16; each format supports
        some of them.
      crf: Constant rate factor of the encoder: lower values give better quality and larger files.
      preset: Encoder preset, a trade-off between encoding speed and compression.
      plot: Live plot of measured values under or beside the frame: energy, qpos[left_*]. Each use adds
        a plot.
      plot_side: Position of the plots relative to the frame. One of under, beside. [default: 'under']
      jobs: Number of rendering processes; auto uses one per core for long videos that are rendered on
        the CPU. [default: 'auto']
      size: Width and height of one view [pixels]. [default: (1280, 720)]
      camera: Camera of the model, by name or index; or one of auto, free, orbit, track, look with
        settings after a colon: auto:azimuth=90 free:azimuth=90,elevation=-20
        orbit:lookat=box,azimuth=140..240,ease=cosine track:box,distance=.5 look:from=0/-2/1,at=box; or
        a camera script, camera.yaml, with a sequence of shots. [default: ('auto',)]
      stage: Surroundings to add to the image: a floor that nothing collides with, light, sky, a camera
        that frames the model closely, or none; auto adds what a model without a floor and a sky lacks.
        [default: ('auto',)]
      geoms: Geoms to show of bodies that have some for looks and others for collisions. One of visual,
        collision, both. [default: visual where both have about the same place]
      show: Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent,
        joint, …
      hide: Visual flags to switch off: shadow, skybox, texture, …
      geomgroup: Groups of geoms to show: 0,1,2, all or none.
      sitegroup: Groups of sites to show.
      jointgroup: Groups of joints to show.
      tendongroup: Groups of tendons to show.
      actuatorgroup: Groups of actuators to show.
      flexgroup: Groups of flexes to show.
      skingroup: Groups of skins to show.
      frame_axes: Objects whose axes are shown: body, geom, site, camera, light, contact or world.
        [default: 'none']
      label: Objects whose names are shown: body, joint, geom, site, camera, tendon, actuator, …
        [default: 'none']
      trail: Bodies, geoms or sites whose paths are drawn, wider and in warmer colours where the speed
        is higher.
      trail_span: Duration of the motion that a trail shows [s]. [default: all]
      ghost: Translucent copy of the model, without flexes and skins: offset=0/1/0, opacity=.3. It shows
        the pose of a keyframe, key=NAME; the motion of a recording, recording=FILE; or that of a table
        of positions, trace=FILE, with map=FILE or map.
      quality: Rendering quality: draft omits shadows, reflections and multisampling; model uses the
        model's settings; high adds supersampling. One of draft, model, high. [default: 'model']
      renderer: Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one,
        which requires Vulkan. One of classic, filament. [default: 'classic']
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      view: Kind of image: colour, depth [m] or segmentation. [default: ('rgb',)]
      layout: Arrangement of several views in one frame. One of row, column, grid. [default: 'row']
      separate: Write each view to a separate file, named NAME-CAMERA-VIEW.
      captions: Label each view with its camera and its kind.
      style: Pixel values of depth and segmentation: color writes colours for viewing; exact writes
        16-bit millimetres or ids. One of color, exact. [default: chosen by the file format]
      depth_range: Depths [m] shown in the first and the last colour. [default: the visible range]
      seg_by: Objects that a segmentation distinguishes: object, geom, site, …, body or root-body.
        [default: 'object']
      text: Text on the frame, with values in braces: '{time:.2f} s', '{speed}x', or any column of a
        trace as in '{qpos/knee:.1f}'.
      text_corner: Position of the text. One of top-left, top, top-right, bottom-left, bottom,
        bottom-right. [default: top-left; bottom-right with captions]
      calibration: File for the calibration of each frame: K, world from camera, near and far [m] and
        time [s], in OpenCV axes.
      calibration_format: Format of the calibration file. One of mjrun, nerfstudio, bop, ros. [default:
        'mjrun']
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
    """
    def __init__(
        self,
        simulation: _Simulation,
        output: str | PathLike[str],
        *,
        manifest: str | PathLike[str] | None = ...,
        command: str = ...,
        view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
        layout: Literal["row", "column", "grid"] = ...,
        separate: bool = ...,
        captions: bool = ...,
        style: Literal["color", "exact"] | None = ...,
        depth_range: Sequence[float] | None = ...,
        seg_by: str = ...,
        text: str | None = ...,
        text_corner: Literal["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"] | None = ...,
        calibration: str | PathLike[str] | None = ...,
        calibration_format: Literal["mjrun", "nerfstudio", "bop", "ros"] = ...,
        gl: str | None = ...,
        require_gpu: bool = ...,
        quality: Literal["draft", "model", "high"] = ...,
        renderer: Literal["classic", "filament"] = ...,
        trail: str | Sequence[str] = ...,
        trail_span: float | str | Fraction | None = ...,
        ghost: str | Sequence[str] = ...,
        size: Sequence[int] = ...,
        camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
        stage: Literal["auto", "none", "floor", "light", "sky", "camera"]
        | Sequence[Literal["auto", "none", "floor", "light", "sky", "camera"]] = ...,
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
    """A live view of a simulation: its options are keywords.

    The simulation begins as soon as the view is visible, and lasts until the view is closed, or for its `duration` or
    `steps`; a replay stays at its last state. It is bit for bit the simulation that a trace measures, until a user
    perturbs or edits it.

    Args:
      simulation: the simulation to show.
      command: the command line, for the recording.

    Options:
      speed: Simulated seconds per second of wall time; 0.25 is slow motion. [default: 1]
      paused: Start paused at time 0.
      browser: Open the view in a browser on this machine instead of a window. [default: a window if a
        display exists]
      port: Port of the browser view, served on 127.0.0.1 only; implies browser. [default: the first
        free one from 8080]
      recording: File for the state of every step since the last reset (.npz), for replay; written
        however the view ends.
    """
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
    task: ModelSource | str,
    *,
    output: str | PathLike[str] = ...,
    episodes: int = ...,
    seed: int = ...,
    compare: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    compare_normalize: str | PathLike[str] | None = ...,
    metric: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    require: str | Sequence[str] = ...,
    fail_below: Mapping[str, float | Sequence[float]] = ...,
    videos: int | str = ...,
    camera: str | int | PathLike[str] | CameraScript | Sequence[str | int | PathLike[str] | CameraScript] = ...,
    size: Sequence[int] = ...,
    quality: Literal["draft", "model", "high"] = ...,
    fps: float | str | Fraction = ...,
    speed: float | str | Fraction = ...,
    html: str | PathLike[str] | None = ...,
    embed_up_to: float = ...,
    export_to: str | PathLike[str] | None = ...,
    vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    points: str | PathLike[str] | None = ...,
    design: Literal["grid", "zip"] = ...,
    samples: int = ...,
    sampler: Literal["sobol", "halton", "lhs", "random", "saltelli", "morris"] = ...,
    correlate: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    repeats: int = ...,
    when: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    where: str | Sequence[str] = ...,
    ctrl_noise: float | None = ...,
    ctrl_noise_time: float | None = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    confidence: float = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    jobs: int | Literal["auto"] = ...,
    engine: str = ...,
    slurm: str | Sequence[str] = ...,
    chunk: int | None = ...,
    time_limit: float | str | Fraction | None = ...,
    time_budget: float | str | Fraction | None = ...,
    max_failures: int | None = ...,
    retry_failed: bool = ...,
) -> EvaluationResult:
    """Plays episodes of a task with a policy, as `mjrun eval` does; `result.table` has a row for each episode.

    Args:
      task: a task, its document, or a name such as `scene:car_drive` or `gym:Walker2d-v5`.
      options: the options of `mjrun.Evaluation`. Without `output`, the files exist as long as the result.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Evaluation(…).run()` raises.

    Options:
      output: Folder for the results; running again with the same folder continues an interrupted
        evaluation.
      episodes: Number of episodes for each policy and each point of a study. [default: 100]
      seed: Seed of the first episode; each later episode uses the next seed.
      compare: Second policy, evaluated on the same episodes; the report gives paired differences with
        confidence intervals.
      compare_normalize: Normalization statistics for the observations of the second policy.
      metric: Additional number per episode, computed from a trace with one row per control period:
        effort=mean(abs(ctrl/motor)), 'pace [km/h]=3.6*mean(speed/torso)'.
      require: Exit with code 1 unless this condition holds for the table of episodes: share(success) >
        0.9, quantile(return, 0.05) > 100.
      fail_below: Exit with code 1 if a value is below its threshold: the success rate, success=90%; the
        mean return, return=200; its interquartile mean, return_iqm=200; the mean of a metric; or the
        lower end of a confidence interval, success_low=0.8.
      videos: Number of episodes to record as videos, evenly spaced by return: 3 gives the worst, median
        and best; worst:3, those with the three lowest returns; failures, all episodes that end in a
        failure.
      camera: Camera of the videos: a camera of the model, or a rig. [default: ('auto',)]
      size: Width and height of the videos [pixels]. [default: (640, 360)]
      quality: Rendering quality of the videos. One of draft, model, high. [default: 'model']
      fps: Frames per second of the videos [Hz]. [default: 30]
      speed: Simulated seconds per second of video. [default: 1]
      html: Page about the result (.html): plots, images, videos, descriptions of columns, assertions
        and manifests.
      embed_up_to: Embed images and videos up to this size in the page; larger ones are linked.
        [default: 10.0]
      export_to: Also write the results as runs of MLflow, one for each point with its parameters and
        metrics, to this folder (mlruns), which is replaced as a whole.
      vary: Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1,
        opt.timestep=log:1e-4..1e-2:5, seed=1..40:40, qpos/hip=-1..1:21,
        scale:body/torso.mass=uniform(.8,1.2). Accepts any path of set; each:PATH, which varies all
        objects that match a wildcard separately; or an option of the simulation, such as
        controller=a.py:act,b.py:act.
      points: Table of points: one column per parameter, one row per point.
      design: How lists of values combine: grid makes all combinations, zip pairs them in order. One of
        grid, zip. [default: 'grid']
      samples: Number of points to draw from distributions such as uniform(0,1); of saltelli and morris,
        the number of groups of points. [default: 64]
      sampler: Sampling method: sobol, a scrambled Sobol sequence, which keeps its points when samples
        are added; halton, a scrambled Halton sequence, which keeps its points, too, for any number of
        samples; lhs, a Latin hypercube; random, independent random numbers; saltelli, N samples of
        parameters + 2 points each, for Sobol' indices of the metrics; morris, N trajectories of
        parameters + 1 points each, for the elementary effects on the metrics. One of sobol, halton,
        lhs, random, saltelli, morris. [default: 'sobol']
      correlate: Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its
        distribution.
      repeats: Number of simulations per point, each with the next seed; the table of means,
        repeats.csv, has confidence intervals. [default: 1]
      when: Condition on other parameters under which a parameter exists: kd=kp > 0,
        iterations=integrator == 'rk4'. Elsewhere the model keeps its own value, the cell is empty, and
        equal points are one.
      where: Include only points for which this condition holds: mass < 10, integrator != 'rk4'.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      confidence: Confidence level of all intervals. [default: 0.95]
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      jobs: Number of processes on this machine; on Slurm, largest number of jobs that run or wait, by
        default 1000, and as many as the cluster accepts. [default: 'auto']
      engine: Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision),
        dask, dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns
        a concurrent.futures.Executor. [default: 'local']
      slurm: Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos,
        constraint, and array=N, the largest number of jobs that run at once. Requires engine slurm.
        [default: time=5min, and what the cluster sets]
      chunk: Number of points or episodes per task of the engine. [default: a few seconds' worth]
      time_limit: Maximum wall time per point or episode [s]. [default: none]
      time_budget: Start no more points or episodes after this wall time [s], as in 2h or 50min; those
        that are running finish. Exits with code 8 if some are left; the same command continues.
        [default: none]
      max_failures: Start no more points or episodes once N of them have failed in this run; the same
        command continues. Exits with code 8. [default: none]
      retry_failed: Simulate again the points or episodes that failed before.
    """

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
    until: str | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    ctrl_noise: float | None = ...,
    ctrl_noise_time: float | None = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    position_control: str | None = ...,
    assets: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
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
    """Estimates parameters of a model from measurements, as `mjrun fit` does.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      data: one or several tables of measurements.
      options: the options of `mjrun.Simulation` and of `mjrun fit`; `free` selects the parameters, and `output` is the
        file of the fitted model, if there is to be one.

    Raises:
      TypeError: an option is unknown.
      UnidentifiableError: the measurements do not determine the parameters.
      UnimprovedFitError: the fitted model does not predict held-out data better.
      MjrunError: the fit is impossible.

    Options:
      key: Keyframe to start from, by name or index.
      qpos: Initial joint positions by name [m, rad]: hip=0.3, hip=20deg, root/z=1, root=0,0,1,1,0,0,0.
      qvel: Initial joint velocities by name [m/s, rad/s]: hip=2, hip=90deg/s, root/wx=1.
      ctrl: Constant controls by actuator name or wildcard, in the actuator's units: motor=20,
        left_*=0.5.
      ctrl_from: Table of controls over time, with a column time [s] and one for each actuator, which is
        named ctrl/ACTUATOR as in a trace, ACTUATOR or JOINT; one named hip [deg] contains degrees.
      ctrl_interpolation: Interpolation between the rows of the table of controls. One of hold, linear.
        [default: 'hold']
      replay: Recording (.npz) whose states are replayed instead of simulated, a demonstration in HDF5
        such as demo.hdf5:demo_3, or a table of joint positions over time, with columns such as
        qpos/hip: motion capture, a log, the output of another simulator.
      replay_mode: Replay mode: states plays back the recorded states; controls simulates again from the
        first state, with the recorded controls and forces. One of states, controls. [default: 'states']
      replay_rate: Rows per second of a table without a column time [Hz]. [default: from the column
        time]
      replay_interpolation: Interpolation between the rows of a replayed table and across gaps in it;
        linear interpolates quaternions along an arc. One of hold, linear. [default: 'linear']
      replay_unwrap: Unwrap hinge angles: treat a jump of more than half a turn between rows as a
        continued rotation.
      map: Column of mjrun and its value, an expression over the columns of a table that is replayed or
        that a ghost follows: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all matching
        columns 'qpos/{}={}_deg*pi/180'. @FILE reads such lines from a file.
      quat: Order of quaternion components in a replayed table whose columns number them instead of
        naming them qw … qz. One of wxyz, xyzw. [default: 'wxyz']
      perturb: Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].
      seed: Seed of all noise; with a policy, seed of the episode.
      duration: Simulated time [s]. [default: 5, or that of the recording or episode; unlimited in a
        view]
      steps: Number of steps, instead of a duration.
      until: End the simulation at the first step at which this condition on its columns holds, if that
        is before its duration: qpos/root/z < 0.3, contact(ball, floor).
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      controller: Python code that sets the controls: a function or class such as policy.py:act or
        package.module:Policy, called with (model, data). It writes data.ctrl or returns the controls; a
        class may have a method reset.
      control_dt: Time between two calls of the controller, or of a policy that has no task document
        [s]. [default: every step]
      position_control: Replace motors on joints by servos, whose controls are joint positions [rad, m],
        from the initial ones on; a model without actuators gets a servo on each joint. Gains that are
        left out follow from inertias, weights and force limits.
      assets: Folder with the meshes and textures that the model of a demonstration names by paths of
        another machine, which are looked up by their ends: DIR/robots/panda/link0.stl, or
        DIR/panda/link0.stl.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      free: Parameter to estimate and its bounds: joint/hinge.damping=0.001..1, or log:1e-4..1 if its
        order of magnitude is unknown. Accepts any path of set, with scale: or wildcards to tie several
        values together; actuator/NAME.kp and .kv of position servos; delay:ctrl/* or delay:qpos/knee
        [s]; inertia:BODY.mass [kg], .center (of mass) [m] and .shape (factors for the spread of mass).
        Append ~normal(MEAN, STD) to add a prior.
      output: Fitted model (.xml): the original text with only the fitted attributes changed.
      comparison: Table of the measurements and of the predictions of the model before (/nominal) and
        after the fit (/fitted), for mjrun plot.
      ranges: Distributions of the fitted parameters (.yaml), for the key vary in documents of mjrun
        sweep.
      html: Self-contained page (.html) about the fit: parameters with confidence intervals, errors,
        correlations, and plots of the measurements with the model before and after the fit.
      video: Video of the fitted model with the measured motion as a ghost: mp4, mov, mkv, webm, gif,
        apng, webp.
      camera: Camera of the video: a camera of the model, or a rig. [default: ('auto',)]
      size: Width and height of the video [pixels]. [default: (640, 360)]
      noise: Standard deviation of the measurement noise of a signal, in its unit; accepts wildcards. By
        default, it is estimated from the high frequencies of the data.
      holdout: Share of each table, at its end, that is not used for the fit, but predicted to test
        whether the fit is an improvement. [default: 0.2]
      holdout_data: Table that is not used for the fit but only predicted, instead of the last part of
        each table.
      starts: Number of starting points: first the values of the model, then values spread evenly over
        the bounds, which are used if the fit does not reach the noise level. [default: 3]
      confidence: Confidence level of the intervals: the share of repeated fits whose intervals contain
        the true value. [default: 0.95]
      loss: Loss function of the residuals. All but linear are robust: they reduce the weight of
        outliers and estimate noise and errors by medians. One of linear, soft_l1, huber, cauchy.
        [default: 'linear']
      allow_unidentifiable: Continue even if the measurements do not determine some parameters or
        combinations of them.
      keep_partial: If the fit is interrupted, write the model with the best parameters so far and
        report them; by default nothing is written.
      excite: Instead of fitting, write a table of controls that excite the parameters: chirps of 0.1 to
        10 Hz within the ranges of controls, joints and forces. ctrl_from applies the table; duration
        sets its length.
      excite_noise: Expected standard deviation of the measured positions [rad, m], from which excite
        predicts confidence intervals. [default: 0.001]
      velocity_limit: Maximum joint velocity under excite [rad/s, m/s].
    """

def frames(
    model: ModelLike | Task | _Simulation,
    *,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
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
    until: str | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    ctrl_noise: float | None = ...,
    ctrl_noise_time: float | None = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    position_control: str | None = ...,
    assets: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
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
    stage: Literal["auto", "none", "floor", "light", "sky", "camera"]
    | Sequence[Literal["auto", "none", "floor", "light", "sky", "camera"]] = ...,
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
    quality: Literal["draft", "model", "high"] = ...,
    renderer: Literal["classic", "filament"] = ...,
    gl: str | None = ...,
    require_gpu: bool = ...,
    view: Literal["rgb", "depth", "seg"] | Sequence[Literal["rgb", "depth", "seg"]] = ...,
    layout: Literal["row", "column", "grid"] = ...,
    captions: bool = ...,
    style: Literal["color", "exact"] | None = ...,
    depth_range: Sequence[float] | None = ...,
    seg_by: str = ...,
    text: str | None = ...,
    text_corner: Literal["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"] | None = ...,
) -> Generator[np.ndarray]:
    """Simulates a model, and yields the frames of the video that `mjrun video` makes, with the same pixels.

    The simulation runs when the first frame is asked for, and frames are drawn one after another, in one thread.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      options: the options of `mjrun.Simulation` and `mjrun.Video`, without those of its file.

    Yields:
      Arrays uint8 `(height, width, 3)`; with `style="exact"`, uint16 `(height, width)`: depths [mm], or ids.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Video(…).run()` raises.

    Options:
      key: Keyframe to start from, by name or index.
      qpos: Initial joint positions by name [m, rad]: hip=0.3, hip=20deg, root/z=1, root=0,0,1,1,0,0,0.
      qvel: Initial joint velocities by name [m/s, rad/s]: hip=2, hip=90deg/s, root/wx=1.
      ctrl: Constant controls by actuator name or wildcard, in the actuator's units: motor=20,
        left_*=0.5.
      ctrl_from: Table of controls over time, with a column time [s] and one for each actuator, which is
        named ctrl/ACTUATOR as in a trace, ACTUATOR or JOINT; one named hip [deg] contains degrees.
      ctrl_interpolation: Interpolation between the rows of the table of controls. One of hold, linear.
        [default: 'hold']
      replay: Recording (.npz) whose states are replayed instead of simulated, a demonstration in HDF5
        such as demo.hdf5:demo_3, or a table of joint positions over time, with columns such as
        qpos/hip: motion capture, a log, the output of another simulator.
      replay_mode: Replay mode: states plays back the recorded states; controls simulates again from the
        first state, with the recorded controls and forces. One of states, controls. [default: 'states']
      replay_rate: Rows per second of a table without a column time [Hz]. [default: from the column
        time]
      replay_interpolation: Interpolation between the rows of a replayed table and across gaps in it;
        linear interpolates quaternions along an arc. One of hold, linear. [default: 'linear']
      replay_unwrap: Unwrap hinge angles: treat a jump of more than half a turn between rows as a
        continued rotation.
      map: Column of mjrun and its value, an expression over the columns of a table that is replayed or
        that a ghost follows: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all matching
        columns 'qpos/{}={}_deg*pi/180'. @FILE reads such lines from a file.
      quat: Order of quaternion components in a replayed table whose columns number them instead of
        naming them qw … qz. One of wxyz, xyzw. [default: 'wxyz']
      perturb: Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].
      seed: Seed of all noise; with a policy, seed of the episode.
      duration: Simulated time [s]. [default: 5, or that of the recording or episode; unlimited in a
        view]
      steps: Number of steps, instead of a duration.
      until: End the simulation at the first step at which this condition on its columns holds, if that
        is before its duration: qpos/root/z < 0.3, contact(ball, floor).
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      controller: Python code that sets the controls: a function or class such as policy.py:act or
        package.module:Policy, called with (model, data). It writes data.ctrl or returns the controls; a
        class may have a method reset.
      control_dt: Time between two calls of the controller, or of a policy that has no task document
        [s]. [default: every step]
      position_control: Replace motors on joints by servos, whose controls are joint positions [rad, m],
        from the initial ones on; a model without actuators gets a servo on each joint. Gains that are
        left out follow from inertias, weights and force limits.
      assets: Folder with the meshes and textures that the model of a demonstration names by paths of
        another machine, which are looked up by their ends: DIR/robots/panda/link0.stl, or
        DIR/panda/link0.stl.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      fps: Frames per second of the video [Hz], such as 60 or 30000/1001. [default: 30; 25 in a GIF]
      speed: Simulated seconds per second of video; 0.25 is slow motion. [default: 1]
      plot: Live plot of measured values under or beside the frame: energy, qpos[left_*]. Each use adds
        a plot.
      plot_side: Position of the plots relative to the frame. One of under, beside. [default: 'under']
      jobs: Number of rendering processes; auto uses one per core for long videos that are rendered on
        the CPU. [default: 'auto']
      size: Width and height of one view [pixels]. [default: (1280, 720)]
      camera: Camera of the model, by name or index; or one of auto, free, orbit, track, look with
        settings after a colon: auto:azimuth=90 free:azimuth=90,elevation=-20
        orbit:lookat=box,azimuth=140..240,ease=cosine track:box,distance=.5 look:from=0/-2/1,at=box; or
        a camera script, camera.yaml, with a sequence of shots. [default: ('auto',)]
      stage: Surroundings to add to the image: a floor that nothing collides with, light, sky, a camera
        that frames the model closely, or none; auto adds what a model without a floor and a sky lacks.
        [default: ('auto',)]
      geoms: Geoms to show of bodies that have some for looks and others for collisions. One of visual,
        collision, both. [default: visual where both have about the same place]
      show: Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent,
        joint, …
      hide: Visual flags to switch off: shadow, skybox, texture, …
      geomgroup: Groups of geoms to show: 0,1,2, all or none.
      sitegroup: Groups of sites to show.
      jointgroup: Groups of joints to show.
      tendongroup: Groups of tendons to show.
      actuatorgroup: Groups of actuators to show.
      flexgroup: Groups of flexes to show.
      skingroup: Groups of skins to show.
      frame_axes: Objects whose axes are shown: body, geom, site, camera, light, contact or world.
        [default: 'none']
      label: Objects whose names are shown: body, joint, geom, site, camera, tendon, actuator, …
        [default: 'none']
      trail: Bodies, geoms or sites whose paths are drawn, wider and in warmer colours where the speed
        is higher.
      trail_span: Duration of the motion that a trail shows [s]. [default: all]
      ghost: Translucent copy of the model, without flexes and skins: offset=0/1/0, opacity=.3. It shows
        the pose of a keyframe, key=NAME; the motion of a recording, recording=FILE; or that of a table
        of positions, trace=FILE, with map=FILE or map.
      quality: Rendering quality: draft omits shadows, reflections and multisampling; model uses the
        model's settings; high adds supersampling. One of draft, model, high. [default: 'model']
      renderer: Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one,
        which requires Vulkan. One of classic, filament. [default: 'classic']
      gl: OpenGL backend: auto, egl, osmesa or glfw. [default: $MUJOCO_GL, or auto]
      require_gpu: Fail instead of rendering in software.
      view: Kind of image: colour, depth [m] or segmentation. [default: ('rgb',)]
      layout: Arrangement of several views in one frame. One of row, column, grid. [default: 'row']
      captions: Label each view with its camera and its kind.
      style: Pixel values of depth and segmentation: color writes colours for viewing; exact writes
        16-bit millimetres or ids. One of color, exact. [default: chosen by the file format]
      depth_range: Depths [m] shown in the first and the last colour. [default: the visible range]
      seg_by: Objects that a segmentation distinguishes: object, geom, site, …, body or root-body.
        [default: 'object']
      text: Text on the frame, with values in braces: '{time:.2f} s', '{speed}x', or any column of a
        trace as in '{qpos/knee:.1f}'.
      text_corner: Position of the text. One of top-left, top, top-right, bottom-left, bottom,
        bottom-right. [default: top-left; bottom-right with captions]
    """

def sweep(
    model: ModelLike | Task | _Simulation,
    *,
    controllers: Mapping[str, Callable[..., object]] = ...,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
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
    until: str | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    ctrl_noise: float | None = ...,
    ctrl_noise_time: float | None = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    position_control: str | None = ...,
    assets: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
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
    html: str | PathLike[str] | None = ...,
    embed_up_to: float = ...,
    export_to: str | PathLike[str] | None = ...,
    vary: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    points: str | PathLike[str] | None = ...,
    design: Literal["grid", "zip"] = ...,
    samples: int = ...,
    sampler: Literal["sobol", "halton", "lhs", "random", "saltelli", "morris"] = ...,
    correlate: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    repeats: int = ...,
    when: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    where: str | Sequence[str] = ...,
    confidence: float = ...,
    jobs: int | Literal["auto"] = ...,
    engine: str = ...,
    slurm: str | Sequence[str] = ...,
    chunk: int | None = ...,
    time_limit: float | str | Fraction | None = ...,
    time_budget: float | str | Fraction | None = ...,
    max_failures: int | None = ...,
    retry_failed: bool = ...,
) -> StudyResult:
    """Simulates a model with varied parameters, as `mjrun sweep` does; `result.table` has a row for each point.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      controllers: functions by the values of `controller`, where the controller varies.
      options: the options of `mjrun.Simulation` and `mjrun.Study`. Without `output`, the files of the study exist as
        long as the result; with it, `mjrun sweep FOLDER` continues the study, unless it has code or a model in memory.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Study(…).run()` raises.

    Options:
      output: Folder for the study, on this machine or in an object store: s3://bucket/study. Running
        again with the same folder continues the study.
      key: Keyframe to start from, by name or index.
      qpos: Initial joint positions by name [m, rad]: hip=0.3, hip=20deg, root/z=1, root=0,0,1,1,0,0,0.
      qvel: Initial joint velocities by name [m/s, rad/s]: hip=2, hip=90deg/s, root/wx=1.
      ctrl: Constant controls by actuator name or wildcard, in the actuator's units: motor=20,
        left_*=0.5.
      ctrl_from: Table of controls over time, with a column time [s] and one for each actuator, which is
        named ctrl/ACTUATOR as in a trace, ACTUATOR or JOINT; one named hip [deg] contains degrees.
      ctrl_interpolation: Interpolation between the rows of the table of controls. One of hold, linear.
        [default: 'hold']
      replay: Recording (.npz) whose states are replayed instead of simulated, a demonstration in HDF5
        such as demo.hdf5:demo_3, or a table of joint positions over time, with columns such as
        qpos/hip: motion capture, a log, the output of another simulator.
      replay_mode: Replay mode: states plays back the recorded states; controls simulates again from the
        first state, with the recorded controls and forces. One of states, controls. [default: 'states']
      replay_rate: Rows per second of a table without a column time [Hz]. [default: from the column
        time]
      replay_interpolation: Interpolation between the rows of a replayed table and across gaps in it;
        linear interpolates quaternions along an arc. One of hold, linear. [default: 'linear']
      replay_unwrap: Unwrap hinge angles: treat a jump of more than half a turn between rows as a
        continued rotation.
      map: Column of mjrun and its value, an expression over the columns of a table that is replayed or
        that a ghost follows: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all matching
        columns 'qpos/{}={}_deg*pi/180'. @FILE reads such lines from a file.
      quat: Order of quaternion components in a replayed table whose columns number them instead of
        naming them qw … qz. One of wxyz, xyzw. [default: 'wxyz']
      perturb: Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].
      seed: Seed of all noise; with a policy, seed of the episode.
      duration: Simulated time [s]. [default: 5, or that of the recording or episode; unlimited in a
        view]
      steps: Number of steps, instead of a duration.
      until: End the simulation at the first step at which this condition on its columns holds, if that
        is before its duration: qpos/root/z < 0.3, contact(ball, floor).
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      controller: Python code that sets the controls: a function or class such as policy.py:act or
        package.module:Policy, called with (model, data). It writes data.ctrl or returns the controls; a
        class may have a method reset.
      control_dt: Time between two calls of the controller, or of a policy that has no task document
        [s]. [default: every step]
      position_control: Replace motors on joints by servos, whose controls are joint positions [rad, m],
        from the initial ones on; a model without actuators gets a servo on each joint. Gains that are
        left out follow from inertias, weights and force limits.
      assets: Folder with the meshes and textures that the model of a demonstration names by paths of
        another machine, which are looked up by their ends: DIR/robots/panda/link0.stl, or
        DIR/panda/link0.stl.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      metric: Number computed from each simulation: drift=max(abs(energy/drift)), fell=first(time,
        xpos/torso/z < 0.8), 'pace [km/h]=3.6*max(speed/torso)' with a unit. Uses the same expressions
        as assert.
      every: Evaluate metrics at every N-th step. [default: 1]
      require: Exit with code 1 unless this condition holds over all points: share(failed) < 0.05.
      keep: Files to write for each kept point, in points/NUMBER in the study's folder: trace.parquet,
        recording.npz, video.mp4.
      keep_where: Keep the files of points for which this condition on parameters, metrics and statuses
        holds: unstable, drift > 1.
      keep_lowest: Keep the files of the N points with the lowest values of a metric: 4:drift.
      keep_highest: Keep the files of the N points with the highest values of a metric: 4:drift.
      contact_sheet: Video that shows the videos of all kept points side by side with their values: mp4,
        mov, mkv, webm, gif, apng, webp.
      probe: Values to measure in kept traces, in addition to the columns that the metrics read.
        [default: qpos,qvel,ctrl,act,energy,contact,sensor]
      camera: Camera of the videos: a camera of the model, or a rig. [default: ('auto',)]
      size: Width and height of the videos [pixels]. [default: (640, 360)]
      quality: Rendering quality of the videos. One of draft, model, high. [default: 'model']
      fps: Frames per second of the videos [Hz]. [default: 30]
      speed: Simulated seconds per second of video. [default: 1]
      html: Page about the result (.html): plots, images, videos, descriptions of columns, assertions
        and manifests.
      embed_up_to: Embed images and videos up to this size in the page; larger ones are linked.
        [default: 10.0]
      export_to: Also write the results as runs of MLflow, one for each point with its parameters and
        metrics, to this folder (mlruns), which is replaced as a whole.
      vary: Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1,
        opt.timestep=log:1e-4..1e-2:5, seed=1..40:40, qpos/hip=-1..1:21,
        scale:body/torso.mass=uniform(.8,1.2). Accepts any path of set; each:PATH, which varies all
        objects that match a wildcard separately; or an option of the simulation, such as
        controller=a.py:act,b.py:act.
      points: Table of points: one column per parameter, one row per point.
      design: How lists of values combine: grid makes all combinations, zip pairs them in order. One of
        grid, zip. [default: 'grid']
      samples: Number of points to draw from distributions such as uniform(0,1); of saltelli and morris,
        the number of groups of points. [default: 64]
      sampler: Sampling method: sobol, a scrambled Sobol sequence, which keeps its points when samples
        are added; halton, a scrambled Halton sequence, which keeps its points, too, for any number of
        samples; lhs, a Latin hypercube; random, independent random numbers; saltelli, N samples of
        parameters + 2 points each, for Sobol' indices of the metrics; morris, N trajectories of
        parameters + 1 points each, for the elementary effects on the metrics. One of sobol, halton,
        lhs, random, saltelli, morris. [default: 'sobol']
      correlate: Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its
        distribution.
      repeats: Number of simulations per point, each with the next seed; the table of means,
        repeats.csv, has confidence intervals. [default: 1]
      when: Condition on other parameters under which a parameter exists: kd=kp > 0,
        iterations=integrator == 'rk4'. Elsewhere the model keeps its own value, the cell is empty, and
        equal points are one.
      where: Include only points for which this condition holds: mass < 10, integrator != 'rk4'.
      confidence: Confidence level of all intervals. [default: 0.95]
      jobs: Number of processes on this machine; on Slurm, largest number of jobs that run or wait, by
        default 1000, and as many as the cluster accepts. [default: 'auto']
      engine: Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision),
        dask, dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns
        a concurrent.futures.Executor. [default: 'local']
      slurm: Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos,
        constraint, and array=N, the largest number of jobs that run at once. Requires engine slurm.
        [default: time=5min, and what the cluster sets]
      chunk: Number of points or episodes per task of the engine. [default: a few seconds' worth]
      time_limit: Maximum wall time per point or episode [s]. [default: none]
      time_budget: Start no more points or episodes after this wall time [s], as in 2h or 50min; those
        that are running finish. Exits with code 8 if some are left; the same command continues.
        [default: none]
      max_failures: Start no more points or episodes once N of them have failed in this run; the same
        command continues. Exits with code 8. [default: none]
      retry_failed: Simulate again the points or episodes that failed before.
    """

def trace(
    model: ModelLike | Task | _Simulation,
    *,
    key: str | int | None = ...,
    qpos: Mapping[str, float | Sequence[float]] = ...,
    qvel: Mapping[str, float | Sequence[float]] = ...,
    ctrl: Mapping[str, float | Sequence[float]] = ...,
    ctrl_from: str | PathLike[str] | None = ...,
    ctrl_interpolation: Literal["hold", "linear"] = ...,
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
    until: str | None = ...,
    policy: str | PathLike[str] | Policy | Callable[..., object] | None = ...,
    normalize: str | PathLike[str] | None = ...,
    trust: bool = ...,
    ctrl_noise: float | None = ...,
    ctrl_noise_time: float | None = ...,
    push: Push | str | Mapping[str, object] | Sequence[Push | str | Mapping[str, object]] = ...,
    controller: Callable[..., object] | None = ...,
    control_dt: float | str | Fraction | None = ...,
    position_control: str | None = ...,
    assets: str | PathLike[str] | Sequence[str | PathLike[str]] = ...,
    integrator: Literal["euler", "rk4", "implicit", "implicitfast", "discrete"] | None = ...,
    timestep: float | str | Fraction | None = ...,
    ground: float | None = ...,
    set: Mapping[str, object] | Sequence[tuple[str, object]] = ...,
    output: str | PathLike[str] = ...,
    probe: str | Sequence[str] = ...,
    assert_: str | Sequence[str] = ...,
    units: Literal["comment", "metadata"] | None = ...,
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
    """Simulates a model, and returns the table that `mjrun trace` writes, with the same numbers.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      options: the options of `mjrun.Simulation` and `mjrun.Trace`; with `output`, the table is also written.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Trace(…).run()` raises.

    Options:
      key: Keyframe to start from, by name or index.
      qpos: Initial joint positions by name [m, rad]: hip=0.3, hip=20deg, root/z=1, root=0,0,1,1,0,0,0.
      qvel: Initial joint velocities by name [m/s, rad/s]: hip=2, hip=90deg/s, root/wx=1.
      ctrl: Constant controls by actuator name or wildcard, in the actuator's units: motor=20,
        left_*=0.5.
      ctrl_from: Table of controls over time, with a column time [s] and one for each actuator, which is
        named ctrl/ACTUATOR as in a trace, ACTUATOR or JOINT; one named hip [deg] contains degrees.
      ctrl_interpolation: Interpolation between the rows of the table of controls. One of hold, linear.
        [default: 'hold']
      replay: Recording (.npz) whose states are replayed instead of simulated, a demonstration in HDF5
        such as demo.hdf5:demo_3, or a table of joint positions over time, with columns such as
        qpos/hip: motion capture, a log, the output of another simulator.
      replay_mode: Replay mode: states plays back the recorded states; controls simulates again from the
        first state, with the recorded controls and forces. One of states, controls. [default: 'states']
      replay_rate: Rows per second of a table without a column time [Hz]. [default: from the column
        time]
      replay_interpolation: Interpolation between the rows of a replayed table and across gaps in it;
        linear interpolates quaternions along an arc. One of hold, linear. [default: 'linear']
      replay_unwrap: Unwrap hinge angles: treat a jump of more than half a turn between rows as a
        continued rotation.
      map: Column of mjrun and its value, an expression over the columns of a table that is replayed or
        that a ghost follows: time=t, 'qpos/knee=knee_deg*pi/180', qpos/root=pelvis, or for all matching
        columns 'qpos/{}={}_deg*pi/180'. @FILE reads such lines from a file.
      quat: Order of quaternion components in a replayed table whose columns number them instead of
        naming them qw … qz. One of wxyz, xyzw. [default: 'wxyz']
      perturb: Standard deviation of Gaussian noise on the initial velocities [m/s, rad/s].
      seed: Seed of all noise; with a policy, seed of the episode.
      duration: Simulated time [s]. [default: 5, or that of the recording or episode; unlimited in a
        view]
      steps: Number of steps, instead of a duration.
      until: End the simulation at the first step at which this condition on its columns holds, if that
        is before its duration: qpos/root/z < 0.3, contact(ball, floor).
      policy: Policy that acts in the task: LEAPP packages (.yaml or its folder), ONNX files (.onnx),
        Stable-Baselines3 archives (.zip), TorchScript modules (.pt), of which Stable-Baselines3
        archives and TorchScript modules require trust; Python code, policy.py:act or
        package.module:Policy; random; or zero.
      normalize: Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz
        with mean, var, epsilon and clip. Use none for a Stable-Baselines3 policy that was trained
        without them.
      trust: Allow policy files that can run code when they are opened: Stable-Baselines3 archives and
        torch files.
      ctrl_noise: Standard deviation of Gaussian noise on every control, in the actuators' units.
        [default: 0, or that of the task]
      ctrl_noise_time: Correlation time of the control noise [s]; 0 makes it independent at every step.
        [default: 0, or that of the task]
      push: Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start
        and its duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up;
        show pertforce draws them in videos and images.
      controller: Python code that sets the controls: a function or class such as policy.py:act or
        package.module:Policy, called with (model, data). It writes data.ctrl or returns the controls; a
        class may have a method reset.
      control_dt: Time between two calls of the controller, or of a policy that has no task document
        [s]. [default: every step]
      position_control: Replace motors on joints by servos, whose controls are joint positions [rad, m],
        from the initial ones on; a model without actuators gets a servo on each joint. Gains that are
        left out follow from inertias, weights and force limits.
      assets: Folder with the meshes and textures that the model of a demonstration names by paths of
        another machine, which are looked up by their ends: DIR/robots/panda/link0.stl, or
        DIR/panda/link0.stl.
      integrator: Integrator, instead of the model's. One of euler, rk4, implicit, implicitfast,
        discrete.
      timestep: Timestep [s], instead of the model's.
      ground: Add a horizontal floor that collides, at this height [m].
      set: Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10,
        opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1,
        vis.quality.shadowsize=1024; relative to the model's value, scale:geom/*.density=1.2,
        add:body/box.pos=0,0,.1. Lengths, masses and times may have units, geom/ball.size=25mm.
      output: csv, feather, h5, jsonl, mat, npz, parquet, or - for standard output. [default: '-']
      probe: Values to measure: qpos, qvel, qacc, ctrl, act, energy, sensor, contact, xpos, speed,
        momentum, … or any field of MjData; values of some objects, qpos[left_*], xpos[hand]; or a
        column, xpos/hand/z. [default: qpos,qvel,ctrl,act,energy,contact,sensor]
      assert_: Exit with code 1 unless this condition holds: max(abs(energy/drift)) < 1e-3.
      units: Where a CSV file states its units: in a comment below the header, # units: s,rad, or in a
        file beside it, run.csv-metadata.json (CSV on the Web). Other formats hold their units. One of
        comment, metadata.
      keep_partial: If the simulation becomes unstable, keep the rows from before.
      contacts: Second table with one row per contact and instant: the geoms, position and depth [m],
        force [N] and torque [N m].
      every: Write a row every N steps. [default: 1]
      rate: Rows per simulated second [Hz], at most one per step, instead of every N steps.
      format: File format. [default: the output's suffix]
      manifest: JSON file that records how the output was made: versions, command, model, options, wall
        times and hashes.
      golden: Table of an earlier run with which to compare, within the tolerances; the exit code is 1
        if they differ.
      update: Create or replace the golden table, and report what changed.
      atol: Absolute tolerance: numbers and pixels count as equal if |a - b| <= ATOL + RTOL·|b|. If both
        tolerances are 0, they must be identical bit for bit; NaN equals NaN.
      rtol: Relative tolerance.
      tol: Tolerances for single columns, by name or wildcard: 'qvel/*=1e-6', 'energy/*=0,1e-9'. If
        several match, the last one applies. The tolerance of the column time determines which times
        count as equal.
    """
