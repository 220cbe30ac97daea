"""The sandbox: a process confines itself to what work on untrusted files requires.

It does so before it reads the first of them, and everything it starts is confined with it: Landlock grants access only
to the necessary files, a filter of system calls denies network, other processes and metadata of files. Models are
loaded in a thread that can read only their folder.
"""

import ctypes
import json
import os
import site
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import TypeVar

from mjrun.confinement import landlock, seccomp
from mjrun.confinement.confinement import CHECKS, VARIABLE, Confinement, confinement, is_within

PREFIX = "mjrun-untrusted-"  # of temporary folders
# The folders that interpreters, drivers and encoders read; missing ones are skipped.
LIBRARIES = ("/lib", "/lib32", "/lib64", "/usr/lib", "/usr/lib32", "/usr/lib64", "/usr/local/lib", "/nix/store")
PROGRAMS = ("/usr", "/bin", "/sbin", "/opt", "/run/opengl-driver")
SETTINGS = (
    *("ld.so.cache", "ld.so.conf", "ld.so.conf.d", "alternatives", "drirc", "egl", "fonts", "glvnd", "vulkan", "X11"),
    *("group", "localtime", "nsswitch.conf", "passwd", "timezone", "OpenCL"),
)
STATE = ("/proc", *(f"/sys/{name}" for name in ("bus", "class", "dev", "devices", "fs/cgroup", "module")))
CACHES = ("fontconfig", "matplotlib", "mesa_shader_cache", "mesa_shader_cache_db", "nvidia")
MODULES = (".py", ".pyc", ".so", ".zip", ".egg", ".dist-info", ".egg-info")  # names that an import inspects
TASKS = "/proc/self/task"  # the threads of this process
DEVICES = (
    *("null", "zero", "full", "random", "urandom", "dri", "kfd", "dxg"),
    *("nvidiactl", "nvidia-modeset", "nvidia-uvm", "nvidia-uvm-tools", *(f"nvidia{number}" for number in range(16))),
)

# Capabilities, the parts of a superuser's privileges: see capabilities(7) and linux/capability.h.
DAC_OVERRIDE, DAC_READ_SEARCH, FOWNER = 1, 2, 3
KEPT_CAPABILITIES = 1 << DAC_OVERRIDE | 1 << DAC_READ_SEARCH | 1 << FOWNER  # to use files of other owners
CAPABILITY_VERSION = 0x20080522
LAST_CAPABILITY = 63
BOUNDING_DROP = 24  # of prctl

T = TypeVar("T")


def means(*, serves: bool = False) -> tuple[str, str]:
    """Returns the mechanisms of confinement on this machine: for files, and for the network, which may be empty."""
    version = landlock.version()
    by = f"Landlock {version}" if version else CHECKS
    if seccomp.is_known():
        return by, "seccomp" + (", except for TCP" if serves else "")
    return by, f"{by}, TCP only" if version >= 4 else ""


def with_temporary(wanted: Confinement) -> Confinement:
    """Returns `wanted` with a new folder for temporary files, which this process uses from now on."""
    temporary = os.path.realpath(tempfile.mkdtemp(prefix=PREFIX))
    tempfile.tempdir = os.environ["TMPDIR"] = temporary
    return replace(wanted, temporary=temporary)


def confine(wanted: Confinement, *, serves: bool = False) -> Confinement:
    """Confines this process and everything it starts from now on; returns the limits and their mechanisms.

    Args:
      serves: whether it opens a port, for a browser on the same machine.

    Raises:
      OSError: the kernel refuses what it offers.
      RuntimeError: the process has several threads; the others would not be confined.
    """
    by, network = means(serves=serves)
    made = replace(wanted, by=by, network=network)
    if os.path.isdir(TASKS) and len(os.listdir(TASKS)) > 1:  # noqa: PTH112, PTH208
        raise RuntimeError("a process with several threads cannot be confined")
    _close_inherited()
    from mjrun.confinement.loopback_connector import LoopbackConnector

    connector = LoopbackConnector() if serves and seccomp.is_known() else None
    if connector:
        made = replace(made, own_port=connector.bound.detach())
    if landlock.version():
        rules = [
            *_system(),
            *((path, landlock.READ) for path in (*made.roots, *made.files)),
            *((path, landlock.WRITE) for path in (*made.written, made.temporary)),
        ]
        landlock.restrict(rules, serves=serves)
    drop_capabilities()
    if seccomp.is_known():
        listener = seccomp.restrict(serves=serves)
        if connector and listener is not None:
            connector.listen(listener)
    os.environ[VARIABLE] = json.dumps(asdict(made))
    return made


def confined_load(load: Callable[[], T]) -> T:
    """Calls `load`, in a confined process in a thread that can open only the files of models.

    That thread can open neither the outputs nor the files that drivers and encoders read.
    """
    limits = confinement()
    if limits is None or not landlock.version() or threading.current_thread().name == PREFIX:
        return load()
    results: list[T] = []
    errors: list[BaseException] = []

    def work() -> None:
        try:
            places = (*limits.roots, *limits.files, limits.temporary)  # the last may contain copies of models
            rules = [*_libraries(), *((path, landlock.READ) for path in places)]
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


class _CapabilityHeader(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))


class _CapabilitySets(ctypes.Structure):
    """The capabilities 0 to 31, and those from 32 on."""

    _fields_ = (("effective", ctypes.c_uint32), ("permitted", ctypes.c_uint32), ("inheritable", ctypes.c_uint32))


def drop_capabilities() -> None:
    """Drops all capabilities of this process except those on files.

    Raises:
      OSError: they cannot be dropped.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None, use_errno=True)
    header, sets = _CapabilityHeader(CAPABILITY_VERSION, 0), (_CapabilitySets * 2)()
    if library.capget(ctypes.byref(header), sets):
        raise OSError(ctypes.get_errno(), "the capabilities of this process are unknown")
    if not any(each.permitted for each in sets):
        return
    for number in range(LAST_CAPABILITY + 1):
        if not KEPT_CAPABILITIES >> number & 1:
            library.prctl(BOUNDING_DROP, number, 0, 0, 0)  # fails for unknown numbers, and without the privilege
    for place, each in enumerate(sets):
        lasting = KEPT_CAPABILITIES >> 32 * place
        each.effective &= lasting
        each.permitted &= lasting
        each.inheritable &= lasting  # this removes the ambient ones, too
    if library.capset(ctypes.byref(header), sets):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _close_inherited() -> None:
    """Closes the files that this process inherited, except its standard streams."""
    for name in os.listdir("/dev/fd"):  # noqa: PTH208
        with suppress(OSError):  # of the descriptor by which the folder is listed
            if int(name) > 2 and os.get_inheritable(int(name)):  # files that Python opens are not inheritable
                os.close(int(name))


def _system() -> Iterator[tuple[str, int]]:
    """Yields the files of the system that a process needs, whatever it works on."""
    yield from _libraries()
    home = Path(os.environ.get("HOME") or "/nonexistent")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    paths = [*PROGRAMS, *STATE, *(f"/etc/{name}" for name in SETTINGS), *(str(cache / name) for name in CACHES)]
    paths += [f"{prefix}/{name}" for prefix in {sys.prefix, sys.base_prefix} for name in ("bin", "share", "etc/fonts")]
    paths += [str(home / ".fonts"), str(home / ".local/share/fonts"), os.environ.get("IMAGEIO_FFMPEG_EXE", "")]
    yield from ((path, landlock.READ) for path in paths)
    yield from ((f"/dev/{name}", landlock.USE) for name in DEVICES)
    yield TASKS, landlock.WRITE_FILE  # to name threads


@cache
def _libraries() -> tuple[tuple[str, int], ...]:
    """Returns the files that the interpreter reads: itself, its libraries and packages."""
    package = str(Path(__file__).parents[1])
    prefixes = {sys.prefix, sys.base_prefix, sys.exec_prefix}
    paths = {*LIBRARIES, package, sys.executable, *site.getsitepackages(), site.getusersitepackages()}
    paths |= {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    paths |= {f"{prefix}/{name}" for prefix in prefixes for name in ("lib", "lib32", "lib64", "pyvenv.cfg")}
    chosen = [path for path in sys.path if _is_chosen(path) and not any(is_within(path, each) for each in paths)]
    paths |= {path for folder in chosen for path in _importable(folder)}
    return (
        *((path, landlock.READ) for path in paths),
        *((folder or ".", landlock.READ_DIR) for folder in sys.path),
    )


def _is_chosen(folder: str) -> bool:
    """Returns whether a folder of `sys.path` comes from PYTHONPATH or a .pth file, not from how the program started."""
    named = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return sys.flags.safe_path or folder != sys.path[0] or folder in map(os.path.abspath, filter(None, named))


def _importable(folder: str) -> Iterator[str]:
    """Yields the modules and packages in a folder, which may contain private files, too."""
    if os.path.isfile(folder):  # noqa: PTH113 – an archive of modules
        yield folder
        return
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _is_module(entry.name) or (entry.is_dir() and any(_is_package(entry.path))):
                yield entry.path


def _is_package(folder: str) -> Iterator[bool]:
    """Yields, for each entry of a folder and of its subfolders, whether it is a module."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            yield _is_module(entry.name) or (entry.is_dir() and os.path.exists(f"{entry.path}/__init__.py"))  # noqa: PTH110


def _is_module(name: str) -> bool:
    return name.endswith(MODULES) or ".so." in name
