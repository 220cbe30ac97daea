"""MuJoCo's process-wide state: disables its log file and timers, collects its warnings, and empties its asset cache."""

import ctypes
import os
import threading
import time
import warnings
from collections.abc import Generator, Iterable, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path

import mujoco

from mjrun.errors import MjrunWarning, UsageError, clean, option
from mjrun.file_version import is_settled, version_of
from mjrun.reporter import Reporter

CALLBACKS = "act_bias", "act_dyn", "act_gain", "contactfilter", "control", "passive", "sensor"  # of the physics
_C_FUNCTION = type(ctypes.pythonapi.Py_IsInitialized).__base__ or object  # of all function types of ctypes

_lock = threading.RLock()  # of everything below that belongs to the process
_log_blocks, _timer_blocks = 0, 0  # open at present, in all threads; the last one that ends restores
_writes_log, _clock_before = True, None


@contextmanager
def without_log() -> Generator[None]:
    """Prevents MuJoCo from writing MUJOCO_LOG.TXT into the working directory.

    Threads may have blocks at once, which end in any order.
    """
    global _log_blocks, _writes_log
    with _lock:
        if not _log_blocks:
            _writes_log = _write_log(False)
        _log_blocks += 1
    try:
        yield
    finally:
        with _lock:
            _log_blocks -= 1
            if not _log_blocks:
                _write_log(_writes_log)


def _write_log(is_written: bool) -> bool:
    """Sets whether MuJoCo writes its log file, and returns whether it did."""
    log = mujoco.MjLogConfig.get()
    before, log.logto_file = log.logto_file, is_written
    log.set()
    return before


class without_timers:  # noqa: N801 - a context manager, and a class because it is entered once a step
    """A context in which MuJoCo does not read the clock dozens of times per step for its profile, which mjrun ignores.

    The Python bindings install a clock, and `set_mjcb_time(None)` only restores it. Without it, a step is as fast as
    in C: for small models it takes a fifth to a half less time. Threads may have blocks at once, which end in any
    order.
    """

    def __enter__(self) -> None:
        global _timer_blocks, _clock_before
        clock = _clock()
        if clock is not None:
            with _lock:
                if not _timer_blocks:
                    _clock_before, clock.value = clock.value, None
                _timer_blocks += 1

    def __exit__(self, *error: object) -> None:
        global _timer_blocks
        clock = _clock()
        if clock is not None:
            with _lock:
                _timer_blocks -= 1
                if not _timer_blocks:
                    clock.value = _clock_before


@cache
def _clock() -> ctypes.c_void_p | None:
    """Returns MuJoCo's global `mjcb_time`; None if it cannot be located."""
    for library in sorted(Path(mujoco.__file__).parent.glob("libmujoco*")):
        with suppress(OSError, ValueError):
            return ctypes.c_void_p.in_dll(ctypes.CDLL(str(library)), "mjcb_time")
    return None


# The versions of the files whose contents the asset cache may hold; None where a file may change unnoticed.
_compiled_files: dict[str, list[int] | None] = {}
_compiles_alone = False


def keep_assets() -> None:
    """Keeps the assets of all models in a process in which nothing compiles files except after `drop_outdated_assets`.

    Elsewhere, MuJoCo's cache may hold an earlier content of each file that has not been passed to that function.
    """
    global _compiles_alone
    _compiles_alone = True


def drop_outdated_assets(files: Mapping[str, os.stat_result]) -> None:
    """Empties MuJoCo's cache of meshes, textures and height fields if it may hold other contents of these files.

    MuJoCo compares paths and times in whole seconds: of a file that is written twice within a second, or whose time is
    restored, it would compile the first content again.

    Args:
      files: the status of each file of the model that is compiled next.
    """
    now, is_outdated = time.time_ns(), False
    for path, status in files.items():
        version = version_of(status)
        path = os.path.abspath(path)  # noqa: PTH100 – of thousands; pathlib takes longer
        is_outdated |= _compiled_files.get(path, version if _compiles_alone else None) != version
        _compiled_files[path] = version if is_settled(version, now) else None
    if is_outdated:
        mujoco.mj_clearCache(mujoco.mj_getCache())


def refuse_python_callbacks() -> None:
    """Requires that no Python function is installed as a callback of the physics, as by `mujoco.set_mjcb_control`.

    It would change some simulations of this process, and none in other processes.

    Raises:
      UsageError: one is installed.
    """
    for name in CALLBACKS:
        function = getattr(mujoco, f"get_mjcb_{name}")()
        if function is not None and not isinstance(function, _C_FUNCTION):
            advice = f"uninstall it with mujoco.set_mjcb_{name}(None)"
            if name == "control":
                advice += f"; {option('controller')} accepts functions"
            raise UsageError(f"mjcb_{name} is a Python function, which mjrun does not support\n{advice}")


@contextmanager
def reported_warnings(reporter: Reporter) -> Generator[None]:
    """Reports MuJoCo's warnings inside the block to `reporter` when it ends."""
    warned: list[str] = []
    try:
        with collected_warnings() as warned:
            yield
    finally:
        report_warnings(warned, reporter)


def report_warnings(texts: Iterable[str], reporter: Reporter) -> None:
    """Reports MuJoCo's warnings to `reporter`, one per line."""
    for text in texts:
        reporter.warn(f"MuJoCo: {clean('; '.join(text.splitlines()))}")


@contextmanager
def collected_warnings() -> Generator[list[str]]:
    """Collects MuJoCo's warnings inside the block, each text once, in order; the list is filled when the block ends.

    These are the warnings of the engine, and those that the bindings raise as Python warnings. Within the block MuJoCo
    does not write MUJOCO_LOG.TXT into the working directory. Threads may have blocks at once, which end in any order.
    """
    collector = _Collector()
    _enter(collector)
    texts: list[str] = []
    try:
        yield texts
    finally:
        _leave(collector)
        for warning in collector.others:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
        # The bindings report an attach conflict twice: the whole text, and its first line.
        found = collector.texts
        texts.extend(t for t in found if not any(other.startswith(f"{t}\n") for other in found))


def warn_again(texts: Iterable[str]) -> None:
    """Passes collected warnings to the block around, or to Python where none is open."""
    report = mujoco.get_mju_user_warning()
    for text in texts:
        if report:
            report(text)
        else:
            warnings.warn(text, stacklevel=3)


class _Collector:
    """The warnings of one block: texts of MuJoCo's, and others, which are raised again after it."""

    def __init__(self) -> None:
        self.thread = threading.get_ident()
        self.texts: dict[str, None] = {}
        self.others: list[warnings.WarningMessage] = []


# MuJoCo's handler of warnings, its log and Python's filters belong to the process: the first block takes them over,
# the last one that ends puts them back.
_open_blocks, _taken_over = list[_Collector](), ExitStack()


def _enter(collector: _Collector) -> None:
    with _lock:
        if not _open_blocks:
            _taken_over.callback(mujoco.set_mju_user_warning, mujoco.get_mju_user_warning())
            _taken_over.enter_context(without_log())
            _taken_over.enter_context(warnings.catch_warnings())
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = _note_warning
            mujoco.set_mju_user_warning(_note)
        _open_blocks.append(collector)


def _leave(collector: _Collector) -> None:
    with _lock:
        if len(_open_blocks) == 1:
            _taken_over.close()
        _open_blocks.remove(collector)


def _innermost() -> _Collector:
    """Returns the innermost block of this thread; for a thread without blocks, which MuJoCo started, any innermost."""
    blocks = _open_blocks[:]
    return next((each for each in reversed(blocks) if each.thread == threading.get_ident()), blocks[-1])


def _note(text: str) -> None:
    _innermost().texts[text.strip()] = None


def _note_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: object, **__: object
) -> None:
    if issubclass(category, UserWarning) and not issubclass(category, MjrunWarning):
        _note(str(message))
    else:
        _innermost().others.append(warnings.WarningMessage(message, category, filename, lineno))
