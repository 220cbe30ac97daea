"""The camera document: shots in time, each a rig, with cuts, blends and events.

```yaml
speed: 0.25
shots:
  - orbit: {lookat: floor, distance: 0.9, azimuth: {from: 140, to: 240, ease: cosine}, elevation: -30}
    until: {when: speed(box) > 0.02}
  - track: {target: box, distance: 0.08, azimuth: 280, elevation: -10}
    blend: {shape: sigmoid, width: 0.3}
```
"""

import pathlib

from mjrun.camera.script import CameraDocument, CameraScript
from mjrun.document.reader import read
from mjrun.options.record import Record

CAMERA = Record(CameraDocument, CameraDocument)


def read_camera(path: pathlib.Path | str) -> CameraScript:
    """Reads the camera document at `path`; the script is named after the file, without its suffix.

    Raises:
      DocumentError: with all faults, line by line.
      FileError: the file is missing or cannot be read.
    """
    return read(path, CAMERA)[0].script(pathlib.Path(path).stem)
