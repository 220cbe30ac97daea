"""Camera rigs, which determine how a view moves, by their names in documents and on the command line.

A rig is found by its place in a module of this package.
"""

import pkgutil
from importlib import import_module

from mjrun.camera.rigs.rig import Rig

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

RIGS: dict[str, type[Rig]] = {rig.kind: rig for rig in sorted(Rig.__subclasses__(), key=lambda rig: rig.kind)}
