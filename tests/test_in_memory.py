"""Results in memory have the numbers and the pixels of the files that commands write."""

import base64
import contextlib
import copy
import ctypes
import gc
import pickle
import re
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.document.study import read_folder
from mjrun.errors import DrawError, FailedAssertionError, FileError, UnknownNameError, UsageError
from mjrun.in_memory import frames
from mjrun.python_help import OF_FILES
from tests.processes import largest_file

OPTIONS = {"qvel": {"hinge": 3}, "duration": 0.2, "probe": ["energy", "qpos,xpos"]}


@pytest.mark.parametrize("more", [{}, {"every": 7}, {"rate": 100}, {"timestep": 0.001, "integrator": "rk4"}])
def test_a_table_in_memory_is_the_table_in_a_file(swing: Path, tmp_path: Path, more: dict[str, object]) -> None:
    table = mjrun.trace(swing, output=f"{tmp_path}/t.npz", **OPTIONS, **more)  # type: ignore[arg-type]
    alone = mjrun.trace(swing, **OPTIONS, **more)  # type: ignore[arg-type]
    written = mjrun.read_table(tmp_path / "t.npz")
    assert list(table) == list(alone) == list(written)
    assert table.units == alone.units == written.units
    for name in written:
        assert np.array_equal(table[name], written[name])
        assert np.array_equal(alone[name], written[name])


def test_a_simulation_is_traced_as_its_model_is(swing: Path) -> None:
    simulation = mjrun.Simulation(swing, qvel={"hinge": 3}, duration=0.2)
    one, other = mjrun.trace(simulation, probe="qpos"), mjrun.trace(swing, **(OPTIONS | {"probe": "qpos"}))  # type: ignore[arg-type]
    assert all(np.array_equal(one[name], other[name]) for name in other)


@pytest.mark.parametrize("form", ["path", "binary", "model"])
@pytest.mark.parametrize("name", ["control", "passive", "sensor"])
def test_callbacks_that_would_change_only_some_simulations_are_refused(
    swing: Path, tmp_path: Path, form: str, name: str
) -> None:
    compiled = mujoco.MjModel.from_xml_path(str(swing))
    mujoco.mj_saveModel(compiled, str(tmp_path / "swing.mjb"))
    model = {"path": swing, "binary": tmp_path / "swing.mjb", "model": compiled}[form]
    install = getattr(mujoco, f"set_mjcb_{name}")
    expected = re.escape(f"mjcb_{name} is a Python function, which mjrun does not support\nuninstall it with mujoco.")
    install(lambda *arguments: None)
    try:
        with pytest.raises(UsageError, match=expected):
            mjrun.trace(model, duration=0.1, controller=lambda model, data: None)
        with pytest.raises(UsageError, match=expected):
            mjrun.sweep(model, duration=0.1, vary={"qvel/hinge": "1,2"}, metric={"last": "last(qpos/hinge)"})
    finally:
        install(None)
    assert len(mjrun.trace(model, duration=0.1)["time"]) > 1


def test_callbacks_in_c_take_part(swing: Path) -> None:
    calls: list[int] = []
    callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda model, data: calls.append(1))
    mujoco.set_mjcb_control(callback)
    try:
        table = mjrun.trace(swing, duration=0.1)
    finally:
        mujoco.set_mjcb_control(None)
    assert len(calls) >= len(table["time"]) - 1


def test_a_compiled_model_may_change_after_its_simulation_is_made(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    made: list[tuple[mjrun.Simulation, np.ndarray]] = []
    for gravity in (-9.81, -1.62):
        model.opt.gravity[2] = gravity
        data = mujoco.MjData(model)
        data.qvel[0] = 3
        mujoco.mj_step(model, data, nstep=50)
        made.append((mjrun.Simulation(model, qvel={"hinge": 3}, steps=50), data.qpos.copy()))
    for simulation, expected in made:
        assert mjrun.trace(simulation, probe="qpos")["qpos/hinge"][-1] == expected[0]


@pytest.mark.gl
def test_frames_are_those_of_the_model_when_they_were_asked_for(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    options: dict[str, object] = {"qvel": {"hinge": 3}, "duration": 0.1, "size": (48, 32)}
    expected = [*mjrun.frames(model, **options)]  # type: ignore[arg-type]
    pictures = mjrun.frames(model, **options)  # type: ignore[arg-type]
    model.geom_rgba[:] = 1
    np.testing.assert_array_equal([*pictures], expected)


@pytest.mark.gl
def test_frames_stay_the_same_if_other_pictures_are_rendered_between_them(swing: Path) -> None:
    options: dict[str, object] = {"qvel": {"hinge": 3}, "duration": 0.1, "size": (48, 32)}
    expected = [*mjrun.frames(swing, **options)]  # type: ignore[arg-type]
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/></worldbody></mujoco>")
    others, pictures = mjrun.frames(model, duration=1, size=(20, 30)), []
    for picture in mjrun.frames(swing, **options):  # type: ignore[arg-type]
        pictures.append(picture)
        mjrun.render(model, mujoco.MjData(model), size=(30, 20))
        next(others)
    np.testing.assert_array_equal(pictures, expected)

    pictures = mjrun.frames(swing, **options)  # type: ignore[arg-type]
    first = next(pictures)
    others.close()
    np.testing.assert_array_equal([first, *pictures], expected)


@pytest.mark.gl
def test_frames_are_never_wrong_in_another_thread(swing: Path) -> None:
    options: dict[str, object] = {"qvel": {"hinge": 3}, "duration": 0.1, "size": (48, 32)}
    expected = [*mjrun.frames(swing, **options)]  # type: ignore[arg-type]
    pictures = mjrun.frames(swing, **options)  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as first, ThreadPoolExecutor(1) as second:
        first.submit(next, pictures).result()
        with contextlib.suppress(DrawError):  # EGL's contexts belong to one thread
            np.testing.assert_array_equal(second.submit(next, pictures).result(), expected[1])


def test_wrong_options_are_refused_by_name(swing: Path) -> None:
    with pytest.raises(TypeError, match=re.escape("trace: unknown option 'durtion' (did you mean 'duration'?)")):
        mjrun.trace(swing, durtion=1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="trace: the simulation has these options: duration, key"):
        mjrun.trace(mjrun.Simulation(swing, steps=1), duration=1, key=0)
    with pytest.raises(UnknownNameError, match="did you mean 'qpos'"):
        mjrun.trace(swing, probe="qpo", steps=1)
    with pytest.raises(FailedAssertionError):
        mjrun.trace(swing, steps=1, assert_="time < 0")


@pytest.mark.gl
@pytest.mark.parametrize(
    "more",
    [
        {"view": "rgb", "camera": ["side", "free"], "captions": True},
        {"view": "depth"},
        {"view": "seg", "style": "exact"},
        {"view": "depth", "style": "exact"},
    ],
)
def test_frames_in_memory_are_those_of_the_lossless_video(swing: Path, tmp_path: Path, more: dict[str, object]) -> None:
    drawing = {"size": (64, 48), "fps": 20, "speed": 0.5, "jobs": 1, **more}
    simulation = mjrun.Simulation(swing, qvel={"hinge": 3}, duration=0.1)
    made = list(frames(simulation, **drawing))
    file = "f.mkv" if more.get("style") == "exact" else "f/"
    mjrun.Video(simulation, f"{tmp_path}/{file}", **drawing).run()  # type: ignore[arg-type]
    if file == "f/":
        paths = sorted(tmp_path.glob("f/*.png"))
        written = [iio.imread(path) for path in paths]
    else:
        written = list(_lossless(tmp_path / file, made[0].shape))
    assert len(made) == len(written) == 4
    assert made[0].dtype == (np.uint16 if more.get("style") == "exact" else np.uint8)
    for one, other in zip(made, written, strict=True):
        assert np.array_equal(one, other)
    assert not np.array_equal(made[0], made[-1])  # each belongs to the caller


def _lossless(path: Path, shape: tuple[int, ...]) -> list[np.ndarray]:
    """Decodes frames of 16 bits by ffmpeg itself."""
    program = imageio_ffmpeg.get_ffmpeg_exe()
    raw = ["-i", str(path), "-f", "rawvideo", "-pix_fmt", "gray16le", "-"]
    done = subprocess.run([program, "-v", "error", *raw], capture_output=True, check=True)
    return list(np.frombuffer(done.stdout, np.uint16).reshape(-1, *shape))


def test_frames_have_no_options_of_files(swing: Path) -> None:
    for name in OF_FILES:
        with pytest.raises(TypeError, match=f"frames: unknown option '{name}'"):
            frames(swing, **{name: "x"})


def test_a_study_in_memory_has_the_numbers_of_its_folder_and_leaves_nothing(swing: Path, tmp_path: Path) -> None:
    vary = {"qvel/hinge": "1..3:3"}
    chosen = {"vary": vary, "metric": {"far": "max(abs(qpos/hinge))"}, "duration": 0.1, "jobs": 1}
    result = mjrun.sweep(swing, **chosen)  # type: ignore[arg-type]
    kept = mjrun.sweep(mjrun.Simulation(swing, duration=0.1), output=tmp_path / "s", **_without(chosen, "duration"))  # type: ignore[arg-type]
    for index, speed in enumerate([1, 2, 3]):
        alone = mjrun.trace(swing, qvel={"hinge": speed}, duration=0.1, probe="qpos")
        assert result.table["far"][index] == kept.table["far"][index] == np.abs(alone["qpos/hinge"]).max()
    assert "qvel/hinge" in result._repr_html_()
    folder = Path(result.path)
    assert folder.is_dir()
    del result
    assert not folder.exists()
    assert (tmp_path / "s" / "results.csv").is_file()
    again = read_folder(str(tmp_path / "s")).run()
    assert (again.points, again.simulated) == (3, 0)
    assert again.table["far"].tolist() == kept.table["far"].tolist()


def test_copies_of_a_study_in_memory_hold_its_files_and_a_pickle_says_that_it_has_none(swing: Path) -> None:
    result = mjrun.sweep(swing, vary={"qvel/hinge": "1,2"}, metric={"far": "max(qpos/hinge)"}, duration=0.1, jobs=1)
    far, pickled = result.table["far"].tolist(), pickle.dumps(result)
    copies = [copy.copy(result), copy.deepcopy(result)]
    del result
    while copies:
        assert copies.pop().table["far"].tolist() == far
        gc.collect()
    unpickled = pickle.loads(pickled)
    assert unpickled.points == 2
    with pytest.raises(FileError, match=r"has been removed or moved\nwithout output=FOLDER, files exist as long as"):
        _ = unpickled.table


def test_controllers_vary_in_memory(swing: Path) -> None:
    def push(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[0] = 1

    result = mjrun.sweep(
        swing,
        vary={"controller": "none,push"},
        controllers={"none": lambda model, data: None, "push": push},
        metric={"far": "max(abs(qpos/hinge))"},
        duration=0.1,
        jobs=1,
    )
    pushed = mjrun.trace(swing, controller=push, duration=0.1, probe="qpos")
    free = mjrun.trace(swing, duration=0.1, probe="qpos")
    assert result.table["far"].tolist() == [np.abs(each["qpos/hinge"]).max() for each in (free, pushed)]


def test_a_study_in_memory_that_fails_leaves_nothing_or_has_its_files_as_long_as_its_result(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    chosen: dict[str, Any] = {"vary": {"qvel/hinge": "1,2"}, "metric": {"far": "max(qpos/hinge)"}, "duration": 0.1}
    with largest_file(2500), pytest.raises(FileError, match="cannot be written: File too large") as caught:
        mjrun.sweep(swing, **chosen, jobs=1)
    assert caught.value.__notes__ == ["set TMPDIR to another folder"]  # and nothing about what is kept
    del caught
    gc.collect()  # the error, whose traceback refers to itself in Python 3.13
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]
    with pytest.raises(FailedAssertionError) as failed:
        mjrun.sweep(swing, **chosen, jobs=1, require=["far > 9"])
    (result,) = failed.value.results
    assert len(result.table["far"]) == 2
    del failed, result
    gc.collect()
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def _without(options: dict[str, object], name: str) -> dict[str, object]:
    return {key: value for key, value in options.items() if key != name}


def test_an_evaluation_in_memory_has_a_row_for_each_episode(tmp_path: Path) -> None:
    result = mjrun.evaluate("scene:car_drive", policy="zero", episodes=2, seed=3, jobs=1)
    table = result.table
    assert table["seed"].tolist() == [3, 4]
    assert table["return"].mean() == pytest.approx(result.policies[0].returns.mean)
    task = mjrun.read_task("scenes/car_drive.yaml")
    again = mjrun.evaluate(task, policy="zero", episodes=2, seed=3, jobs=1, output=tmp_path / "e")
    assert np.array_equal(again.table["return"], table["return"])


def test_a_fit_in_memory_writes_nothing_and_shows_its_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = {"qvel": {"hinge": 3}, "duration": 1, "rate": 100, "probe": "qpos/hinge"}
    truth = mjrun.trace("scene:pendulum", set={"joint/hinge.damping": 0.2}, **motion)  # type: ignore[arg-type]
    noise = np.random.default_rng(0).normal(0, 1e-4, truth.rows)
    rows = zip(truth["time"], truth["qpos/hinge"] + noise, strict=True)
    lines = [",".join(truth.names), *(",".join(map(repr, map(float, row))) for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    result = mjrun.fit("scene:pendulum", "log.csv", free={"joint/hinge.damping": "0.001..1"})
    (damping,) = result.parameters
    assert damping.low <= 0.2 <= damping.high
    assert damping.high - damping.low < 0.02
    assert f"{damping.value:.4g}" in result._repr_html_()
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.gl
def test_notebooks_show_what_was_made(swing: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(swing, steps=2)
    image = mjrun.Image(simulation, tmp_path / "i.png", size=(64, 48)).run()
    content = re.search('src="data:image/png;base64,([^"]+)"', str(image._repr_html_()))
    assert content
    assert base64.b64decode(content[1]) == (tmp_path / "i.png").read_bytes()
    assert mjrun.Trace(simulation, tmp_path / "t.csv").run()._repr_html_() is None
    video = mjrun.Video(simulation, tmp_path / "v.mp4", size=(64, 48)).run()
    assert re.findall("<video src=.data:video/mp4|base64", str(video._repr_html_())) == [
        '<video src="data:video/mp4',
        "base64",
    ]
