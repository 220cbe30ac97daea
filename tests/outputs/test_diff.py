"""The comparison as a job."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.diff import file_kind
from mjrun.errors import ModelNotFoundError, UsageError
from mjrun.model.sources import parse_source
from mjrun.outputs.diff import APPLICABLE, COMPARISONS
from tests.diff.models import CRATE, spec, xml
from tests.formats.table_files import columns, write


def test_two_tables_agree_or_not(tmp_path: Path) -> None:
    names = columns("time", "x")
    a = write(tmp_path / "a.csv", [np.array([[0.0, 1], [1, 2]])], names)
    b = write(tmp_path / "b.npz", [np.array([[0.0, 1], [1, 2.5]])], names)
    result = mjrun.Diff(a, b).run()
    assert (result.kind, result.a, result.b, result.equal) == ("table", str(a), str(b), False)
    assert result.differences == ["x differs in row 1, time 1.0 s: 2.0, not 2.5"]
    assert result.table
    assert mjrun.Diff(a, b, atol=0.5).run().equal


def test_a_kind_of_files_is_told_before_anything_is_read() -> None:
    assert set(COMPARISONS) <= {file_kind.TABLE, file_kind.RECORDING, file_kind.VIDEO, file_kind.IMAGE, file_kind.MODEL}
    with pytest.raises(UsageError, match="only results of the same kind can be compared"):
        mjrun.Diff("a.csv", "b.mp4").run()


def test_two_models_agree_or_not(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(xml())
    (tmp_path / "b.xml").write_text(xml().replace("8.907", "8.908"))
    a, b = tmp_path / "a.xml", tmp_path / "b.xml"
    result = mjrun.Diff(a, b).run()
    assert (result.kind, result.a, result.b, result.equal) == ("model", str(a), str(b), False)
    assert result.differences == ["body_mass[torso] 8.907 → 8.908 kg"]
    assert result.model
    assert [place.line for place in (result.model.xml[0].place_a, result.model.xml[0].place_b) if place] == [15, 15]
    assert mjrun.Diff(a, b, tol={"body_mass": 0.01}, rtol=0.01).run().equal
    assert mjrun.Diff(a, str(a)).run().equal


def test_models_may_be_compiled_and_out_of_a_collection() -> None:
    assert mjrun.Diff("scene:pendulum", parse_source("scene:pendulum")).run().equal
    result = mjrun.Diff(spec().compile(), spec(CRATE).compile()).run()
    assert result.differences == ["only in a compiled model: body crate; joint crate; geom lid"]


def test_options_that_mean_nothing_for_models() -> None:
    with pytest.raises(UsageError, match="columns does not apply to models"):
        mjrun.Diff("scene:pendulum", "scene:car", columns=("qpos",)).run()
    with pytest.raises(UsageError, match="no field 'qpos'"):
        mjrun.Diff("scene:pendulum", "scene:car", tol={"qpos": 1}).run()
    with pytest.raises(UsageError, match=r"is a model and x\.csv is a table"):
        mjrun.Diff("scene:pendulum", "x.csv").run()
    with pytest.raises(ModelNotFoundError, match="no such scene"):
        mjrun.Diff("scene:pendulum", "scene:nothing").run()


def test_two_videos_agree_within_limits_and_their_worst_frame_is_drawn(tmp_path: Path) -> None:
    frames = np.zeros((4, 32, 48, 3), np.uint8)
    frames[2, 8:16] = 90
    mjrun.write_video(str(tmp_path / "a.mp4"), frames, 10)
    mjrun.write_video(str(tmp_path / "b.mp4"), frames[::-1], 10)
    pair = tmp_path / "a.mp4", tmp_path / "b.mp4"
    worst = tmp_path / "worst.png"
    result = mjrun.Diff(*pair, output=worst).run()
    assert (result.kind, result.equal) == ("video", False)
    assert result.differences[0] == "2 of 4 frames differ"
    assert worst.exists()
    assert mjrun.Diff(*pair, max_changed=0.5).run().equal


def test_two_images_and_two_recordings_are_compared(tmp_path: Path) -> None:
    Image.new("RGB", (9, 9)).save(tmp_path / "a.png")
    Image.new("RGB", (9, 9), (0, 0, 1)).save(tmp_path / "b.png")
    result = mjrun.Diff(tmp_path / "a.png", tmp_path / "b.png").run()
    assert (result.kind, len(result.differences)) == ("image", 1)
    assert mjrun.Diff(tmp_path / "a.png", tmp_path / "b.png", atol=1).run().equal

    simulation = mjrun.Simulation("scene:dominos", steps=3)
    mjrun.Recording(simulation, str(tmp_path / "a.npz")).run()
    result = mjrun.Diff(tmp_path / "a.npz", tmp_path / "a.npz", model="scene:dominos").run()
    assert (result.kind, result.equal) == ("recording", True)
    assert result.table
    assert "qpos/" in result.table.columns[0].name or result.table.rows == 4


def test_an_option_that_does_not_apply_is_refused(tmp_path: Path) -> None:
    assert set(COMPARISONS) <= set(APPLICABLE)
    with pytest.raises(UsageError, match=r"min_psnr does not apply to tables"):
        mjrun.Diff("a.csv", "b.csv", min_psnr=3).run()
    with pytest.raises(UsageError, match="columns does not apply to images"):
        mjrun.Diff("a.png", "b.png", columns="x").run()
