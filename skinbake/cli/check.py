"""`skinbake check CONFIG`: a look's mesh, UVs and maps, and the cost of its bake, before it is started."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbake.cli.options import Output, config_argument, json_option, quiet_option, set_option

if TYPE_CHECKING:
    from skinbake.atlas.report import UvReport
    from skinbake.diffuse.planning.texture_size import TextureSize
    from skinbake.io.waiting import Waiting
    from skinbake.irradiance.scene_data import SceneData
    from skinbake.scene.spec import SceneSpec

PICTURE = "uv_check.png"
LISTED = 12  # frames in a message
_SMALLEST = 15  # times that a texture is halved, at most
SIGNED_SHARE = 0.7  # of a texture of relight.exr that zip leaves


@click.command("check")
@config_argument
@click.option("--out", type=Output(file_okay=False), help=f"Folder for {PICTURE}, a picture of overlaps and flips.")
@set_option
@json_option
@quiet_option
def command(config: str, out: str | None, overrides: tuple[str, ...], as_json: bool, verbosity: int) -> None:
    """Report on units, texels, UVs, maps, memory, time and file sizes of CONFIG. Exit 2 on what would spoil a bake."""
    import json

    from skinbake.atlas.report import refuse_spoilt
    from skinbake.baking.stage_log import StageLog
    from skinbake.errors import printable
    from skinbake.io.config import load_look

    spec = load_look(config, overrides, first_frame=True)
    log = StageLog(verbosity)
    with log.telling_of_compiling(), log.progress.task("checking"):
        report, pictures, uv = examine(spec, log.waiting)
    report["notes"] += _frames(config, overrides)
    if out is not None:
        from skinbake.io.fingerprint import every_input
        from skinbake.io.output_names import refuse_inputs
        from skinbake.io.png import write_png

        names = [PICTURE if len(pictures) == 1 else f"uv_check.{tile}.png" for tile, _ in pictures]
        paths = [Path(out) / name for name in names]
        refuse_inputs(paths, [config, *every_input(spec)])
        for path, (_, picture) in zip(paths, pictures, strict=True):
            write_png(path, picture)
        report["pictures"] = [str(path) for path in paths]
    if as_json:
        click.echo(json.dumps(report | {"faults": uv.faults}, indent=1))
    elif verbosity:
        click.echo(printable(readable(report)))
    refuse_spoilt(uv, spec.mesh.path)


def _frames(config: str, overrides: tuple[str, ...]) -> list[str]:
    """Which frame of a sequence was looked at, and of which there are no files."""
    from skinbake.io.config import frames_of, load_frames
    from skinbake.io.fingerprint import every_input

    if len(frames_of(config, overrides)) < 2:
        return []
    _, looks = load_frames(config, overrides)
    first, *others = looks
    bare = [number for number in others if not all(path.exists() for path in every_input(looks[number]))]
    shown = ", ".join(map(str, bare[:LISTED])) + (f" and {len(bare) - LISTED} more" if len(bare) > LISTED else "")
    missing = f"; files are missing of {shown}" if bare else ""
    return [f"frames: {len(looks)}, this is what frame {first} would be{missing}"]


def examine(spec: SceneSpec, waiting: Waiting | None = None) -> tuple[dict[str, Any], list[tuple[int, Any]], UvReport]:
    """Report on a look: the report as a mapping, a picture for each tile, and the report on the UVs.

    Parameters
    ----------
    spec : SceneSpec
    waiting : Waiting, optional
        Told while UVs are made.

    Raises
    ------
    InputError, MachineError
        Files that cannot be read; a bake that this machine cannot hold.
    """
    from dataclasses import asdict

    import numpy as np

    from skinbake.atlas import tiles_of
    from skinbake.atlas.look_atlas import look_atlas
    from skinbake.atlas.report import report_picture, uv_report
    from skinbake.baking.warnings import look_warnings
    from skinbake.diffuse.planning.texture_size import at_size, choose_size
    from skinbake.diffuse.scatter import refuse_too_large
    from skinbake.io.image_memory import memory_of_images
    from skinbake.io.mesh import guess_orientation, part_table
    from skinbake.io.scene_files import read_scene
    from skinbake.io.table import read_profile_csv
    from skinbake.io.waiting import unseen
    from skinbake.irradiance.decide import decide
    from skinbake.irradiance.unreached import unreached
    from skinbake.profile import fit_skin
    from skinbake.profile.varying_skin import ranges_of
    from skinbake.scene.maps import IMAGES

    scene = read_scene(spec, rays=False, waiting=waiting or unseen)
    refuse_too_large(spec, decide(spec), len(tiles_of(scene.mesh, spec.texture.udim)))
    atlas = look_atlas(spec.texture, scene.mesh)
    uv = uv_report(scene.mesh, atlas)
    path = getattr(spec.skin, "path", None)
    over = ranges_of(scene.maps, spec.skin, tiles_of(scene.mesh, spec.texture.udim))
    gaussians = fit_skin(spec.skin, read_profile_csv(path) if path else None, over=over).gaussians
    size = choose_size(spec, scene.mesh, scene.maps, gaussians)
    texel_mm = max(uv.mm_per_texel[1], 1e-12)
    sizes = {name: [list(image.shape[1::-1]) for image in getattr(scene.maps, name).values()] for name in IMAGES}
    orientation = guess_orientation(scene.mesh)
    casters = len(scene.mesh.casters.faces) if scene.mesh.casters else 0
    images_mib = (sum(memory_of_images(spec).values()) + _of_materials(spec, scene)) / 2**20
    report = {
        "mesh": {
            "path": spec.mesh.path,
            "box_mm": [
                [round(float(x), 2) for x in side(scene.mesh.positions_mm, axis=0)] for side in (np.min, np.max)
            ],
            "lateral": orientation.lateral,
            "crown": orientation.crown,
            "face": orientation.face,
            "extent_mm": [round(x, 2) for x in uv.extent_mm],
            "area_mm2": round(uv.area_mm2, 1),
            "triangles": uv.triangles,
            "open_edges": uv.open_edges,
        },
        "uv": {
            "size": list(spec.texture.size),
            "tiles": [raster.tile for raster in atlas],
            "coverage": round(uv.coverage, 4),
            "mm_per_texel_5_50_95": [round(x, 4) for x in uv.mm_per_texel],
            "stretch_95": round(uv.stretch_95, 3),
            "overlapping": uv.overlapping,
            "flipped": uv.flipped,
            "degenerate": uv.degenerate,
            "outside": uv.outside,
            "overlapping_share": uv.overlapping_share,
            "degenerate_share": uv.degenerate_share,
            "outside_share": uv.outside_share,
        },
        "lobes": [
            {"sigma_mm": round(float(v) ** 0.5, 4), "sigma_texels": round(float(v) ** 0.5 / texel_mm, 3)}
            for v in gaussians.variance_mm2
        ],
        "parts": [asdict(row) for row in part_table(spec)],
        "hidden_parts": [list(pair) for pair in uv.hidden_parts],
        "maps": sizes,
        "notes": [
            *scene.mesh.notes,
            *scene.notes,
            *_told(spec, scene, size),
        ],
        "warnings": [
            *filter(None, [orientation.advice]),
            *look_warnings(spec, scene, texel_mm, gaussians),
            *unreached(spec.lights, scene.mesh, spec.texture.size, scene.environments, spec.shadows),
        ],
        "expected": expected(
            at_size(spec, size), uv, len(atlas), gaussians.variance_mm2.tolist(), images_mib, casters, size.lost
        ),
    }
    tiles = [raster.tile for raster in atlas]
    return report, list(zip(tiles, report_picture(uv, atlas), strict=True)), uv


def _told(spec: SceneSpec, scene: SceneData, size: TextureSize) -> list[str]:
    """What is used where there is no albedo, what a loose tolerance does to the texture's size, what relights."""
    from skinbake.relight.transfer import transfer_size

    told = [*_unpainted(spec, scene), *([f"texture.size: {size.decision.why}"] if size.decision else [])]
    if spec.relight is not None and spec.relight.reuse:
        told.append(f"relight: one of up to {spec.relight.textures} textures, kept in the cache, may show its lights")
    elif spec.relight is not None:
        width, height = transfer_size(spec)
        many = f"up to {spec.relight.textures}" if spec.relight.fewer else spec.relight.textures
        told.append(f"relight: {many} textures of {width} x {height} for any sky and any sun")
    return told


def _unpainted(spec: SceneSpec, scene: SceneData) -> list[str]:
    """What is used where there is no albedo."""
    if scene.maps.albedo:
        return []
    colour = ", ".join(f"{value:.2f}" for value in spec.maps.albedo_rgb or ())
    return [f"maps.albedo: none, the skin is of one colour, albedo_rgb [{colour}]"]


def _of_materials(spec: SceneSpec, scene: SceneData) -> int:
    """Bytes of the maps that the mesh's own file holds, as float32 and as the 8-bit pictures that they were."""
    roles = [role for role in ("albedo", "normal", "roughness") if getattr(spec.maps, role) is None]
    images = [image for role in roles for image in getattr(scene.maps, role).values()]
    return sum(image.nbytes + image.size for image in images) if spec.maps.source else 0


def expected(
    spec: SceneSpec,
    uv: UvReport,
    tiles: int,
    variance_mm2: Sequence[float],
    images_mib: float = 0.0,
    casters: int = 0,
    lost: float = 0.0,
) -> dict[str, float]:
    """Memory, seconds and file sizes of a bake of this look and of its picture, once its machine code is compiled.

    Fitted to bakes of the sample head at 256^2 to 4096^2, with its own and with 16 times its triangles, and of the Lee
    Perry-Smith scan at 1024^2 and 2048^2: within a factor 1.5 for sizes; memory to the head with three lights at 512^2
    to 4096^2, within a tenth; seconds, on two free cores of a 2.6 GHz server, within 1.5, times what this machine took
    longer before (`baking.pace`). Sizes are those of skin with its albedo map; constant light on constant skin takes
    less.

    Parameters
    ----------
    spec : SceneSpec
    uv : UvReport
    tiles : int
    variance_mm2 : sequence of float
        Variance of each lobe.
    images_mib : float
        Of maps and skies.
    casters : int
        Triangles besides the skin's.
    lost : float
        Error of a texture that is coarser than asked for.
    """
    from skinbake.baking.cost_model import START_S, Work, looking, stage_seconds
    from skinbake.baking.pace import paced
    from skinbake.baking.preview_scene import picture_bytes
    from skinbake.diffuse.memory import LOADED_BYTES, memory_needed_bytes
    from skinbake.diffuse.methods import METHODS
    from skinbake.diffuse.planning.rules import stored_level
    from skinbake.diffuse.scatter import other_lights
    from skinbake.diffuse.terms.thin_parts import transmitted_level
    from skinbake.io.mesh.unwrap import unwrap_seconds
    from skinbake.io.user_cache import user_cache
    from skinbake.relight.transfer import AT_ONCE, transfer_size
    from skinbake.scene.budget import budget_of

    budget, work = budget_of(spec, lost), Work(tiles, len(variance_mm2), uv.triangles + casters, uv.area_mm2)
    lights, summed = len(spec.lights), not spec.output.separate_lights
    megatexels = spec.texture.size[0] * spec.texture.size[1] * tiles / 2**20
    megatriangles = (uv.triangles + casters) / 1e6
    covered = megatexels * uv.coverage
    texel_mm2 = uv.area_mm2 / max(covered * 2**20, 1)
    # Texels of all lobes, in full textures: the sizes of the plan's rule for surface sums, and light through thin parts
    bilinear_error, tolerance = METHODS["surface"].bilinear_error, budget.blur
    levels = [stored_level(bilinear_error, float(v), max(texel_mm2, 1e-12), tolerance, _SMALLEST) for v in variance_mm2]
    kept = [4.0**-level for level in levels]
    if spec.terms.transmission != "off":
        kept.append(4.0 ** -transmitted_level(texel_mm2**0.5))
    # Skies, and the total of several lights, reach everywhere; any other light leaves half of the skin dark
    skies = sum(light.type == "environment" for light in spec.lights)
    total = 1 if skies or lights > 1 else 0
    bright, dark = skies + total, 1 + lights - skies - total
    value = {"half": 2.0, "float": 4.0}[spec.output.precision]
    if spec.output.compression == "none":
        irradiance, lobes = value * megatexels * (4 * (1 + lights)), value * 3 * megatexels * sum(kept)
        lobes *= 1 if summed else 1 + lights
    else:
        # Neighbouring texels differ less the finer they are
        packed = value * covered * (megatexels / tiles) ** -0.1 * (1.9 if spec.output.precision == "float" else 1.0)
        packed *= 1.35 if spec.packing == "rle" else 1.0
        irradiance = packed * 4 * (0.31 * bright + 0.21 * dark)
        lobes = packed * 3 * sum(kept) * (0.24 + 0.24 * total if summed else 0.48 * bright + 0.24 * dark)
    # Lights stored summed are blurred summed; drawn are the sum of each lobe, and maps and irradiance as they are
    separate, others = 1 if summed else lights, other_lights(spec)
    look = looking(spec, budget, work)[0]
    needed = memory_needed_bytes(spec.texture.size, separate, tiles, others=others, on_disk=True, looking=look) / 2**20
    needed = max(needed, images_mib + picture_bytes(spec.texture.size, lights, tiles) / 2**20)
    needed = needed if lights else images_mib
    relight = {}
    if spec.relight is not None and not spec.relight.reuse:
        textures, of = spec.relight.textures, tiles * transfer_size(spec)[0] * transfer_size(spec)[1] / 2**20
        needed = max(needed, images_mib + of * (235 + 24 * textures + 58 * AT_ONCE))
        relight["relight_mib"] = round(SIGNED_SHARE * value * of * uv.coverage * 3 * textures, 2)
    return {
        "memory_mib": round(LOADED_BYTES / 2**20 + needed + megatriangles * 1400),
        "seconds": round(
            START_S
            + sum(paced(stage_seconds(spec, budget, work), spec).values())
            + (unwrap_seconds(uv.triangles) if spec.texture.unwrap != "none" and user_cache() is None else 0.0),
            1,
        ),
        "irradiance_mib": round(irradiance, 2) if lights else 0.0,
        "lobes_mib": round(lobes, 2) if lights else 0.0,
        **relight,
    }


def readable(report: dict[str, Any]) -> str:
    """The report for a terminal."""
    from skinbake.baking.verdict import marked
    from skinbake.machine import physical_memory_bytes

    mesh, uv, cost = report["mesh"], report["uv"], report["expected"]
    there_mib = physical_memory_bytes() // 2**20
    too_little = f" (this machine has {there_mib})" if cost["memory_mib"] > there_mib else ""
    low, middle, high = uv["mm_per_texel_5_50_95"]
    lines = [
        f"mesh      {' x '.join(f'{x:.0f}' for x in mesh['extent_mm'])} mm, {mesh['area_mm2'] / 100:.0f} cm2,"
        f" {mesh['triangles']} triangles, {mesh['open_edges']} open edges",
        f"box       {_box(mesh)}",
        f"texture   {uv['size'][0]} x {uv['size'][1]}, tiles {', '.join(map(str, uv['tiles']))},"
        f" {uv['coverage']:.1%} covered",
        f"texel     {middle:.3f} mm (5 % below {low:.3f}, 5 % above {high:.3f}), 95 % stretch of UV"
        f" {uv['stretch_95']:.2f}",
        f"charts    {uv['overlapping']} overlapping, {uv['flipped']} flipped, {uv['degenerate']} without UV area,"
        f" {uv['outside']} outside",
        "lobes     sigma "
        + ", ".join(f"{lobe['sigma_mm']:.3g} mm = {lobe['sigma_texels']:.3g} texels" for lobe in report["lobes"]),
    ]
    if len(report["parts"]) > 1:
        lines += [f"part      {_part(part)}" for part in report["parts"]]
        lines += [
            f"hidden    {share:.1%} of the skin: {below} under {above}"
            for below, above, share in report["hidden_parts"]
        ]
    lines += [f"note      {note}" for note in report["notes"]]
    for name, sizes in report["maps"].items():
        if sizes:
            lines.append(f"{name:<9} " + ", ".join(f"{w} x {h}" for w, h in sizes))
    files = [
        f"{name} {cost[f'{name}_mib']} MiB" for name in ("irradiance", "lobes", "relight") if cost.get(f"{name}_mib")
    ]
    lines.append(
        ", ".join([f"expected  about {cost['memory_mib']} MiB{too_little}, {cost['seconds']} s on two cores", *files])
    )
    lines += [f"picture   {path}" for path in report.get("pictures", [])]
    lines += marked(report.get("warnings", []))
    return "\n".join(lines)


def _part(part: dict[str, Any]) -> str:
    """One line of the list of parts."""
    box = part["uv_box"]
    uvs = f"UVs {box[0]:.2f} {box[1]:.2f} to {box[2]:.2f} {box[3]:.2f}" if box else "no UVs"
    size = " x ".join(f"{x:.0f}" for x in part["extent_mm"])
    return f"{part['role']:<6} {part['name']}: {part['triangles']} triangles, {size} mm, {uvs}"


def _box(mesh: dict[str, Any]) -> str:
    """Where the mesh lies and how it seems to be turned."""
    low, high = mesh["box_mm"]
    ranges = ", ".join(f"{axis} {a:.0f} .. {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True))
    centre = ", ".join(f"{(a + b) / 2:.0f}" for a, b in zip(low, high, strict=True))
    seen = [f"{name} along {mesh[name]}" for name in ("crown", "face") if mesh[name]]
    return f"{ranges} mm, centre {centre}" + (f"; {', '.join(seen)}" if seen else "")
