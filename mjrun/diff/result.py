"""The result of a comparison. As JSON (`mjrun diff --json`), these dataclasses are objects with the same keys.

Reports with the same `schema` have these keys, and may have new ones.
"""

from collections.abc import Sequence

from mjrun.dataclass import dataclass

SCHEMA = "mjrun-diff-1"
SSIM_WINDOW = 7  # pixels per side, over which structural similarity is computed
Value = str | int | float | bool


@dataclass(frozen=True)
class CellDifference:
    """A cell that differs.

    Attributes:
      row, row_b: the numbers of the row in A and in B, counted from 0; in recordings, numbers of states.
      at: the time of the row [s], or the step of the state; None if rows are aligned by something else.
      a, b: the numbers, as the shortest texts that read back as the same bits; or the texts.
      key: the key of the row, as in `friction = 0.3, seed = 2`, if rows are aligned by such columns; else empty.
    """

    row: int
    row_b: int
    at: float | None
    a: str
    b: str
    key: str = ""


@dataclass(frozen=True)
class ColumnDifference:
    """The differences of the cells of one column, b − a.

    Attributes:
      name: the name of the column.
      unit: the unit, if a file states it; else empty.
      atol, rtol: the tolerance.
      differing: the number of rows in which the difference exceeds the tolerance.
      maximum: the largest absolute difference; None if it is not finite, as for texts that differ.
      rms: the root mean square of the differences; None if it is not finite.
      last: the difference in the last row that both have; None if it is not finite.
      first: the first cell beyond the tolerance, or None.
      worst: the cell with the largest difference of those beyond the tolerance, or None.
      text: true if a text was among the compared cells.
    """

    name: str
    unit: str
    atol: float
    rtol: float
    differing: int
    maximum: float | None
    rms: float | None
    last: float | None
    first: CellDifference | None
    worst: CellDifference | None
    text: bool = False


@dataclass(frozen=True)
class UnmatchedRows:
    """Rows that only one of two tables has.

    Attributes:
      count: the number of rows.
      first: the number of the first row, counted from 0, or None.
      at: its time [s] or step, if rows are aligned by it; else None.
      key: its key, if rows are aligned by other columns; else empty.
    """

    count: int
    first: int | None
    at: float | None
    key: str = ""


@dataclass(frozen=True)
class UnitDifference:
    """A column whose units in the two tables differ.

    Attributes:
      name: the name of the column.
      a, b: its unit in each table.
    """

    name: str
    a: str
    b: str


@dataclass(frozen=True)
class TableDifference:
    """The differences of two tables, or of the states of two recordings.

    Attributes:
      aligned: the key by which rows are matched: `time`, `row`, `step`, or names of columns.
      rows: the number of compared rows.
      rows_a, rows_b: the number of rows of each.
      only_a, only_b: the rows that only one of them has.
      columns: the columns that both have, the worst first.
      columns_only_a, columns_only_b: the names of the columns that only one of them has.
      units: the units that differ.
      shared_agree: true if they have rows and columns in common, and these agree.
    """

    aligned: str
    rows: int
    rows_a: int
    rows_b: int
    only_a: UnmatchedRows
    only_b: UnmatchedRows
    columns: Sequence[ColumnDifference]
    columns_only_a: Sequence[str]
    columns_only_b: Sequence[str]
    units: Sequence[UnitDifference]
    shared_agree: bool = False


@dataclass(frozen=True)
class FrameDifference:
    """The differences of two frames, or of two images.

    Attributes:
      frame: the number of the frame, counted from 0.
      time: its time in the video [s]; None for images, and if the files do not state the rate.
      changed: the share of the pixels that differ beyond the tolerance.
      maximum: the largest absolute difference: of colours from 0 to 255, or of numbers; None if it is not finite.
      psnr: the peak signal-to-noise ratio [dB], 10·log10(255²/mean square difference); None for numbers, and if no
        pixel differs.
      ssim: the structural similarity of the luma (Wang et al., 2004; uniform windows of 7 × 7 pixels); None for
        numbers, frames with less than 7 pixels per side, and without scikit-image.
    """

    frame: int
    time: float | None
    changed: float
    maximum: float | None
    psnr: float | None
    ssim: float | None


@dataclass(frozen=True)
class VideoOrImageDifference:
    """The differences of two videos or images.

    Attributes:
      pixels: `colours`, or `numbers` for depth and segmentation; `colours and numbers` if the two differ in this.
      size_a, size_b: the width and height of each.
      fps_a, fps_b: the frames per second of each; None for images, and if the files do not state the rate.
      frames_a, frames_b: the number of frames of each.
      frames: the number of compared frames; 0 if the sizes differ.
      differing: the number of frames that differ beyond the tolerance.
      changed: the mean share of pixels that differ beyond the tolerance.
      psnr: that of all frames together [dB]; None for numbers, and if nothing differs.
      ssim: the mean over all frames; None if that of a frame is unknown.
      first: the first frame that differs beyond the tolerance, or None.
      worst: the frame with the largest mean square difference; None if nothing differs.
      least_similar: the frame with the least structural similarity; None if nothing differs, or it is unknown.
      most_changed: the frame with the largest share of pixels that differ; None if no frame differs.
    """

    pixels: str
    size_a: tuple[int, int]
    size_b: tuple[int, int]
    fps_a: float | None
    fps_b: float | None
    frames_a: int
    frames_b: int
    frames: int
    differing: int
    changed: float
    psnr: float | None
    ssim: float | None
    first: FrameDifference | None
    worst: FrameDifference | None
    least_similar: FrameDifference | None
    most_changed: FrameDifference | None


@dataclass(frozen=True)
class GoldenVersions:
    """The versions that made the two sides of a comparison with a golden table.

    Attributes:
      mjrun, mujoco: the versions that made the golden table; empty if unknown.
      mjrun_now, mujoco_now: the versions of the current simulation.
      updated: true if the golden table was created or replaced.
    """

    mjrun: str
    mujoco: str
    mjrun_now: str
    mujoco_now: str
    updated: bool


@dataclass(frozen=True)
class FieldDifference:
    """A difference between two models in one object, or in the whole model.

    Attributes:
      field: MuJoCo's name: `body_mass`, `opt.timestep`. `name` is the name of an object or of the model, `order` the
        order of objects of a kind.
      object: the name of the object, or both names if they differ: `torso`, `torso → trunk`; empty for the whole model.
        For a name, with the kind: `joint knee`.
      components: the components of the field that differ, `slide`; empty if it has one only, or if all differ.
      a, b: the values of these components: numbers, names of objects, MuJoCo's names.
      unit: the unit of the numbers; empty for pure numbers, unknown units, and units that differ.
    """

    field: str
    object: str
    components: tuple[str, ...]
    a: tuple[Value, ...]
    b: tuple[Value, ...]
    unit: str = ""

    @property
    def largest(self) -> float | None:
        """The largest difference of two numbers; None if the values are not numbers."""
        numbers = [(a, b) for a, b in zip(self.a, self.b, strict=False) if not isinstance(a, str | bool)]
        return max((abs(float(b) - float(a)) for a, b in numbers if not isinstance(b, str)), default=None)


@dataclass(frozen=True)
class ArrayDifference:
    """An array that differs between two models: of one asset or flex, or of the whole model.

    Attributes:
      field, object: as for FieldDifference.
      shape_a, shape_b: the shapes of the arrays.
      count: the number of values that differ; None if the shapes do.
      largest: the largest difference of two numbers; None if the shapes differ.
      sha256_a, sha256_b: the hashes of the bytes of the arrays.
    """

    field: str
    object: str
    shape_a: tuple[int, ...]
    shape_b: tuple[int, ...]
    count: int | None
    largest: float | None
    sha256_a: str
    sha256_b: str


Difference = FieldDifference | ArrayDifference


@dataclass(frozen=True)
class DerivedFieldDifference:
    """A field that differs, and that the compiler derives from others.

    Attributes:
      field: MuJoCo's name; `stat` for the statistics.
      objects: the number of objects that differ in it.
      largest: the largest difference of two numbers; None if the values are not numbers, or differ in number.
    """

    field: str
    objects: int
    largest: float | None


@dataclass(frozen=True)
class UnmatchedObject:
    """An object that only one of two models has.

    Attributes:
      kind: `body`, `joint`, `geom`, …
      name: the name of the object; `geom:3` if it has none.
    """

    kind: str
    name: str


@dataclass(frozen=True)
class XmlPlace:
    """A place in an XML file, by its line.

    Attributes:
      file: the model, or a file that it includes or attaches.
      line: the number of the line, counted from 1.
    """

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True)
class XmlChange:
    """An element or an attribute that differs between two models.

    Attributes:
      element: its start tag with its name, `<geom name="floor">`, or with all its attributes if it has none.
      attribute: the attribute that differs; empty if only one model has the element.
      a, b: the values of the attribute as written; None if it is missing.
      place_a, place_b: the places of the elements; None if an element is missing.
    """

    element: str
    attribute: str
    a: str | None
    b: str | None
    place_a: XmlPlace | None
    place_b: XmlPlace | None


@dataclass(frozen=True)
class ModelComparison:
    """The comparison of two models, `a` and `b`: all their differences.

    Attributes:
      a, b: their sources.
      fields: the values that differ.
      arrays: the data of assets, and other long arrays, that differ.
      only_a, only_b: the objects that only one of them has.
      computed: the fields that differ and that the compiler derives from others. If nothing else differs, they are
        among `fields` and `arrays` instead.
      xml: the differences in the source, with lines, if both are XML files.
      warnings: MuJoCo's warnings during compilation.
      exact: false if numbers agree within a tolerance.
    """

    a: str
    b: str
    fields: Sequence[FieldDifference]
    arrays: Sequence[ArrayDifference]
    only_a: Sequence[UnmatchedObject]
    only_b: Sequence[UnmatchedObject]
    computed: Sequence[DerivedFieldDifference]
    xml: Sequence[XmlChange]
    warnings: Sequence[str] = ()
    exact: bool = True

    @property
    def equal(self) -> bool:
        """True if both compile to the same model, within the tolerance if there is one."""
        return not (self.fields or self.arrays or self.only_a or self.only_b)


@dataclass(frozen=True)
class DiffResult:
    """The result of a comparison.

    Attributes:
      kind: the kind of A and B: `table`, `recording`, `video`, `image` or `model`; `golden` if A is a golden table and
        B a simulation.
      a, b: the compared results, as named by the user.
      equal: true if they agree.
      differences: a sentence for each difference.
      notes: possible reasons: versions, machines and models that differ. They do not affect the result.
      table: the columns of tables, golden tables and recordings; None for others, and for recordings whose states
        differ in size.
      model: the fields and objects of models; else None.
      picture: the frames of videos and images; else None.
      golden: the versions that made a golden table; else None.
      schema: the schema of this document.
    """

    kind: str
    a: str
    b: str
    equal: bool
    differences: Sequence[str]
    notes: Sequence[str] = ()
    table: TableDifference | None = None
    model: ModelComparison | None = None
    picture: VideoOrImageDifference | None = None
    golden: GoldenVersions | None = None
    schema: str = SCHEMA
