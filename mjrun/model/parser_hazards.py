"""Hazards in the text of a model that would crash MuJoCo or keep it busy forever, found before MuJoCo reads it.

MuJoCo reads attached models recursively: a circle overflows the stack, and the time for a chain of models grows with
the cube of its length.
"""

import os.path
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mjrun.errors import BrokenModelError, quoted
from mjrun.model.model_files import file_content, first_existing, main_mjcf
from mjrun.model.xml_source import scan, with_slashes
from mjrun.suffixes import ARCHIVES

# A stack of 8 MiB overflows at about 2,500 includes, and below 2,000 models; a hundred models take a second.
MOST_INCLUDES = 500
MOST_MODELS = 100
MOST_KEYFRAMES = 20_000  # allocated by nkey: MuJoCo compares the name of each with all others
MOST_POINTS = 32_000  # of a flexcomp: MuJoCo compares each with all others
MOST_LINKS = 1000  # in a chain of a URDF: MuJoCo compares all joints; 2,000 links take 15 s, 3,000 a minute
MOST_COPIES = 1_000_000  # made by <replicate>: more take MuJoCo minutes and gigabytes
NESTED = (b"<include", b"<model", b"nkey", b"<flexcomp", b"<replicate")


class _Tag(NamedTuple):
    """An element in line `line` of the file `file`."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    copies: int  # of its content, made by this and the surrounding <replicate> elements


class _Model(NamedTuple):
    """A model in a chain of attached models, with its <model> elements that are still to be followed."""

    path: str
    real: str
    attached: Iterator[_Tag]


def require_finite_nesting(path: Path, main: str, text: bytes | None) -> None:
    """Checks that models do not attach each other in a circle or too deeply, and that no count is excessive.

    Args:
      path: the name of the model in errors.
      main: the file with its `text`; a path within an archive if the model is one.

    Raises:
      BrokenModelError: a check fails.
    """
    if text is not None and path.suffix == ".urdf":
        _check_links(path, text)
    if text is None or not any(word in text for word in NESTED):
        return
    known = {os.path.realpath(main)}
    waiting = [_Model(main, os.path.realpath(main), _attached(main, text))]
    while waiting:
        tag = next(waiting[-1].attached, None)
        if tag is None:
            waiting.pop()
            continue
        inner = _attached_file(tag, waiting[-1].path)
        if inner is None:
            continue
        real = os.path.realpath(inner)
        if real in [model.real for model in waiting]:
            what = f"attaches {quoted(tag.attributes['file'])}, which is or attaches this model again"
            raise _broken(tag, f"{what}: MuJoCo would never finish", "remove one of the <model> elements")
        if len(waiting) >= MOST_MODELS:
            what = f"attaches a model at nesting level {len(waiting) + 1}; the limit is {MOST_MODELS}"
            raise _broken(tag, what, "attach the models side by side, or write them into fewer files")
        if real not in known and (content := file_content(inner)) is not None:
            known.add(real)
            waiting.append(_Model(inner, real, _attached(inner, content)))


def _attached(main: str, text: bytes) -> Iterator[_Tag]:
    """Yields the `<model>` elements of a model and of its includes, whose counts it checks."""
    files, included = [(main, text, 1)], {os.path.realpath(main)}
    while files:
        path, content, depth = files.pop()
        for tag in _tags(path, content):
            if tag.tag == "model":
                yield tag
            elif tag.tag == "include":
                place = _included_file(tag, main)
                if place is None or os.path.realpath(place) in included:  # MuJoCo reports the circle
                    continue
                if depth >= MOST_INCLUDES:
                    what = f"is included at nesting level {depth}; the limit is {MOST_INCLUDES}"
                    raise _broken(tag, f"{quoted(tag.attributes['file'])} {what}", "include the files side by side")
                included.add(os.path.realpath(place))
                if (inner := file_content(place)) is not None:
                    files.append((place, inner, depth + 1))
            else:
                _check_counts(tag)


def _check_links(path: Path, text: bytes) -> None:
    """Checks the length of the chains of links in a URDF."""
    parents, ends = dict[str, str](), dict[str, str]()

    def start(tag: str, attributes: dict[str, str], line: int) -> None:
        if tag == "joint":
            ends.clear()
        elif tag in ("parent", "child"):
            ends[tag] = attributes.get("link", "")
            if len(ends) == 2:
                parents[ends["child"]] = ends["parent"]

    scan(text, start)
    for link in parents.keys() - set(parents.values()):  # the last of each chain
        length, above = 1, link
        while (above := parents.get(above, "")) and length <= MOST_LINKS:
            length += 1
        if length > MOST_LINKS:
            message = f"more than {MOST_LINKS} links form a chain to {quoted(link)}, which takes MuJoCo minutes"
            raise BrokenModelError(path, message, hint="merge links that are fixed to each other, or convert to MJCF")


def _check_counts(tag: _Tag) -> None:
    if tag.tag == "size" and _whole(tag.attributes.get("nkey", "")) > MOST_KEYFRAMES:
        what = f"nkey allocates {tag.attributes['nkey']} keyframes; MuJoCo needs hours for more than {MOST_KEYFRAMES}"
        raise _broken(tag, what, "omit nkey: by default it is the number of keyframes in the model")
    if tag.tag == "replicate" and tag.copies > MOST_COPIES:
        what = f"replicate makes {tag.copies:.3g} copies; MuJoCo needs hours and too much memory"
        raise _broken(tag, f"{what} for more than {MOST_COPIES}", "lower its count")
    if tag.tag == "flexcomp":
        points = 1
        for count in tag.attributes.get("count", "").split():
            points *= max(1, _whole(count))
        if points > MOST_POINTS:
            what = f"flexcomp has {points} points; MuJoCo needs hours for more than {MOST_POINTS}"
            raise _broken(tag, what, "lower its count")


def _whole(text: str) -> int:
    try:
        return int(float(text))
    except (ValueError, OverflowError):
        return 0


def _tags(path: str, content: bytes) -> list[_Tag]:
    """Returns the elements of interest in a file; those before the fault if it is not well-formed."""
    tags, copies = list[_Tag](), [1]

    def start(tag: str, attributes: dict[str, str], line: int) -> None:
        if tag == "replicate":
            copies.append(copies[-1] * max(1, _whole(attributes.get("count", ""))))
        if (tag in ("include", "model") and attributes.get("file")) or tag in ("size", "flexcomp", "replicate"):
            tags.append(_Tag(tag, attributes, path, line, copies[-1]))

    def end(tag: str) -> None:
        if tag == "replicate":
            copies.pop()

    scan(content, start, end)
    return tags


def _attached_file(tag: _Tag, model: str) -> str | None:
    """Returns the file of a `<model>` element, and the main member of an archive; None if it does not exist."""
    name = with_slashes(tag.attributes["file"])
    place = first_existing([os.path.join(os.path.dirname(model), name), name])  # noqa: PTH118, PTH120
    if place and place.endswith(ARCHIVES):
        return main_mjcf(Path(place))
    return place


def _included_file(tag: _Tag, main: str) -> str | None:
    """Returns the file of an `<include>` element, which MuJoCo looks for next to the model first."""
    name = with_slashes(tag.attributes["file"])
    return first_existing(os.path.join(os.path.dirname(base), name) for base in (main, tag.file))  # noqa: PTH118, PTH120


def _broken(tag: _Tag, message: str, hint: str) -> BrokenModelError:
    return BrokenModelError(Path(tag.file), message, tag.line, hint)
