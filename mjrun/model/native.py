"""MuJoCo's own voice: its log file off, its warnings collected instead of printed."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from mjrun.errors import MjrunWarning


@contextmanager
def without_log() -> Iterator[None]:
    """Keeps MuJoCo from writing MUJOCO_LOG.TXT into the working directory."""
    log = mujoco.MjLogConfig.get()
    to_file, log.logto_file = log.logto_file, False
    log.set()
    try:
        yield
    finally:
        log.logto_file = to_file
        log.set()


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collects what MuJoCo warns of inside the block, each text once, in order.

    Catches the engine's warnings and those that its bindings raise as Python warnings, and keeps
    MuJoCo from writing MUJOCO_LOG.TXT into the working directory.
    """
    heard: dict[str, None] = {}

    def note(text: str) -> None:
        heard[text.strip()] = None

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
        # The bindings raise an attach conflict both ways, once whole and once as its first line.
        texts.extend(t for t in heard if not any(other.startswith(f"{t}\n") for other in heard))
