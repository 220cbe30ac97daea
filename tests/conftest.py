"""Shared parts of the tests: paths, a renderer, and oracles that inspect files from outside."""

import fcntl
import functools
import gc
import inspect
import itertools
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import types
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any, cast
from unittest import mock

os.environ.setdefault("MUJOCO_GL", "egl")  # for mujoco.Renderer, the oracle of drawing
os.environ["MJRUN_CACHE"] = os.devnull  # nothing is stored below it
os.environ.setdefault("GALLIVM_PERF", "nopt")  # Mesa compiles shaders in half the time, and draws almost as fast
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a fifth of the start of a process: the tests start thousands
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")  # gRPC prints into the output of programs that start beside it
# As in an activated environment, whose pip messages name.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

import mjrun.cli.main as cli
from mjrun import child_process
from mjrun.errors import NoRendererError
from mjrun.formats.ffmpeg import working_codecs
from mjrun.physics import warp_device
from mjrun.platform import cores, system
from mjrun.rendering import backend as backend_module
from mjrun.rendering.backend import BackendDetector, VulkanDetector, WorkingBackend
from tests.backend_trials import RememberedTrial
from tests.cases import mjcf
from tests.merged_cases import merged
from tests.prepared_interpreters import PreparedPopen
from tests.processes import PATIENCE, without_progress

ROOT = Path(__file__).parents[1]

# Where bytecode is not cached, every process that a test starts compiles all of mjrun again: half of the whole time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Lets the workers of CI collect one after the other; in a new checkout, each would compile the same modules.

    Meanwhile, the garbage collector would scan what has been collected again and again. Property tests that draw the
    same examples everywhere draw no constants of the code: those of the modules that other tests have imported by then.
    """
    gc.disable()
    if settings.default and settings.default.derandomize:
        providers._get_local_constants = lambda: providers._local_constants
    with Path(__file__).open() as turn:
        if {"CI", "PYTEST_XDIST_WORKER"} <= os.environ.keys():
            fcntl.flock(turn, fcntl.LOCK_EX)
        return (yield)


OF_ALL = {"tmp_path", "tmp_path_factory", "request"}  # fixtures that leave a folder empty
OF_ALL |= {"workers_are_copies_of_prepared_interpreters", "warp_compiles_without_optimization"}
OF_ALL |= {"workplace", "monkeypatch"}  # which makes the folder the working directory


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(collector: pytest.Module, name: str, obj: object) -> object:
    """Merges the cases of a test, unless the command line selects some."""
    options = collector.config.option
    if not isinstance(obj, types.FunctionType) or hasattr(obj, "hypothesis"):
        return None
    marks = [*getattr(obj, "pytestmark", ())]
    if not marks:
        return None
    if options.keyword or "[" in "".join(options.file_or_dir) or collector.get_closest_marker("slow"):
        return None
    if (test := merged(obj, marks)) is None:
        return None
    setattr(collector.obj, name, test)
    (item,) = collector.ihook.pytest_pycollect_makeitem(collector=collector, name=name, obj=test)
    if "tmp_path" in inspect.signature(test).parameters and {*item.fixturenames} - OF_ALL:
        setattr(collector.obj, name, obj)  # another fixture may have filled the folder
        return None
    return item


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the tests of Warp side by side, so that one worker imports it and loads its kernels."""
    items.sort(key=lambda item: item.get_closest_marker("warp") is None)


def pytest_collection_finish() -> None:
    """Keeps the garbage collector from scanning the collected tests, a million objects, again and again."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(100_000, 20, 100)


_write_bytecode = SourceFileLoader.set_data


def _write_bytecode_of_packages(self: SourceFileLoader, path: str, data: Any, **mode: int) -> None:
    """Leaves no bytecode of modules that a test imports from a folder, among the files that it lists.

    Nor is any written while a test limits the size of files: Python would take the half that fits for the whole.
    """
    is_limited = resource.getrlimit(resource.RLIMIT_FSIZE) != LIMITS[resource.RLIMIT_FSIZE]
    if not is_limited and any(Path(path).is_relative_to(folder) for folder in (sys.prefix, ROOT / "mjrun")):
        _write_bytecode(self, path, data, **mode)


SourceFileLoader.set_data = _write_bytecode_of_packages

# Property tests draw the same examples everywhere. `make explore` draws others; what it finds becomes an `@example`.
# How slowly examples are made says nothing on a busy machine.
ANYWHERE = {"database": None, "deadline": None, "print_blob": True, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, max_examples=25, **ANYWHERE)
settings.register_profile("explore", derandomize=False, **ANYWHERE)
settings.load_profile("same")

# Commands under test hear these even where the tests are started in the background, by nohup or without a terminal.
for ending, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(ending) is signal.SIG_IGN:
        signal.signal(ending, handler)

# Without multisampling, which takes half of the time in software; tests/rendering/test_classic.py has it.
SWING = mjcf("swing")


def pytest_xdist_auto_num_workers() -> int:
    """Returns one more worker than cores, since tests wait for commands, signals and leases."""
    return cores.available_cores() + 1


@pytest.fixture
def half_a_core(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Makes this process one of a container with a quota of half a core, on a machine with eight."""
    folder = tmp_path_factory.mktemp("container")
    (folder / "cgroup").write_text("0::/\n")
    (folder / "mountinfo").write_text(f"25 1 0:22 / {folder} rw - cgroup2 cgroup rw\n")
    (folder / "cpu.max").write_text("50000 100000\n")
    monkeypatch.setattr(cores, "PROCESS", folder)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)))


_folders = itertools.count()


@pytest.fixture
def tmp_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty folder; for its own, pytest looks through the folders of all tests before, and makes a link."""
    folder = tmp_path_factory.getbasetemp() / str(next(_folders))
    folder.mkdir()
    return folder


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """A model file: a red box on a hinge and a green ball that drops on the floor."""
    path = tmp_path / "swing.xml"
    path.write_text(SWING)
    return path


@pytest.fixture
def exploding(tmp_path: Path) -> Path:
    """A model file whose simulation becomes unstable within its first second."""
    path = tmp_path / "exploding.xml"
    path.write_text(mjcf("exploding"))
    return path


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Lets each test detect backends, of which each is tried once."""
    backend_module.BackendTrialProcess = RememberedTrial
    backend_module._working = {}


_working_codecs = functools.cache(working_codecs)


@pytest.fixture
def codecs_are_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The doctor tries each codec for the first test only."""
    monkeypatch.setattr("mjrun.doctor.working_codecs", _working_codecs)


@pytest.fixture(scope="session", autouse=True)
def workers_are_copies_of_prepared_interpreters() -> Iterator[None]:
    if sys.platform != "linux":
        yield
        return
    prepared = types.SimpleNamespace(**{**vars(subprocess), "Popen": PreparedPopen})
    with mock.patch.object(child_process, "subprocess", prepared):
        yield


@pytest.fixture
def new_interpreters(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers start as they do for users."""
    monkeypatch.setattr(child_process, "subprocess", subprocess)


@pytest.fixture(scope="session", autouse=True)
def warp_compiles_without_optimization() -> Iterator[None]:
    """Halves the time in which Warp compiles the kernels, from which tests ask for a few steps only."""
    imported = warp_device._imported

    def unoptimized() -> tuple[Any, Any]:
        warp, library = imported()
        warp.config.optimization_level = 0
        return warp, library

    with mock.patch.object(warp_device, "_imported", unoptimized):
        yield


@pytest.fixture(scope="session")
def backend() -> WorkingBackend:
    """A renderer that works here; a test that needs one fails where there is none."""
    return BackendDetector("auto").result()


@pytest.fixture(scope="session")
def vulkan() -> WorkingBackend:
    """A Vulkan that Filament draws with; skipped only where the set-up could not install one."""
    try:
        return VulkanDetector().result()
    except NoRendererError:
        if (ROOT / ".venv/mjrun-no-vulkan").exists():
            pytest.skip("Vulkan cannot be installed here")
        raise


@pytest.fixture(scope="session")
def display() -> Iterator[dict[str, str]]:
    """An environment with a virtual display. The set-up installs Xvfb; tests fail without it."""
    program = shutil.which("Xvfb")
    assert program, "Xvfb is not installed: scripts/setup.sh installs it"
    reading, writing = os.pipe()
    command = [program, "-displayfd", str(writing), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        number = pipe.readline().strip()  # empty if the server ends at once
    assert number, "Xvfb did not start"
    yield {"DISPLAY": f":{number}", "WAYLAND_DISPLAY": "", "LIBGL_ALWAYS_SOFTWARE": "1"}
    server.terminate()
    server.wait()


@pytest.fixture
def no_display() -> dict[str, str]:
    """An environment without a display."""
    return {"DISPLAY": "", "WAYLAND_DISPLAY": ""}


@pytest.fixture
def shared_models() -> Path:
    """Models from other projects; the test is skipped where they are missing."""
    path = ROOT / "../shared/models"
    if not path.is_dir():
        pytest.skip("../shared/models is not here")
    return path


@dataclass(frozen=True)
class Film:
    """A decoded video: `frames` `(n, height, width, 3)` uint8, the stream's description, start [s]."""

    frames: np.ndarray
    stream: str
    fps: float
    start: float


@pytest.fixture
def decode() -> Callable[[Path], Film]:
    """Decodes every frame of a video to RGB."""

    def decoded(path: Path) -> Film:
        program = imageio_ffmpeg.get_ffmpeg_exe()
        described = subprocess.run([program, "-hide_banner", "-i", str(path)], capture_output=True, text=True).stderr
        stream = next(line for line in described.splitlines() if "Video:" in line)
        size = re.search(r", (\d+)x(\d+)", stream)
        fps = re.search(r"([\d.]+) fps", stream)
        assert size
        raw = ["-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
        done = subprocess.run([program, "-v", "error", "-i", str(path), *raw], capture_output=True, check=True)
        width, height = map(int, size.groups())
        frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3)
        start = re.search(r"start: ([\d.]+)", described)
        return Film(frames, stream, float(fps[1]) if fps else 0.0, float(start[1]) if start else 0.0)

    return decoded


@dataclass(frozen=True)
class Command:
    """Runs mjrun in a separate process, in an empty folder."""

    folder: Path

    def start(self, *arguments: str | Path, **settings: object) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error::ResourceWarning"}
        for name in ("MUJOCO_GL", "COLUMNS"):
            environment.pop(name, None)
        given = cast(dict[str, str], settings.pop("env", {}))
        may_be_a_copy = sys.platform == "linux" and "PYTHONPATH" not in given  # of what has imported from elsewhere
        return (PreparedPopen if may_be_a_copy else subprocess.Popen)(
            [sys.executable, "-m", "mjrun", *map(str, arguments)],
            cwd=self.folder,
            env={**environment, **given},
            stdin=subprocess.DEVNULL,
            stdout=settings.pop("stdout", subprocess.PIPE),  # type: ignore[call-overload]
            stderr=subprocess.PIPE,
        )

    def __call__(self, *arguments: str | Path, **settings: object) -> subprocess.CompletedProcess[bytes]:
        child = self.start(*arguments, **settings)
        out, err = child.communicate(timeout=PATIENCE)
        return subprocess.CompletedProcess(child.args, child.returncode, out, without_progress(err))

    def files(self) -> list[str]:
        """Returns the names in the folder, hidden ones too."""
        return sorted(path.name for path in self.folder.iterdir())


@pytest.fixture
def mjrun(tmp_path: Path) -> Command:
    """The command, run in an empty folder."""
    folder = tmp_path / "work"
    folder.mkdir()
    return Command(folder)


@dataclass(frozen=True)
class CommandInProcess(Command):
    """Runs mjrun in this process, which is faster, where a separate process would show nothing more."""

    capture: pytest.CaptureFixture[bytes]

    def __call__(self, *arguments: str | Path, **settings: object) -> subprocess.CompletedProcess[bytes]:
        environment = cast(dict[str, str], settings.pop("env", {}))
        assert not settings, "only a separate process has them"
        self.capture.readouterr()
        with mock.patch.dict(os.environ, environment):
            code = cli.run([*map(str, arguments)])
        out, err = self.capture.readouterr()
        return subprocess.CompletedProcess(arguments, code, out, without_progress(err))


@pytest.fixture
def own_signals(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that is run in this process leaves its signals to pytest."""
    monkeypatch.setattr(system, "SIGNALS", ())


@pytest.fixture
def mjrun_here(
    mjrun: Command, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, own_signals: None
) -> Command:
    """The command, run in this process and in an empty folder."""
    monkeypatch.chdir(mjrun.folder)
    monkeypatch.delenv("COLUMNS", raising=False)
    return CommandInProcess(mjrun.folder, capfdbinary)


def _log_to_file(enabled: bool) -> None:
    """Sets whether MuJoCo writes its warnings to MUJOCO_LOG.TXT in the working directory of this process."""
    config = mujoco.MjLogConfig.get()
    config.logto_file = enabled
    config.set()


LIMITS = {kind: resource.getrlimit(kind) for kind in (resource.RLIMIT_AS, resource.RLIMIT_FSIZE, resource.RLIMIT_CPU)}
LOG = Path("MUJOCO_LOG.TXT").absolute()
LOG_SIZE = LOG.stat().st_size if LOG.exists() else None
_log_to_file(False)  # bare loops diverge on purpose


@pytest.fixture
def mujoco_log() -> Iterator[None]:
    """MuJoCo writes its log, as it does by default; only for tests in a separate folder."""
    _log_to_file(True)
    yield
    _log_to_file(False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Function) -> Generator[None]:
    """Sees to it that a test has left nothing behind. Fixtures that all tests use would take longer."""
    yield
    folder: Any = item.funcargs.get("tmp_path")
    assert not folder or not list(folder.rglob("*.part"))
    assert (LOG.stat().st_size if LOG.exists() else None) == LOG_SIZE
    assert mujoco.get_mju_user_warning() is None, "a block of collected_warnings is still open"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "see the fixture own_signals"
    limits = [resource.getrlimit(kind) for kind in LIMITS]
    assert limits == [*LIMITS.values()], "this process is limited from now on"


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scenes without their textures, drawn in a fraction of the time."""
    from tests.documentation import plain_scenes

    return plain_scenes(tmp_path_factory.mktemp("plain"))


def instant(path: Path, step: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model after `step` steps, with everything derived from that state computed."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=step)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture
def still() -> Callable[..., np.ndarray]:
    """Renders `data` through a camera with MuJoCo's own renderer, the oracle."""

    def drawn(
        model: mujoco.MjModel,
        data: mujoco.MjData,
        size: tuple[int, int],
        camera: int | str = -1,
        option: mujoco.MjvOption | None = None,
    ) -> np.ndarray:
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        with mujoco.Renderer(model, size[1], size[0]) as renderer:
            renderer.update_scene(data, camera, option)
            return renderer.render()

    return drawn
