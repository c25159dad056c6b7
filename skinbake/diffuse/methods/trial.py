"""One lobe at planning probes: what methods make their candidates from."""

from __future__ import annotations

from dataclasses import dataclass, field

from skinbake.diffuse.probes import Probes
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.blur_at_probes import TexelBlur, blur_around_probes
from skinbake.diffuse.tiled import Tiled
from skinbake.numerics import Float


@dataclass
class Trial:
    """What `auto` knows of a lobe before it has tried any method.

    Attributes
    ----------
    resources : LobeResources
    variance_mm2 : float
    levels : range
        Stored sizes that can show the lobe; empty for one that is too narrow to blur anything.
    spacing : float
        Of clusters that are within the tolerance, in sigma.
    probes : Probes
    exact : ndarray of shape (P, 3 L)
        The surface integral at the probes.
    half : bool
        Whether files will hold binary16.
    """

    resources: LobeResources
    variance_mm2: float
    levels: range
    spacing: float
    probes: Probes
    exact: Float
    half: bool
    _blurred: dict[int, Tiled[TexelBlur]] = field(default_factory=dict)

    def texture_blur(self, level: int) -> Tiled[TexelBlur]:
        """The texture's blur of the texels that reading a stored size at the probes touches."""
        if level not in self._blurred:
            resources = self.resources
            texels2 = resources.geometry.variance_texels2(self.variance_mm2)
            self._blurred[level] = blur_around_probes(resources.pyramids.get(), texels2, level, self.probes)
        return self._blurred[level]
