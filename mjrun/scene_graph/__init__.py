"""Scene graphs: visible objects as nodes with meshes, materials, lights and cameras, and the motion of the nodes."""
