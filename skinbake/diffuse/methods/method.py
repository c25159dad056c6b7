"""What a diffusion method is: the operations that planning, making and measuring of lobes ask of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

from skinbake.atlas import Tiled, Tiles
from skinbake.diffuse.probes import Probes, read_at_probes
from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.texture_space.blur import widest_level
from skinbake.diffuse.texture_space.blur_at_probes import TexelBlur, blur_around_probes
from skinbake.numerics import Float

RAISE_SIZE = "raise texture.size, or the tolerance"


class LobeParameters(NamedTuple):
    """How one lobe is made, whatever the method.

    Attributes
    ----------
    variance_mm2 : float
        Of the Gaussian.
    level : int
        It is stored at the full size halved this many times.
    spacing : float
        Side of the widest cluster of surface sums, in sigma.
    threshold : float
        Predicted error of the blur, over a light's mean, from which on `hybrid` takes sums in its place.
    """

    variance_mm2: float
    level: int = 0
    spacing: float = 0.0
    threshold: float = 0.0


class Proposal(NamedTuple):
    """One way to make a lobe, for `auto` to weigh.

    Attributes
    ----------
    parameters : LobeParameters
    cost : float
        Estimated, in the unit of `methods.costs`, without writing the result.
    read : ndarray of shape (P, 3 L)
        What would be read at the planning probes.
    tried : bool
        False: in `read` surface sums are taken for exact.
    """

    parameters: LobeParameters
    cost: float
    read: Float
    tried: bool


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
        Side of clusters that are within the tolerance, in sigma.
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

    @property
    def blurred_levels(self) -> range:
        """Those of `levels` at which the texture can be blurred."""
        widest = widest_level(self.resources.geometry.variance_texels2(self.variance_mm2))
        return range(min(self.levels.start, widest), min(self.levels.stop, widest + 1)) if self.levels else self.levels

    def texture_blur(self, level: int) -> Tiled[TexelBlur]:
        """The texture's blur of the texels that reading a stored size at the probes touches."""
        if level not in self._blurred:
            resources = self.resources
            texels2 = resources.geometry.variance_texels2(self.variance_mm2)
            self._blurred[level] = blur_around_probes(resources.pyramids.get(), texels2, level, self.probes)
        return self._blurred[level]


class DiffusionMethod(ABC):
    """One way to blur light by a Gaussian. It has no state: whatever lobes share is handed to its operations.

    Attributes
    ----------
    name : str
        In `diffusion.method` of a look and in a bake's manifest.
    bilinear_error : float
        Bilinear reading of stored texels of side h is wrong by this times (h / sigma)^2, rms.
    asked_for : bool
        Whether a look may name it in `diffusion.method`.
    blurs : bool
        Whether the lobe is anything else than the light itself.
    classical : bool
        Whether it knows the integral that is not divided by the sum of its weights (`diffusion.normalise: false`).
    exact : bool
        Whether it is what the others are measured against.
    through_flesh : bool
        Whether its lobes carry light through flesh, from one side of an ear to the other.
    quick : bool
        Whether a lobe is sooner made again than read from a cache.
    continuous : bool
        Whether it has values between the texels that it was made at; without, `at_probes` reads the map.
    misses_unseen : bool
        Whether it fails in few places, but there by so much that a plan which no probe there has warned pays a premium.
    advice : str
        What to change where the method misses the tolerance.
    """

    name: ClassVar[str]
    bilinear_error: ClassVar[float]
    asked_for: ClassVar[bool] = True
    blurs: ClassVar[bool] = True
    classical: ClassVar[bool] = False
    exact: ClassVar[bool] = False
    through_flesh: ClassVar[bool] = False
    quick: ClassVar[bool] = False
    continuous: ClassVar[bool] = True
    misses_unseen: ClassVar[bool] = False
    advice: ClassVar[str] = RAISE_SIZE

    @abstractmethod
    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """The lobe at its stored size, the full one halved `lobe.level` times, (L, h, w, 3) a tile, float32.

        Odd sizes are rounded up. The light that arrives (`resources.source`) may be given as it is: nobody changes it.
        """

    def at_probes(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """The lobe at probes as the method gives it, before any storage, (P, 3 L).

        Parameters
        ----------
        resources : LobeResources
        lobe : LobeParameters
        probes : Probes
        """
        return self.read_stored(resources, lobe, probes)

    def read_stored(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """What reading the stored map will give at probes, (P, 3 L), for less than the whole map where that is known.

        Parameters
        ----------
        resources : LobeResources
        lobe : LobeParameters
        probes : Probes
        """
        return read_at_probes(self.map(resources, lobe), probes)

    def candidates(self, trial: Trial) -> Iterator[Proposal]:
        """Ways to make a lobe, for `auto` to choose from, with what each would cost and give at the trial's probes."""
        yield from ()

    def coarsest_level(self, size: tuple[int, int], level: int) -> int:
        """The coarsest stored size, `level` at most, that the method can make of textures of a size (H, W)."""
        return level

    def needs(self, resources: LobeResources, lobe: LobeParameters) -> frozenset[Resource]:
        """The large resources that making this lobe takes; others may be released before."""
        return frozenset()

    def memory_bytes_per_texel(self, lights: int) -> float:
        """Memory of what this method alone holds at a time, bytes a texel of the full size."""
        return 0.0


@dataclass(frozen=True)
class LobePlan:
    """How one lobe is made.

    Attributes
    ----------
    method : DiffusionMethod
    parameters : LobeParameters
    why : str
        The numbers that decided.
    """

    method: DiffusionMethod
    parameters: LobeParameters
    why: str
