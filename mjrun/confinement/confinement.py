"""What a process may do that works on files nobody vouches for: `--untrusted`.

A process confines itself before it reads the first of them, and what it starts is confined with it: Landlock gives it
no files but those it needs, a filter of system calls gives it no network. Models are loaded in a thread that may read
their folder alone. Where the kernel knows neither, paths are checked before they are opened; they are everywhere.
"""

import json
import os
import platform
import site
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

from mjrun.confinement import landlock, seccomp
from mjrun.errors import UsageError, option

VARIABLE = "MJRUN_CONFINEMENT"  # by which the processes that a confined one starts know that they are
CHECKS = "checks of paths"
PREFIX = "mjrun-untrusted-"  # of temporary folders

# What interpreters, drivers and encoders read; those of these that there are.
LIBRARIES = ("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin", "/opt", "/nix/store", "/run/opengl-driver")
SETTINGS = (
    *("ld.so.cache", "ld.so.conf", "ld.so.conf.d", "alternatives", "drirc", "egl", "fonts", "glvnd", "vulkan", "X11"),
    *("group", "localtime", "nsswitch.conf", "passwd", "timezone", "OpenCL"),
)
STATE = ("/proc", "/sys")
CACHES = ("fontconfig", "matplotlib", "mesa_shader_cache", "mesa_shader_cache_db", "nvidia")
DEVICES = (
    *("null", "zero", "full", "random", "urandom", "shm", "dri", "kfd", "dxg", "pts", "tty"),
    *("nvidiactl", "nvidia-modeset", "nvidia-uvm", "nvidia-uvm-tools", *(f"nvidia{number}" for number in range(16))),
)

T = TypeVar("T")


@dataclass(frozen=True)
class Confinement:
    """What a confined process may do.

    Attributes:
      roots: the folders that models and documents may name files in.
      files: files and folders that the user has named, which may be read too.
      written: folders that outputs are written in.
      temporary: the folder of temporary files.
      by: what keeps it from reading and writing other files.
      network: what keeps it from the network; empty if nothing does.
    """

    roots: tuple[str, ...]
    files: tuple[str, ...] = ()
    written: tuple[str, ...] = ()
    temporary: str = ""
    by: str = CHECKS
    network: str = ""

    def allows(self, path: str | Path) -> bool:
        """Whether a model or a document may name the file `path`, which need not exist."""
        real = os.path.realpath(path)
        return any(_is_within(real, place) for place in (*self.roots, *self.files, self.temporary))

    def facts(self) -> dict[str, object]:
        """What a report says of it."""
        return {"roots": list(self.roots), "files": self.by, "network": self.network or "not confined"}


def confinement() -> Confinement | None:
    """How this process is confined; None if it is not."""
    text = os.environ.get(VARIABLE)
    return _parsed(text) if text else None


def means(*, serves: bool = False) -> tuple[str, str]:
    """What confines a process on this machine: to files, and from the network; the latter empty if nothing does."""
    version = landlock.version()
    by = f"Landlock {version}" if version else CHECKS
    if seccomp.is_known():
        return by, "seccomp" + (", which leaves it TCP" if serves else "")
    return by, f"{by}, TCP only" if version >= 4 else ""


def confine(wanted: Confinement, *, serves: bool = False) -> Confinement:
    """Confines this process and what it starts from now on, and returns how. It must have one thread.

    Args:
      serves: whether it opens a port, for a browser on the same machine.

    Raises:
      OSError: the kernel refuses what it offers.
    """
    by, network = means(serves=serves)
    temporary = os.path.realpath(tempfile.mkdtemp(prefix=PREFIX))
    above = os.path.dirname(temporary)  # noqa: PTH120
    tempfile.tempdir = os.environ["TMPDIR"] = temporary
    made = Confinement(wanted.roots, wanted.files, wanted.written, temporary, by, network)
    if landlock.version():
        rules = [
            *_system(),
            *((path, landlock.READ) for path in (*made.roots, *made.files)),
            *((path, landlock.WRITE) for path in (*made.written, temporary)),
            (above, landlock.REMOVE_FOLDER),
        ]
        landlock.restrict(rules, serves=serves)
    if seccomp.is_known():
        seccomp.refuse_network(serves=serves)
    os.environ[VARIABLE] = json.dumps(asdict(made))
    return made


def confined_load(load: Callable[[], T]) -> T:
    """What `load` returns, called where a model's own files are all that can be opened, if this process is confined.

    It is called in a thread of its own then, which can open neither the outputs nor what drivers read.
    """
    limits = confinement()
    if limits is None or not landlock.version() or threading.current_thread().name == PREFIX:
        return load()
    results: list[T] = []
    errors: list[BaseException] = []

    def work() -> None:
        try:
            rules = [*_python(), *((path, landlock.READ) for path in (*limits.roots, *limits.files))]
            landlock.restrict(rules, network=False)
            results.append(load())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, name=PREFIX, daemon=True)
    thread.start()
    thread.join()
    if errors:
        raise errors[0]
    return results[0]


def require_unconfined(what: str) -> None:
    """Checks that this process is not confined, which `what` does not go with.

    Raises:
      UsageError: it is.
    """
    if confinement():
        raise UsageError(f"{what}, which {option('untrusted')} does not allow")


def is_readable(path: str | Path) -> bool:
    """Whether a model or a document may name the file `path`: any, unless this process is confined."""
    limits = confinement()
    return limits is None or limits.allows(path)


def is_writable(path: str | Path) -> bool:
    """Whether outputs may be written at `path`: anywhere, unless this process is confined."""
    limits = confinement()
    real = os.path.realpath(path)
    return limits is None or any(_is_within(real, place) for place in (*limits.written, limits.temporary))


OUTSIDE = "lies outside the folder that files are read from"


def advice() -> str:
    """What to do when a model or a document names a file outside."""
    return f"{option('untrusted')} reads what is beside the model and what you name; {option('root')} chooses a folder"


@cache
def _parsed(text: str) -> Confinement:
    values = json.loads(text)
    roots, files, written = (tuple(map(str, values.pop(name))) for name in ("roots", "files", "written"))
    return Confinement(roots, files, written, **values)


def _is_within(path: str, folder: str) -> bool:
    return bool(folder) and (path == folder or path.startswith(folder.rstrip("/") + "/"))


def _system() -> Iterator[tuple[str, int]]:
    """What a process needs of the system, whatever it works on."""
    yield from _python()
    home = Path(os.environ.get("HOME") or "/nonexistent")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    paths = [*STATE, *(f"/etc/{name}" for name in SETTINGS), *(str(cache / name) for name in CACHES)]
    paths += [str(home / ".fonts"), str(home / ".local/share/fonts"), os.environ.get("IMAGEIO_FFMPEG_EXE", "")]
    yield from ((path, landlock.READ) for path in paths)
    yield from ((f"/dev/{name}", landlock.USE) for name in DEVICES)
    yield "/dev/shm", landlock.WRITE
    yield "/proc/self/task", landlock.WRITE_FILE  # where threads get their names


def _python() -> Iterator[tuple[str, int]]:
    """What the interpreter reads: itself, its libraries and packages."""
    package = Path(__file__).parents[1]
    installed = [sys.prefix, sys.base_prefix, sys.exec_prefix, *sysconfig.get_paths().values(), *site.getsitepackages()]
    for path in {*LIBRARIES, *installed, site.getusersitepackages(), str(package), os.path.realpath(sys.executable)}:
        yield path, landlock.READ
    for path in sys.path:  # of a checkout, say, no more than the names of its files
        yield path or ".", landlock.READ_DIR


def system() -> str:
    """The operating system, for what it lacks."""
    return f"{platform.system()} {platform.release()}"
