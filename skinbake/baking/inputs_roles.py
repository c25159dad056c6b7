"""Roles of files that belong together; apart, since stages import it and their keys hang on what they import."""

OCCLUDERS = "occluders"  # every occluder with its opacity
SHAPING = ("mesh", "normal", "height", "detail")  # every light depends on these
OILY = ("roughness", "specular", "cavity", "f0")  # ... and on these, where the oil's share is taken off
LATER = (*SHAPING, "albedo", *OILY)  # what light that comes later needs
DETAILED = ("albedo", "normal", "height", "detail")  # a coarser texture loses detail of these
OF_MATERIALS = ("albedo", "normal", "roughness")  # a glTF's materials may hold these
