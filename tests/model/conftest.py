"""What tests of models share: a working directory, a model of many kinds of objects, and our scenes."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from mjrun.model.info import ModelDescription
from tests.cases import mjcf

Describe = Callable[[str], ModelDescription]

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.xml"))

MIXED = mjcf("mixed")


@pytest.fixture
def described() -> Describe:
    """Describes the model in a text."""
    return lambda text: ModelDescription(mujoco.MjModel.from_xml_string(text))


@pytest.fixture(scope="session")
def mixed_xml() -> str:
    """MJCF with objects of most kinds; its last part is its keyframes."""
    return MIXED


@pytest.fixture(scope="session")
def mixed() -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(MIXED.replace('ctrl="5"', 'ctrl="5 0 0 0 0 0 0"')))


@pytest.fixture(params=SCENES, ids=lambda path: path.stem)
def scene(request: pytest.FixtureRequest) -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_path(str(request.param)), request.param)


@pytest.fixture(autouse=True)
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory for MuJoCo's log, which warns of a NaN in a file."""
    monkeypatch.chdir(tmp_path)
