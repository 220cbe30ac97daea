"""Keyframe output: the model's XML with an instant of the simulation added as a keyframe.

Every other byte of the file stays unchanged, and MuJoCo loads it in its new place before it is published.
"""

import html
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BrokenModelError, FileError, UsageError, clean, file_errors, listing, option, quoted
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.formats.temporary_output import temporary_file
from mjrun.model import state
from mjrun.model.names import identify, names
from mjrun.model.source import compile_spec, model_errors, physics_fingerprint
from mjrun.model.text_edits import ATTRIBUTE
from mjrun.model.xml_source import START_TAG, Element, XmlParser, without_dashes
from mjrun.options.option import options
from mjrun.options.output import KeyframeOptions
from mjrun.outputs import output
from mjrun.physics.simulation_loop import Tap
from mjrun.physics.stepper import Stepper
from mjrun.timeline import nearest

ELSEWHERE = "relative paths in it start from the folder of the model: write it there"
NOT_STATE = ("qacc_warmstart",)  # fields that help the solver, whose loss is not reported
QUATERNIONS = ("qpos", "mocap_quat")  # MuJoCo normalizes those of keyframes
BOM = b"\xef\xbb\xbf"
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, 2.2
LINE_END = re.compile("\r\n?")
INDENT = b"  "  # for files without indentation
# The field of MjData that each attribute of a key holds, in MuJoCo's order.
ATTRIBUTES = {
    "time": "time",
    "qpos": "qpos",
    "qvel": "qvel",
    "act": "act",
    "ctrl": "ctrl",
    "mpos": "mocap_pos",
    "mquat": "mocap_quat",
}


class KeyframeWriter(OutputWriter):
    """A writer of a model's XML with a key.

    Opening it compiles the model, with a preliminary key, from the folder of the output: assets and includes must be
    found from there, and be the same.

    Args:
      path: an .xml file; it may be the model's.
      source: main file of the model.
      xml: content of that file.
      name: name of the key.
      model: the model, compiled without overrides.

    Raises:
      FileError: the output cannot be written, or would not be the same model there.
    """

    def __init__(self, path: str, source: Path, xml: bytes, name: str, model: mujoco.MjModel) -> None:
        super().__init__(StagedFile(Path(path)))
        self._source = source
        self._xml = xml
        self._name = name
        self._in_place = os.path.realpath(path) == os.path.realpath(source)
        with self.opening():
            first = _fields(model, state.save(model, mujoco.MjData(model)))
            compiled = self._compiled(with_key(xml, name, first))
            if physics_fingerprint(compiled) != physics_fingerprint(model):
                raise FileError(
                    path, f"would be another model than {clean(str(source))}: files beside it differ", ELSEWHERE
                )

    def write(self, model: mujoco.MjModel, last: np.ndarray) -> list[str]:
        """Writes the key of the integration state `last` `(nstate,)` of `model`, and loads it to compare.

        Returns:
          A sentence for each field of the state that a start from the key does not reproduce.

        Raises:
          FileError: the disk is full, or the model's file has changed in the meantime and would be overwritten.
        """
        if self._in_place and self._source.read_bytes() != self._xml:
            raise FileError(self._source, "has changed since it was read, and is left unchanged")
        text = with_key(self._xml, self._name, _fields(model, last))
        loaded = self._compiled(text)
        data = mujoco.MjData(loaded)
        mujoco.mj_resetDataKeyframe(loaded, data, identify(loaded, "keyframe", self._name))
        self.write_file(text)
        return _differences(_parts(model, last), _parts(loaded, state.save(loaded, data)))

    def _compiled(self, text: bytes) -> mujoco.MjModel:
        shown = Path(self.destination.shown)
        beside = Path(self.destination.path).with_name(shown.name)
        with self.writing(), temporary_file(beside, text, ".xml") as path:
            try:
                with model_errors(shown):
                    spec = mujoco.MjSpec.from_file(str(path))
                return compile_spec(spec, (), shown)[1]
            except BrokenModelError as error:
                reason = str(error).removeprefix(f"{clean(str(shown))}:").lstrip()
                reason = f"line {reason}" if error.line else reason
                raise FileError(shown, f"would not load: {reason}", ELSEWHERE) from None


def _fields(model: mujoco.MjModel, last: np.ndarray) -> Mapping[str, np.ndarray]:
    """Returns the fields of a state that a key holds."""
    parts = _parts(model, last)
    return {name: parts.get(name, np.empty(0)) for name in ATTRIBUTES.values()}


def _parts(model: mujoco.MjModel, whole: np.ndarray) -> Mapping[str, np.ndarray]:
    """Returns the fields of an integration state of `model`."""
    return {name: whole[part] for name, part in state.fields(state.sizes(model)).items()}


def _differences(last: Mapping[str, np.ndarray], loaded: Mapping[str, np.ndarray]) -> list[str]:
    """Returns a sentence for each field of a state `last` that differs in `loaded`, the state of a start from the key.

    Overrides may have added numbers to `last`: a ground adds a body, on which no force acts, and a delay adds history.
    """
    texts: list[str] = []
    for name, part in last.items():
        start = np.zeros(len(part))
        start[: len(loaded.get(name, ()))] = loaded.get(name, ())
        if name in NOT_STATE or np.array_equal(part, start):
            continue
        if name in QUATERNIONS:
            texts.append(f"MuJoCo normalizes quaternions of keyframes: {name} differs in its last bits")
        elif name in ATTRIBUTES.values():
            raise AssertionError(f"{name} of the key is not that of the state")
        else:
            texts.append(f"a keyframe does not hold {name}: its value at this instant is lost")
    return texts


def with_key(xml: bytes, name: str, fields: Mapping[str, np.ndarray]) -> bytes:
    """Returns the MJCF `xml` with a key called `name` that holds `fields` of MjData, by name; empty fields are omitted.

    A key with that name is replaced. A new key follows the last one, or goes into a new section at the end. All other
    bytes stay unchanged: comments, indentation, line ends, encoding.

    Raises:
      ValueError: `xml` is not an MJCF model, or not well-formed; the message states the fault.
    """
    if xml.startswith(BOM):
        return BOM + with_key(xml.removeprefix(BOM), name, fields)
    root = _parse(xml)
    newline = b"\r\n" if b"\r\n" in xml else b"\n"
    unit = (_indent(xml, root.children[0].offset) if root.children else b"") or INDENT
    sections = [element for element in root.children if element.tag == "keyframe"]
    keys = _keys(root)

    def lines(indent: bytes) -> bytes:
        return (newline + indent + unit).join(_lines(name, fields))

    if same := [key for key in keys if _name(xml, key) == name]:
        start = same[-1].offset
        return _replaced(xml, start, _end(xml, same[-1]), lines(_indent(xml, start)))
    if keys:
        indent, end = _indent(xml, keys[-1].offset), _end(xml, keys[-1])
        return _replaced(xml, end, end, newline + indent + lines(indent))
    if sections:
        indent = _indent(xml, sections[-1].offset)
        return _with_child(xml, sections[-1], lines(indent + unit), indent, unit, newline)
    section = (newline + unit).join([b"<keyframe>", unit + lines(2 * unit), b"</keyframe>"])
    return _with_child(xml, root, section, _indent(xml, root.offset), unit, newline)


def key_names(xml: bytes) -> list[str]:
    """Returns the names of the keys in `xml`; empty for unnamed keys. Included files are not read.

    Raises:
      ValueError: `xml` is not an MJCF model, or not well-formed.
    """
    text = xml.removeprefix(BOM)
    return [_name(text, key) for key in _keys(_parse(text))]


def _keys(root: Element) -> list[Element]:
    sections = [element for element in root.children if element.tag == "keyframe"]
    return [key for section in sections for key in section.children if key.tag == "key"]


def _name(xml: bytes, key: Element) -> str:
    """Returns the name of a key, decoded as UTF-8 like MuJoCo does, with its character references."""
    attributes = ATTRIBUTE.finditer(xml, key.offset, _inner(xml, key))
    name = next((attribute["value"] for attribute in attributes if attribute["name"] == b"name"), b"")
    return html.unescape(LINE_END.sub("\n", name[1:-1].decode("utf-8", "replace")))


def _inner(xml: bytes, element: Element) -> int:
    """Returns the offset at which the start tag of an element ends."""
    tag = START_TAG.match(xml, element.offset)
    assert tag, "the parser reported an element here"
    return tag.end()


def _is_empty(xml: bytes, element: Element) -> bool:
    return xml[: _inner(xml, element)].endswith(b"/>")


def _end(xml: bytes, element: Element) -> int:
    """Returns the offset at which an element ends."""
    return _inner(xml, element) if _is_empty(xml, element) else xml.index(b">", element.closing) + 1


def _with_child(xml: bytes, parent: Element, child: bytes, indent: bytes, unit: bytes, newline: bytes) -> bytes:
    """Returns `xml` with `child` at the end of `parent`, which is indented by `indent`."""
    inserted = newline + indent + unit + child
    if _is_empty(xml, parent):
        end = _inner(xml, parent)
        opened = re.sub(rb"\s*/>\Z", b">", xml[parent.offset : end])
        closing = newline + indent + f"</{parent.tag}>".encode()
        return _replaced(xml, parent.offset, end, opened + inserted + closing)
    end = len(xml[: parent.closing].rstrip(b" \t\r\n"))  # after its last child
    rest = xml[end : parent.closing]
    return _replaced(xml, end, end, inserted + (b"" if b"\n" in rest else newline + indent))


def _lines(name: str, fields: Mapping[str, np.ndarray]) -> list[bytes]:
    """Returns the lines of a key without indentation: name and time, then one line for each vector."""
    texts = [
        f"{attribute}={quoteattr(' '.join(repr(value).removesuffix('.0') for value in values))}"  # reads back exactly
        for attribute, source in ATTRIBUTES.items()
        if (values := np.ravel(fields[source]).tolist())
    ]
    heads = [f"<key name={quoteattr(name)} {texts[0]}", *texts[1:]]
    return [line.encode() for line in [*heads[:-1], heads[-1] + "/>"]]


def _replaced(xml: bytes, start: int, end: int, text: bytes) -> bytes:
    return xml[:start] + text + xml[end:]


def _indent(xml: bytes, start: int) -> bytes:
    """Returns the text before `start` on its line if it is blank."""
    before = xml[:start].rpartition(b"\n")[2]
    return b"" if before.strip(b" \t") else before


def _parse(xml: bytes) -> Element:
    """Returns the root of `xml`, with all elements below it."""
    # MuJoCo reads a file as UTF-8, whatever encoding it declares, and accepts invalid bytes. In Latin-1 every byte is a
    # character, so positions in the text are positions of bytes.
    parser = XmlParser(Path(), "iso-8859-1")
    try:
        parser.expat.Parse(without_dashes(xml), True)
    except expat.ExpatError as error:
        raise ValueError(f"it is not well-formed XML: {error}") from None
    assert parser.root
    if parser.root.tag != "mujoco":
        raise ValueError(f"it is not MJCF: its root element is <{clean(parser.root.tag)}>")
    return parser.root


SUFFIX = ".xml"
KEY_SIZES = ("nq", "nv", "na", "nu", "nmocap")  # that determine the lengths of the attributes of a key


@options
class Keyframe(KeyframeOptions, output.OutputRequest["KeyframeResult"]):
    """A keyframe with an instant of a simulation, saved in the model's XML: its options are keywords."""

    @property
    def rewritten_inputs(self) -> Sequence[str]:
        """The model file, which may be replaced by one with the keyframe."""
        return [self.output]

    def check(self) -> None:
        """Checks the file name, the key name, and that the model has XML.

        Raises:
          UsageError: the output is not an .xml file, or the model has no XML file.
        """
        if Path(self.output).suffix != SUFFIX:
            raise UsageError(
                f"{clean(self.output)}: keyframes are saved as XML; give an {SUFFIX} file",
                path=("output",),
            )
        if not self.name.strip():
            raise UsageError("the keyframe needs a name", path=("name",))
        if NOT_XML.search(self.name):
            reason = "has a character that XML does not allow; choose another name"
            raise UsageError(f"the name of the keyframe, {quoted(self.name)}, {reason}", path=("name",))
        if self.simulation.position_control is not None:
            reason = "the controls of the keyframe would be positions, and the file has no servos"
            raise UsageError(f"{option('position_control')} and a keyframe exclude each other: {reason}", ("output",))
        self._main_file()

    def _main_file(self) -> Path:
        """Returns the file that the keyframe is added to."""
        source = self.simulation.source
        main = source.main_file
        if main is None or main.suffix != SUFFIX:
            model = f"the model {clean(source.text)}" if source.text else "a compiled model"
            raise UsageError(f"{model} has no {SUFFIX} file to add a keyframe to")
        return main

    def plan(self, context: output.PassContext) -> "output.OutputPlan[KeyframeResult]":
        """Reads the XML and finds the place for the key.

        Raises:
          FileError: the model cannot be read.
          UsageError: the key cannot be added to the XML.
        """
        model, file = context.model, self._main_file()
        with file_errors(file):
            xml = file.read_bytes()
        try:
            written = key_names(xml)
        except ValueError as error:
            raise UsageError(f"cannot add a key to {clean(str(file))}: {error}") from None
        if self.name in names(model, "keyframe") and self.name not in written:
            raise UsageError(
                f"keyframe {quoted(self.name)} already exists in a file that the model includes\nchoose another name",
                path=("name",),
            )

        step, timeline = self.step, context.timeline
        if step is None:
            step = timeline.steps if self.time is None else nearest(self.time / timeline.timestep)
        context.require_before_end(step, "time" if self.step is None else "step")
        numbers = 1 + model.nq + model.nv + model.na + model.nu + 7 * model.nmocap
        about = f"{clean(self.name)}, {numbers} numbers"
        preview = output.OutputPreview("keyframe", self.output, 1, "key", [numbers], about)
        return output.OutputPlan(
            preview=preview, until=step, open=lambda stack, _: OpenKeyframe(self, context, step, file, xml, stack)
        )


@dataclass(frozen=True)
class KeyframeResult(output.OutputResult):
    """The result of a keyframe output.

    Attributes:
      path: path of the file.
      name: name of the key.
      time: simulated time of the key [s].
      step: step of the key.
    """

    name: str
    time: float
    step: int


class OpenKeyframe(output.OpenOutput[KeyframeResult]):
    """A keyframe with an open file.

    Args:
      file, xml: the main file of the model and its content.
    """

    def __init__(
        self, request: Keyframe, context: output.PassContext, step: int, file: Path, xml: bytes, stack: ExitStack
    ) -> None:
        self._request, self._context, self._step = request, context, step
        self._state = np.empty(0)
        model, origin = context.model, request.simulation.source
        if origin.overrides:
            model = replace(origin, overrides=()).load()
            overrides = listing([str(override) for override in origin.overrides])
            for size in KEY_SIZES:
                if getattr(model, size) != getattr(context.model, size):
                    reason = f"with {overrides}, {size} is {getattr(context.model, size)}, not {getattr(model, size)}"
                    raise UsageError(f"the file cannot hold a keyframe of the overridden model: {reason}", ("output",))
            context.reporter.warn(f"{request.output} holds the model without its overrides: {overrides} is left out")
        self._facts = context.facts(request)
        self.taps = [Tap([step], self._record)]
        self._writer = stack.enter_context(KeyframeWriter(request.output, file, xml, request.name, model))

    def finish(self, simulation_wall: float) -> output.FinishedOutput[KeyframeResult]:
        for text in self._writer.write(self._context.model, self._state):
            self._context.reporter.warn(f"{clean(self._request.output)}: {text}")
        result = KeyframeResult(
            path=self._request.output,
            name=self._request.name,
            time=float(self._context.timeline.time(self._step)),
            step=self._step,
        )
        self._writer.finish()
        return output.FinishedOutput(result, [self._writer], self._facts)

    def _record(self, stepper: Stepper) -> None:
        self._state = stepper.state()
