"""The judge of two states finds a single pixel and a single bit, and passes over metadata and wall times."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pyarrow
import pytest
import scipy.io
from PIL import Image, PngImagePlugin
from pyarrow import feather, parquet

sys.path.append(str(Path(__file__).parents[2]))

from scripts.compare_states import Command, State, commands, difference, pair

ROOT = Path(__file__).parents[2]
FRAMES = np.random.default_rng(0).integers(0, 256, (3, 8, 10, 3), np.uint8)
VALUES = np.array([0.1, -0.0, np.nan, np.inf, 1e300])


def _video(path: Path, frames: np.ndarray, comment: str) -> None:
    ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "10x8"]
    lossless = ["-i", "-", "-c:v", "ffv1", "-pix_fmt", "bgr0", "-metadata", f"comment={comment}", str(path)]
    subprocess.run([*ffmpeg, *lossless], input=frames.tobytes(), check=True)


def _png(path: Path, frames: np.ndarray, comment: str) -> None:
    text = PngImagePlugin.PngInfo()
    text.add_text("comment", comment)
    Image.fromarray(frames[1]).save(path, pnginfo=text)


def _webp(path: Path, frames: np.ndarray, comment: str) -> None:
    first, *rest = (Image.fromarray(frame) for frame in frames)
    first.save(path, save_all=True, append_images=rest, lossless=True, exif=comment.encode())


@pytest.mark.parametrize(("suffix", "write"), [("mkv", _video), ("png", _png), ("webp", _webp)])
def test_one_pixel_that_is_one_brighter_is_found_and_metadata_is_not(
    suffix: str, write: Callable[[Path, np.ndarray, str], None], tmp_path: Path
) -> None:
    old, same, other = (tmp_path / f"{name}.{suffix}" for name in ("old", "same", "other"))
    changed = FRAMES.copy()
    changed[1, 4, 5, 2] ^= 1
    write(old, FRAMES, "before")
    write(same, FRAMES, "after")
    write(other, changed, "before")
    assert old.read_bytes() != same.read_bytes()
    assert difference(old, same) == ""
    assert difference(old, other).endswith(f"first: frame {0 if suffix == 'png' else 1}")


def _npz(path: Path, values: np.ndarray, manifest: str) -> None:
    np.savez(path, qpos=values, manifest=np.array(manifest))


def _mat(path: Path, values: np.ndarray, manifest: str) -> None:
    scipy.io.savemat(path, {"qpos_hinge": values, "manifest": manifest})


def _parquet(path: Path, values: np.ndarray, manifest: str) -> None:
    parquet.write_table(_table(values, manifest), path)


def _feather(path: Path, values: np.ndarray, manifest: str) -> None:
    feather.write_feather(_table(values, manifest), path)


def _table(values: np.ndarray, manifest: str) -> pyarrow.Table:
    columns = {"qpos/hinge": values, "geom1/name": ["floor", "a", "b", "ä", ""]}
    return pyarrow.table(columns).replace_schema_metadata({"mjrun": manifest})


@pytest.mark.parametrize("write", [_npz, _mat, _parquet, _feather])
@pytest.mark.parametrize("row", range(len(VALUES)))
def test_one_bit_of_one_number_is_found_and_the_manifest_is_not(
    write: Callable[[Path, np.ndarray, str], None], row: int, tmp_path: Path
) -> None:
    old, same, other = (tmp_path / f"{name}.{write.__name__[1:]}" for name in ("old", "same", "other"))
    changed = VALUES.copy()
    changed.view(np.uint64)[row] ^= 1
    write(old, VALUES, "before")
    write(same, VALUES, "and after")
    write(other, changed, "before")
    assert old.read_bytes() != same.read_bytes()
    assert difference(old, same) == ""
    assert "first: qpos" in difference(old, other)


def test_the_sign_of_zero_and_the_last_digit_of_a_text_are_found(tmp_path: Path) -> None:
    for name, value, text in (("old", 0.0, "0.1,0.30000000000000004"), ("new", -0.0, "0.1,0.30000000000000003")):
        np.save(tmp_path / f"{name}.npy", np.array([value], np.float32))
        (tmp_path / f"{name}.csv").write_text(text)
    assert difference(tmp_path / "old.npy", tmp_path / "new.npy")
    assert difference(tmp_path / "old.csv", tmp_path / "new.csv")


def test_results_are_compared_without_wall_times_and_manifests_not_at_all(tmp_path: Path) -> None:
    def differ(old: object, new: object) -> bool:
        for name, document in (("old", old), ("new", new)):
            (tmp_path / f"{name}.json").write_text(json.dumps(document))
        return bool(difference(tmp_path / "old.json", tmp_path / "new.json"))

    assert not differ({"frames": 6, "draw_wall": 0.1}, {"frames": 6, "draw_wall": 0.2})
    assert differ({"frames": 6, "wall": 0.1}, {"frames": 7, "wall": 0.1})
    assert differ({"pictures": [{"near": 0.1}]}, {"pictures": [{"near": 0.10000000000000002}]})
    assert not differ({"mjrun": "1", "command": "a"}, {"mjrun": "2", "command": "b"})


def test_a_damaged_file_is_a_difference_and_not_an_end(tmp_path: Path) -> None:
    _png(tmp_path / "old.png", FRAMES, "")
    (tmp_path / "new.png").write_bytes((tmp_path / "old.png").read_bytes()[:60])
    assert difference(tmp_path / "old.png", tmp_path / "new.png")


def test_commands_are_paired_by_their_text_and_the_others_are_reported() -> None:
    old = [Command(f"mjrun {text}") for text in ("run a.yaml films[0].fps=30", "image b.xml", "trace c.xml -o c.csv")]
    new = [Command(f"mjrun {text}") for text in ("trace c.xml -o c.csv --every 2", "run a.yaml videos[0].fps=30", "-V")]
    pairs, missing, added = pair(old, new)
    assert [(each.old, each.new) for each in pairs] == [(old[0], new[1]), (old[2], new[0])]
    assert (missing, added) == ([old[1]], [new[2]])


def test_every_command_of_the_readme_and_every_scene_is_run() -> None:
    found, left_out = commands(ROOT, small=True)
    assert sum(command.text.startswith("mjrun video") for command in found) >= 20
    assert {f"mjrun run scenes/{path.name} -o out" for path in ROOT.glob("scenes/*.yaml")} <= {c.text for c in found}
    assert all(command.startswith(("make ", "pip ")) for command in left_out)


PROGRAM = """
import pathlib, sys
pathlib.Path("top.csv").write_text({table!r})
pathlib.Path("top/parts").mkdir(parents=True)
pathlib.Path("top/parts/{wall}.parquet").touch()
print("mjrun: 3 of {wall:.0f}9 frames", file=sys.stderr)
print("mjrun: 3 of {wall:.0f}9 points", file=sys.stderr)
print("top: 9 points; {wall} s")
print("time,qpos" if "--csv" in sys.argv else "top.csv: {words}; made in {wall} s, by llvmpipe")
sys.exit({exit})
"""


def _checkout(folder: Path, table: str = "1,2", words: str = "1 row", wall: float = 0.1, code: int = 0) -> Path:
    for name in ("mjrun", "scenes"):
        (folder / name).mkdir(parents=True)
    (folder / "mjrun/__init__.py").touch()
    (folder / "README.md").write_text("```sh\nmjrun trace \\\n  top.xml --csv\nmjrun trace top.xml\nmake test\n```\n")
    (folder / "scenes/top.yaml").write_text("films:\n  - {output: top.mp4}\n")
    (folder / "mjrun/__main__.py").write_text(PROGRAM.format(table=table, words=words, wall=wall, exit=code))
    return folder


def _compared(tmp_path: Path, new: Path) -> tuple[int, str]:
    script = [sys.executable, str(ROOT / "scripts/compare_states.py"), str(_checkout(tmp_path / "old")), str(new)]
    done = subprocess.run([*script, "--small", "--cache", str(tmp_path / "cache")], capture_output=True, text=True)
    assert done.stderr == ""
    return done.returncode, done.stdout


def test_states_that_differ_in_wall_times_alone_are_equal(tmp_path: Path) -> None:
    code, table = _compared(tmp_path, _checkout(tmp_path / "new", wall=0.9))
    assert (code, re.findall(r"^\w+", table, re.MULTILINE)) == (0, ["equal", "equal", "equal", "Not", "3"])
    assert "Not run: make test" in table


def test_states_that_differ_in_words_alone_are_not_different(tmp_path: Path) -> None:
    code, table = _compared(tmp_path, _checkout(tmp_path / "new", words="one row"))
    assert code == 0
    assert "prose: top.csv: 1 row; made, by llvmpipe → top.csv: one row; made, by llvmpipe" in table


def test_a_different_table_and_exit_code_are_reported_for_each_command(tmp_path: Path) -> None:
    code, table = _compared(tmp_path, _checkout(tmp_path / "new", table="1,3", code=7))
    assert code == 1
    assert table.count("DIFFERS: top.csv: 1 of 1 parts differ, first: bytes") == 3
    assert table.count("DIFFERS: exit code 0, now 7") == 3


def test_what_is_cached_is_run_once_and_leaves_the_scenes_out(tmp_path: Path) -> None:
    state = State(_checkout(tmp_path / "old"), tmp_path / "store", small=False)
    first = state.run(Command("mjrun trace top.xml > said.txt && date +%N >> said.txt"), cached=True)
    again = state.run(Command("mjrun trace top.xml > said.txt && date +%N >> said.txt"), cached=True)
    assert first == again
    assert sorted(path.name for path in (first.folder / "files").iterdir()) == ["said.txt", "top", "top.csv"]
