"""LEAPP packages (.yaml or its folder): networks that run in order, with data flow between them and back.

The format of Isaac Lab 3. Source: `leapp/leapp.py`, `leapp/inference_manager.py` and
`leapp/utils/tensor_description.py` of leapp 0.7.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import NoReturn, cast

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, UsageError, clean, counted, listing, quoted, shortened
from mjrun.formats.input_file import decoding, is_file, is_folder, opened
from mjrun.options.task import POSITION, TORQUE, VELOCITY
from mjrun.policy.loaders.onnx import FORMAT as ONNX
from mjrun.policy.loaders.onnx import OnnxModel
from mjrun.policy.policy import POLICY, ActionSpace, Actor, Numbers, ObservationFacts, Policy, PolicyFacts, PolicyFormat
from mjrun.suffixes import YAML, is_yaml

TYPES = {
    "float16": np.float16,
    "float32": np.float32,
    "float64": np.float64,
    "int64": np.int64,
    "int32": np.int32,
    "bool": np.bool_,
}
LARGEST, VALUES = 2**22, 1_000_000  # maximum size of a description [bytes], and number of values in it
SLOWEST, FASTEST = 1e-9, 1e9  # frequencies of calls [Hz]
TEMPORAL = "__temporal_axis__"
# Tensors in the safetensors format: a header in JSON, and the numbers after it.
# Source: https://huggingface.co/docs/safetensors, "Format".
SAFETENSORS = (".safetensors",)
TENSOR_TYPES = {
    "F64": "<f8",
    "F32": "<f4",
    "F16": "<f2",
    "I64": "<i8",
    "I32": "<i4",
    "I16": "<i2",
    "I8": "i1",
    "U8": "u1",
    "BOOL": "?",
}
HEADER = 8  # bytes of the length of the header
LONGEST = 100_000_000  # maximum size of a header [bytes]
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


@dataclass(frozen=True)
class LeappTensorSpec:
    """The specification of an input or output of a network.

    Attributes:
      place: `network/tensor`.
      kind: the kind of the quantity, `state/joint/position`; None if unspecified.
      elements: the names of its numbers, `knee` or `foot/x`; None if unspecified.
    """

    place: str
    shape: tuple[int, ...]
    type: type[np.generic]
    kind: str | None
    elements: tuple[str, ...] | None

    @property
    def name(self) -> str:
        """The name without the network."""
        return self.place.partition("/")[2]

    @property
    def size(self) -> int:
        """The number of values."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class LeappNetwork:
    """A network of a LEAPP package."""

    name: str
    path: Path
    inputs: tuple[LeappTensorSpec, ...]
    outputs: tuple[LeappTensorSpec, ...]


@dataclass(frozen=True)
class LeappPackage:
    """A LEAPP package.

    Attributes:
      networks: the networks in the order of execution.
      flows: the inputs that receive an output, by the place of the output; an earlier network receives it in the next
        call.
      inputs, outputs: the inputs and outputs of the package.
      initial: values of inputs at the start of an episode; zeros for others.
      period: time between two calls [s]; None if unspecified.
    """

    path: Path
    networks: tuple[LeappNetwork, ...]
    flows: Mapping[str, tuple[str, ...]]
    inputs: tuple[LeappTensorSpec, ...]
    outputs: tuple[LeappTensorSpec, ...]
    initial: Mapping[str, np.ndarray]
    period: Fraction | None


def find_package(path: Path) -> Path:
    """Returns the YAML file of a package, which is named by this file or by its folder.

    Raises:
      UsageError: the folder contains none, or several.
    """
    if not is_folder(path):
        return path
    documents = sorted(each for each in path.iterdir() if is_yaml(each))
    if len(documents) != 1:
        what = "several .yaml files" if documents else "no .yaml file"
        names = f": {listing([each.name for each in documents])}" if documents else ""
        raise UsageError(f"{clean(str(path))} is not a LEAPP package: it contains {what}{names}", ("policy",))
    return documents[0]


def read_package(path: Path) -> LeappPackage:
    """Reads the package that the YAML file at `path` describes.

    Raises:
      FileError: it cannot be read, is not a package, or its files are missing, changed or outside its folder.
      UsageError: its networks are not in ONNX.
    """
    return _Reader(path).package(_document(path))


def files_beside(path: Path) -> list[Path]:
    """Returns the existing files that the YAML file at `path` names, in its folder or below; none if it is damaged."""
    try:
        waiting, files = [_document(path)], dict[Path, None]()
    except FileError:  # reading the package reports it
        return []
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, str) and _is_below(value) and is_file(path.parent / value):
            files[path.parent / value] = None
    return sorted(files)


def _is_below(name: str) -> bool:
    return bool(name) and not Path(name).is_absolute() and ".." not in Path(name).parts


def _document(path: Path) -> object:
    """Returns the content of a YAML file."""
    import yaml  # slow to import, as is every loader to find that of a file

    with opened(path, "LEAPP package", YAML) as file, decoding(path, "cannot be read as YAML"):
        text = file.read(LARGEST + 1)
        if len(text) > LARGEST:
            raise ValueError(f"it has more than {LARGEST // 2**20} MiB")
        document: object = yaml.safe_load(text)
        if _count(document, {}) > VALUES:
            raise ValueError(f"its aliases (*) make more than {VALUES:,} values of it")
    return document


def _count(value: object, known: dict[int, int]) -> int:
    """Returns the number of values in `value`, in which aliases repeat values.

    Args:
      known: the counts of values by their identity; 0 for unfinished ones.

    Raises:
      ValueError: a value contains itself.
    """
    if not isinstance(value, dict | list):
        return 1
    identity = id(cast("object", value))
    if identity in known:
        if not known[identity]:
            raise ValueError("a value contains itself, by an alias (*)")
        return known[identity]
    known[identity] = 0
    inner = cast("dict[object, object]", value).values() if isinstance(value, dict) else cast("list[object]", value)
    known[identity] = 1 + sum(_count(each, known) for each in inner)
    return known[identity]


class _Reader:
    """A reader that converts a document to a package, and refuses an invalid one."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def package(self, document: object) -> LeappPackage:
        root = self._mapping(document, "the document")
        models, pipeline = (self._mapping(root.get(key), key) for key in ("models", "pipeline"))
        networks = tuple(self._network(name, value) for name, value in models.items())
        inputs = {tensor.place: tensor for network in networks for tensor in network.inputs}
        outputs = {tensor.place: tensor for network in networks for tensor in network.outputs}
        tensors = (*inputs.values(), *outputs.values())
        require_expandable(self._path, sum(tensor.size * np.dtype(tensor.type).itemsize for tensor in tensors))
        flows = self._flows(pipeline, inputs, outputs)
        frequency = self._mapping(pipeline.get("configs") or {}, "configs").get("frequency")
        return LeappPackage(
            self._path,
            networks,
            flows,
            self._ports(pipeline, "inputs", inputs),
            self._ports(pipeline, "outputs", outputs),
            self._initial(pipeline.get("initial_values"), inputs),
            self._period(frequency),
        )

    def _network(self, name: str, value: object) -> LeappNetwork:
        description = self._mapping(value, name)
        parameters = self._mapping(description.get("parameters"), f"parameters of {name}")
        backend = parameters.get("backend")
        if backend != "onnx":
            message = f"its network {clean(name)} has the format {quoted(str(backend))}; export it as onnx"
            raise UsageError(f"{clean(str(self._path))} cannot be played: {message}", ("policy",))
        path = self._file(parameters.get("model_path"), f"model_path of {name}")
        expected = parameters.get("sha256sum")
        if isinstance(expected, str) and path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() != expected:
            raise FileError(path, f"is not the file that {clean(self._path.name)} describes: its SHA-256 differs")
        tensors = {
            key: tuple(self._tensor(name, each, key) for each in self._list(description.get(key), f"{key} of {name}"))
            for key in ("inputs", "outputs")
        }
        return LeappNetwork(name, path, tensors["inputs"], tensors["outputs"])

    def _tensor(self, network: str, value: object, where: str) -> LeappTensorSpec:
        description = self._mapping(value, f"{where} of {network}")
        name, kind = description.get("name"), description.get("kind")
        if not isinstance(name, str):
            self._refuse(f"a tensor in {where} of {network} has no name")
        shape = self._list(description.get("shape"), f"the shape of {name}")
        if not all(isinstance(size, int) and not isinstance(size, bool) and size > 0 for size in shape):
            self._refuse(f"the shape of {name} is not a list of sizes")
        if str(description.get("dtype")) not in TYPES:
            self._refuse(f"the dtype of {name} is not one of {', '.join(TYPES)}")
        sizes = cast("tuple[int, ...]", tuple(shape))
        elements = self._elements(description.get("element_names"), math.prod(sizes))
        type_ = TYPES[str(description["dtype"])]
        return LeappTensorSpec(f"{network}/{name}", sizes, type_, str(kind) if kind is not None else None, elements)

    def _elements(self, value: object, size: int) -> tuple[str, ...] | None:
        """Returns the names of the numbers, `foot/x` where several axes have names; None if their number differs."""
        axes = cast("list[object]", value) if isinstance(value, list) else []
        named = [cast("list[object]", axis) for axis in axes if isinstance(axis, list)]
        if not named or TEMPORAL in axes:
            return None
        if math.prod(map(len, named)) != size:
            return None
        return tuple("/".join(map(str, combination)) for combination in product(*named))

    def _flows(
        self,
        pipeline: Mapping[str, object],
        inputs: Mapping[str, LeappTensorSpec],
        outputs: Mapping[str, LeappTensorSpec],
    ) -> dict[str, tuple[str, ...]]:
        flows: dict[str, tuple[str, ...]] = {}
        for key in ("data_flow", "feedback_flow"):
            for source, value in self._mapping(pipeline.get(key) or {}, key).items():
                targets = [str(target) for target in self._list(value, f"{key} of {source}")]
                for place, known in [(source, outputs), *((target, inputs) for target in targets)]:
                    if place not in known:
                        self._refuse(f"{key} names {quoted(place)}, which is not a tensor")
                for target in targets:
                    if (inputs[target].shape, inputs[target].type) != (outputs[source].shape, outputs[source].type):
                        self._refuse(f"{key}: {source} and {target} differ in shape or type")
                flows[source] = (*flows.get(source, ()), *targets)
        return flows

    def _ports(
        self, pipeline: Mapping[str, object], key: str, tensors: Mapping[str, LeappTensorSpec]
    ) -> tuple[LeappTensorSpec, ...]:
        ports: list[LeappTensorSpec] = []
        for network, value in self._mapping(pipeline.get(key), key).items():
            for name in self._list(value, f"{key} of {network}"):
                place = f"{network}/{name}"
                if place not in tensors:
                    self._refuse(f"{key} of the pipeline name {quoted(place)}, which is not a tensor")
                ports.append(tensors[place])
        return tuple(ports)

    def _initial(self, value: object, inputs: Mapping[str, LeappTensorSpec]) -> dict[str, np.ndarray]:
        if value is None:
            return {}
        path = self._file(value, "initial_values")
        values = read_safetensors(path)
        for place, array in values.items():
            if place not in inputs or array.shape != inputs[place].shape:
                raise FileError(path, f"{quoted(place)} is not an input of a network, or has another shape")
        return {place: array.astype(inputs[place].type) for place, array in values.items()}

    def _period(self, frequency: object) -> Fraction | None:
        if frequency is None:
            return None
        number = frequency if isinstance(frequency, int | float) and not isinstance(frequency, bool) else math.nan
        if not SLOWEST <= number <= FASTEST:
            written = quoted(shortened(str(frequency)))
            self._refuse(f"the frequency is {written}, not a number from {SLOWEST:g} to {FASTEST:g} [Hz]")
        return 1 / Fraction(str(number))

    def _file(self, value: object, what: str) -> Path:
        """Returns the path of a file in the folder of the document."""
        if not isinstance(value, str) or not value:
            self._refuse(f"{what} is not a path")
        if "\0" in value:
            self._refuse(f"{what} is {quoted(shortened(value))}, not a path")
        folder = self._path.parent.resolve()
        path = (folder / value).resolve()
        if not path.is_relative_to(folder):
            self._refuse(f"{what} is {quoted(shortened(value))}, which is outside its folder")
        return path

    def _mapping(self, value: object, what: str) -> dict[str, object]:
        if not isinstance(value, dict):
            self._refuse(f"{what} is not a mapping")
        return {str(key): entry for key, entry in cast("dict[object, object]", value).items()}

    def _list(self, value: object, what: str) -> Sequence[object]:
        if not isinstance(value, list):
            self._refuse(f"{what} is not a list")
        return cast("list[object]", value)

    def _refuse(self, message: str) -> NoReturn:
        raise FileError(self._path, f"is not a LEAPP package: {clean(message)}")


def read_safetensors(path: Path) -> dict[str, np.ndarray]:
    """Reads the tensors at `path`, by name.

    Raises:
      FileError: it cannot be read, is damaged, or contains a type that NumPy lacks.
    """
    with opened(path, "file of tensors", SAFETENSORS) as file, decoding(path, "cannot be read as safetensors"):
        length = int.from_bytes(file.read(HEADER), "little")
        if length > LONGEST:
            raise ValueError("its header is too long")
        text = file.read(length)
        if len(text) < length:
            raise ValueError("it ends within its header")
        header = cast("dict[str, dict[str, object]]", json.loads(text))
        content = file.read()
        return {name: _tensor(entry, content) for name, entry in header.items() if name != "__metadata__"}


def _tensor(entry: dict[str, object], content: bytes) -> np.ndarray:
    start, end = cast("list[int]", entry["data_offsets"])
    if not 0 <= start <= end <= len(content):
        raise ValueError("a tensor is outside of the file")
    numbers = np.frombuffer(content[start:end], TENSOR_TYPES[str(entry["dtype"])])
    return numbers.reshape(cast("list[int]", entry["shape"]))


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
