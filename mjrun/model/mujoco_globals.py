"""MuJoCo's process-wide state: disables its log file and timers, and collects its warnings instead of printing them."""

import ctypes
import warnings
from collections.abc import Generator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import mujoco

from mjrun.errors import MjrunWarning
from mjrun.reporter import Reporter, pass_on


@contextmanager
def without_log() -> Generator[None]:
    """Prevents MuJoCo from writing MUJOCO_LOG.TXT into the working directory."""
    log = mujoco.MjLogConfig.get()
    to_file, log.logto_file = log.logto_file, False
    log.set()
    try:
        yield
    finally:
        log.logto_file = to_file
        log.set()


class without_timers:  # noqa: N801 - a context manager, and a class because it is entered once a step
    """A context in which MuJoCo does not read the clock dozens of times per step for its profile, which mjrun ignores.

    The Python bindings install a clock, and `set_mjcb_time(None)` only restores it. Without it, a step is as fast as
    in C: for small models it takes a fifth to a half less time.
    """

    def __enter__(self) -> None:
        self._clock = clock = _clock()
        if clock is not None:
            self._callback, clock.value = clock.value, None

    def __exit__(self, *error: object) -> None:
        if self._clock is not None:
            self._clock.value = self._callback


@cache
def _clock() -> ctypes.c_void_p | None:
    """Returns MuJoCo's global `mjcb_time`; None if it cannot be located."""
    for library in sorted(Path(mujoco.__file__).parent.glob("libmujoco*")):
        with suppress(OSError, ValueError):
            return ctypes.c_void_p.in_dll(ctypes.CDLL(str(library)), "mjcb_time")
    return None


@contextmanager
def reported_warnings(reporter: Reporter) -> Generator[None]:
    """Reports MuJoCo's warnings inside the block to `reporter` when it ends."""
    warned: list[str] = []
    try:
        with collected_warnings() as warned:
            yield
    finally:
        pass_on(warned, reporter)


@contextmanager
def collected_warnings() -> Generator[list[str]]:
    """Collects MuJoCo's warnings inside the block, each text once, in order; the list is filled when the block ends.

    These are the warnings of the engine, and those that the bindings raise as Python warnings. Within the block MuJoCo
    does not write MUJOCO_LOG.TXT into the working directory.
    """
    messages: dict[str, None] = {}

    def note(text: str) -> None:
        messages[text.strip()] = None

    previous = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(note)
    texts: list[str] = []
    caught: list[warnings.WarningMessage] = []
    try:
        with without_log(), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            yield texts
    finally:
        mujoco.set_mju_user_warning(previous)
        for warning in caught:
            if issubclass(warning.category, UserWarning) and not issubclass(warning.category, MjrunWarning):
                note(str(warning.message))
            else:
                warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
        # The bindings report an attach conflict twice: the whole text, and its first line.
        texts.extend(t for t in messages if not any(other.startswith(f"{t}\n") for other in messages))
