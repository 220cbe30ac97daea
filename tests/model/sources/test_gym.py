"""Theorems about the models of Gymnasium's environments as model sources."""

import importlib.util
import pickle
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from mjrun.errors import BrokenModelError, CompiledOverrideError, MissingExtraError, ModelNotFoundError, UsageError
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.override import Override
from mjrun.model.source import physics_fingerprint
from mjrun.model.sources import gym, parse_source
from mjrun.model.sources.gym import GymSource, environment_model, make_environment
from tests.cases import cases

NAMES = sorted(GymSource.descriptions())
THIRD_PARTY = '''
import gymnasium, mujoco
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv

class Cart(MujocoEnv):
    """A model from a file, which Python changes if asked."""

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}  # which older Gymnasiums ask for

    def __init__(self, heavy=False, **kwargs):
        space = gymnasium.spaces.Box(-np.inf, np.inf, (2,))
        super().__init__(FILE, 3, space, **kwargs)
        if heavy:
            self.model.body_mass[1] *= 2

    def step(self, action):
        self.do_simulation(action, self.frame_skip)
        return self.state_vector(), 0.0, False, False, {}

    def reset_model(self):
        return self.state_vector()

gymnasium.register("acme/Cart-v0", Cart, max_episode_steps=7)
gymnasium.register("acme/HeavyCart-v0", Cart, kwargs={"heavy": True})
'''
CART = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom name="cart" size=".1"/></body>
</worldbody><actuator><motor joint="x" ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""


def made(name: str) -> Any:
    with collected_warnings(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return gymnasium.make(name)


def test_all_eleven_environments_of_version_5_are_listed() -> None:
    assert len([name for name in NAMES if name.endswith("-v5")]) == 11
    assert {"Humanoid-v4", "Humanoid-v5"} < set(NAMES)
    assert not {"Humanoid-v3", "CartPole-v1"} & set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_model_is_that_of_the_environment(name: str) -> None:
    source, environment = parse_source(f"gym:{name}"), made(name)
    theirs = environment.unwrapped
    assert source.main_file == Path(theirs.fullpath)
    assert source.files[0] == source.main_file
    with collected_warnings():  # one model has a deprecated attribute
        model = source.load()
    assert physics_fingerprint(model) == physics_fingerprint(theirs.model)
    assert np.array_equal(model.qpos0, theirs.init_qpos)  # it starts where they do without noise
    assert not theirs.init_qvel.any()
    steps, seconds = f"{theirs.frame_skip} steps", f"of {theirs.model.opt.timestep:g} s"
    assert (
        f"{steps} {seconds} per action, {environment.spec.max_episode_steps} actions" in GymSource.descriptions()[name]
    )


def test_what_is_simulated_depends_on_the_environment_and_its_version() -> None:
    assert GymSource("Hopper-v5").code == f"Hopper-v5, gymnasium {gymnasium.__version__}"


def test_overrides_are_applied_and_travel_with_it() -> None:
    source = parse_source("gym:Hopper-v5", [Override("opt.timestep", "0.001")])
    assert pickle.loads(pickle.dumps(source)).load().opt.timestep == 0.001
    assert source.stem == "Hopper_v5"


@cases("name, message")
def test_what_is_no_environment_on_mujoco_is_refused_with_those_there_are(name: str, message: str) -> None:
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source(f"gym:{name}").load()
    first, second = str(caught.value).splitlines()
    assert message in first
    assert second.startswith("environments of Gymnasium on MuJoCo: Ant-v4, Ant-v5, ")


def test_an_environment_that_cannot_be_made_says_why() -> None:
    with pytest.raises(BrokenModelError, match=r"gym:Pusher-v4: ImportError: .*mujoco<3"):
        parse_source("gym:Pusher-v4").load()


def test_without_gymnasium_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "gymnasium" else find(name))
    environment_model.cache_clear()
    with pytest.raises(MissingExtraError, match=r"gym:Ant-v5 needs gymnasium.*\n.*mjrun\[gym\]"):
        parse_source("gym:Ant-v5").load()


@pytest.fixture
def third_party(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "cart.xml").write_text(CART)
    (tmp_path / "acme_cart.py").write_text(THIRD_PARTY.replace("FILE", repr(str(tmp_path / "cart.xml"))))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(gym.importlib.metadata, "packages_distributions", lambda: {"acme_cart": ["acme-cart"]})
    yield
    for name in ("acme/Cart-v0", "acme/HeavyCart-v0"):
        gymnasium.registry.pop(name, None)
    sys.modules.pop("acme_cart", None)
    environment_model.cache_clear()


@pytest.mark.usefixtures("third_party")
def test_environments_of_others_are_imported_by_their_module(tmp_path: Path) -> None:
    source = parse_source("gym:acme_cart:acme/Cart-v0", [Override("opt.gravity", "0 0 -1")])
    assert source.main_file == tmp_path / "cart.xml"
    assert source.load().opt.gravity[2] == -1
    environment = environment_model("acme_cart:acme/Cart-v0")
    assert (environment.control_steps, environment.episode_steps) == (3, 7)


@pytest.mark.usefixtures("third_party")
def test_a_model_that_python_changes_is_the_compiled_one_and_takes_no_overrides(tmp_path: Path) -> None:
    model = parse_source("gym:acme_cart:acme/HeavyCart-v0").load()
    assert model.body_mass[1] == 2 * mujoco.MjModel.from_xml_path(str(tmp_path / "cart.xml")).body_mass[1]
    heavy = parse_source("gym:acme_cart:acme/HeavyCart-v0", [Override("opt.gravity", "0 0 -1", "gravity")])
    assert heavy.main_file is None
    model.body_mass[1] = 0  # is nobody else's
    assert parse_source("gym:acme_cart:acme/HeavyCart-v0").load().body_mass[1]
    with pytest.raises(CompiledOverrideError):
        heavy.load()


def test_settings_of_an_environment_are_part_of_its_name(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    source = parse_source(f"gym:Hopper-v5?xml_file={tmp_path / 'cart.xml'}&frame_skip=8&max_episode_steps=9")
    assert (source.main_file, source.stem) == (tmp_path / "cart.xml", "Hopper_v5")
    short = environment_model("Hopper-v5?frame_skip=8&max_episode_steps=9")
    assert (short.control_steps, short.episode_steps) == (8, 9)
    assert make_environment("Ant-v5?include_cfrc_ext_in_observation=false").observation_space.shape == (27,)


@cases("query, message")
def test_settings_that_an_environment_does_not_take_are_refused(query: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_source(f"gym:Hopper-v5?{query}").load()
