"""The stages of a look on a store of results."""

from __future__ import annotations

from skinbake.atlas.report import UvReport, refuse_spoilt, uv_report
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.result_store import ResultStore
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.baking.stages.diffuse import DiffuseStage
from skinbake.baking.stages.irradiance import GivenIrradiance, IrradianceStage
from skinbake.baking.stages.profile import ProfileStage
from skinbake.baking.stages.raster import RasterStage
from skinbake.baking.stages.relight import RelightStage
from skinbake.diffuse.scatter import refuse_too_large
from skinbake.io.spool import Spool
from skinbake.pipeline import Stages


def look_stages(
    inputs: BakeInputs,
    results: ResultStore,
    session: BakeSession,
    log: StageLog,
    given: GivenIrradiance | None = None,
) -> Stages:
    """The stages of a look.

    Parameters
    ----------
    inputs : BakeInputs
        The look and its files.
    results : ResultStore
        Where results are looked for and kept.
    session : BakeSession
        What looks of one process share.
    log : StageLog
    given : GivenIrradiance, optional
        Irradiance from somewhere else, in place of the look's lights.
    """
    profile = ProfileStage(inputs, results, log)
    raster = RasterStage(inputs, results, session, log)
    irradiance = given or IrradianceStage(inputs, profile, raster, results, session, log, log.note)
    relight = RelightStage(inputs, profile, results, log, log.note) if inputs.spec.relight else None
    reused = inputs.spec.relight is not None and inputs.spec.relight.reuse and given is None
    diffuse = DiffuseStage(inputs, profile, raster, irradiance, results, log, log.note, relight if reused else None)
    return Stages(inputs.decisions, profile, raster, irradiance, diffuse, None if reused else relight)


def put_aside(inputs: BakeInputs, stages: Stages, spool: Spool) -> None:
    """Have what was read and rasterised so far stand in files while no stage reads it.

    Parameters
    ----------
    inputs : BakeInputs
    stages : Stages
    spool : Spool
        Where it stands.
    """
    inputs.put_aside(spool)
    if isinstance(stages.raster, RasterStage):
        stages.raster.put_aside(spool)


def refuse_spoilt_look(inputs: BakeInputs, stages: Stages, on_disk: bool = True) -> UvReport | None:
    """Read what is new and stop at what would spoil the bake, before anything is written.

    Gives what was found of the UVs; None where no light will be traced.

    Parameters
    ----------
    inputs : BakeInputs
    stages : Stages
    on_disk : bool
        Whether results stand in files.

    Raises
    ------
    InputError
        A file that cannot be used, or UVs whose faults `check` reports.
    MachineError
        More memory than there is.
    """
    if stages.irradiance.stale() or (stages.relight and stages.relight.stale()):
        refuse_too_large(inputs.spec, inputs.decisions, len(inputs.tiles), on_disk)
        uv = uv_report(inputs.scene().mesh, stages.raster.result())
        refuse_spoilt(uv, inputs.spec.mesh.path)
        return uv
    return None
