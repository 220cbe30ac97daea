"""Units of resistance follow from that of the position."""

from mjrun.model.description.resistance_units import ARMATURE, DAMPING, FORCE, STIFFNESS


def test_they_are_forces_by_the_unit_of_position_and_its_rates() -> None:
    for unit, force in FORCE.items():
        assert STIFFNESS[unit] == f"{force}/{unit}"
        assert DAMPING[unit] == f"{force}·s/{unit}"
    assert ARMATURE == {"rad": "kg·m²", "m": "kg"}
