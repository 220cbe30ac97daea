"""Stable-Baselines3 archives (.zip): the models that it saves."""

import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjrun.errors import FileError, UsageError, clean, option
from mjrun.packages import require
from mjrun.policy.policy import ActionSpace, Actor, Policy, PolicyFacts, PolicyFormat, require_trusted_file

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy  # pyright: ignore[reportMissingImports]


class StableBaselinesPolicy(Policy):
    """The policy of an archive. It acts without noise, and clips and scales its actions as in training.

    Raises:
      UsageError: it is not trusted, its normalization is unspecified, its spaces are not vectors of numbers, or this
        process has used software OpenGL.
      FileError: it cannot be read.
      MissingExtraError: Stable-Baselines3 is not installed.
    """

    def __init__(self, path: Path, name: str, *, trust: bool, normalize: str | None) -> None:
        require_trusted_file(path, trust)
        if normalize is None:
            raise UsageError(
                f"{clean(str(path))}: Stable-Baselines3 keeps the statistics of VecNormalize in a separate file\n"
                f"set {option('normalize')} to that file, or to none if the policy was trained without",
                ("normalize",),
            )
        self._policy = _read(path)
        spaces = {"observation": self._policy.observation_space.shape, "action": self._policy.action_space.shape}
        sizes: dict[str, int] = {}
        for what, shape in spaces.items():
            if shape is None or len(shape) != 1 or (what == "action" and not _is_continuous(self._policy)):
                raise UsageError(f"{clean(str(path))}: its {what} is not a vector of numbers", ("policy",))
            sizes[what] = shape[0]
        facts = PolicyFacts(observation_size=sizes["observation"], action_size=sizes["action"])
        super().__init__(name, facts)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        state: tuple[np.ndarray, ...] | None = None
        is_start = True

        def act(observation: np.ndarray) -> np.ndarray:
            nonlocal state, is_start
            action, state = self._policy.predict(observation, state, np.array([is_start]), deterministic=True)
            is_start = False
            return action

        return act


def _is_continuous(policy: "BasePolicy") -> bool:
    return np.issubdtype(policy.action_space.dtype or np.object_, np.floating)


def _read(path: Path) -> "BasePolicy":
    require("a policy of Stable-Baselines3", "", "stable_baselines3")
    _require_no_llvm()
    import torch  # pyright: ignore[reportMissingImports]
    from stable_baselines3.common.save_util import load_from_zip_file  # pyright: ignore[reportMissingImports]

    torch.set_num_threads(1)  # for a fixed order of sums
    try:
        data, parameters, _ = load_from_zip_file(str(path), device="cpu")
        assert data is not None
        sde = {"use_sde": True} if data.get("use_sde") else {}
        make, spaces = data["policy_class"], (data["observation_space"], data["action_space"])
        policy = make(*spaces, lambda _: 0.0, **{**data["policy_kwargs"], **sde})  # the schedule is for training
        policy.load_state_dict(parameters["policy"])
        policy.set_training_mode(False)
    except Exception as error:  # unpickling may raise anything
        kind = type(error).__name__
        raise FileError(path, f"is not a readable archive of Stable-Baselines3: {kind}: {clean(str(error))}") from error
    return policy


def _require_no_llvm() -> None:
    """Raises UsageError where PyTorch's import of Triton would crash this process, which has loaded Mesa's LLVM."""
    if "triton" in sys.modules or find_spec("triton") is None:
        return
    with suppress(OSError):  # no such file on other systems
        if "/libLLVM" in Path("/proc/self/maps").read_text():
            raise UsageError(
                "this process has used software OpenGL, and importing PyTorch's Triton would now crash it\n"
                "run `import triton` before the first image is drawn"
            )


FORMAT = PolicyFormat(
    (".zip",),
    lambda path, name, trust, normalize: StableBaselinesPolicy(path, name, trust=trust, normalize=normalize),
    packages=("stable-baselines3", "torch"),
)
