"""Whole videos of whole simulations, against a bare MuJoCo loop."""

import json
import subprocess
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import imageio.v3 as iio
import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import BadValueError, MjrunError, MjrunWarning, NoRendererError, UnknownNameError, UnstableError
from mjrun.outputs import frame_drawing, perform
from mjrun.outputs.image import Image
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.reporters import RecordingReporter

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")

SIZE = (64, 48)
SCENES = Path(__file__).parents[2] / "scenes"


@pytest.mark.parametrize(
    ("fps", "speed", "duration"), [(30, 1, "0.1"), (100, Fraction(1, 10), "0.006"), ("30000/1001", 2, "0.3")]
)
@pytest.mark.slow
def test_frame_k_is_exactly_its_step_of_a_bare_loop(
    swing: Path, tmp_path: Path, still: Callable, fps: float | str, speed: Fraction | int, duration: str
) -> None:
    simulation = Simulation(swing, duration=duration, qvel={"hinge": 3})
    result = Video(simulation, f"{tmp_path}/f/", camera="side", size=SIZE, fps=fps, speed=speed).run()
    period = Fraction(speed) / Fraction(fps)
    count = -(-Fraction(duration) // period)
    steps = [int(k * period / Fraction(1, 500) + Fraction(1, 2)) for k in range(count)]
    expected = []
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    data.joint("hinge").qvel = 3
    for step in range(steps[-1] + 1):
        for _ in range(steps.count(step)):
            shown = mujoco.MjData(model)
            mujoco.mj_copyData(shown, model, data)
            mujoco.mj_forward(model, shown)
            expected.append(still(model, shown, SIZE, "side"))
        mujoco.mj_step(model, data)
    found = [iio.imread(file) for file in sorted((tmp_path / "f").iterdir())]
    assert result.frames == count == len(found)
    assert np.array_equal(np.stack(found), np.stack(expected))


def test_half_a_second_of_humanoid_at_thirty_fps_is_fifteen_frames(
    shared_models: Path, tmp_path: Path, decode: Callable
) -> None:
    simulation = Simulation(shared_models / "humanoid/humanoid.xml", key="squat", duration=0.5)
    result = Video(simulation, str(tmp_path / "h.mp4"), size=SIZE, fps=30, quality="draft").run()
    decoded = decode(tmp_path / "h.mp4")
    assert result.frames == len(decoded.frames) == 15
    assert result.steps == 100
    assert result.duration == result.simulated == Fraction(1, 2)


SHARED = Path(__file__).parents[3] / "shared/models"
# One for each kind of object that is drawn: flexes of two and three dimensions, meshes with textures, tendons, sensors
# of plugins, sliders and cranks, many bodies.
DRAWN = ("balloons", "cube_3x3x3", "flag", "pancake", "mug", "touch_grid", "tendon", "slider_crank", "22_humanoids")
MODELS = sorted(path for path in SHARED.rglob("*.xml") if path.stem in DRAWN)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")
@pytest.mark.parametrize("model", MODELS, ids=[path.stem for path in MODELS])
def test_models_that_nobody_here_wrote_become_videos(model: Path, tmp_path: Path) -> None:
    simulation = Simulation(model, steps=5)
    result = Video(simulation, str(tmp_path / "f.mp4"), size=SIZE, fps=2, quality="draft").run()
    assert result.frames == 1
    assert (tmp_path / "f.mp4").stat().st_size > 0


def test_the_tippe_top_is_seen_to_turn_over(tmp_path: Path) -> None:
    simulation = Simulation(SCENES / "tippe_top.xml", key="spinning", duration=7)
    Video(simulation, f"{tmp_path}/f/", camera="closeup", size=(160, 120), fps="2/7", quality="draft").run()
    Video(
        Simulation(SCENES / "tippe_top.xml", key="spinning", duration="7.001"),
        f"{tmp_path}/end/", camera="closeup", size=(160, 120), fps="1/7", quality="draft",
    ).run()  # fmt: skip

    def rows(picture: Path) -> tuple[float, float]:
        """Mean rows of the brown stem and of the orange ball."""
        red, green, blue = iio.imread(picture).astype(int).transpose(2, 0, 1)
        stem = (red > 60) & (abs(red - 1.35 * green) < 12) & (green > 1.3 * blue) & (red < 200)
        ball = (red > 150) & (blue < 90) & ~stem
        assert stem.sum() > 10
        return stem.nonzero()[0].mean(), ball.nonzero()[0].mean()

    stem, ball = rows(tmp_path / "f/000000.png")
    assert stem < ball
    stem, ball = rows(tmp_path / "end/000001.png")
    assert stem > ball


def test_an_unstable_simulation_publishes_nothing_and_keeps_the_old_video(exploding: Path, tmp_path: Path) -> None:
    old = tmp_path / "video.mp4"
    old.write_text("old")
    with pytest.raises(UnstableError, match="joint 'a'"):
        Video(Simulation(exploding, key="fast", duration=5), str(old), size=SIZE, quality="draft").run()
    assert old.read_text() == "old"


@cases("wrong")
def test_what_is_wrong_is_refused_before_the_first_step(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: dict
) -> None:
    def stepped(*_: object) -> None:
        raise AssertionError("a step was taken")

    monkeypatch.setattr(perform, "run_with_taps", stepped)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MjrunError) as caught:
        Video(**{"simulation": Simulation(swing), "output": "video.mp4", "size": SIZE, **wrong}).run()
    assert caught.value.exit_code in (2, 7)
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def test_without_a_renderer_nothing_is_left(swing: Path, tmp_path: Path) -> None:
    with pytest.raises(NoRendererError):
        Video(Simulation(swing), str(tmp_path / "video.mp4"), gl="off").run()
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def test_software_rendering_is_reported_once_with_its_cost(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_drawing, "LONG", 0.0)
    reporter = RecordingReporter()
    job = Video(Simulation(swing, duration="0.2"), str(tmp_path / "f.mp4"), size=(63, 48), fps=20)
    result = job.run(reporter)
    assert reporter.steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert sum("software rendering" in text and "ms per frame" in text for text in reporter.texts) == result.software
    assert "h264 needs even sides: the video is padded from 63x48 to 64x48" in reporter.texts
    assert result.size == (64, 48)

    refused = RecordingReporter()
    with pytest.raises(BadValueError, match="size: '1x1' is not at least 16x16"):
        replace(job, size=(1, 1)).run(refused)
    assert not any("padded" in text for text in refused.texts)


def test_warnings_of_mujoco_reach_the_result_and_no_log_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = tmp_path / "singular.xml"
    model.write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint axis="0 1 0"/><joint axis="0 1 0"/>'
        '<geom size=".05" pos=".1 0 0"/></body></worldbody></mujoco>'
    )
    monkeypatch.chdir(tmp_path)
    with pytest.warns(UserWarning, match="MuJoCo: "):
        result = Video(Simulation(model, duration="0.1"), "f.mp4", size=SIZE, fps=10, quality="draft").run()
    assert any("singular" in text for text in result.warnings)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["f.mp4", "singular.xml"]


def test_the_python_interface_is_the_same_job(tmp_path: Path, swing: Path, decode: Callable) -> None:
    model = mjrun.load(swing, timestep=0.001)
    run = mjrun.Simulation(model, duration=0.1, qpos={"hinge": 0.5})
    result = mjrun.Video(run, str(tmp_path / "f.mp4"), camera="side", size=SIZE, fps=50).run()
    assert isinstance(result, mjrun.VideoResult)
    assert (result.frames, result.steps) == (5, 100)
    assert len(decode(tmp_path / "f.mp4").frames) == 5
    assert model.opt.timestep == 0.001
    assert not model.opt.disableflags


def test_an_unknown_name_in_the_python_interface_lists_the_known_ones() -> None:
    with pytest.raises(AttributeError, match="no attribute 'vidoe'"):
        mjrun.vidoe  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(UnknownNameError):
        mjrun.Visual(show=["nonsense"])
    assert set(mjrun.__all__) <= set(dir(mjrun))


def frames_of(folder: Path) -> np.ndarray:
    return np.stack([iio.imread(file) for file in sorted(folder.iterdir())])


@pytest.mark.slow
def test_pixels_are_the_same_for_any_number_of_processes(swing: Path, tmp_path: Path) -> None:
    found = []
    for jobs in (1, 2):
        output = tmp_path / f"{jobs}/"
        views = {"view": ["rgb", "depth", "seg"], "camera": ["side", "orbit:azimuth=0..90"], "text": "{time:.2f} s"}
        result = Video(Simulation(swing, duration=0.15), f"{output}/", size=SIZE, jobs=jobs, **views).run()  # type: ignore[arg-type]
        assert result.jobs == jobs
        found.append(frames_of(output))
    assert len(found[0]) == 5
    assert np.array_equal(*found)


def test_separate_views_are_videos_of_the_same_instants(swing: Path, tmp_path: Path, decode: Callable) -> None:
    job = Video(Simulation(swing, duration=0.2), f"{tmp_path}/v.mkv", size=SIZE, camera="side", view=["rgb", "seg"])
    result = replace(job, separate=True).run()
    assert [Path(path).name for path in result.paths] == ["v-rgb.mkv", "v-seg.mkv", "v-seg.labels.json"]
    colors = [len(np.unique(f.reshape(-1, 3), axis=0)) for f in decode(tmp_path / "v-seg.mkv").frames]
    assert set(colors) == {4}  # floor, box, ball, nothing: to the bit
    said = {
        tuple(label["rgb"]): label["name"]
        for label in json.loads((tmp_path / "v-seg.labels.json").read_text())["labels"]
    }
    shown = np.unique(decode(tmp_path / "v-seg.mkv").frames[0].reshape(-1, 3), axis=0)
    assert {said.get(tuple(color.tolist())) for color in shown} == {"floor", "box", "ball", None}
    assert len(decode(tmp_path / "v-rgb.mkv").frames) == len(colors) == 6


@pytest.mark.parametrize("output", ["d.mkv", "d/"])
@pytest.mark.parametrize("view", ["depth", "seg"])
def test_numbers_of_a_video_are_those_of_stills(swing: Path, tmp_path: Path, output: str, view: str) -> None:
    options = {"size": SIZE, "camera": "side", "view": view, "style": "exact"}
    Video(Simulation(swing, duration=0.2), f"{tmp_path}/{output}", fps=10, **options).run()  # type: ignore[arg-type]
    if output == "d/":
        found = np.stack([np.array(iio.imread(file)) for file in sorted((tmp_path / "d").iterdir())])
    else:
        found = gray16(tmp_path / output)
    for index in (0, 1):
        still = tmp_path / f"{index}.png"
        Image(Simulation(swing), str(still), time=index / 10, **options).run()  # type: ignore[arg-type]
        assert np.array_equal(found[index], iio.imread(still))
    assert len(found) == 2
    assert (tmp_path / "d.labels.json").exists() == (view == "seg")


def gray16(video: Path) -> np.ndarray:
    """The frames of a video of 16-bit numbers."""
    program = imageio_ffmpeg.get_ffmpeg_exe()
    raw = ["-f", "rawvideo", "-pix_fmt", "gray16le", "-"]
    done = subprocess.run([program, "-v", "error", "-i", str(video), *raw], capture_output=True, check=True)
    return np.frombuffer(done.stdout, "<u2").reshape(-1, SIZE[1], SIZE[0])


@cases("how, said")
def test_views_that_a_video_cannot_hold_are_refused(
    swing: Path, tmp_path: Path, how: dict[str, object], said: str
) -> None:
    output = str(how.pop("output"))
    target = output if output == "-" else f"{tmp_path}/{output}"
    with pytest.raises(MjrunError, match=said):
        Video(Simulation(swing, duration=0.1), target, size=SIZE, **how).run()  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def test_a_lossy_codec_may_be_asked_for_a_segmentation(swing: Path, tmp_path: Path) -> None:
    job = Video(Simulation(swing, duration=0.1), f"{tmp_path}/s.webm", size=SIZE, view="seg", codec="vp9")
    assert job.run().codec == "vp9"


def test_depth_beyond_sixteen_bits_is_reported(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="box" size="99 99 1"/><camera name="c" pos="0 0 90"/></worldbody></mujoco>'
    )
    job = Video(
        Simulation(model, duration=0.05), f"{tmp_path}/d.mkv", size=SIZE, view="depth", style="exact", camera="c"
    )
    with pytest.warns(MjrunWarning, match="100.00 % of the pixels are at 65.535 m or beyond"):
        job.run()
