"""Camera rigs, which determine how a view moves, by their names in documents and on the command line."""

from mjrun.camera.rigs.around import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.auto import AutoRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import PathRig
from mjrun.camera.rigs.rig import Rig

RIGS: dict[str, type[Rig]] = {
    rig.kind: rig for rig in (ModelRig, AutoRig, FreeRig, OrbitRig, TrackRig, LookRig, PathRig)
}
