"""Tasks as Gymnasium environments: `mjrun.gym.make("task.yaml")`, and many side by side by `make_vec`.

Importing this registers `mjrun/Task-v0`, which takes `task`; `gymnasium.make("mjrun.gym:mjrun/Task-v0", task=…)`
imports it. The numbers are those of `mjrun eval`, to the bit.
"""

from mjrun.packages import cause_of, require, require_core_versions

try:
    import gymnasium

    from mjrun.gym.environments import TaskEnv, TaskVectorEnv, make, make_vec
except Exception as error:
    require("mjrun.gym", "gym", "gymnasium")
    raise cause_of(error) or error from None
require_core_versions()

__all__ = ["TaskEnv", "TaskVectorEnv", "make", "make_vec"]

gymnasium.register(  # pyright: ignore[reportUnknownMemberType]
    "mjrun/Task-v0",
    entry_point="mjrun.gym.environments:TaskEnv",
    vector_entry_point="mjrun.gym.environments:TaskVectorEnv",
)
