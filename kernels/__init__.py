"""Warp kernels and their launchers. Warp's settings are made here, before the first kernel is declared."""

import dsmap.kernels.runtime  # noqa: F401
