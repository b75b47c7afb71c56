"""Readers of recordings as cameras and data sets leave them, one file a format.

A reader looks whether a path is its own and lists the frames; an image is read when a frame asks for it, so that a
recording of any length fits in memory. Add one by writing its file and naming it in `READERS` of the registry.
"""
