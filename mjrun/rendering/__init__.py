"""Drawing: the OpenGL backend, cameras, visual options, the classic renderer."""
