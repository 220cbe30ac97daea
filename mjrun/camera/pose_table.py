"""The poses of cameras frame by frame, as numbers: as objects, those of a long film would fill the memory."""

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import astuple
from typing import overload

import numpy as np

from mjrun.camera.pose import Frustum, Pose

NUMBERS = 3 + 9 + 1 + 7  # of a pose: position, rotation, distance, frustum


class PoseTable(Sequence[tuple[Pose, ...]]):
    """Of each frame, the pose of each camera.

    Args:
      cameras: the poses of each camera, in the order of frames; as many of each.
    """

    def __init__(self, cameras: Iterable[Iterable[Pose]]) -> None:
        self._tracks = [_Track(poses) for poses in cameras]

    def __len__(self) -> int:
        return min(map(len, self._tracks))

    @overload
    def __getitem__(self, index: int) -> tuple[Pose, ...]: ...

    @overload
    def __getitem__(self, index: slice) -> list[tuple[Pose, ...]]: ...

    def __getitem__(self, index: int | slice) -> tuple[Pose, ...] | list[tuple[Pose, ...]]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return tuple(track[index] for track in self._tracks)


class _Track:
    """The poses of one camera; while it stands still, they are held once."""

    def __init__(self, poses: Iterable[Pose]) -> None:
        self._numbers, self._rows = array("d"), array("l")
        last = b""
        for pose in poses:
            numbers = np.concatenate([pose.position, pose.rotation.ravel(), [pose.distance], astuple(pose.frustum)])
            if (content := numbers.tobytes()) != last:
                self._numbers.frombytes(content)
                last = content
            self._rows.append(len(self._numbers) // NUMBERS - 1)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Pose:
        start = NUMBERS * self._rows[index]
        numbers = np.array(self._numbers[start : start + NUMBERS])
        distance, *frustum, orthographic = numbers[12:].tolist()
        seen = Frustum(*frustum, orthographic=bool(orthographic))
        return Pose(numbers[:3], numbers[3:12].reshape(3, 3), seen, distance)
