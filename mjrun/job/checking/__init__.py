"""How `check` looks at a model: in a process of its own, which is watched, and as it moves."""
