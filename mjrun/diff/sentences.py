"""Sentences about two results: differences of tables, recordings, models, videos and images, and possible reasons.

Possible reasons are the versions, machines, options and models that differ, as far as manifests state them.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import PurePath
from typing import Any, cast

from mjrun.diff.result import (
    SSIM_WINDOW,
    ArrayDifference,
    CellDifference,
    ColumnDifference,
    DerivedFieldDifference,
    FieldDifference,
    FrameDifference,
    GoldenVersions,
    ModelComparison,
    TableDifference,
    UnmatchedObject,
    UnmatchedRows,
    Value,
    VideoOrImageDifference,
    XmlChange,
)
from mjrun.errors import UsageError, clean, counted, listing, option, plain, quoted, shortened
from mjrun.model.names import PLURALS
from mjrun.options.diff import PictureDiffOptions

LISTED = 10  # entries of a list before it is cut: objects of a field, names of a kind, changes of the XML
NUMBERS = 7  # numbers of a row that are shown side by side; of more, only the largest difference
DIGITS = 6  # of a number, or as many as it takes to see a difference
HASH = 12  # characters of a SHA-256
# Keys of a manifest, and their names in messages.
VERSIONS = {"mjrun": "mjrun", "mujoco": "MuJoCo", "numpy": "numpy", "machine": "the machine"}
SETTINGS = {"timestep": "the timestep", "seed": "the seed"}


def table_sentences(table: TableDifference, a: str, b: str, what: str = "row", *, common: bool = False) -> list[str]:
    """Returns the differences between two tables or recordings.

    Args:
      a, b: their names.
      what: the noun for a row: `row` or `state`.
      common: whether only rows and columns that both have count.
    """
    if common:
        of_one = [] if table.rows else [f"no {what} exists in both"]
    else:
        of_one = [
            *_columns_of_one(table.columns_only_a, a),
            *_columns_of_one(table.columns_only_b, b),
            *_rows_of_one(table.only_a, a, table.aligned, what),
            *_rows_of_one(table.only_b, b, table.aligned, what),
        ]
    return [
        *of_one,
        *(f"the unit of {quoted(unit.name)} is {clean(unit.a)} in {a}, {clean(unit.b)} in {b}" for unit in table.units),
        *(_column(column, table, what) for column in table.columns if column.first),
    ]


def place(cell: CellDifference, aligned: str) -> str:
    """Returns the place of a number that differs: `row 207, time 0.412 s`."""
    if aligned == "step":
        return f"step {cell.at:.0f}"
    row = f"row {cell.row}" if cell.row == cell.row_b else f"rows {cell.row} and {cell.row_b}"
    if cell.key:
        return f"{row}, {cell.key}"
    return row if cell.at is None else f"{row}, time {cell.at!r} s"


def golden_versions(golden: GoldenVersions) -> str:
    """Returns a sentence about the versions that made a golden table, and the current ones."""
    made = ", ".join(f"{name} {v}" for name, v in (("mjrun", golden.mjrun), ("MuJoCo", golden.mujoco)) if v)
    now = f"mjrun {golden.mjrun_now}, MuJoCo {golden.mujoco_now}"
    if made == now:
        return f"both were made by {now}"
    return f"it was made by {clean(made) or 'unknown versions'}, this is {now}"


def _columns_of_one(names: Sequence[str], where: str) -> Iterator[str]:
    if names:
        count = "1 column is" if len(names) == 1 else f"{len(names)} columns are"
        yield f"{count} in {where} only: {listing(names)}"


def _rows_of_one(rows: UnmatchedRows, where: str, aligned: str, what: str) -> Iterator[str]:
    if rows.count:
        count = f"1 {what} is" if rows.count == 1 else f"{rows.count} {what}s are"
        first = "" if rows.count == 1 else "the first is "
        yield f"{count} in {where} only: {first}{unmatched_place(rows, aligned)}"


def unmatched_place(rows: UnmatchedRows, aligned: str) -> str:
    """Returns the place of the first of the rows."""
    if rows.at is None:
        return f"row {rows.first}{', ' if rows.key else ''}{rows.key}"
    return f"step {rows.at:.0f}" if aligned == "step" else f"row {rows.first}, time {rows.at!r} s"


def _column(column: ColumnDifference, table: TableDifference, what: str) -> str:
    assert column.first
    where = place(column.first, table.aligned)
    often = f"in {column.differing} of {table.rows} {what}s, first in" if column.differing > 1 else "in"
    a, b = cell_texts(column, column.first)
    return f"{clean(column.name)} differs {often} {where}: {a}, not {b}"


def cell_texts(column: ColumnDifference, cell: CellDifference) -> tuple[str, str]:
    """Returns the two cells of a column as messages show them: texts in quotes."""
    return (quoted(cell.a), quoted(cell.b)) if column.text else (cell.a, cell.b)


def shared_sentence(table: TableDifference, what: str = "row") -> str:
    """Returns a sentence that the shared rows and columns agree, although the tables differ; empty if they do not."""
    if not table.shared_agree:
        return ""
    both = f"{counted(table.rows, what)} and {counted(len(table.columns), 'column')}"
    return f"the {both} that both have agree; {option('common')} compares only these"


def model_sentences(result: ModelComparison) -> list[str]:
    """Returns a line for each value, array, and model with additional objects."""
    values = [_field_line(each) for each in result.fields]
    return [*values, *map(_array_line, result.arrays), *_objects_of_one(result)]


def model_lines(result: ModelComparison, *, every: bool = False) -> Iterator[str]:
    """Yields the differences: values, arrays, objects of one model, computed values, the XML.

    Args:
      every: whether long lists are shown in full.
    """
    most = None if every else LISTED
    for _, group in groupby(result.fields, lambda each: each.field):
        yield from _cut([_field_line(each) for each in group], most)
    for _, group in groupby(result.arrays, lambda each: each.field):
        yield from _cut([_array_line(each) for each in group], most)
    yield from _objects_of_one(result)
    if result.computed:
        yield f"computed from these: {', '.join(map(_computed, result.computed))}"
    if result.xml and not result.equal:
        yield "in the XML:"
        yield from (f"  {line}" for line in _cut([_xml_line(change) for change in result.xml], most))


def _objects_of_one(result: ModelComparison) -> Iterator[str]:
    for source, objects in ((result.a, result.only_a), (result.b, result.only_b)):
        if objects:
            yield f"only in {clean(source)}: {_objects(objects)}"


def _cut(lines: Sequence[str], most: int | None) -> Iterator[str]:
    yield from lines[:most]
    if most is not None and len(lines) > most:
        yield f"… and {len(lines) - most} more like this"


def _field_line(difference: FieldDifference) -> str:
    name = _named(difference.field, difference.object)
    if len(difference.a) > NUMBERS:
        return f"{name} {_most(difference)}"
    components = f".{','.join(map(clean, difference.components))}" if difference.components else ""
    a, b = _side_by_side(difference.a, difference.b)
    unit = f" {difference.unit}" if difference.unit else ""
    return f"{name}{components} {a} → {b}{unit}"


def _most(difference: FieldDifference) -> str:
    """Returns how many of many numbers differ, and the largest difference."""
    largest = "" if difference.largest is None else f", by {difference.largest:.{DIGITS}g} at most"
    return f"differs in {len(difference.a)} values{largest}"


def _array_line(difference: ArrayDifference) -> str:
    name = _named(difference.field, difference.object)
    hashes = f"sha256 {difference.sha256_a[:HASH]} → {difference.sha256_b[:HASH]}"
    if difference.count is None:
        return f"{name} {_shape(difference.shape_a)} → {_shape(difference.shape_b)}, {hashes}"
    largest = f"by {difference.largest:.{DIGITS}g} at most" if difference.largest is not None else ""
    return f"{name} {_shape(difference.shape_a)} differs in {counted(difference.count, 'value')}, {largest}, {hashes}"


def _shape(shape: Sequence[int]) -> str:
    return "×".join(map(str, shape))


def _named(field: str, label: str) -> str:
    return f"{field}[{clean(label)}]" if label else field


def _side_by_side(a: Sequence[Value], b: Sequence[Value]) -> tuple[str, str]:
    if len(a) != len(b):
        return _row(list(map(_plain, a))), _row(list(map(_plain, b)))
    pairs = [_pair(x, y) for x, y in zip(a, b, strict=True)]
    return _row([x for x, _ in pairs]), _row([y for _, y in pairs])


def _row(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def _pair(a: Value, b: Value) -> tuple[str, str]:
    """Formats two values with as many digits as it takes to distinguish them."""
    if isinstance(a, float) and isinstance(b, float) and a != b:
        for digits in range(DIGITS, 18):
            first, second = f"{a:.{digits}g}", f"{b:.{digits}g}"
            if first != second:
                return first, second
    return _plain(a), _plain(b)


def _plain(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else clean(str(value)) or "''"


def _objects(objects: Sequence[UnmatchedObject]) -> str:
    """Formats objects by kind."""
    parts: list[str] = []
    for kind, group in groupby(objects, lambda each: each.kind):
        names = [clean(each.name) for each in group]
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        plural = PLURALS.get(kind, f"{kind}s") if len(names) > 1 else kind
        parts.append(f"{plural} {', '.join(names[:LISTED])}{more}")
    return "; ".join(parts)


def _computed(difference: DerivedFieldDifference) -> str:
    count = f" ({difference.objects})" if difference.objects > 1 else ""
    return f"{difference.field}{count}"


def _xml_line(change: XmlChange) -> str:
    places = " → ".join(clean(str(place)) for place in (change.place_a, change.place_b) if place)
    element = clean(change.element)
    if not change.attribute:
        return f"{places}: {element} {'removed' if change.place_b is None else 'added'}"
    a, b = ("not set" if text is None else f'"{clean(text)}"' for text in (change.a, change.b))
    return f"{places}: {element} {clean(change.attribute)} {a} → {b}"


def picture_sentences(picture: VideoOrImageDifference, a: str, b: str, options: PictureDiffOptions) -> list[str]:
    """Returns the differences beyond the limits of `options`; without limits, every pixel beyond the tolerance counts.

    Raises:
      UsageError: a limit does not apply to these pictures.
    """
    _require_fitting(picture, options)
    differences = [*_structure(picture, a, b)]
    if not picture.frames:
        return differences
    limits = (options.min_psnr, options.min_ssim, options.max_changed)
    beyond = _changed(picture) if limits == (None, None, None) else _beyond_limits(picture, options)
    return [*differences, *beyond]


def frame_facts(frame: FrameDifference) -> str:
    """Returns the measures of a frame: `PSNR 31.2 dB, SSIM 0.912, 3.1 % of the pixels changed, by 0.25 at most`."""
    facts = [
        "" if frame.psnr is None else f"PSNR {frame.psnr:.2f} dB",
        "" if frame.ssim is None else f"SSIM {frame.ssim:.4f}",
        f"{percent(frame.changed)} of the pixels changed",
        f"by {'a non-finite value' if frame.maximum is None else f'{frame.maximum:.6g} at most'}",
    ]
    return ", ".join(filter(None, facts))


def percent(share: float) -> str:
    """Formats a share as a percentage, which is never rounded to zero."""
    return f"{100 * share:.3g} %"


def frame_place(frame: FrameDifference, picture: VideoOrImageDifference) -> str:
    """Returns the place of a frame, `frame 17, time 0.283 s: `; empty for images."""
    if picture.frames_a == picture.frames_b == 1 and frame.time is None:
        return ""
    return f"frame {frame.frame}" + ("" if frame.time is None else f", time {frame.time:.6g} s") + ": "


def _require_fitting(picture: VideoOrImageDifference, options: PictureDiffOptions) -> None:
    limits = {"min_psnr": options.min_psnr, "min_ssim": options.min_ssim}
    for name, limit in limits.items():
        if limit is not None and picture.pixels == "numbers":
            raise UsageError(
                f"{option(name)} applies to colours; numbers are compared within {option('atol')} and {option('rtol')}"
            )
    if options.min_ssim is not None and min(picture.size_a) < SSIM_WINDOW:
        raise UsageError(f"{option('min_ssim')} requires images of at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels")


def _structure(picture: VideoOrImageDifference, a: str, b: str) -> Iterator[str]:
    """Yields the differences other than those of pixels."""
    if picture.size_a != picture.size_b:
        one, other = (f"{width}x{height}" for width, height in (picture.size_a, picture.size_b))
        yield f"the size is {one} in {a}, {other} in {b}"
    elif not picture.frames:
        yield f"one of {a} and {b} has colours, the other one numbers"
    if picture.fps_a and picture.fps_b and picture.fps_a != picture.fps_b:
        yield f"the rate is {picture.fps_a:.9g} frames per second in {a}, {picture.fps_b:.9g} in {b}"
    if picture.frames_a != picture.frames_b:
        yield f"the number of frames is {picture.frames_a} in {a}, {picture.frames_b} in {b}"


def _changed(picture: VideoOrImageDifference) -> Iterator[str]:
    if picture.first is None or picture.worst is None:
        return
    if picture.frames_a == picture.frames_b == 1:
        yield f"{frame_place(picture.worst, picture)}{frame_facts(picture.worst)}"
        return
    yield f"{picture.differing} of {picture.frames} frames differ"
    yield f"first {frame_place(picture.first, picture)}{frame_facts(picture.first)}"
    if picture.worst != picture.first:
        yield f"worst {frame_place(picture.worst, picture)}{frame_facts(picture.worst)}"


def _beyond_limits(picture: VideoOrImageDifference, options: PictureDiffOptions) -> Iterator[str]:
    """Yields the worst frame by each limit that is exceeded."""
    worst, similar, changed = picture.worst, picture.least_similar, picture.most_changed
    if options.min_psnr is not None and worst and worst.psnr is not None and worst.psnr < options.min_psnr:
        yield f"{frame_place(worst, picture)}PSNR {worst.psnr:.6g} dB is less than {options.min_psnr:g} dB"
    if options.min_ssim is not None and similar and similar.ssim is not None and similar.ssim < options.min_ssim:
        yield f"{frame_place(similar, picture)}SSIM {similar.ssim:.6g} is less than {options.min_ssim:g}"
    if options.max_changed is not None and changed and changed.changed > options.max_changed:
        share = f"{percent(changed.changed)} of the pixels changed"
        yield f"{frame_place(changed, picture)}{share}, more than {percent(options.max_changed)}"


def provenance_notes(a: Mapping[str, Any] | None, b: Mapping[str, Any] | None) -> list[str]:
    """Returns a sentence for each difference between the manifests of two results, whose content is untrusted."""
    if not a or not b:
        return []
    named = {**VERSIONS, **SETTINGS}
    both = {key: (a[key], b[key]) for key in named if key in a and key in b}
    notes = [f"{named[key]} is {_shown(one)} and {_shown(other)}" for key, (one, other) in both.items() if one != other]
    changed = [
        f"the option {clean(shortened(key))} is {_shown(one)} and {_shown(other)}"
        for key, one, other in _changed_options(a, b)
    ]
    return [*notes, *_model_note(a, b, is_overridden=bool(changed)), *changed]


def _changed_options(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[tuple[str, object, object]]:
    """Returns the options of the simulation that differ, such as overrides of the model, each with both values."""
    one, other = (manifest_part(manifest_part(manifest, "options"), "simulation") for manifest in (a, b))
    both = [key for key in one if key in other and key not in (*SETTINGS, "model")]
    return [(key, one[key], other[key]) for key in both if plain(one[key]) != plain(other[key])]


def _model_note(a: Mapping[str, Any], b: Mapping[str, Any], *, is_overridden: bool) -> list[str]:
    """Returns a sentence about the models if they differ."""
    one, other = manifest_part(a, "model"), manifest_part(b, "model")
    hashes = one.get("sha256"), other.get("sha256")
    if not all(hashes) or hashes[0] == hashes[1]:
        return []
    same_physics = "physics" in a and a["physics"] == b.get("physics")  # only recordings have it
    but = "; their physics is the same" if same_physics else ""
    names = _shown(one.get("path", "")), _shown(other.get("path", ""))
    if is_overridden or not all(names):
        return [f"the models, or their overrides, differ{but}"]
    if names[0] == names[1]:
        return [f"the model {names[0]}, or a file that it refers to, has changed{but}"]
    return [f"the models {names[0]} and {names[1]} differ{but}"]


def other_model(a: Mapping[str, Any], b: Mapping[str, Any]) -> str:
    """Returns the model of the manifest `a` if that of `b` has both another name and another content; else nothing."""
    one, other = manifest_part(a, "model"), manifest_part(b, "model")
    names = [PurePath(str(each.get("path") or "")).name for each in (one, other)]
    is_other = all(names) and names[0] != names[1] and one.get("sha256") != other.get("sha256")
    return _shown(one["path"]) if is_other else ""


def manifest_part(manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Returns an object in a manifest; empty if the manifest, which is untrusted, has none."""
    part = manifest.get(key)
    return cast("dict[str, Any]", part) if isinstance(part, dict) else {}


def _shown(value: object) -> str:
    return clean(shortened(str(value)))
