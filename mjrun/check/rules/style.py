"""Attributes that are valid but better written in another way, and objects without a name."""

import os
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Fix, Place, Violation
from mjrun.check.rule import SAFE, rule
from mjrun.check.rules.asset_files import FOLDER_ATTRIBUTES, asset_folders, file_attributes
from mjrun.check.rules.bodies import flex_bodies
from mjrun.errors import quoted
from mjrun.model.names import COUNTS, KINDS
from mjrun.model.text_edits import number_word
from mjrun.model.xml_source import Element, with_slashes

# Attributes that MuJoCo still reads, the reason against them, and the fields of the model that change without them.
WITHOUT_EFFECT = "it has no effect any more"
DEPRECATED = {
    ("size", "njmax"): (f"{WITHOUT_EFFECT}: MuJoCo allocates memory as needed", ("njmax", "narena")),
    ("size", "nconmax"): (f"{WITHOUT_EFFECT}: MuJoCo allocates memory as needed", ("nconmax", "narena")),
    ("size", "nstack"): ("memory is its successor, and is sufficient by default", ("narena",)),
    ("statistic", "meaninertia"): (WITHOUT_EFFECT, ("stat*",)),
    ("light", "directional"): ("type is its successor", ()),
}
ROUNDED, INTENDED = 1e-3, 0.02  # differences of a length from 1: of few digits, and of a vector meant to have length 1
DIRECTIONS = {"quat": 4, "axis": 3}  # attributes that MuJoCo normalizes, and their numbers
FOLDERS = ("meshdir", "texturedir", "assetdir")
LISTED = 8  # numbers in one message


@rule("MJ116", "note", "deprecated attribute", fix=SAFE)
def deprecated_attributes(context: CheckContext) -> Iterator[Violation]:
    """Yields attributes that MuJoCo accepts only for the sake of older models."""
    for element in _elements(context):
        for attribute in element.attributes:
            if reason := DEPRECATED.get((element.tag, attribute)):
                message = f"the attribute {attribute} of <{element.tag}> is deprecated: {reason[0]}"
                remedy = 'write type="directional"' if attribute == "directional" else "delete it"
                yield _violation(element, message, remedy, partial(_modern, context, element, attribute))


def _modern(context: CheckContext, element: Element, attribute: str) -> Fix:
    deprecated = {
        name: DEPRECATED[element.tag, name][1] for name in element.attributes if (element.tag, name) in DEPRECATED
    }
    if attribute != "directional" or element.attributes[attribute] != "true":
        fields = chain.from_iterable(deprecated.values())
        removed = () if element.tag == "light" else deprecated  # a light without attributes is one
        return Fix((context.editor.without(element, attribute, removed),), tuple((field, "") for field in fields))
    renamed = context.editor.renamed(element, attribute, "type")
    return Fix((renamed, context.editor.with_value(element, attribute, attribute)))


@rule("MJ117", "note", "absolute path", fix=SAFE)
def absolute_paths(context: CheckContext) -> Iterator[Violation]:
    """Yields absolute paths of files and folders below that of the model, which a copy of the model does not find."""
    home, folders = context.home, asset_folders(context.source)
    if folders.get("strippath") == "true":
        return
    for element in (*context.source.includes, *_elements(context)):
        keys = [*file_attributes(element), *(key for key in FOLDERS if element.tag == "compiler")]
        for key in keys:
            path = Path(with_slashes(element.attributes.get(key, "")))
            if not path.is_absolute() or not path.is_relative_to(home):
                continue
            base = home if key in FOLDERS else home / folders.get(FOLDER_ATTRIBUTES.get(element.tag, ""), "")
            relative = Path(os.path.relpath(path, base)).as_posix()
            message = f"{quoted(str(path))} is absolute: the model works only in this folder of this machine"
            fix = partial(_with_value, context, element, key, relative)
            yield _violation(element, message, f'write {key}="{relative}"', fix)


def _with_value(context: CheckContext, element: Element, attribute: str, value: str) -> Fix:
    return Fix((context.editor.with_value(element, attribute, value),))


@rule("MJ118", "note", "direction that is not normalized", fix=SAFE)
def directions_not_normalized(context: CheckContext) -> Iterator[Violation]:
    """Yields quaternions and axes that are probably meant to have length 1: decimals, and a length close to 1."""
    for element in _elements(context):
        for attribute, count in DIRECTIONS.items():
            numbers = element.numbers(attribute)
            length = float(np.linalg.norm(numbers))
            if len(numbers) == count and ROUNDED < abs(length - 1) < INTENDED:
                message = f"the length of its {attribute} is close to 1, but not 1; MuJoCo normalizes it"
                words = [number_word(number / length) for number in numbers]
                remedy = f'write {attribute}="{" ".join(words)}"'
                yield _violation(element, message, remedy, partial(_with_words, context, element, attribute, words))


def _with_words(context: CheckContext, element: Element, attribute: str, words: Sequence[str]) -> Fix:
    return Fix(context.editor.with_words(element, attribute, dict(enumerate(words))))


def _elements(context: CheckContext) -> Iterator[Element]:
    """Yields the elements of an MJCF model."""
    root = context.source.root
    return context.source.elements() if root is not None and root.tag == "mujoco" else iter(())


def _violation(element: Element, message: str, remedy: str, fix: partial[Fix]) -> Violation:
    return Violation(message, remedy, Place(element.file, element.line), str(element), fix=fix)


@rule("MJ201", "note", "object without a name")
def unnamed_objects(context: CheckContext) -> Iterator[Violation]:
    """Yields joints, actuators, sensors and cameras without a name, one violation for each kind.

    The only joint of a body can be addressed by the name of its body, and the parts of a flexcomp cannot be named.
    """
    for kind in ("joint", "actuator", "sensor", "camera"):
        count = getattr(context.model, COUNTS[kind])
        unnamed = [i for i in range(count) if not mujoco.mj_id2name(context.model, KINDS[kind], i)]
        if kind == "joint":
            generated = flex_bodies(context.model)
            unnamed = [joint for joint in unnamed if not _needs_no_name(context.model, joint, generated)]
        if not unnamed:
            continue
        numbers = [str(i) for i in unnamed[:LISTED]] + ["…"] * (len(unnamed) > LISTED)
        message = f"{len(unnamed)} {kind}{'s' * (len(unnamed) > 1)} without a name: {kind}:{', '.join(numbers)}"
        remedy = "name the objects that you want to address: numbers shift whenever the model changes"
        yield context.violation(kind, unnamed[0], message, remedy)


def _needs_no_name(model: mujoco.MjModel, joint: int, generated: set[int]) -> bool:
    body = int(model.jnt_bodyid[joint])
    only_joint = model.body_jntnum[body] == 1 and bool(mujoco.mj_id2name(model, KINDS["body"], body))
    return only_joint or body in generated
