"""YOLO: labels/NAME.txt beside images/NAME.png, and data.yaml. https://docs.ultralytics.com/datasets/"""

from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from mjrun.formats.datasets import DatasetRecords, Files, Record
from mjrun.formats.datasets.coco import area, keypoints, mask_of, polygons
from mjrun.formats.segmentation_labels import ascii_json

LAST_SHORT = 0xFFFF  # the last character that JSON escapes as one


def files(dataset: DatasetRecords) -> Files:
    """Returns the labels of each image, the list of images of each part, and data.yaml."""
    written = list[tuple[str, bytes]]()
    for part, records in dataset.records.items():
        for record in records:
            name = PurePosixPath(record["files"]["rgb"]).stem
            lines = "".join(f"{line}\n" for line in _lines(dataset, record))
            written.append((f"labels/{name}.txt", lines.encode()))
        listed = "".join(f"./{record['files']['rgb']}\n" for record in records)
        written.append((f"{part}.txt", listed.encode()))
    return [*written, ("data.yaml", _description(dataset).encode())]


def _description(dataset: DatasetRecords) -> str:
    lines = [f"{part}: {part}.txt" for part in dataset.records]
    if "val" not in dataset.records:  # which Ultralytics requires
        lines.append(f"val: {next(iter(dataset.records))}.txt")
    lines += ["names:", *(f"  {i}: {_quoted(name)}" for i, name in enumerate(dataset.categories))]
    if dataset.yolo_task == "pose":
        lines.append(f"kpt_shape: [{_most_keypoints(dataset)}, 3]")
    return "\n".join(lines) + "\n"


def _most_keypoints(dataset: DatasetRecords) -> int:
    return max(len(dataset.keypoints(name)) for name in dataset.categories)


def _lines(dataset: DatasetRecords, record: Record) -> Iterator[str]:
    """Yields a line for each visible object: its category, and numbers relative to the size of the image."""
    width, height = record["size"]
    for each in record["objects"]:
        if each["bbox"] is None:
            continue
        category = dataset.categories.index(each["category"])
        if dataset.yolo_task == "segment":
            outlines = polygons(mask_of(each["counts"], (width, height)))
            largest = max(outlines, key=area)  # a line of YOLO is one polygon
            yield _line(category, [number for x, y in largest for number in (x / width, y / height)])
            continue
        x, y, across, down = each["bbox"]
        box = [(x + across / 2) / width, (y + down / 2) / height, across / width, down / height]
        if dataset.yolo_task == "pose":
            points = keypoints(dataset, each)
            points += [[0.0, 0.0, 0]] * (_most_keypoints(dataset) - len(points))
            box += [number for u, v, shown in points for number in (u / width, v / height, shown)]
        yield _line(category, box)


def _line(category: int, numbers: Sequence[float]) -> str:
    return " ".join([str(category), *(f"{number:.6g}" for number in numbers)])


def _quoted(text: str) -> str:
    """Returns a text in YAML: JSON, except that two escapes of JSON for one character are two characters in YAML."""
    parts = (ascii_json(each)[1:-1] if ord(each) <= LAST_SHORT else f"\\U{ord(each):08x}" for each in text)
    return f'"{"".join(parts)}"'
