"""Roles of files that stand for several; apart, since stages import it and their keys hang on what they import."""

OCCLUDERS = "occluders"  # every occluder with its opacity
