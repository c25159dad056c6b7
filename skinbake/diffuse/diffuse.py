"""From light that arrives to light that leaves: every Gaussian of the profile, and the error of their sum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import prange
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.diffuse.diffuse_map import Decision, DiffuseMap, Lobe, MeasuredError
from skinbake.diffuse.error import measure_error, weighted_sum
from skinbake.diffuse.evaluator import LobeEvaluator, Tiles
from skinbake.diffuse.memoize import Memoize, MemoizedEvaluator
from skinbake.diffuse.memory import check_memory
from skinbake.diffuse.planning.auto import plan_auto
from skinbake.diffuse.planning.lobe_plan import LobePlan, plan_lines, plan_lobes
from skinbake.diffuse.probes import VERIFY, VERIFY_AGAIN, Probes, draw_probes, squeezed_share
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.errors import InputError
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec

_BLOCK = 65536  # texels


def diffuse(
    source: dict[int, NDArray[np.float32]],
    lights: tuple[str, ...],
    atlas: Atlas,
    mesh: SkinMesh,
    gaussians: GaussianSum,
    spec: DiffusionSpec,
    seed: int,
    precision: str = "half",
    progress: Callable[[str], None] | None = None,
    remember: Memoize | None = None,
) -> DiffuseMap:
    """Blur light by each Gaussian and measure the error of the sum.

    Parameters
    ----------
    source : dict of int to ndarray of shape (L, H, W, 3), float32
        By tile: light that arrives, times albedo^x when it is coloured before scattering; also in the gutter.
    lights : tuple of L str
    atlas : Atlas
        Of the same tiles and size.
    seed : int
        Of the probes.
    precision : "half" or "float"
        What the lobes will be written as; its rounding is part of the storage error.
    progress : callable, optional
        Told in words what begins.
    remember : callable, optional
        Asked for what is known of a light already; the result is the same to the last bit.

    Returns
    -------
    DiffuseMap
        Lobes narrowest first. A light gives the same lobes alone as together with others (for the same plan).

    Raises
    ------
    InputError
        If a texel of `source` is not finite: named by tile, row and column.
    MachineError
        If the memory would not do.

    References
    ----------
    [dEon2007], [Jensen2002]
    """
    tiles = _checked(source, lights, atlas)
    check_memory(atlas[0].shape, len(lights), len(atlas), len(gaussians.variance_mm2), spec.method)
    tell = progress or (lambda _: None)
    scaled, exponent = _scaled(tiles)
    diffuser = (
        LobeEvaluator(scaled, atlas, mesh, spec)
        if remember is None
        else MemoizedEvaluator(scaled, atlas, mesh, spec, lights, remember)
    )

    lines: list[Decision] = []
    if spec.method == "auto":
        tell("planning lobes")
        plans, lines = plan_auto(diffuser, gaussians, seed, precision)
    else:
        plans = plan_lobes(diffuser, gaussians)
        lines = plan_lines(plans, gaussians)

    tell("measuring points")
    points = [p for p, _, _ in diffuser.surface.tiles]
    probes = draw_probes(atlas, mesh, points, spec.probes, seed, VERIFY)
    made, error, by_lobe = _make(diffuser, plans, gaussians, probes, precision, tell)
    if error is not None and error.rms > spec.tolerance and spec.method == "auto":
        # The probes showed what the plan had not seen: plan with them, and judge by others
        tell("planning again")
        del made
        plans, lines = plan_auto(diffuser, gaussians, seed, precision, probes)
        probes = draw_probes(atlas, mesh, points, spec.probes, seed, VERIFY_AGAIN)
        first = error.rms
        made, error, by_lobe = _make(diffuser, plans, gaussians, probes, precision, tell)
        why = f"the first plan was wrong by {first:.3%} at probes that it had not seen; judged by others again"
        lines.append(Decision("second plan", True, why))
    if spec.probes:
        squeezed = squeezed_share(points)
        if squeezed > 0:
            why = f"{squeezed:.2%} of the skin has no texture to speak of: not judged"
            lines.append(Decision("squeezed skin", False, why))
    if not spec.normalise:
        lines += _classical_lines(diffuser, gaussians)
    arrives = _area_sum(diffuser.source, points)
    met = error is None or error.rms <= spec.tolerance
    return DiffuseMap(
        lights=lights,
        lobes=tuple(
            Lobe(
                variance_mm2=float(v),
                weight_rgb=tuple(float(w) for w in weight),  # type: ignore[arg-type]
                method=plan.method,
                rgb={r.tile: _unscaled(rgb, exponent) for r, rgb in zip(atlas, values, strict=True)},
                error=own,
                total_rgb=_total(diffuser, values, plan.level, arrives),
            )
            for v, weight, plan, values, own in zip(
                gaussians.variance_mm2, gaussians.weight_rgb, plans, made, by_lobe, strict=True
            )
        ),
        error=error,
        plan=tuple(lines),
        tolerance_met=met,
        advice="" if met or error is None else _advice(spec, error, precision),
    )


def _classical_lines(diffuser: LobeEvaluator, gaussians: GaussianSum) -> list[Decision]:
    """Sums that are not normalised take a texel for a point: for a lobe that is narrower, one of its own weight."""
    texel_mm = float(np.sqrt(diffuser.surface.mean_texel_mm2))
    narrow = [i for i, v in enumerate(gaussians.variance_mm2) if 0 < v < 0.5 * texel_mm**2]
    if not narrow:
        return []
    why = (
        f"lobes {', '.join(map(str, narrow))} are narrower than a texel of {texel_mm:.2g} mm: where texels are oblong "
        "they come out up to several times too bright, and the measured error does not show it; raise texture.size, or "
        "set diffusion.normalise to true"
    )
    return [Decision("classical integral", False, why)]


def _make(
    diffuser: LobeEvaluator,
    plans: tuple[LobePlan, ...],
    gaussians: GaussianSum,
    probes: Probes,
    precision: str,
    tell: Callable[[str], None],
) -> tuple[list[Tiles], MeasuredError | None, list[MeasuredError | None]]:
    """Every lobe; the error of their sum and of each, if there are probes."""
    variances = [float(v) for v in gaussians.variance_mm2]
    sums_texels = [diffuser.sums_texels(p.method, v, p.spacing) for p, v in zip(plans, variances, strict=True)]
    if not any(sums and p.method == "hybrid" for sums, p in zip(sums_texels, plans, strict=True)):
        diffuser.drop_pyramids()  # not wanted before the single texels are done with
    tell("measuring lobes exactly")
    exact = [diffuser.reference(v, probes) for v in variances] if len(probes) else []
    made: dict[int, Tiles] = {}
    unreduced, read = {}, {}
    # What lobes share is larger than they are: first those of single texels, then those of pyramids, each let go
    share = [
        0 if sums else 1 if p.method in ("texture", "hybrid") else 2 for sums, p in zip(sums_texels, plans, strict=True)
    ]
    for i in sorted(range(len(plans)), key=share.__getitem__):
        if share[i] > 0:
            diffuser.drop_texels()
        if share[i] > 1:
            diffuser.drop_pyramids()
        plan, variance = plans[i], variances[i]
        tell(f"lobe {i}: {plan.method}")
        made[i] = diffuser.map(plan.method, variance, plan.level, plan.spacing, plan.threshold)
        if len(probes):
            tell(f"measuring lobe {i}")
            if plan.method == "stretch":  # has no result of its own between the texels that it was made at
                unreduced[i] = diffuser.read(made[i], probes, half=False)
            else:
                unreduced[i] = diffuser.at(plan.method, variance, plan.level, plan.spacing, probes, plan.threshold)
            read[i] = diffuser.read(made[i], probes, precision == "half")
        diffuser.forget(variance)
    lobes = [made[i] for i in range(len(plans))]
    if not len(probes):
        return lobes, None, [None] * len(plans)
    found = [[of[i] for i in range(len(plans))] for of in (read, unreduced)]
    total = measure_error(*(weighted_sum(x, gaussians.weight_rgb) for x in (*found, exact)))
    return lobes, total, [measure_error(*each) for each in zip(*found, exact, strict=True)]


def _checked(source: dict[int, NDArray[np.float32]], lights: tuple[str, ...], atlas: Atlas) -> Tiles:
    tiles = []
    for raster in atlas:
        values = source.get(raster.tile)
        want = (len(lights), *raster.shape, 3)
        if values is None or values.shape != want:
            got = "nothing" if values is None else str(values.shape)
            raise InputError(f"irradiance of tile {raster.tile}: expected shape {want}, got {got}")
        if not np.isfinite(values.sum(dtype=np.float64)):
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                light, row, col, _ = bad[0]
                raise InputError(
                    f"irradiance of tile {raster.tile}: light {lights[light]} is not finite at row {row}, column {col} "
                    f"({len(bad)} values): expected finite light"
                )
        tiles.append(np.ascontiguousarray(values, dtype=np.float32))
    return tiles


def _scaled(tiles: Tiles) -> tuple[Tiles, list[int]]:
    """Each light by a power of two, if sums of it could leave float32; the exponents that were taken off."""
    exponents = []
    for k in range(tiles[0].shape[0]):
        peak = max(max(float(t[k].max(initial=0)), -float(t[k].min(initial=0))) for t in tiles)
        exponents.append(int(np.frexp(peak)[1]) if peak > 0 and not 1e-12 < peak < 1e12 else 0)
    if not any(exponents):
        return tiles, exponents
    factor = np.exp2(-np.asarray(exponents, np.float64))[:, None, None, None]
    return [(t * factor).astype(np.float32) for t in tiles], exponents


def _unscaled(rgb: NDArray[np.float32], exponents: list[int]) -> NDArray[np.float32]:
    if not any(exponents):
        return rgb
    return (rgb * np.exp2(np.asarray(exponents, np.float64))[:, None, None, None]).astype(np.float32)


def _total(diffuser: LobeEvaluator, values: Tiles, level: int, arrives: Float) -> tuple[float, float, float]:
    """Area-weighted total of a lobe over the light's, `arrives`."""
    leaves = _area_sum(values, diffuser.targets(level) if level else [p for p, _, _ in diffuser.surface.tiles])
    ratio = np.divide(leaves, arrives, out=np.ones(3), where=arrives > 0)
    return float(ratio[0]), float(ratio[1]), float(ratio[2])


def _area_sum(tiles: Tiles, points: list[TexelPoints]) -> Float:
    """Sum over lights and texels of radiosity times area, (3,); in blocks, so that threads cannot change it."""
    total = np.zeros(3)
    for rgb, here in zip(tiles, points, strict=True):
        blocks = np.zeros((-(-len(here.flat_index) // _BLOCK), 3))
        _area_sums(rgb.reshape(len(rgb), -1, 3), here.flat_index, here.area_mm2, blocks)
        total += blocks.sum(axis=0)
    return total


@kernel(parallel=True)
def _area_sums(rgb, flat, area, blocks):  # type: ignore[no-untyped-def]
    for block in prange(len(blocks)):
        for i in range(block * _BLOCK, min((block + 1) * _BLOCK, len(flat))):
            for light in range(len(rgb)):
                for c in range(3):
                    blocks[block, c] += np.float64(area[i]) * rgb[light, flat[i], c]


def _advice(spec: DiffusionSpec, error: MeasuredError, precision: str) -> str:
    head = f"measured rms {100 * error.rms:.3g}% is above diffusion.tolerance {100 * spec.tolerance:.3g}%: "
    if error.storage > error.method:
        rounding = ", or set output.precision to float" if precision == "half" else ""
        return f"{head}storage is the larger part; raise texture.size{rounding}"
    if spec.method in ("texture", "stretch"):
        return head + "the method is the larger part; set diffusion.method to auto or surface"
    return head + "the method is the larger part; raise texture.size, or the tolerance"
