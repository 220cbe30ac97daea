"""Films of fits, looked at."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.fitting.measurements import LogSegment
from mjrun.fitting.outputs import FitVideo, VideoStretch
from mjrun.fitting.prediction import Chunk
from mjrun.formats.video_reader import read_video
from mjrun.options.fit import FitOptions
from mjrun.reporter import WarningReporter
from tests.fitting.logs import TRUTH, write_model

SIZE = (64, 48)


def film(folder: Path, measured: np.ndarray, delay: float = 0.0) -> np.ndarray:
    """Frames `(n, 48, 64, 3)` of a model that hangs still, in two logs of half a second with a ghost at `measured`."""
    model = mujoco.MjModel.from_xml_path(str(write_model(folder, **TRUTH)))
    path = folder / "fit.apng"  # which loses nothing
    path.unlink(missing_ok=True)
    options = FitOptions(video=str(path), size=SIZE)
    times = np.arange(51) * 0.01
    logs = [LogSegment(name, times + 3, measured[:, None], np.zeros((51, 1))) for name in "ab"]
    stretches = [VideoStretch(Chunk(log, slice(None), 0, times / 0.002), np.zeros((51, 1))) for log in logs]
    with FitVideo(options, model, ["qpos/hinge"]).writer(model, stretches, [delay], WarningReporter()) as writer:
        assert not path.exists()
        writer.publish()
    return np.stack([np.array(frame, int) for frame in read_video(str(path))])


def test_logs_follow_each_other_and_what_was_measured_is_a_ghost(tmp_path: Path) -> None:
    """It turns 0.3 s after the beginning of each log; if measured 0.2 s late, it turned after 0.1 s."""
    turns = np.where(np.arange(51) < 30, 0.0, 1.5)
    hanging, turned, late = film(tmp_path, 0 * turns), film(tmp_path, turns), film(tmp_path, turns, delay=0.2)
    assert len(hanging) == len(turned) == 31  # 1.01 s at 30 frames a second, and the first
    differ = [(np.abs(each - hanging).max(axis=(1, 2, 3)) > 30).tolist() for each in (turned, late)]
    assert differ[0] == [False] * 9 + [True] * 7 + [False] * 9 + [True] * 6
    assert differ[1][:15] == [False] * 3 + [True] * 12


def test_what_makes_no_video_is_refused_before_anything_is_fitted(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(write_model(tmp_path)))
    with pytest.raises(UsageError, match="no position such as qpos/knee is measured"):
        FitVideo(FitOptions(video="fit.mp4"), model, ["qvel/hinge"])
    for options in ({"video": "fit.xyz"}, {"video": "frames/%03d.png"}, {"video": "fit.mp4", "camera": "nose"}):
        with pytest.raises(UsageError, match=r"xyz|single file|nose"):
            FitVideo(FitOptions(**options), model, ["qpos/hinge"])  # type: ignore[arg-type]
