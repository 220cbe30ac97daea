"""Groups of columns, against the columns of a model."""

from pathlib import Path

import mujoco

from mjrun.probe.select import available_columns, column_groups, selected_columns

ARM = Path(__file__).parents[2] / "scenes/arm.xml"


def test_groups_divide_the_columns_and_each_is_what_its_name_selects() -> None:
    model = mujoco.MjModel.from_xml_path(str(ARM))
    columns = available_columns(model)
    groups = column_groups(columns)
    assert sorted(column.name for group in groups for column in group.columns) == sorted(c.name for c in columns)
    for group in groups:
        names = [column.name for column in group.columns]
        assert names == [column.name for column in selected_columns(model, [group.name])]
        assert group.texts("kind") == [kind for kind in dict.fromkeys(c.kind for c in group.columns) if kind]
