"""dsmap: a moving RGB-D camera goes in, a dense 3D map that knows what every surface is comes out."""

import os

from dsmap.limits import MAX_IMAGE_PIXELS

__version__ = "0.1.0"

# OpenCV reads its bound when it is loaded, and would ask for 3 GB before it says no to a header that lies.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_IMAGE_PIXELS))
