import pytest

from mjrun.closable import Closable


class Door(Closable):
    is_open = True

    def close(self) -> None:
        self.is_open = False


def test_a_block_closes_what_it_opens() -> None:
    with Door() as door:
        assert door.is_open
    assert not door.is_open


def test_a_block_closes_what_it_opens_whatever_happens_in_it() -> None:
    door = Door()
    with pytest.raises(KeyError), door:
        raise KeyError
    assert not door.is_open
