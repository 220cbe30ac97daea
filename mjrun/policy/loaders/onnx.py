"""ONNX files (.onnx): an observation as input, an action as output, and recurrent state carried from call to call.

onnxruntime opens models with restrictions, and runs them on the CPU by one thread, for equal bits from equal inputs.

Files of mjlab have metadata: lists separated by commas, numbers rounded to three decimals. Source:
`mjlab/rl/exporter_utils.py` of mjlab 1.6. Older versions wrote ranges as `[-1.0, 1.0]`, newer ones as `-1;1`.
"""

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, NoReturn, Protocol, TypeVar, cast

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, UsageError, clean, counted, listing, quoted
from mjrun.formats.input_file import decoding, is_file, require_file
from mjrun.options.task import POSITION
from mjrun.packages import require
from mjrun.policy.policy import POLICY, ActionSpace, Actor, Numbers, ObservationFacts, Policy, PolicyFacts, PolicyFormat

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

SUFFIXES = (".onnx",)
FLOATS = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(float16)": np.float16}
QUIET = 4  # onnxruntime's severity of fatal errors, which it also raises
OUTSIDE = r"External data path.*(escapes|Absolute)|should be (file inside|a relative path)|it is a symbolic link"
UNKNOWN = r"No Op registered for ([^ ]+)|: (\S+)\(-?\d+\) is not a registered"
DAMAGED = "is not an ONNX model, or is damaged"
# The messages with which onnxruntime refuses a model, and their causes.
CAUSES = (
    (OUTSIDE, "its weights are in a file outside its folder"),
    (r"External data path.*does not exist", "the file with its weights is missing"),
    (UNKNOWN, "it uses an operator that onnxruntime lacks"),
    (r"only \*guarantees\* support|Unsupported model IR version", "it requires a newer onnxruntime"),
    (r"Protobuf parsing failed|codec can't decode|No graph was found", DAMAGED),
)

# Words that distinguish the two ends of a state: h_in and h_out, state and next_state, h0 and hn.
ENDS = {"in", "out", "input", "output", "prev", "previous", "next", "new", "old", "initial", "final"}
ACTIONS = ("actions", "action", "continuous_actions", "deterministic_continuous_actions")
KEYS = ("joint_names", "observation_names", "action_scale")  # always present in mjlab's files
ROUNDING = 5.1e-4  # the largest error of rounded numbers
T = TypeVar("T")


def weight_files(path: Path) -> list[Path]:
    """Returns the existing files beside an ONNX file that contain its weights, as far as its bytes name them.

    Files in other folders, which onnxruntime refuses, are left out: a copy would be beside that of the model.

    Source: `external_data` of TensorProto in onnx.proto, entries of a key `location` and a relative path.
    """
    try:
        content = path.read_bytes()
    except OSError:  # opening the model reports it
        return []
    names = dict[str, None]()
    for entry in re.finditer(rb"\x0a\x08location\x12([\x80-\xff]*[\x00-\x7f])", content):
        size = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(entry[1]))
        names[content[entry.end() : entry.end() + size].decode("utf-8", "replace")] = None
    files = [path.parent / name for name in names if name and "\0" not in name and is_file(path.parent / name)]
    folders = (path.parent.resolve(), path.resolve().parent)  # where both are links, as in caches
    return [file for file in files if any(file.resolve().is_relative_to(folder) for folder in folders)]


class _Node(Protocol):
    """onnxruntime's description of an input or output."""

    name: str
    type: str
    shape: Sequence[int | str | None]


@dataclass(frozen=True)
class TensorSpec:
    """The specification of an input or output of a model.

    Attributes:
      type: the type in the syntax of ONNX: `tensor(float)`.
      shape: sizes; None for a variable one.
    """

    name: str
    type: str
    shape: tuple[int | None, ...]

    @property
    def size(self) -> int | None:
        """The number of values for one observation, with a batch of one; None if unspecified."""
        return None if not self.shape or self.shape[-1] is None else math.prod(self.one)

    @property
    def one(self) -> tuple[int, ...]:
        """Its shape with 1 for every variable size."""
        return tuple(1 if each is None else each for each in self.shape)

    def __str__(self) -> str:
        shape = ", ".join("?" if each is None else str(each) for each in self.shape)
        return f"{clean(self.name)} ({shape})"


class OnnxModel:
    """An ONNX model.

    Args:
      path: its file.

    Attributes:
      path: its file.
      inputs, outputs: the inputs and outputs in the order of the file.
      metadata: texts by key.

    Raises:
      FileError: it cannot be read, or onnxruntime refuses it.
      MissingExtraError: onnxruntime is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._session = _session(path)
        with decoding(path, DAMAGED):  # a name may not be text
            self.inputs = [_tensor(each) for each in self._session.get_inputs()]
            self.outputs = [_tensor(each) for each in self._session.get_outputs()]
            self.metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map

    def run(self, inputs: Mapping[str, np.ndarray], outputs: Sequence[str]) -> list[np.ndarray]:
        """Returns the values of `outputs`.

        Raises:
          UsageError: onnxruntime fails on these inputs.
        """
        try:
            return cast("list[np.ndarray]", self._session.run(outputs, inputs))
        except Exception as error:  # onnxruntime's errors have no common base
            reason = _reason(str(error))
            raise UsageError(f"{clean(str(self.path))} cannot be computed: {reason}", ("policy",)) from error

    def bound(self, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]) -> Callable[[], object]:
        """Returns a function that computes `outputs` from `inputs`, in these very arrays; they must outlive it."""
        binding = self._session.io_binding()
        for name, values in inputs.items():
            binding.bind_input(name, "cpu", 0, values.dtype.type, values.shape, values.ctypes.data)
        for name, values in outputs.items():
            binding.bind_output(name, "cpu", 0, values.dtype.type, values.shape, values.ctypes.data)
        return partial(self._session.run_with_iobinding, binding)

    def float_type(self, tensor: TensorSpec) -> type[np.floating]:
        """Returns the floating-point type of `tensor`.

        Raises:
          UsageError: it has another type.
        """
        if tensor.type not in FLOATS:
            kind = f"{clean(tensor.name)} is a {clean(tensor.type)}"
            raise UsageError(f"{clean(str(self.path))}: {kind}; a policy requires floating-point numbers", ("policy",))
        return FLOATS[tensor.type]


def _session(path: Path) -> "InferenceSession":
    require("a policy in ONNX", "policy", "onnxruntime")
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # telemetry would leave a file, and may contact its vendor
    import onnxruntime

    require_file(path, "policy", SUFFIXES)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = QUIET
    options.use_deterministic_compute = True
    try:
        providers = ["CPUExecutionProvider"]
        return onnxruntime.InferenceSession(str(path), options, providers, enable_fallback=0)  # a fallback prints
    except Exception as error:  # onnxruntime's errors have no common base
        raise _refusal(path, str(error), onnxruntime.__version__) from error


def _refusal(path: Path, message: str, version: str) -> FileError:
    reason = _reason(message)
    for pattern, cause in CAUSES:
        if found := re.search(pattern, message):
            what = f"{cause}: {quoted(found[1] or found[2])}" if pattern == UNKNOWN else cause
            return FileError(path, what, f"onnxruntime {version}: {reason}")
    return FileError(path, "onnxruntime refuses it", f"onnxruntime {version}: {reason}")


def _reason(message: str) -> str:
    """Returns onnxruntime's message without codes and positions in its source."""
    text = re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", message)
    text = re.sub(r"^Load model from .*? failed:", "", text, flags=re.DOTALL)
    text = re.sub(r"/onnxruntime_src/\S+ .*?\) (?=[A-Z!])", "", text, flags=re.DOTALL)
    text = re.sub(r"\S+\.cc:\d+ \w+ ", "", text)
    return clean(" ".join(text.split()))


def _tensor(node: "_Node") -> TensorSpec:
    return TensorSpec(node.name, node.type, tuple(each if isinstance(each, int) else None for each in node.shape))


def names_of(tensors: Sequence[TensorSpec]) -> str:
    """Lists `tensors` for messages."""
    return listing([str(tensor) for tensor in tensors])


class OnnxPolicy(Policy):
    """A network. Inputs other than recurrent state are parts of the observation, in the order of the file.

    Raises:
      FileError: it cannot be read, or onnxruntime refuses it.
      UsageError: its inputs or outputs are not those of a policy.
      MissingExtraError: onnxruntime is not installed.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.model = OnnxModel(path)
        self.states = state_pairs(self.model.inputs, self.model.outputs)
        starts, ends = {start.name for start, _ in self.states}, {end.name for _, end in self.states}
        self.inputs = [tensor for tensor in self.model.inputs if tensor.name not in starts]
        self.action = self._action_of([tensor for tensor in self.model.outputs if tensor.name not in ends])
        self._check_inputs()
        super().__init__(name, self._facts())
        ends_of_parts = [int(end) for end in np.cumsum([tensor.size or 0 for tensor in self.inputs])]
        # The place of each input in the observation; a single input may have any size, which the network checks.
        self.places = [
            (tensor.name, slice(end - size, end) if size else slice(None), self.model.float_type(tensor), shape)
            for tensor, end in zip(self.inputs, ends_of_parts, strict=True)
            for size, shape in [(tensor.size or 0, (*tensor.one[:-1], -1))]
        ]

        # Without states, all episodes share its arrays, which stay in the processor's cache.
        self._stateless = None if self.states else _Inference(self)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return self._stateless or _Inference(self)

    def parts(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        """Splits `observation` into the inputs of the network.

        Raises:
          UsageError: it has another size.
        """
        size = self.facts.observation_size
        if size is not None and size != len(observation):
            what = f"policy {clean(self.name)} observes {counted(size, 'number')}"
            raise UsageError(f"{what}, and the task has {len(observation)}: {names_of(self.inputs)}", POLICY)
        return {name: observation[at].astype(kind).reshape(shape) for name, at, kind, shape in self.places}

    def _action_of(self, outputs: Sequence[TensorSpec]) -> TensorSpec:
        """Returns the output that is the action."""
        named = [tensor for tensor in outputs if tensor.name in ACTIONS]
        choices = [tensor for tensor in named if tensor.name.startswith("deterministic")] or named or [*outputs]
        if len(choices) != 1:
            what = "several outputs that could be" if choices else "no output that could be"
            raise self._refusal(
                f"it has {what} the action: {names_of(self.model.outputs)}\nname it one of {', '.join(ACTIONS)}"
            )
        self.model.float_type(choices[0])
        return choices[0]

    def _check_inputs(self) -> None:
        if not self.inputs:
            raise self._refusal(f"it has no input for an observation: {names_of(self.model.inputs) or 'no inputs'}")
        for tensor in self.inputs:
            self.model.float_type(tensor)
            if not tensor.shape:
                raise self._refusal(f"its input {clean(tensor.name)} is a single number, or has no specified shape")
            batch = [size for size in tensor.shape[:-1] if size not in (None, 1)]
            if batch:
                raise self._refusal(
                    f"the input {tensor} contains more than one observation; export it for a batch of 1, "
                    "and set the history in the task"
                )
            if len(self.inputs) > 1 and tensor.size is None:
                raise self._refusal(f"each of several inputs must have a specified size: {names_of(self.inputs)}")
        sizes = [math.prod(start.one) * np.dtype(self.model.float_type(start)).itemsize for start, _ in self.states]
        require_expandable(self.model.path, sum(sizes))  # they are zeros at first

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


class _Inference:
    """A network in one episode, or in all episodes if it has no states, as an actor.

    Its first call shows the shapes of the outputs; later ones read and write arrays of these shapes, in half the time.
    """

    def __init__(self, policy: OnnxPolicy) -> None:
        self._model, self._parts = policy.model, policy.parts
        self._places = [place for _, place, _, _ in policy.places]
        self._inputs = {start.name: np.zeros(start.one, policy.model.float_type(start)) for start, _ in policy.states}
        self._states = [*self._inputs.values()]
        self._names = [policy.action.name, *(end.name for _, end in policy.states)]
        self._outputs: list[np.ndarray] = []
        self._compute: Callable[[], object] = lambda: None
        self._size = -1  # of the observation in these arrays
        self._lock = Lock()  # episodes may be played in several threads

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        with self._lock:
            if not (len(observation) == self._size and self._computes_in_place(observation)):
                self._allocate(observation)
            action, *ends = self._outputs
            for state, end in zip(self._states, ends, strict=True):
                state[...] = end
            return action.astype(np.float64).reshape(-1)

    def _allocate(self, observation: np.ndarray) -> None:
        """Computes the outputs in new arrays."""
        parts = self._parts(observation)
        self._inputs |= parts
        self._outputs = self._model.run(self._inputs, self._names)
        self._targets = [part.reshape(-1) for part in parts.values()]
        self._size = len(observation)
        self._compute = self._model.bound(self._inputs, dict(zip(self._names, self._outputs, strict=True)))

    def _computes_in_place(self, observation: np.ndarray) -> bool:
        """Computes the outputs in the arrays of the previous call; returns False if this fails."""
        for target, place in zip(self._targets, self._places, strict=True):
            target[:] = observation[place]
        try:
            self._compute()
        except Exception:  # an output of another shape, or an error that is reported by a call without these arrays
            return False
        return True


def state_pairs(inputs: Sequence[TensorSpec], outputs: Sequence[TensorSpec]) -> list[tuple[TensorSpec, TensorSpec]]:
    """Returns inputs, each with the output that it receives in the next call, by their types, shapes and names."""
    ends = [tensor for tensor in outputs if tensor.name not in ACTIONS]
    pairs: list[tuple[TensorSpec, TensorSpec]] = []
    for start in inputs:
        fits = [end for end in ends if _stem(end.name) == _stem(start.name) and _agree(start, end)]
        rivals = [other for other in inputs if _stem(other.name) == _stem(start.name)]
        if len(fits) == len(rivals) == 1 and start.name != fits[0].name:
            pairs.append((start, fits[0]))
    return pairs


def _stem(name: str) -> str:
    """Returns `name` without the words that distinguish the ends of a state."""
    words = re.split(r"[^0-9a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower())
    words = [re.sub(r"^([hc])[0n]$", r"\1", word) for word in words if word not in ENDS]
    if len(words) == 2 and words[0] in ("h", "c") and words[1] in ("0", "n"):
        words = words[:1]
    return "_".join(words)


def _agree(start: TensorSpec, end: TensorSpec) -> bool:
    sizes = zip(start.shape, end.shape, strict=False)
    return (
        start.type == end.type
        and len(start.shape) == len(end.shape)
        and all(one is None or other is None or one == other for one, other in sizes)
    )


FORMAT = PolicyFormat(
    SUFFIXES,
    lambda path, name, trust, normalize: OnnxPolicy(path, name),
    files=lambda path: [path, *weight_files(path)],
    packages=("onnxruntime",),
)


def is_mjlab(metadata: Mapping[str, str]) -> bool:
    """Returns whether the metadata has any of mjlab's keys; other tools write some of them too."""
    return any(key in metadata for key in KEYS)


def mjlab_facts(metadata: Mapping[str, str], path: Path) -> PolicyFacts:
    """Returns the facts in the metadata.

    Raises:
      FileError: the metadata is invalid.
    """
    lists = _Lists(metadata, path)
    joints = lists.names("joint_names")
    stiffness, damping = lists.numbers("joint_stiffness"), lists.numbers("joint_damping")
    scale = lists.numbers("action_scale")
    if stiffness is not None and damping is not None and len(stiffness) != len(damping):
        lists.refuse("joint_damping", f"has {counted(len(damping), 'number')}, and joint_stiffness {len(stiffness)}")
    default = lists.numbers("default_joint_pos")
    if joints and default is not None and len(default) != len(joints):
        lists.refuse("default_joint_pos", f"has {counted(len(default), 'number')}, and joint_names {len(joints)}")
    by_mjlab = all(key in metadata for key in KEYS)
    # Actions move the joints with actuators; the file identifies these only if all joints have one.
    all_move = joints is not None and stiffness is not None and len(stiffness) == len(joints)
    return PolicyFacts(
        observations=_observations(lists),
        joints=joints,
        default_position=default,
        action_joints=joints if all_move else None,
        action_size=None if stiffness is None else len(stiffness),
        action_target=POSITION if by_mjlab else None,  # mjlab writes metadata of position actions alone
        action_scale=scale,
        commands=lists.names("command_names"),
        stiffness=stiffness,
        damping=damping,
        quaternion_order="wxyz" if by_mjlab else None,  # MuJoCo's order
        rounding=ROUNDING,
    )


def _observations(lists: "_Lists") -> tuple[ObservationFacts, ...]:
    names = lists.names("observation_names") or ()
    scales = lists.entries("observation_terms_scale", len(names), _vector)
    clips = lists.entries("observation_terms_clip", len(names), _range)
    histories = lists.entries("observation_terms_history_length", len(names), _whole)
    return tuple(
        ObservationFacts(
            name, scale=scale, clip=_scaled(clip, scale), history=None if history is None else max(1, history)
        )
        for name, scale, clip, history in zip(names, scales, clips, histories, strict=True)
    )


def _scaled(clip: tuple[float, float] | None, scale: Numbers | None) -> tuple[float, float] | None:
    """Returns the clip after the scale, where mjlab clips before it; None if two numbers cannot express it."""
    factors = set(scale or (1.0,))
    if clip is None or len(factors) != 1:
        return None
    low, high = sorted(bound * next(iter(factors)) for bound in clip)
    return low, high


class _Lists:
    """The lists in the metadata."""

    def __init__(self, metadata: Mapping[str, str], path: Path) -> None:
        self._metadata, self._path = metadata, path

    def names(self, key: str) -> tuple[str, ...] | None:
        text = self._metadata.get(key)
        if text is None:
            return None
        names = (name.strip(" \"'") for name in text.strip("[] ").split(","))
        return tuple(name for name in names if name)

    def numbers(self, key: str) -> Numbers | None:
        text = self._metadata.get(key)
        if text is None:
            return None
        try:
            return tuple(map(float, text.strip("[] ").split(","))) if text else ()
        except ValueError:
            self.refuse(key, f"is {quoted(text[:60])}, not a list of numbers")

    def entries(self, key: str, count: int, parse: Callable[[str], T]) -> list[T | None]:
        """Returns an entry for each term of the observation; None if the file has no such entries."""
        text = self._metadata.get(key)
        if text is None:
            return [None] * count
        entries = re.findall(r"\[[^\]]*\]|[^,]+", text)
        if len(entries) != count:
            self.refuse(key, f"has {len(entries)} entries for {count} observations")
        try:
            return [parse(entry) for entry in entries]
        except ValueError:
            self.refuse(key, f"is {quoted(text[:60])}, which cannot be read")

    def refuse(self, key: str, message: str) -> NoReturn:
        raise FileError(self._path, f"the metadata {key} {message}")


def _whole(text: str) -> int:
    """Parses an integer, which newer versions write as `3.000` and older ones as `3`."""
    number = float(text)
    if not number.is_integer():
        raise ValueError(f"{text} is not a whole number")
    return int(number)


def _vector(text: str) -> Numbers:
    return tuple(float(part) for part in re.split("[;,]", text.strip("[]() ")))


def _range(text: str) -> tuple[float, float]:
    low, high = _vector(text)
    return low, high
