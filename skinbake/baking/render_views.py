"""Pictures of a bake, as many as are asked for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from pathlib import Path

from skinbake.baking.warnings import EMPTY_PICTURE
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.movie import write_movie
from skinbake.io.output_names import refuse_inputs
from skinbake.io.png import write_png
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import Mode, parse_mode
from skinbake.preview.picture_part import refuse_picture_too_large
from skinbake.preview.relit import LaterLight
from skinbake.preview.views import View, plan_views, side_by_side, tone_map
from skinbake.progress import Progress
from skinbake.scene.output import PreviewSpec


def render(
    renderer: OffscreenRenderer,
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
    movie: Path | str | None = None,
    stills: bool = True,
    frames_per_second: float = 24.0,
    progress: Progress | None = None,
    inputs: Iterable[Path] = (),
    later: LaterLight | None = None,
    turn: str = "camera",
) -> list[Path]:
    """Render pictures into a folder and give the paths of the PNGs; the defaults render out/preview.png.

    Those that were asked for by view or turntable are named after it, also where there is only one.

    Parameters
    ----------
    renderer : OffscreenRenderer
    look : PreviewSpec
        What is not said otherwise.
    out : Path
        The folder.
    png : path, optional
        Another name for the one picture.
    exr : bool
        Also write linear radiance as EXR.
    views : sequence of str
        Names of views.
    turntable : int, optional
        Frames once around the head.
    size : (width, height), optional
    compare : bool
        Without scattering and with it, side by side.
    mode : str
        What is shown, as `parse_mode` has it.
    gains : dict of light name to (R, G, B), optional
    exposure : float, optional
        In stops.
    supersample : int
        Each pixel is the mean of its square of points.
    movie : path, optional
        One .mp4 or .gif of all frames; then there are pictures only where `stills` asks for them.
    stills : bool
    frames_per_second : float
        Of the movie.
    progress : Progress, optional
        Shows how far it is, and each path.
    inputs : iterable of Path
        Files that no picture is written over.
    later : LaterLight, optional
        The light of a scene of `relit_scene`.
    turn : "camera" or "light"
        What goes around in a turntable.

    Raises
    ------
    InputError
        A picture has the name of one of the inputs.
    MachineError
        A picture that is larger than this machine can hold; no OpenGL.
    """
    size = size or look.size
    shown = parse_mode(mode, len(renderer.scene.lobes))
    modes = [Mode("none"), shown] if compare else [shown]
    exposure = look.exposure if exposure is None else exposure
    refuse_picture_too_large(size, len(modes))
    frames = turntable if turn == "light" else None
    planned = plan_views(renderer.scene.mesh, look, views, None if frames else turntable, size[0] / size[1])
    lit = [later] * len(planned)
    if frames and later is not None:
        lit = [later.turned(360.0 * k / frames) for _ in planned for k in range(frames)]
        planned = [
            View(f"{each.name}_{k:04d}" if len(planned) > 1 else f"{k:04d}", each.camera)
            for each in planned
            for k in range(frames)
        ]
    names = [f"preview_{each.name}" for each in planned] if views or turntable else ["preview"]
    paths = [Path(png)] if png else [out / f"{name}{'_compare' if compare else ''}.png" for name in names]
    refuse_inputs([*([movie] if movie else []), *paths, *(path.with_suffix(".exr") for path in paths if exr)], inputs)
    progress = progress or Progress(shown=False)
    film = write_movie(movie, frames_per_second) if movie else nullcontext(lambda pixels: None)
    with film as add, progress.task("drawing", total=len(planned)) as task:
        for task.done, (each, light, path) in enumerate(zip(planned, lit, paths, strict=True)):
            task.note = f"{each.name}, {task.done + 1} of {len(planned)}"
            image = side_by_side([renderer.draw(each.camera, size, m, gains, supersample, later=light) for m in modes])
            pixels = tone_map(image, look.background_rgb, exposure)
            add(pixels)
            if not image.rgba[..., 3].any():
                progress.line(f"warning  {each.name}: {EMPTY_PICTURE}")
            if not stills:
                continue
            write_png(path, pixels)
            if exr:
                channels = rgb_channels(image.rgba[..., :3]) | {"A": image.rgba[..., 3]}
                write_parts(path.with_suffix(".exr"), [Part("preview", channels)], precision="float")
            progress.line(str(path))
    if movie:
        progress.line(str(movie))
    return paths if stills else []
