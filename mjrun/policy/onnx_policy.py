"""Policies in ONNX: one observation in, one action out, and recurrent state carried from call to call."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, clean, counted, option
from mjrun.policy.mjlab import is_mjlab, mjlab_facts
from mjrun.policy.onnx_model import OnnxModel, Tensor, names_of
from mjrun.policy.policy import ActionSpace, Actor, ObservationFacts, Policy, PolicyFacts
from mjrun.policy.recurrence import ACTIONS, state_pairs


class OnnxPolicy(Policy):
    """A network. Inputs other than recurrent state are parts of the observation, in the order of the file."""

    def __init__(self, path: Path, name: str) -> None:
        """Opens the network.

        Raises:
          FileError: it cannot be read, or onnxruntime refuses it.
          UsageError: its inputs or outputs are not those of a policy.
          MissingExtraError: onnxruntime is not installed.
        """
        self.model = OnnxModel(path)
        self.states = state_pairs(self.model.inputs, self.model.outputs)
        starts, ends = {start.name for start, _ in self.states}, {end.name for _, end in self.states}
        self.inputs = [tensor for tensor in self.model.inputs if tensor.name not in starts]
        self.action = self._action_of([tensor for tensor in self.model.outputs if tensor.name not in ends])
        self._check_inputs()
        super().__init__(name, self._facts())
        ends_of_parts = [int(end) for end in np.cumsum([tensor.size or 0 for tensor in self.inputs])]
        # Where each input stands in the observation; one alone may be of any size, which the network will tell.
        self._places = [
            (tensor.name, slice(end - size, end) if size else slice(None), self.model.float_type(tensor), shape)
            for tensor, end in zip(self.inputs, ends_of_parts, strict=True)
            for size, shape in [(tensor.size or 0, (*tensor.one[:-1], -1))]
        ]

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return _OnnxActor(self)

    def parts(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        """`observation` as the inputs of the network.

        Raises:
          UsageError: it is of another size.
        """
        size = self.facts.observation_size
        if size is not None and size != len(observation):
            what = f"{option('policy')} {clean(self.name)} observes {counted(size, 'number')}"
            raise UsageError(f"{what}, and the task gives {len(observation)}: {names_of(self.inputs)}")
        return {name: observation[at].astype(kind).reshape(shape) for name, at, kind, shape in self._places}

    def _action_of(self, outputs: Sequence[Tensor]) -> Tensor:
        """The output that is the action."""
        named = [tensor for tensor in outputs if tensor.name in ACTIONS]
        choices = [tensor for tensor in named if tensor.name.startswith("deterministic")] or named or [*outputs]
        if len(choices) != 1:
            what = "no output that could be" if not choices else "several outputs, and none says that it is"
            raise self._refusal(
                f"it has {what} the action: {names_of(self.model.outputs)}\nthe names are {', '.join(ACTIONS)}"
            )
        self.model.float_type(choices[0])
        return choices[0]

    def _check_inputs(self) -> None:
        if not self.inputs:
            raise self._refusal(f"it has no input for an observation: {names_of(self.model.inputs) or 'none at all'}")
        for tensor in self.inputs:
            self.model.float_type(tensor)
            if not tensor.shape:
                raise self._refusal(
                    f"its input {clean(tensor.name)} is a single number, or of a shape that is not said"
                )
            batch = [size for size in tensor.shape[:-1] if size not in (None, 1)]
            if batch:
                raise self._refusal(
                    f"the input {tensor} holds more than one observation; export it for a batch of 1, "
                    "and let the task say the history"
                )
            if len(self.inputs) > 1 and tensor.size is None:
                raise self._refusal(f"of several inputs each must say its size: {names_of(self.inputs)}")
        for start, _ in self.states:
            self.model.float_type(start)

    def _facts(self) -> PolicyFacts:
        metadata = self.model.metadata
        facts = mjlab_facts(metadata, self.model.path) if is_mjlab(metadata) else PolicyFacts()
        sizes = [tensor.size for tensor in self.inputs]
        if facts.observations is None and len(self.inputs) > 1:
            parts = tuple(ObservationFacts(tensor.name, tensor.size) for tensor in self.inputs)
            facts = replace(facts, observations=parts)
        action_size = facts.action_size if self.action.size is None else self.action.size
        return replace(
            facts, observation_size=None if None in sizes else sum(filter(None, sizes)), action_size=action_size
        )

    def _refusal(self, message: str) -> UsageError:
        return UsageError(f"{clean(str(self.model.path))} cannot be played: {message}", ("policy",))


class _OnnxActor:
    """A network within an episode."""

    def __init__(self, policy: OnnxPolicy) -> None:
        self._policy = policy
        kind = policy.model.float_type
        self._states = {start.name: np.zeros(start.one, kind(start)) for start, _ in policy.states}
        self._outputs = [policy.action.name, *(end.name for _, end in policy.states)]

    def act(self, observation: np.ndarray) -> np.ndarray:
        action, *states = self._policy.model.run({**self._policy.parts(observation), **self._states}, self._outputs)
        self._states = {start.name: state for (start, _), state in zip(self._policy.states, states, strict=True)}
        return action.astype(np.float64).reshape(-1)
