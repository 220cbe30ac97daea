"""ONNX models: opened by onnxruntime with care, and run on the CPU by one thread, for equal bits from equal inputs."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from mjrun.errors import FileError, UsageError, clean, listing, quoted
from mjrun.formats.input_file import decoding, is_file, require_file
from mjrun.packages import require

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

SUFFIXES = (".onnx",)
FLOATS = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(float16)": np.float16}
QUIET = 4  # onnxruntime's severity of what cannot go on, which it raises anyway
OUTSIDE = r"External data path.*(escapes|Absolute)|should be (file inside|a relative path)|it is a symbolic link"
UNKNOWN = r"No Op registered for ([^ ]+)|: (\S+)\(-?\d+\) is not a registered"
# What onnxruntime says of a model that it refuses, and what that means.
CAUSES = (
    (OUTSIDE, "its weights are in a file outside of its folder"),
    (r"External data path.*does not exist", "the file with its weights is missing"),
    (UNKNOWN, "it uses an operator that onnxruntime lacks"),
    (r"only \*guarantees\* support|Unsupported model IR version", "it is written for a newer onnxruntime"),
    (r"Protobuf parsing failed|codec can't decode|No graph was found", "is no ONNX model, or a damaged one"),
)


def weight_files(path: Path) -> list[Path]:
    """Returns the existing files beside an ONNX file that hold its weights, as far as its bytes name them.

    Source: `external_data` of TensorProto in onnx.proto, entries of a key `location` and a relative path.
    """
    try:
        content = path.read_bytes()
    except OSError:  # which opening the model reports
        return []
    names = dict[str, None]()
    for entry in re.finditer(rb"\x0a\x08location\x12([\x80-\xff]*[\x00-\x7f])", content):
        size = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(entry[1]))
        names[content[entry.end() : entry.end() + size].decode("utf-8", "replace")] = None
    return [path.parent / name for name in names if name and "\0" not in name and is_file(path.parent / name)]


class _Node(Protocol):
    """What onnxruntime says of an input or output."""

    name: str
    type: str
    shape: Sequence[int | str | None]


@dataclass(frozen=True)
class Tensor:
    """An input or output of a model.

    Attributes:
      type: `tensor(float)` and so on, in the words of ONNX.
      shape: sizes; None where one may vary.
    """

    name: str
    type: str
    shape: tuple[int | None, ...]

    @property
    def size(self) -> int | None:
        """How many numbers of one observation it holds, taking the batch for one; None if the file does not say."""
        return None if not self.shape or self.shape[-1] is None else int(np.prod(self.one))

    @property
    def one(self) -> tuple[int, ...]:
        """Its shape where every size that may vary is 1."""
        return tuple(1 if each is None else each for each in self.shape)

    def __str__(self) -> str:
        shape = ", ".join("?" if each is None else str(each) for each in self.shape)
        return f"{clean(self.name)} ({shape})"


class OnnxModel:
    """A model.

    Attributes:
      path: its file.
      inputs, outputs: in the order of the file.
      metadata: texts by key.
    """

    def __init__(self, path: Path) -> None:
        """Opens a model.

        Raises:
          FileError: it cannot be read, or onnxruntime refuses it.
          MissingExtraError: onnxruntime is not installed.
        """
        self.path = path
        self._session = _session(path)
        with decoding(path, "is no ONNX model, or a damaged one"):  # a name may be no text
            self.inputs = [_tensor(each) for each in self._session.get_inputs()]
            self.outputs = [_tensor(each) for each in self._session.get_outputs()]
            self.metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map

    def run(self, inputs: Mapping[str, np.ndarray], outputs: Sequence[str]) -> list[np.ndarray]:
        """The values of `outputs`.

        Raises:
          UsageError: the model cannot be computed with these inputs.
        """
        try:
            return cast("list[np.ndarray]", self._session.run(outputs, inputs))
        except Exception as error:  # onnxruntime's have no base of their own
            reason = _reason(str(error))
            raise UsageError(f"{clean(str(self.path))} cannot be computed: {reason}", ("policy",)) from error

    def float_type(self, tensor: Tensor) -> type[np.floating]:
        """The type of `tensor`, which must be of floating point.

        Raises:
          UsageError: it is not.
        """
        if tensor.type not in FLOATS:
            kind = f"{clean(tensor.name)} is a {clean(tensor.type)}"
            raise UsageError(f"{clean(str(self.path))}: {kind}, and policies take and give real numbers", ("policy",))
        return FLOATS[tensor.type]


def _session(path: Path) -> "InferenceSession":
    require("a policy in ONNX", "policy", "onnxruntime")
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # which would leave a file, and may call its makers
    import onnxruntime

    require_file(path, "policy", SUFFIXES)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = QUIET
    options.use_deterministic_compute = True
    try:
        providers = ["CPUExecutionProvider"]
        return onnxruntime.InferenceSession(str(path), options, providers, enable_fallback=0)  # which prints
    except Exception as error:  # onnxruntime's have no base of their own
        raise _refusal(path, str(error), onnxruntime.__version__) from error


def _refusal(path: Path, message: str, version: str) -> FileError:
    reason = _reason(message)
    for pattern, cause in CAUSES:
        if found := re.search(pattern, message):
            what = f"{cause}: {quoted(found[1] or found[2])}" if pattern == UNKNOWN else cause
            return FileError(path, what, f"onnxruntime {version}: {reason}")
    return FileError(path, "onnxruntime refuses it", f"onnxruntime {version}: {reason}")


def _reason(message: str) -> str:
    """What onnxruntime says, without codes and places in its source."""
    text = re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", message)
    text = re.sub(r"^Load model from .*? failed:", "", text, flags=re.DOTALL)
    text = re.sub(r"/onnxruntime_src/\S+ .*?\) (?=[A-Z!])", "", text, flags=re.DOTALL)
    text = re.sub(r"\S+\.cc:\d+ \w+ ", "", text)
    return clean(" ".join(text.split()))


def _tensor(node: "_Node") -> Tensor:
    return Tensor(node.name, node.type, tuple(each if isinstance(each, int) else None for each in node.shape))


def names_of(tensors: Sequence[Tensor]) -> str:
    """`tensors` as a list for messages."""
    return listing([str(tensor) for tensor in tensors])
