"""LEAPP packages (.yaml or its folder): networks that run in order, with data flow between them and back."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjrun.errors import FileError, UsageError, clean, counted, listing
from mjrun.options.task import POSITION, TORQUE, VELOCITY
from mjrun.policy.leapp_package import LeappNetwork, LeappTensorSpec, files_beside, find_package, read_package
from mjrun.policy.loaders.onnx import FORMAT as ONNX
from mjrun.policy.loaders.onnx import OnnxModel
from mjrun.policy.policy import POLICY, ActionSpace, Actor, Numbers, ObservationFacts, Policy, PolicyFacts, PolicyFormat
from mjrun.suffixes import YAML

TARGETS = {
    "target/joint/position": POSITION,
    "target/joint/velocity": VELOCITY,
    "target/joint/torques": TORQUE,
    "target/joint/effort": TORQUE,
}
ROTATION, JOINT_STATE = "state/body/rotation", "state/joint/"
GAINS = ("kp", "kd")
QUATERNIONS: dict[tuple[str, ...], str] = {("qw", "qx", "qy", "qz"): "wxyz", ("qx", "qy", "qz", "qw"): "xyzw"}

Values = Mapping[str, np.ndarray]


class LeappPolicy(Policy):
    """A LEAPP package. The observation is its inputs in order; the action its outputs, without gains.

    Raises:
      FileError: it cannot be read, or onnxruntime refuses one of its networks.
      UsageError: its tensors are not floating-point numbers, or its gains change from call to call.
      MissingExtraError: onnxruntime is not installed.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.package = read_package(find_package(path))
        self._models = [_Network(network) for network in self.package.networks]
        self.targets = [tensor for tensor in self.package.outputs if tensor.kind not in GAINS]
        if not self.package.inputs or not self.targets:
            raise UsageError(
                f"{clean(str(self.package.path))} cannot be played: it has no inputs or outputs", ("policy",)
            )
        for tensor in (*self.package.inputs, *self.targets):
            if not np.issubdtype(tensor.type, np.floating):
                message = f"{clean(tensor.place)} is not a tensor of floating-point numbers"
                raise UsageError(f"{clean(str(self.package.path))} cannot be played: {message}", ("policy",))
        super().__init__(name, self._facts())

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        values = self.values_at_start()

        def act(observation: np.ndarray) -> np.ndarray:
            values.update(self.parts(observation))
            outputs = self.run(values)
            return np.concatenate([outputs[each.place].astype(np.float64).reshape(-1) for each in self.targets])

        return act

    def values_at_start(self) -> dict[str, np.ndarray]:
        """Returns the inputs of all networks at the start of an episode, by place."""
        tensors = [tensor for network in self.package.networks for tensor in network.inputs]
        return {each.place: self.package.initial.get(each.place, np.zeros(each.shape, each.type)) for each in tensors}

    def run(self, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Runs all networks on `values`, and stores the inputs of the next call there; returns all outputs."""
        outputs: dict[str, np.ndarray] = {}
        for model in self._models:
            results = model.run(values)
            outputs.update(results)
            for place, result in results.items():
                values.update(dict.fromkeys(self.package.flows.get(place, ()), result))
        return outputs

    def parts(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        """Splits `observation` into the inputs of the package, by place.

        Raises:
          UsageError: it has another size.
        """
        inputs = self.package.inputs
        sizes = [tensor.size for tensor in inputs]
        if sum(sizes) != len(observation):
            what = f"policy {clean(self.name)} observes {counted(sum(sizes), 'number')}"
            parts = listing([f"{tensor.name} ({tensor.size})" for tensor in inputs])
            raise UsageError(f"{what}, and the task has {len(observation)}: {parts}", POLICY)
        pieces = np.split(observation, np.cumsum(sizes)[:-1])
        return {
            tensor.place: piece.astype(tensor.type).reshape(tensor.shape)
            for tensor, piece in zip(inputs, pieces, strict=True)
        }

    def _facts(self) -> PolicyFacts:
        inputs = self.package.inputs
        parts = tuple(_part(tensor) for tensor in inputs)
        orders = {QUATERNIONS.get(each.elements or ()) for each in inputs if each.kind == ROTATION} - {None}
        named = [tensor.elements for tensor in self.targets]
        joints = tuple(name for names in named for name in names or ())
        targets = {TARGETS.get(tensor.kind or "") for tensor in self.targets}
        target = targets.pop() if len(targets) == 1 else None  # outputs are in SI units
        kp, kd = (self._gains(kind) for kind in GAINS)
        return PolicyFacts(
            observation_size=sum(tensor.size for tensor in inputs),
            action_size=sum(tensor.size for tensor in self.targets),
            observations=parts,
            action_joints=None if None in named else joints,
            action_target=target,
            action_scale=None if target is None else (1.0,),
            action_offset=None if target is None else (0.0,),
            stiffness=kp,
            damping=kd,
            control_dt=self.package.period,
            quaternion_order=orders.pop() if len(orders) == 1 else None,
        )

    def _gains(self, kind: str) -> Numbers | None:
        """Returns the gains among the outputs, which must not depend on the observation."""
        outputs = [tensor for tensor in self.package.outputs if tensor.kind == kind]
        if not outputs:
            return None
        answers: list[Numbers] = []
        for observation in (np.zeros, np.ones):
            values = self.values_at_start()
            values.update(self.parts(observation(sum(tensor.size for tensor in self.package.inputs))))
            results = self.run(values)
            answers.append(tuple(float(x) for tensor in outputs for x in results[tensor.place].reshape(-1)))
        if answers[0] != answers[1]:
            message = f"its gains {kind} depend on the observation"
            raise UsageError(f"{clean(str(self.package.path))} cannot be played: {message}", ("policy",))
        return answers[0]


def _part(tensor: LeappTensorSpec) -> ObservationFacts:
    """Returns the facts of an input. States of joints are in SI units; the network scales them."""
    part = ObservationFacts(tensor.name, tensor.size, tensor.kind, tensor.elements)
    return replace(part, offset=(0.0,), scale=(1.0,)) if (tensor.kind or "").startswith(JOINT_STATE) else part


class _Network:
    """A network of a package, with its tensors by their places."""

    def __init__(self, network: LeappNetwork) -> None:
        self._model = OnnxModel(network.path)
        self._inputs = self._named(network, network.inputs, [tensor.name for tensor in self._model.inputs])
        self._outputs = self._named(network, network.outputs, [tensor.name for tensor in self._model.outputs])

    def run(self, values: Values) -> dict[str, np.ndarray]:
        results = self._model.run(
            {name: values[place] for place, name in self._inputs.items()}, [*self._outputs.values()]
        )
        return dict(zip(self._outputs, results, strict=True))

    def _named(self, network: LeappNetwork, tensors: Sequence[LeappTensorSpec], names: Sequence[str]) -> dict[str, str]:
        """Returns the names of tensors in the file of the network, by their places."""
        by_name = {tensor.place: tensor.name for tensor in tensors}
        if sorted(by_name.values()) == sorted(names):
            return by_name
        if len(tensors) != len(names):
            described = listing([tensor.name for tensor in tensors])
            raise FileError(network.path, f"its tensors are {listing(names)}, and the package describes {described}")
        return dict(zip(by_name, names, strict=True))


def _files(path: Path) -> list[Path]:
    """Returns the YAML file of a package, the files that it names, and the weights of its networks."""
    files = [path, *files_beside(path)]
    networks = [file for file in files if file.suffix.lower() in ONNX.suffixes]
    return [*files, *(weights for network in networks for weights in ONNX.files(network))]


FORMAT = PolicyFormat(
    YAML,
    lambda path, name, trust, normalize: LeappPolicy(path, name),
    reads_folders=True,
    files=_files,
    packages=("onnxruntime",),
)
