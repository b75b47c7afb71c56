"""How large what comes from outside may be, checked before memory is asked for; each bound is named by its message."""

MAX_IMAGE_PIXELS = 1 << 26
"""Of an image: 67 million pixels, 8192x8192; no depth camera comes near."""
MAX_IMAGE_BYTES = 1 << 29
"""Of an image file."""
MAX_TEXT_BYTES = 1 << 28
"""Of a text file (a list of some million lines, a transforms.json)."""
MAX_MESH_BYTES = 1 << 31
"""Of a mesh: some 100 million triangles."""
MAX_VALUES_BYTES = 1 << 22
"""Of a YAML file."""
MAX_VALUES = 200_000
"""Values of a YAML file, aliases counted where they stand."""
MAX_DEPTH = 60
"""Levels of nested lists and mappings in YAML and JSON."""
MAX_ARRAY_BYTES = 1 << 28
"""Of the NumPy arrays of one image file, unpacked: 67 million floats."""
MAX_MAT_BYTES = 1 << 30
"""Of one variable of a MATLAB file: the largest there is, labels40 of NYUv2, has 445 MB."""
MAX_PIECE_BYTES = 1 << 28
"""Of one image of an HDF5 file, and of what it unpacks at once."""
MAX_MODEL_ELEMENTS = 200_000
"""Of a MuJoCo model, those that `replicate`, `composite` and `flexcomp` make included."""
