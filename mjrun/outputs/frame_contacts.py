"""The contacts of the frames of an export, as a few numbers each."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.physics.recorded_states import RowFile
from mjrun.physics.simulation_loop import Tap
from mjrun.probe.copied_contacts import CopiedContacts, RecordedContacts, copy_contacts

BLOCK = 64  # frames whose contacts are converted at once


@dataclass(frozen=True, eq=False)
class FrameContacts:
    """The contacts at each frame.

    Attributes:
      counts: number of contacts at each frame.
      values: position [m], normal and force [N] of each contact, in the axes of the world, `(n, 9)` float32.
    """

    counts: np.ndarray
    values: np.ndarray


class ContactRecorder:
    """A recorder of the contacts at the instants of frames, which are on the disk if they are many. To be closed."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._copies: list[CopiedContacts] = []
        self._counts: list[int] = []
        self._rows = RowFile(9)

    def tap(self, steps: Sequence[int]) -> Tap[CopiedContacts]:
        """Returns the tap that records the contacts at `steps`."""
        return Tap(steps, lambda stepper: copy_contacts(stepper.instant()), self._add)

    def contacts(self, count: int) -> FrameContacts:
        """Returns the contacts of the first `count` frames."""
        self._convert()
        counts = np.array(self._counts[:count], int)
        return FrameContacts(counts, self._rows.read(0, int(counts.sum())).astype(np.float32))

    def close(self) -> None:
        """Frees the recording."""
        self._rows.close()

    def _add(self, copied: CopiedContacts) -> None:
        self._copies.append(copied)
        if len(self._copies) == BLOCK:
            self._convert()

    def _convert(self) -> None:
        if not self._copies:
            return
        contacts = RecordedContacts(self._model, self._copies)
        forces = np.einsum("ni,nij->nj", contacts.wrenches[:, :3], contacts.frames)
        self._rows.extend(np.column_stack([contacts.fields["pos"], contacts.frames[:, 0], forces]))
        self._counts += contacts.counts.tolist()
        self._copies = []
