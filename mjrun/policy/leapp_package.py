"""LEAPP packages, the format of Isaac Lab 3: a YAML file that describes networks and the data flow between them.

Source: `leapp/leapp.py`, `leapp/inference_manager.py` and `leapp/utils/tensor_description.py` of leapp 0.7.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import NoReturn, cast

import numpy as np
import yaml

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, listing, quoted, shortened
from mjrun.formats.input_file import decoding, is_file, is_folder, opened
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
TEMPORAL = "__temporal_axis__"
ONNX = "onnx"
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
        return int(np.prod(self.shape))


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
        if backend != ONNX:
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
        if not all(isinstance(size, int) and size > 0 for size in shape):
            self._refuse(f"the shape of {name} is not a list of sizes")
        if str(description.get("dtype")) not in TYPES:
            self._refuse(f"the dtype of {name} is not one of {', '.join(TYPES)}")
        sizes = cast("tuple[int, ...]", tuple(shape))
        elements = self._elements(description.get("element_names"), int(np.prod(sizes)))
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
        if not isinstance(frequency, int | float) or not 0 < frequency < float("inf"):
            self._refuse(f"the frequency is {quoted(shortened(str(frequency)))}, not a positive number")
        return 1 / Fraction(str(frequency))

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
