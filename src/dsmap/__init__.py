"""dsmap: a moving RGB-D camera goes in, a dense 3D map that knows what every surface is comes out."""

__version__ = "0.1.0"
