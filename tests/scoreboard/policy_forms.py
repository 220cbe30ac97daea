"""Hostile policies: ONNX files, LEAPP packages, files of statistics, archives and pickles."""

import json
import pickle
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper

from tests.policy.leapp_packages import package
from tests.policy.networks import linear, value, write
from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import BETWEEN, CANARY, LAUGHS, TAGS, TASK, Content, Form
from tests.scoreboard.table_forms import Bomb, archive, npy

INPUTS = inputs_of(__name__)
EVAL = ("eval", "task.yaml", "--episodes", "1", "--jobs", "1", "-o", "new", "--policy")
TRACE = ("trace", "task.yaml", "-o", "new.csv", "--policy")
CHECK = ("check", "task.yaml", "--policy")
MODEL = ("trace", "m.xml", "--steps", "5", "-o", "new.csv", "--policy")
WEIGHTS = np.full((1, 1), 0.5, np.float32)


def good(path: Path) -> None:
    linear(path, WEIGHTS)


def _saved(change: Callable[[onnx.ModelProto], object]) -> Callable[[Path], None]:
    """Makes a valid network with a change in its description."""

    def make(path: Path) -> None:
        good(path)
        model = onnx.load(str(path))
        change(model)
        path.write_bytes(model.SerializeToString())

    return make


def _external(place: str, offset: str = "0", length: str = "4") -> Callable[[Path], None]:
    """Makes a network whose weights are in another file."""

    def change(model: onnx.ModelProto) -> None:
        weights = model.graph.initializer[0]
        weights.ClearField("raw_data")
        weights.data_location = TensorProto.EXTERNAL
        for key, text in (("location", place), ("offset", offset), ("length", length)):
            weights.external_data.add(key=key, value=text)

    return _saved(change)


def _bytes(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        good(path)
        path.write_bytes(change(path.read_bytes()))

    return make


def _dims(*sizes: int) -> Callable[[Path], None]:
    def change(model: onnx.ModelProto) -> None:
        del model.graph.initializer[0].dims[:]
        model.graph.initializer[0].dims.extend(sizes)

    return _saved(change)


def _huge_constant(path: Path) -> None:
    """Writes a network that computes 8 TB of zeros."""
    nodes = [
        helper.make_node("ConstantOfShape", ["n"], ["zeros"]),
        helper.make_node("ReduceSum", ["zeros"], ["sum"], keepdims=0),
        helper.make_node("Add", ["obs", "sum"], ["actions"]),
    ]
    write(path, nodes, [value("obs", [1, 1])], [value("actions", [1, 1])], {"n": np.array([2 * 10**12], np.int64)})


def _metadata(**texts: str) -> Callable[[Path], object]:
    return lambda path: linear(path, WEIGHTS, metadata=texts)


def _operator(name: str, domain: str = "") -> Callable[[Path], None]:
    def change(model: onnx.ModelProto) -> None:
        model.graph.node[0].op_type = name
        model.graph.node[0].domain = domain
        if domain:
            model.opset_import.append(helper.make_opsetid(domain, 1))

    return _saved(change)


def _typed(kind: int) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        nodes = [helper.make_node("Identity", ["obs"], ["actions"])]
        write(path, nodes, [value("obs", [1, 1], kind)], [value("actions", [1, 1], kind)])

    return make


def _deep(path: Path) -> None:
    nodes = [helper.make_node("Identity", [f"x{i}" if i else "obs"], [f"x{i + 1}"]) for i in range(20_000)]
    nodes.append(helper.make_node("Identity", ["x20000"], ["actions"]))
    write(path, nodes, [value("obs", [1, 1])], [value("actions", [1, 1])])


def _circle(path: Path) -> None:
    nodes = [helper.make_node("Add", ["obs", "b"], ["a"]), helper.make_node("Add", ["obs", "a"], ["b"])]
    write(
        path,
        [*nodes, helper.make_node("Identity", ["b"], ["actions"])],
        [value("obs", [1, 1])],
        [value("actions", [1, 1])],
    )


def _named(name: str) -> Callable[[Path], object]:
    return lambda path: linear(path, WEIGHTS, names=(name, "actions"))


def networks() -> Iterator[tuple[str, Content, tuple[int, ...]]]:
    """Yields ONNX networks: the fault, the content, and the exit codes."""
    yield "empty", b"", (7,)
    yield "text", "model: m.xml\n", (7,)
    yield "a pickle", pickle.dumps(Bomb()), (7,)
    yield "zeros", bytes(5000), (7,)
    for share in (0.1, 0.5, 0.9, 0.99):
        yield f"cut off at {share:.0%}", _bytes(lambda content, share=share: content[: int(len(content) * share)]), (7,)
    for place in (5, 20, 60, 90):
        flip = _bytes(lambda content, at=place: content[:at] + bytes([content[at] ^ 255]) + content[at + 1 :])
        yield f"byte {place} flipped", flip, (2, 7)
    for what, place in INPUTS["WEIGHTS_OUTSIDE"].items():
        yield f"external data {what}", _external(place), (7,)
    yield "external data far behind", _external("near.bin", offset=str(2**62)), (7,)
    yield "external data of 2^62 bytes", _external("near.bin", length=str(2**62)), (7,)
    yield "external data at a negative place", _external("near.bin", offset="-8"), (7,)
    yield "external data at a place in words", _external("near.bin", offset="\x1b[2J"), (7,)
    yield "weights of 10^12 numbers", _dims(10**6, 10**6), (7,)
    yield "weights of 2^62 numbers", _dims(2**31, 2**31), (7,)
    yield "weights of negative size", _dims(-1, 1), (7,)
    yield "weights of more dimensions", _dims(1, 1, 1, 1), (0,)  # which multiply as well
    yield "8 TB of zeros", _huge_constant, (2, 7)
    yield "an unknown operator", _operator("Frobnicate"), (7,)
    yield "an operator of a foreign domain", _operator("Evil", "com.evil"), (7,)
    yield "an operator of escape sequences", _operator("\x1b[2J"), (7,)
    yield "python", _operator("PyOp", "com.microsoft.extensions"), (7,)
    kinds = {
        "integers": TensorProto.INT64,
        "texts": TensorProto.STRING,
        "truths": TensorProto.BOOL,
        "halves": TensorProto.COMPLEX64,
    }
    for what, kind in kinds.items():
        yield what, _typed(kind), (2, 7)
    yield "seven observations", lambda path: linear(path, np.ones((1, 7), np.float32)), (2,)
    yield "nine actions", lambda path: linear(path, np.ones((9, 1), np.float32)), (2,)
    yield "NaN", lambda path: linear(path, WEIGHTS, bias=np.nan), (4,)
    yield "infinity", lambda path: linear(path, WEIGHTS, bias=np.inf), (4,)
    yield "20,000 operators", _deep, (0,)
    yield "a circle", _circle, (7,)
    yield "an input of escape sequences", _named("\x1b[2J\x1b]0;owned\x07"), (0, 2)
    yield "an input of 100,000 characters", _named("o" * 100_000), (0, 2)
    yield "an opset of the future", _saved(lambda model: model.opset_import[0].__setattr__("version", 10**6)), (7,)
    yield "a version of the future", _saved(lambda model: setattr(model, "ir_version", 10**6)), (7,)
    yield "no graph", _saved(lambda model: model.ClearField("graph")), (7,)
    yield "no inputs", _saved(lambda model: model.graph.ClearField("input")), (2, 7)
    yield "no outputs", _saved(lambda model: model.graph.ClearField("output")), (2, 7)
    yield "an input of size 0", lambda path: linear(path, WEIGHTS, shape=[1, 0]), (2, 7)
    yield "an input of size 2^62", lambda path: linear(path, WEIGHTS, shape=[1, 2**62]), (2, 7)
    yield "an input of no size", lambda path: linear(path, WEIGHTS, shape=[]), (2, 7)
    yield "joints that are not there", _metadata(joint_names="\x1b[2J,b", action_scale="1,1"), (0, 2)
    yield "scales of words", _metadata(joint_names="hinge", action_scale="\x1b[2J"), (2, 7)
    yield "scales without end", _metadata(joint_names="hinge", action_scale=",".join(["1"] * 50_000)), (0, 2, 7)
    yield "scales that are none", _metadata(joint_names="hinge", action_scale="nan", joint_stiffness="inf"), (2, 4, 7)


def packages() -> Iterator[tuple[str, dict[str, Content], tuple[int, ...]]]:
    """Yields LEAPP packages: the fault, the files, and the exit codes."""

    def changed(old: str, new: str) -> dict[str, Content]:
        return {"pack": lambda path: package(path, lambda text: text.replace(old, new))}

    axes = ", ".join(f"[{', '.join(f'n{i}' for i in range(10))}]" for _ in range(12))
    for what, (old, new) in INPUTS["PACKAGES"].items():
        yield what, changed(old, new.replace("AXES", axes)), (2, 7)
    for tag in TAGS[:3]:
        yield f"the tag {tag.split()[0]}", changed("frequency: 50.0", f"frequency: {tag}"), (2, 7)
    yield "aliases that explode", {"pack/walk.yaml": f"{LAUGHS}models: *a9\npipeline: *a9\n"}, (7,)
    backend = f"{LAUGHS}models: {{p: {{parameters: {{backend: *a11, model_path: x}}}}}}\npipeline: {{}}\n"
    yield "aliases that explode in a message", {"pack/walk.yaml": backend}, (2, 7)
    yield "keys that explode", {"pack/walk.yaml": f"{LAUGHS}models: {{? *a11 : 1}}\npipeline: {{}}\n"}, (2, 7)
    yield "itself", {"pack/walk.yaml": "&a {models: *a, pipeline: *a}\n"}, (2, 7)
    yield "100,000 brackets", {"pack/walk.yaml": "models: " + "[" * 100_000}, (7,)
    yield "no package", {"pack/walk.yaml": "a: b\n"}, (7,)
    yield "empty", {"pack/walk.yaml": ""}, (7,)
    yield "two packages", {"pack/a.yaml": "", "pack/b.yaml": ""}, (2,)
    yield "no files", {"pack/readme.txt": ""}, (2,)


def _tensors(header: object, content: bytes = bytes(8)) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + content


def tensors() -> Iterator[tuple[str, bytes]]:
    """Yields broken files of initial values of a package."""
    entry = {"dtype": "F32", "shape": [1, 2], "data_offsets": [0, 8]}
    yield "empty", b""
    yield "a header of 2^63 bytes", struct.pack("<Q", 2**63) + b"{}"
    yield "a header of 90 MB that is not there", struct.pack("<Q", 90_000_000) + b"{}"
    yield "no JSON", _tensors(b"{")
    yield "a list", _tensors([1])
    yield "deep", _tensors(b"[" * 100_000)
    yield "places outside", _tensors({"a": {**entry, "data_offsets": [0, 10**12]}})
    yield "places below 0", _tensors({"a": {**entry, "data_offsets": [-8, 0]}})
    yield "places in words", _tensors({"a": {**entry, "data_offsets": ["a", "b"]}})
    yield "another shape", _tensors({"policy/memory_in": {**entry, "shape": [1, 2, 9]}})
    yield "a shape of 2^62", _tensors({"policy/memory_in": {**entry, "shape": [2**62, 4]}})
    yield "an unknown type", _tensors({"policy/memory_in": {**entry, "dtype": "X9"}})
    yield "objects", _tensors({"policy/memory_in": {**entry, "dtype": "O"}})
    yield "another name", _tensors({"\x1b[2J": entry})


def statistics() -> Iterator[tuple[str, str, Content]]:
    """Yields invalid files of statistics."""

    def npz(**changes: np.ndarray) -> bytes:
        arrays = {"mean": np.zeros(1), "var": np.ones(1), **changes}
        return archive({f"{name}.npy": npy(array) for name, array in arrays.items()})

    yield "empty", "s.npz", b""
    yield "no archive", "s.npz", b"PK"
    yield "other sizes", "s.npz", npz(var=np.ones(2))
    yield "NaN", "s.npz", npz(mean=np.array([np.nan]))
    yield "a negative variance", "s.npz", npz(var=np.array([-1.0]))
    yield "texts", "s.npz", npz(mean=np.array(["a"]))
    yield "objects that unpickle", "s.npz", npz(mean=np.array([Bomb()], object))
    yield "a clip that unpickles", "s.npz", npz(clip=np.array(Bomb(), object))
    yield "no numbers", "s.npz", npz(mean=np.zeros(0), var=np.zeros(0))
    yield "a clip of 0", "s.npz", npz(clip=np.array(0.0))
    yield "a clip that is a list", "s.npz", npz(clip=np.zeros(3))
    yield "without a mean", "s.npz", archive({"var.npy": npy(np.ones(1))})
    yield "a pickle of code", "s.pkl", pickle.dumps(Bomb())
    yield "a pickle of nothing", "s.pkl", pickle.dumps(None)
    yield "a pickle that is cut off", "s.pkl", pickle.dumps({"a": np.zeros(100)})[:50]
    yield "a pickle of a long text that is not there", "s.pkl", b"\x80\x04\x8e" + struct.pack("<Q", 2**40) + b"x."
    yield "a pickle of a deep list", "s.pkl", b"\x80\x04" + b"](" * 200_000 + b"e" * 200_000 + b"."
    yield "a pickle that grows", "s.pkl", b"\x80\x04]" + b"q\x00h\x00a" * 3 + b"."
    yield "a pickle of persistent ids", "s.pkl", b"\x80\x04X\x01\x00\x00\x00aQ."
    yield "a pickle of extensions", "s.pkl", b"\x80\x04\x82\x01."
    yield "text", "s.pkl", "cos\nsystem\n(S'touch " + CANARY + "'\ntR."
    yield "of another kind", "s.txt", "mean: 0\n"


def forms() -> Iterator[Form]:
    base: dict[str, Content] = {
        "task.yaml": TASK,
        "link.bin": lambda path: path.symlink_to(f"../{BETWEEN}"),
        "near.bin": bytes(4),
        "sub/x": b"",
    }
    for index, (what, content, codes) in enumerate(networks()):
        for line in (TRACE, (EVAL, MODEL, CHECK)[index % 3]):
            expected = (1, *codes) if line is CHECK else (0, *codes) if line is MODEL else codes
            expected = (*expected, 2) if line is MODEL else expected  # which needs metadata
            yield Form(
                f"onnx, {what}, {line[0]}",
                (*line, "p.onnx"),
                expected,
                {**base, "p.onnx": content},
                quick=line is TRACE and index % 6 == 0,
            )
    for index, (what, files, codes) in enumerate(packages()):
        for line in (TRACE, (MODEL, EVAL)[index % 2]):
            yield Form(
                f"leapp, {what}, {line[0]} {line[1]}",
                (*line, "pack"),
                codes,
                {**base, **files},
                quick=line is TRACE and index % 8 == 0,
            )
    for what, content in tensors():
        files: Mapping[str, Content] = {**base, "pack": package, "pack/walk_initial_values.safetensors": content}
        yield Form(f"leapp, initial values, {what}", (*TRACE, "pack"), (7,), files)
    for index, (what, name, content) in enumerate(statistics()):
        files = {**base, "p.onnx": good, name: content}
        for line in (TRACE, EVAL):
            arguments = (*line, "p.onnx", "--normalize", name)
            yield Form(
                f"normalize, {what}, {line[0]}",
                arguments,
                (2,) if name == "s.txt" else (7,),
                files,
                quick=line is TRACE and index % 5 == 1,
            )
    for name in ("p.zip", "p.pt", "p.pth", "p.py", "p.txt", "p"):
        for trust in ((), ("--trust",)):
            codes = (2, 7)
            yield Form(
                f"policy {name} {trust}",
                (*TRACE, name, *trust),
                codes,
                {**base, name: pickle.dumps(Bomb()) if name != "p.py" else ""},
            )
    nasty = archive({"data": b"{}", "policy.pth": pickle.dumps(Bomb()), "../../evil": b"x", "system_info.txt": b""})
    yield Form("policy.zip of code, untrusted", (*TRACE, "p.zip"), (2,), {**base, "p.zip": nasty})
    for policy in ("", "nothing", "../x.onnx", "os:system", "\x1b[2J.onnx", "x" * 5000 + ".onnx", "sub", "a\x7f.onnx"):
        yield Form(f"policy {policy[:30]!a}", (*TRACE, policy), (2, 7), base)
