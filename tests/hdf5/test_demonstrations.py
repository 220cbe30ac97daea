"""Files of demonstrations as their programs write them, and files that are damaged or made to do harm."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.hdf5 import untrusted_content
from mjrun.hdf5.demonstration_list import DemonstrationFileOrigin, DemonstrationListEntry
from mjrun.hdf5.demonstrations import DemonstrationFile
from tests.demonstration_files import PLAIN, recorded_states, write_demonstrations

LIBERO = {
    "env_args": json.dumps({"type": 1, "env_name": "Libero_Kitchen", "env_kwargs": {"robots": ["Panda"]}}),
    "problem_info": json.dumps({"language_instruction": ["pick up ", "the bowl"]}),
}
ROBOSUITE = {"env": "Lift", "env_info": '{"robots": ["Panda"], "control_freq": 10}', "repository_version": "1.5.2"}
ROBOCASA = {"env": "PnP", "robosuite_version": "1.5.1", "mujoco_version": "3.2.6"}


def test_episodes_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = ["demo_10", "demo_2", "demo_1", "other"]
    path = write_demonstrations(tmp_path / "d.hdf5", dict.fromkeys(names, recorded_states()))
    with DemonstrationFile(path) as file:
        assert file.names == ["demo_1", "demo_2", "demo_10", "other"]
        assert file.named("demo_10") == "demo_10"


def test_states_and_models_are_those_that_were_written(tmp_path: Path) -> None:
    states = recorded_states()
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo_0": states})
    with DemonstrationFile(path) as file:
        np.testing.assert_array_equal(file.states("demo_0"), states)
        assert file.model_text("demo_0") == PLAIN
        assert file.array("demo_0", "actions").shape == (5, 7)
        assert file.named("") == "demo_0"


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        (LIBERO, DemonstrationFileOrigin("Libero_Kitchen", "pick up the bowl", robots=("Panda",), is_robosuite=True)),
        (
            ROBOSUITE,
            DemonstrationFileOrigin("Lift", robosuite="1.5.2", robots=("Panda",), control_rate=10.0, is_robosuite=True),
        ),
        (ROBOCASA, DemonstrationFileOrigin("PnP", "", "3.2.6", "1.5.1", is_robosuite=True)),
        (None, DemonstrationFileOrigin("Lift", robosuite="1.4.1", control_rate=20.0, is_robosuite=True)),
        ({}, DemonstrationFileOrigin()),
        ({"env_args": "[" * 100_000, "env_info": "[1]", "problem_info": "{"}, DemonstrationFileOrigin()),
        ({"env_args": '{"env_kwargs": {"control_freq": Infinity}}'}, DemonstrationFileOrigin()),
    ],
)
def test_every_program_states_the_origin_in_its_way(
    tmp_path: Path, attributes: dict[str, Any] | None, expected: DemonstrationFileOrigin
) -> None:
    with DemonstrationFile(write_demonstrations(tmp_path / "d.hdf5", attributes=attributes)) as file:
        assert file.origin("demo_1") == file.origin() == expected


def test_an_episode_is_described_with_its_images_and_rewards(tmp_path: Path) -> None:
    observations = {
        "agentview_image": np.zeros((5, 4, 4, 3), np.uint8),
        "agentview_depth": np.zeros((5, 4, 4, 1), np.float32),
        "gripper_closed": np.zeros((5, 1), np.uint8),
        "robot0_eef_pos": np.zeros((5, 3)),
    }
    states = recorded_states()
    states[:, 0] += 0.7  # recorded from a later time on
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo_1": states}, observations=observations)
    with h5py.File(path, "a") as written:
        written["data/demo_1/rewards"] = np.array([0, 0, 0, 0, 1])
        written["data/demo_1"].attrs["ep_meta"] = '{"lang": "lift it"}'
        written["mask/train"] = np.array([b"demo_1"])
        written["mask/both"] = np.array([b"demo_1", b"demo_2"])
        written["mask/none"] = h5py.Empty("S6")
    with DemonstrationFile(path) as file:
        seconds = pytest.approx(0.2, abs=1e-12)
        expected = DemonstrationListEntry("demo_1", 5, seconds, "lift it", 1.0, ("agentview_image",))
        assert file.episode("demo_1") == expected
        assert file.observations("demo_1") == {key: values.shape for key, values in observations.items()}
        assert file.datasets("demo_1") == ["actions", "rewards", "states"]
        assert file.subsets == {"train": 1, "both": 2, "none": 0}
        assert file.origin("demo_1").instruction == "lift it"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", r"d\.hdf5: has 12 demonstrations; select one\n.*d\.hdf5:demo_0, .*demo_7, … \(`mjrun info .*` lists all"),
        ("demo_99", r"has no demonstration 'demo_99' \(did you mean"),
        ("\x1b[31m", r"has no demonstration '\\x1b\[31m'\n"),
    ],
)
def test_another_episode_is_refused_with_those_there_are(tmp_path: Path, name: str, message: str) -> None:
    demos = {f"demo_{index}": recorded_states(2) for index in range(12)}
    path = write_demonstrations(tmp_path / "d.hdf5", demos)
    with DemonstrationFile(path) as file, pytest.raises(FileError, match=message):
        file.named(name)


def broken(path: Path, states: Any, **settings: Any) -> Path:
    """Writes a file with other states of its only demonstration."""
    write_demonstrations(path, {"demo": recorded_states()})
    with h5py.File(path, "a") as file:
        del file["data/demo/states"]
        file.create_dataset("data/demo/states", data=states, **settings)
    return path


WITH_NAN = recorded_states()
WITH_NAN[3, 2] = np.nan


@pytest.mark.parametrize(
    ("states", "settings", "message"),
    [
        (WITH_NAN, {}, r"d\.hdf5:demo: number 2 of state 3 is nan"),
        (np.zeros((0, 16)), {}, r"its states have the shape \(0, 16\)"),
        (np.zeros(16), {}, r"its states have the shape \(16,\)"),
        (np.array(["a", "b"], object), {"dtype": h5py.string_dtype()}, "states does not contain numbers"),
        (np.zeros(2, [("a", float)]), {}, "states does not contain numbers"),
    ],
)
def test_states_that_are_not_numbers_are_refused(tmp_path: Path, states: Any, settings: Any, message: str) -> None:
    path = broken(tmp_path / "d.hdf5", states, **settings)
    with DemonstrationFile(path) as file, pytest.raises(FileError, match=message):
        file.states("demo")


def test_states_without_a_shape_are_listed_as_none_and_refused(tmp_path: Path) -> None:
    path = broken(tmp_path / "d.hdf5", h5py.Empty("f8"))
    with DemonstrationFile(path) as file:
        assert file.episode("demo").states == 0
        with pytest.raises(FileError, match=r"d\.hdf5:demo: "):
            file.states("demo")


def test_states_that_would_fill_the_memory_are_refused(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo": recorded_states()})
    with h5py.File(path, "a") as file:
        del file["data/demo/states"]
        file.create_dataset("data/demo/states", (10**9, 16), float, chunks=(1000, 16), compression="gzip")
    with DemonstrationFile(path) as file:
        assert file.episode("demo") == DemonstrationListEntry("demo", 10**9, 0.0)
        with pytest.raises(FileError, match="would expand to 128 GB in memory"):
            file.states("demo")


def test_chunks_that_would_fill_the_memory_and_content_elsewhere_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "d.hdf5", "w") as file:
        large = file.create_dataset("large", (2**28,), "f8", chunks=(2**28,), compression="gzip")
        outside = file.create_dataset("outside", (1,), "f8", external=[(str(tmp_path / "secret"), 0, 8)])
        small = file.create_dataset("small", (1,), "f8")
        untrusted_content.require_own_content(tmp_path / "d.hdf5", "small", small)
        with pytest.raises(FileError, match=r"would expand to 2\.15 GB in memory"):
            untrusted_content.require_own_content(tmp_path / "d.hdf5", "large", large)
        with pytest.raises(FileError, match="outside is in another file, which is not read"):
            untrusted_content.require_own_content(tmp_path / "d.hdf5", "outside", outside)


def test_links_are_not_followed(tmp_path: Path) -> None:
    write_demonstrations(tmp_path / "secret.hdf5")
    with h5py.File(write_demonstrations(tmp_path / "d.hdf5"), "a") as file:
        file["data/soft"] = h5py.SoftLink("/data")
        file["data/external"] = h5py.ExternalLink(str(tmp_path / "secret.hdf5"), "/data/demo_1")
        file.create_group("data/inner")["states"] = h5py.ExternalLink(
            str(tmp_path / "secret.hdf5"), "data/demo_1/states"
        )
    with DemonstrationFile(tmp_path / "d.hdf5") as file:
        assert file.names == ["demo_1", "demo_2"]


@pytest.mark.parametrize("content", [b"", b"not HDF5", b"\x89HDF\r\n\x1a\n" + bytes(100)])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "d.hdf5").write_bytes(content)
    with pytest.raises(FileError, match=r"d\.hdf5: cannot be read as HDF5: "):
        DemonstrationFile(tmp_path / "d.hdf5")


def test_a_table_is_no_file_of_demonstrations(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["time"] = np.arange(3)
    with pytest.raises(FileError, match=r"has no demonstrations, which are groups data/EPISODE with a dataset states"):
        DemonstrationFile(tmp_path / "t.h5")


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.99])
def test_a_truncated_file_is_an_error(tmp_path: Path, share: float) -> None:
    content = write_demonstrations(tmp_path / "d.hdf5").read_bytes()
    (tmp_path / "d.hdf5").write_bytes(content[: int(share * len(content))])
    with pytest.raises(FileError, match="cannot be read as HDF5"):
        DemonstrationFile(tmp_path / "d.hdf5")
