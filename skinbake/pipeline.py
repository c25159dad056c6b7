"""The bake on one screen: its stages, in order. Every verb and `import skinbake` run this; no file, clock or print."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from skinbake.scene.budget import left_wrong

if TYPE_CHECKING:  # each stage knows what it needs; here there are only their results
    from skinbake.atlas import Atlas
    from skinbake.diffuse import DiffuseMap
    from skinbake.irradiance import IrradianceMap
    from skinbake.profile import GaussianSum
    from skinbake.relight.transfer import Transfer
    from skinbake.scene.decision import Decision, Decisions

Made = TypeVar("Made")
Kept = TypeVar("Kept")


class StageTimer(Protocol):
    """Takes the time of a stage while it runs."""

    def timed(self, stage: Stage[Made, Kept]) -> AbstractContextManager[None]:
        """Measure the block; at its end `stage.reused` tells whether the result was there already."""


class Stage(ABC, Generic[Made, Kept]):
    """One step of a bake, on a store of results: a bake folder, or memory.

    A stage is run at most once; what it reads of other stages it asks of them, so one whose result is stored leaves
    those before it alone.

    Attributes
    ----------
    name : str
    reused : bool
        Whether the result was stored already.
    """

    name: ClassVar[str]

    def __init__(self, timer: StageTimer) -> None:
        self.timer = timer
        self.reused = False
        self._result: Kept | None = None

    @abstractmethod
    def key(self) -> str:
        """Digest of everything the result depends on: settings, contents of files, code."""

    @abstractmethod
    def load(self) -> Kept | None:
        """The stored result of this key, or None where there is none."""

    @abstractmethod
    def compute(self) -> Made:
        """The result, made anew."""

    @abstractmethod
    def store(self, made: Made) -> Kept:
        """Keep a result under the key, and give it as the next stages read it: rounded as it is stored."""

    @abstractmethod
    def stale(self) -> str:
        """Why this stage would run, in a few words; empty where its result is stored. Computes nothing."""

    def result(self) -> Kept:
        """What is stored, else what is computed and then stored."""
        if self._result is None:
            with self.timer.timed(self):
                found = self.load()
                self.reused = found is not None
                self._result = self.store(self.compute()) if found is None else found
        return self._result

    def close(self) -> None:
        """Let the result go; asked for again, it is loaded or computed again."""
        self._result = None


@dataclass(frozen=True)
class Stages:
    """The stages of one look on one store."""

    decisions: Decisions
    profile: Stage[Any, GaussianSum]
    raster: Stage[Any, Atlas]
    irradiance: Stage[Any, tuple[IrradianceMap, ...]]
    diffuse: Stage[Any, DiffuseMap]
    relight: Stage[Any, Transfer] | None = None


@dataclass(frozen=True)
class Baked:
    """Everything a bake computes.

    Attributes
    ----------
    decisions : Decisions
        What the look alone decides.
    gaussians : GaussianSum
        The fitted profile.
    irradiance : tuple of IrradianceMap
        Light arriving, one map a tile.
    diffuse : DiffuseMap
        Light leaving: lobes, measured error, plan. Lobes that were stored already have no pixels.
    relight : Transfer, optional
        Textures for lights that come later, where the look asks for them.
    """

    decisions: Decisions
    gaussians: GaussianSum
    irradiance: tuple[IrradianceMap, ...]
    diffuse: DiffuseMap
    relight: Transfer | None = None

    @property
    def plan(self) -> tuple[Decision, ...]:
        """Every decision of the bake, in the order of its stages."""
        return (*self.of_lights, *(self.relight.plan if self.relight else ()))

    @property
    def of_lights(self) -> tuple[Decision, ...]:
        """Those on the look's own lights."""
        decided = self.irradiance[0].decided if self.irradiance else ()
        return (*self.decisions.of_look, *decided, *self.diffuse.plan)

    @property
    def left_wrong(self) -> float | None:
        """Root mean square of all that is left wrong, as a share of the light that it is worst for: the blur's error as
        it was measured, and what the plan is estimated to leave out; None where nothing was measured.
        """
        error = self.diffuse.error
        return left_wrong(self.of_lights, self.irradiance[0].lights, error.rms) if error else None


def bake(stages: Stages) -> Baked:
    """The fit of the profile, light on the raster of the mesh, its diffusion by Gaussians; light from everywhere."""
    gaussians = stages.profile.result()
    # Asks for the raster where a light is not stored; all lights may come later
    irradiance = stages.irradiance.result() if stages.decisions.stored_lights else ()
    diffused = stages.diffuse.result()  # of both
    relight = stages.relight.result() if stages.relight else None
    return Baked(stages.decisions, gaussians, irradiance, diffused, relight)
