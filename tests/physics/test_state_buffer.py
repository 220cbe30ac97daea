"""Theorems about recordings: what went in comes out, bit for bit, from memory as from disk."""

import tempfile
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mjrun.errors import FileError
from mjrun.physics import recorded_states
from mjrun.physics.simulation_loop import StateBuffer

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><freejoint/><geom size="1"/></body>
<body pos="5 0 0"><joint/><geom size="1"/></body></worldbody></mujoco>""")
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SIZE = mujoco.mj_stateSize(MODEL, STATE)
STATES = hnp.arrays(np.float64, (SIZE,), elements=st.floats(allow_nan=True, allow_subnormal=True))
ODD = np.resize([np.nan, -np.nan, -0.0, 0.0, np.inf, -np.inf, 5e-324, 1 / 3, 1.7976931348623157e308], SIZE)


def counted(index: int) -> np.ndarray:
    return np.arange(SIZE) + index * 1000.0


@given(st.lists(STATES, max_size=6), st.sampled_from([1, 3 * SIZE * 8, 2**20]))
@example([], 1)
@example([ODD], 1)
@example([ODD], 2**20)
@settings(max_examples=20, deadline=None)
def test_what_went_in_comes_out_bit_for_bit_in_order_in_memory_and_on_disk(
    states: list[np.ndarray], spill: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_states, "SPILL", spill)
        with closing(StateBuffer(MODEL)) as kept:
            for state in states:
                kept.append(state)
            assert len(kept) == len(states)
            assert [(state.tobytes(), state.shape) for state in kept] == [(each.tobytes(), (SIZE,)) for each in states]


def test_many_states_go_to_disk_and_few_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_states, "SPILL", 2 * SIZE * 8)
    with closing(StateBuffer(MODEL)) as kept:
        on_disk = []
        for index in range(4):
            kept.append(counted(index))
            on_disk.append(kept._file._rolled)  # type: ignore[attr-defined]
            assert [state[0] for state in kept] == [1000.0 * i for i in range(index + 1)]
        assert on_disk == [False, False, True, True]


@pytest.mark.parametrize("spill", [1, 2**20])
def test_states_can_be_read_in_any_order_between_writes(monkeypatch: pytest.MonkeyPatch, spill: int) -> None:
    monkeypatch.setattr(recorded_states, "SPILL", spill)
    with closing(StateBuffer(MODEL)) as kept:
        for index in range(5):
            kept.append(counted(index))
            for look in (index, 0, index // 2):
                assert np.array_equal(kept[look], counted(look))


@pytest.mark.parametrize("index", [3, 4, 10**9, -1])
def test_there_is_nothing_before_the_first_nor_behind_the_last(index: int) -> None:
    with closing(StateBuffer(MODEL)) as kept:
        for i in range(3):
            kept.append(counted(i))
        with pytest.raises(IndexError):
            _ = kept[index]
        assert len(kept) == 3


def test_a_state_that_was_appended_may_be_changed_afterwards() -> None:
    state = counted(1)
    with closing(StateBuffer(MODEL)) as kept:
        kept.append(state)
        state[:] = 0
        assert np.array_equal(kept[0], counted(1))


def test_states_that_are_not_contiguous_are_kept_as_they_read() -> None:
    wide = np.stack([counted(1), counted(2)], axis=1)
    with closing(StateBuffer(MODEL)) as kept:
        kept.append(wide[:, 1])
        assert np.array_equal(kept[0], counted(2))


def test_a_recording_is_over_when_it_is_closed() -> None:
    kept = StateBuffer(MODEL)
    kept.append(counted(0))
    kept.close()
    with pytest.raises(ValueError, match="closed"):
        _ = kept[0]


def test_no_file_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_states, "SPILL", 1)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with closing(StateBuffer(MODEL)) as kept:
        kept.append(counted(0))
        assert np.array_equal(kept[0], counted(0))
    assert list(tmp_path.iterdir()) == []


def test_states_that_need_a_folder_where_there_is_none_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_folder() -> str:
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_get_default_tempdir", no_folder)
    monkeypatch.setattr(recorded_states, "SPILL", 1)
    with closing(StateBuffer(MODEL)) as states, pytest.raises(FileError, match="no folder: cannot store the recording"):
        states.append(counted(0))
