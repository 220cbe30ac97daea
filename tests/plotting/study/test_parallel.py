"""Lines of parallel coordinates, read back from matplotlib."""

import numpy as np
from matplotlib.collections import LineCollection

from mjrun.plotting.study.axes import Box, Sheet
from mjrun.plotting.study.drawing import ParallelPanel, Scale
from mjrun.plotting.study.parallel import draw_parallel

SCALES = [Scale("mass", 0, 2), Scale("model", -0.5, 1.5, categories=("a", "b")), Scale("z", 0.1, 10, log=True)]


def test_a_line_is_at_the_share_of_each_axis_and_failed_ones_end_before_the_metric(sheet: Sheet) -> None:
    values = np.array([[1.0, 1, np.nan], [0.5, 0, 1.0]])
    draw_parallel(sheet, ParallelPanel(SCALES, values, np.isnan(values[:, 2])), Box(20, 50, 600, 300))
    failed, good = (c for c in sheet.canvas.figure.axes[0].collections if isinstance(c, LineCollection))
    (line,) = failed.get_segments()
    assert [y for _, y in line] == [0.5, 0.75]
    (line,) = good.get_segments()
    np.testing.assert_allclose([y for _, y in line], [0.25, 0.25, 0.5])
    texts = [text.get_text() for text in sheet.canvas.figure.texts]
    assert {"mass", "model", "z", "a", "b"} <= set(texts)


def test_names_without_room_lose_what_all_of_them_share(sheet: Sheet) -> None:
    def shown(*names: str) -> list[str]:
        scales = [*(Scale(name, 0, 1) for name in names), SCALES[-1]]
        values = np.full((1, len(scales)), 0.5)
        draw_parallel(sheet, ParallelPanel(scales, values, np.array([False])), Box(20, 50, 300, 300))
        return [text.get_text() for text in sheet.canvas.figure.texts]

    assert {"foot", "hand"} <= set(shown("geom/foot.friction[0]", "geom/hand.friction[0]"))
    assert not {"wrist", "ankle"} & set(shown("geom/wrist.friction[0]", "joint/ankle.damping"))
    assert {"geom/a.x", "geom/b.x"} <= set(shown("geom/a.x", "geom/b.x"))
