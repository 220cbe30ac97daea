"""What a comparison finds. As JSON (`mjrun diff --json`), these dataclasses are objects with the same keys.

Reports with the same `schema` have these keys, and may have new ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from mjrun.diff.model_differences import ModelComparison

SCHEMA = "mjrun-diff-1"


@dataclass(frozen=True)
class CellDifference:
    """A cell that differs.

    Attributes:
      row, row_b: of A and of B, counted from 0; in recordings, numbers of states.
      at: the time of the row [s], or the step of the state; None where rows are aligned by something else.
      a, b: the numbers, as the shortest texts that read back as the same bits; or the texts.
      key: the key of the row, as in `friction = 0.3, seed = 2`, where rows are aligned by such columns; else empty.
    """

    row: int
    row_b: int
    at: float | None
    a: str
    b: str
    key: str = ""


@dataclass(frozen=True)
class ColumnDifference:
    """How the cells of one column differ, b − a.

    Attributes:
      name: of the column.
      unit: where a file says it; else empty.
      atol, rtol: the tolerance.
      differing: in how many rows the difference is beyond the tolerance.
      maximum: the largest absolute difference; None if it is not finite, as where a text differs.
      rms: the root of the mean square of the differences; None if it is not finite.
      last: the difference in the last row that both have; None if it is not finite.
      first: the first cell beyond the tolerance; None if there is none.
      worst: the cell with the largest difference of those beyond the tolerance; None if there is none.
      text: whether a text was among the cells that were compared.
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
      count: how many.
      first: the number of the first, counted from 0; None if there is none.
      at: its time [s] or step, where rows are aligned by it; else None.
      key: its key, where rows are aligned by other columns; else empty.
    """

    count: int
    first: int | None
    at: float | None
    key: str = ""


@dataclass(frozen=True)
class UnitDifference:
    """A column whose unit is not the same in both tables.

    Attributes:
      name: of the column.
      a, b: its unit in each.
    """

    name: str
    a: str
    b: str


@dataclass(frozen=True)
class TableDifference:
    """How two tables, or the states of two recordings, differ.

    Attributes:
      aligned: what tells which rows belong together: `time`, `row`, `step`, or names of columns.
      rows: how many were compared.
      rows_a, rows_b: how many each has.
      only_a, only_b: rows that the other one does not have.
      columns: that both have, the worst first.
      columns_only_a, columns_only_b: names of columns that the other one does not have.
      units: that differ.
      shared_agree: whether the rows and columns that both have, of which there are some, agree.
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
    """How two frames, or two images, differ.

    Attributes:
      frame: its number, counted from 0.
      time: in the video [s]; None for images, and where the files do not say the rate.
      changed: the share of the pixels that differ beyond the tolerance.
      maximum: the largest absolute difference: of colours from 0 to 255, or of numbers; None if it is not finite.
      psnr: the peak signal-to-noise ratio [dB], 10·log10(255²/mean square difference); None for numbers, and where no
        pixel differs.
      ssim: the structural similarity of the luma (Wang et al., 2004; uniform windows of 7 × 7 pixels); None for
        numbers, frames of less than 7 pixels a side, and without scikit-image.
    """

    frame: int
    time: float | None
    changed: float
    maximum: float | None
    psnr: float | None
    ssim: float | None


@dataclass(frozen=True)
class PictureDifference:
    """How two videos or images differ.

    Attributes:
      pixels: `colours`, or `numbers` for depth and segmentation; `colours and numbers` where the two are not alike.
      size_a, size_b: width and height.
      fps_a, fps_b: frames per second; None for images, and where the files do not say it.
      frames_a, frames_b: how many each has.
      frames: how many were compared; 0 where the sizes differ.
      differing: how many differ beyond the tolerance.
      changed: the mean share of pixels that differ beyond the tolerance.
      psnr: of all frames together [dB]; None for numbers, and where nothing differs.
      ssim: the mean over all frames; None where it is not known of one.
      first: the first frame that differs beyond the tolerance; None if there is none.
      worst: the frame with the largest mean square difference; None if nothing differs at all.
      least_similar: the frame with the least structural similarity; None if nothing differs, or it is not known.
      most_changed: the frame with the largest share of pixels that differ; None if no frame does.
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
class GoldenFacts:
    """The two sides of a comparison with a golden table.

    Attributes:
      mjrun, mujoco: the versions that made the golden table; empty if it does not say.
      mjrun_now, mujoco_now: those that simulated now.
      updated: whether the golden table was made, or replaced.
    """

    mjrun: str
    mujoco: str
    mjrun_now: str
    mujoco_now: str
    updated: bool


@dataclass(frozen=True)
class DiffResult:
    """What a comparison finds.

    Attributes:
      kind: of A and B: `table`, `recording`, `video`, `image` or `model`; `golden` where A is a golden table, and B is
        a simulation.
      a, b: what is compared, as it was named.
      equal: whether they agree.
      differences: a sentence for each way in which they do not.
      notes: what may be the reason of it: versions, machines and models that are not the same. They decide nothing.
      table: of tables, golden ones and recordings, the columns; None for others, and for recordings whose states do
        not fit.
      model: of models, their fields and objects; else None.
      picture: of videos and images; else None.
      golden: of a golden table, what made it; else None.
      schema: of this document.
    """

    kind: str
    a: str
    b: str
    equal: bool
    differences: Sequence[str]
    notes: Sequence[str] = ()
    table: TableDifference | None = None
    model: ModelComparison | None = None
    picture: PictureDifference | None = None
    golden: GoldenFacts | None = None
    schema: str = SCHEMA
