"""Theorems about MuJoCo's own voice: heard once, shown nowhere else, and left as it was."""

import threading
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import mujoco
import pytest

from mjrun.errors import MjrunWarning
from mjrun.model.mujoco_globals import collected_warnings, without_log, without_timers

SUSPECT = '<mujoco><option timestep="nan"/></mujoco>'
NAN = "XML contains a 'NaN'. Please check it carefully."
DIVERGING = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint type="slide"/><geom size="1"/></body></worldbody></mujoco>'
)


@pytest.fixture(autouse=True)
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mujoco_log: None) -> Path:
    """An empty working directory, into which MuJoCo writes its log."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def diverge() -> None:
    """Makes the engine warn."""
    data = mujoco.MjData(DIVERGING)
    data.qvel[0] = 1e11
    mujoco.mj_step(DIVERGING, data)


def warn() -> None:
    """Makes the parser warn."""
    mujoco.MjSpec.from_string(SUSPECT)


def say(text: str) -> None:
    warnings.warn(text, UserWarning, stacklevel=1)


@pytest.mark.parametrize(
    ("causes", "heard"),
    [
        ([warn, diverge], [NAN, "QVEL at DOF 0"]),
        ([warn, warn], [NAN]),
        ([lambda: mujoco.MjSpec.from_string("<mujoco/>")], []),
        ([lambda: say("huge value at DOF 12"), lambda: say("huge value at DOF 1")], ["at DOF 12", "at DOF 1"]),
    ],
)
def test_warnings_of_engine_and_parser_are_collected_once_and_in_order(
    causes: list[Callable[[], object]], heard: list[str]
) -> None:
    with collected_warnings() as texts:
        for cause in causes:
            cause()
    assert len(texts) == len(heard)
    assert all(expected in text for expected, text in zip(heard, texts, strict=True))


def test_a_conflict_that_the_bindings_report_two_ways_is_heard_once_and_whole(workplace: Path) -> None:
    child = """<mujoco><option timestep=".01"/>
<worldbody><body name="c"><geom size="1"/></body></worldbody></mujoco>"""
    (workplace / "child.xml").write_text(child)
    parent = """<mujoco><asset><model name="x" file="child.xml"/></asset>
<worldbody><attach model="x" prefix="p" body="c"/></worldbody></mujoco>"""
    (workplace / "parent.xml").write_text(parent)
    with collected_warnings() as heard:
        mujoco.MjSpec.from_file("parent.xml").compile()
    assert len(heard) == 1
    assert heard[0].startswith("Attach conflict")
    assert "timestep: parent has 0.002" in heard[0]


def test_nothing_is_printed_nor_logged_inside_and_the_log_comes_back_outside(
    workplace: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with collected_warnings() as heard:
        diverge()
        assert not mujoco.MjLogConfig.get().logto_file
    assert heard
    assert capfd.readouterr() == ("", "")
    assert list(workplace.iterdir()) == []
    diverge()
    assert "QVEL" in "".join(capfd.readouterr())
    assert [path.name for path in workplace.iterdir()] == ["MUJOCO_LOG.TXT"]


def test_the_handler_that_was_there_is_put_back_and_did_not_hear() -> None:
    mine: list[str] = []
    mujoco.set_mju_user_warning(mine.append)
    try:
        with collected_warnings():
            diverge()
        assert mine == []
        diverge()
        assert len(mine) == 1
    finally:
        mujoco.set_mju_user_warning(None)


def test_warnings_are_kept_and_handlers_put_back_when_the_block_fails() -> None:
    found: list[list[str]] = []

    def fail() -> None:
        with collected_warnings() as heard:
            found.append(heard)
            warn()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert found == [[NAN]]
    assert mujoco.get_mju_user_warning() is None
    assert mujoco.MjLogConfig.get().logto_file


def test_an_inner_block_hears_its_own_and_the_outer_the_rest() -> None:
    with collected_warnings() as outer:
        with collected_warnings() as inner:
            diverge()
        warn()
    assert len(inner) == 1
    assert outer == [NAN]


def test_blocks_of_threads_that_overlap_hear_their_own_and_restore_everything() -> None:
    filters, turns = warnings.filters[:], [threading.Event() for _ in range(3)]
    heard: dict[str, list[str]] = {}

    def first() -> None:
        with collected_warnings() as heard["first"]:
            turns[0].set()
            turns[1].wait(60)
            diverge()
        turns[2].set()

    thread = threading.Thread(target=first)
    thread.start()
    turns[0].wait(60)
    with collected_warnings() as heard["second"]:  # opened after the other, closed after it
        turns[1].set()
        turns[2].wait(60)
        warn()
        say("look")
    thread.join()
    assert "QVEL at DOF 0" in heard["first"][0]
    assert (len(heard["first"]), heard["second"]) == (1, [NAN, "look"])
    assert mujoco.get_mju_user_warning() is None
    assert mujoco.MjLogConfig.get().logto_file
    assert warnings.filters == filters


def test_a_python_warning_of_the_user_is_heard_and_one_for_developers_continues() -> None:
    def both() -> list[str]:
        with collected_warnings() as heard:
            warnings.warn("look", UserWarning, stacklevel=1)
            warnings.warn("old", DeprecationWarning, stacklevel=1)
        return heard

    with pytest.warns(DeprecationWarning, match="old"):
        assert both() == ["look"]


def test_a_warning_of_mjruns_own_continues() -> None:
    def own() -> list[str]:
        with collected_warnings() as heard:
            warnings.warn("slow", MjrunWarning, stacklevel=1)
        return heard

    with pytest.warns(MjrunWarning, match="slow"):
        assert own() == []


def test_timers_are_off_inside_and_as_they_were_after() -> None:
    def timed() -> float:
        model = mujoco.MjModel.from_xml_string(
            "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
        )
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=100)
        return data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration

    assert timed() > 0
    with without_timers():
        assert timed() == 0
    assert timed() > 0


def test_a_clock_of_one_s_own_comes_back() -> None:
    ticks = iter(range(10**6))
    mujoco.set_mjcb_time(lambda: float(next(ticks)))
    try:
        with without_timers():
            model = mujoco.MjModel.from_xml_string("<mujoco/>")
            mujoco.mj_step(model, mujoco.MjData(model))
            assert next(ticks) == 0
        mujoco.mj_step(model, mujoco.MjData(model))
        assert next(ticks) > 1
    finally:
        mujoco.set_mjcb_time(None)


@pytest.mark.parametrize("first", [0, 1])
def test_blocks_of_threads_end_in_any_order(first: int) -> None:
    def is_timed() -> bool:
        model = mujoco.MjModel.from_xml_string("<mujoco/>")
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=100)
        return data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration > 0

    def facts() -> tuple[bool, bool]:
        return mujoco.MjLogConfig.get().logto_file, is_timed()

    before, blocks = facts(), [ExitStack(), ExitStack()]
    for block in blocks:
        block.enter_context(without_timers())
        block.enter_context(without_log())
    inside = facts()
    blocks[first].close()
    assert facts() == inside == (False, False)
    blocks[1 - first].close()
    assert facts() == before == (True, True)
