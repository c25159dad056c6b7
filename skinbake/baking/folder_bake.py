"""A look on its way into its folder."""

from __future__ import annotations

from dataclasses import dataclass

from skinbake.baking.folder_store import FolderStore
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.baking.stages.irradiance import GivenIrradiance
from skinbake.pipeline import Stages
from skinbake.scene.spec import SceneSpec


@dataclass(frozen=True)
class FolderBake:
    """What every verb that writes a bake folder begins with.

    Attributes
    ----------
    inputs : BakeInputs
    results : FolderStore
    session : BakeSession
    log : StageLog
    """

    inputs: BakeInputs
    results: FolderStore
    session: BakeSession
    log: StageLog

    def stages(self, given: GivenIrradiance | None = None) -> Stages:
        """The stages of the look, with `given` irradiance in place of its lights where there is any."""
        return look_stages(self.inputs, self.results, self.session, self.log, given)


def folder_bake(
    spec: SceneSpec,
    force: bool = False,
    verbosity: int = 1,
    session: BakeSession | None = None,
    told: str = "",
) -> FolderBake:
    """Write nothing yet, and read nothing but digests, and what a loose tolerance needs to choose the texture's size.

    Parameters
    ----------
    spec : SceneSpec
    force : bool
        Run every stage, also those whose results are there.
    verbosity : int
        0 says nothing on stderr, 1 a line a stage, 2 more.
    session : BakeSession, optional
        What this look shares with others.
    told : str
        Said first.

    Raises
    ------
    InputError
        A file of the look is missing.
    """
    session = session or BakeSession(keep=False)
    log = StageLog(verbosity, session.on_event)
    if told:
        log.say(told)
    inputs = BakeInputs(spec, session, log)
    return FolderBake(inputs, FolderStore(inputs, log, session.cache, force), session, log)
