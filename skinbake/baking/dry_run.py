"""What a bake would do, without doing any of it."""

from __future__ import annotations

from skinbake.baking.folder_bake import folder_bake
from skinbake.baking.preview_worker import PreviewWorker
from skinbake.baking.session import BakeSession
from skinbake.baking.stages.preview import PreviewStage
from skinbake.baking.stages.textures import TexturesStage
from skinbake.pipeline import Stage
from skinbake.scene.spec import SceneSpec


def stale_stages(spec: SceneSpec, force: bool, preview: bool, session: BakeSession) -> dict[str, str]:
    """Stages of a look that would run, and why.

    Parameters
    ----------
    spec : SceneSpec
    force : bool
        Every stage would.
    preview : bool
        Whether a picture is wanted.
    session : BakeSession
        Whose cache may have some results.

    Raises
    ------
    InputError
        An input is missing.
    """
    bake = folder_bake(spec, force, 0, session)
    stages, results, log = bake.stages(), bake.results, bake.log
    asked: list[Stage] = [stages.profile, stages.irradiance, stages.diffuse]
    if not spec.lights:
        asked, preview = [stages.profile], False
    if stages.relight:
        asked.append(stages.relight)
    if spec.output.tx and spec.lights:
        asked.append(TexturesStage(stages, results, log))
    if preview:
        asked.append(PreviewStage(bake.inputs, stages, results, PreviewWorker(), log))
    found = {stage.name: why for stage in asked if (why := stage.stale())}
    return found | {"profile": "forced"} if force else found
