"""Pictures of a bake, read from its folder or still in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from skinbake import pipeline
from skinbake.diffuse import DiffuseMap
from skinbake.io.bake_folder import half_maps
from skinbake.io.exr import Part, as_stored, rgb_channels, write_parts
from skinbake.io.lobes import StoredLobe
from skinbake.io.png import write_png
from skinbake.irradiance import IrradianceMap
from skinbake.preview.draw import Studio
from skinbake.preview.mode import Mode, parse_mode
from skinbake.preview.scene import PreviewLobe, PreviewScene
from skinbake.preview.shots import Shot, develop, plan_shots, side_by_side
from skinbake.scene.spec import PreviewSpec, SceneSpec


def render(
    scene: PreviewScene,
    look: PreviewSpec,
    out: Path,
    png: Path | str | None = None,
    exr: bool = False,
    views: Sequence[str] = (),
    turntable: int | None = None,
    size: tuple[int, int] | None = None,
    compare: bool = False,
    mode: str = "full",
    gains: dict[str, list[float]] | None = None,
    exposure: float | None = None,
    supersample: int = 2,
    say: Callable[[Path], None] | None = None,
) -> list[Path]:
    """Render pictures into the folder `out` and give the paths of the PNGs; the defaults render out/preview.png."""
    size = size or look.size
    shown = parse_mode(mode, len(scene.lobes))
    shots: list[Shot] = plan_shots(scene.mesh, views or [look.view], turntable, size[0] / size[1])
    written = []
    with Studio(scene) as studio:
        for shot in shots:
            modes = [Mode("none"), shown] if compare else [shown]
            frames = [studio.draw(shot.camera, size, m, gains, supersample) for m in modes]
            image = side_by_side(frames)
            name = "preview" if len(shots) == 1 else f"preview_{shot.name}"
            path = Path(png) if png else out / f"{name}{'_compare' if compare else ''}.png"
            write_png(path, develop(image, look.background_rgb, look.exposure if exposure is None else exposure))
            if exr:
                channels = rgb_channels(image.rgba[..., :3]) | {"A": image.rgba[..., 3]}
                write_parts(path.with_suffix(".exr"), [Part("preview", channels)], precision="float")
            written.append(path)
            if say:
                say(path)
    return written


def scene_of(
    spec: SceneSpec, scene: pipeline.SceneData, irradiance: Sequence[IrradianceMap], result: DiffuseMap
) -> PreviewScene:
    """What `read_bake_folder` would read, lights summed, without waiting for the files; of `StoredLobe`s."""
    precision = spec.output.precision
    lobes = tuple(
        PreviewLobe(
            {tile: total[None] for tile, total in lobe.total.items()},
            lobe.weight_rgb,
            None if lobe.method == "transmission" else lobe.variance_mm2,
        )
        for lobe in result.lobes
        if isinstance(lobe, StoredLobe)
    )
    return PreviewScene(
        scene.mesh,
        spec.lights,
        lobes,
        {tile.tile: as_stored(tile.rgb, precision) for tile in irradiance},
        {tile.tile: as_stored(tile.visibility[..., None], precision)[..., 0] for tile in irradiance},
        half_maps(scene.maps),
        spec.texturing,
        spec.specular,
        pipeline.energy_conservation(spec).kept,
        separate=False,
    )
