"""Pictures of a bake: lobes added up, the oil layer evaluated per frame."""

from skinbake.preview.draw import PreviewImage, draw
from skinbake.preview.scene import PreviewLobe, PreviewScene

__all__ = ["PreviewImage", "PreviewLobe", "PreviewScene", "draw"]
