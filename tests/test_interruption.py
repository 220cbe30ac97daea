"""Interruptions, raised at once or later."""

import signal
import threading

import pytest

from mjrun.shared_status import interrupt, uninterrupted
from tests.processes import PATIENCE


class EndError(BaseException):
    pass


def test_elsewhere_it_is_raised_at_once() -> None:
    with pytest.raises(EndError):
        interrupt(EndError())


def test_it_waits_for_the_end_of_the_outermost_block_and_is_raised_once() -> None:
    done = list[str]()

    def work() -> None:
        with uninterrupted():
            with uninterrupted():
                interrupt(EndError())
                done.append("inner")
            done.append("outer")

    with pytest.raises(EndError):
        work()
    assert done == ["inner", "outer"]
    with uninterrupted():
        done.append("later")


def test_it_goes_before_what_fails_in_the_block() -> None:
    def work() -> None:
        with uninterrupted():
            interrupt(EndError())
            raise ValueError

    with pytest.raises(EndError) as caught:
        work()
    assert isinstance(caught.value.__context__, ValueError)


def test_a_block_in_another_thread_holds_nothing_up() -> None:
    inside, over = threading.Event(), threading.Event()

    def work() -> None:
        with uninterrupted():
            inside.set()
            over.wait(PATIENCE)

    thread = threading.Thread(target=work)
    thread.start()
    inside.wait(PATIENCE)
    try:
        with pytest.raises(EndError):
            interrupt(EndError())
    finally:
        over.set()
        thread.join()


def test_a_signal_waits() -> None:
    done = list[str]()

    def work() -> None:
        with uninterrupted():
            signal.raise_signal(signal.SIGUSR1)
            done.append("after the signal")

    before = signal.signal(signal.SIGUSR1, lambda *_: interrupt(EndError()))
    try:
        with pytest.raises(EndError):
            work()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert done
