"""`skinbake preview FOLDER`: a window, or pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbake.cli.options import Output, Within, changed_since, named_look, quiet_option
from skinbake.cli.preview_arguments import later_light, parse_lights, parse_names, parse_size, relit_controls
from skinbake.errors import ConfigError, InputError, printable

if TYPE_CHECKING:
    from skinbake.io.bake_folder import BakeFolder
    from skinbake.preview.relit import LaterLight
    from skinbake.preview.scene import PreviewScene
    from skinbake.scene.output import PreviewSpec


@click.command("preview")
@click.argument("folder", type=click.Path())
@click.option(
    "--out",
    type=Output(file_okay=False, instead="; --png names one picture"),
    help="Folder for pictures, named after their views.",
)
@click.option("--png", type=Output(dir_okay=False), help="One picture, to this file.")
@click.option("--exr", is_flag=True, help="Also write linear float EXRs beside the PNGs.")
@click.option(
    "--views",
    metavar="A,B",
    help="front, left, right, three-quarter, three-quarter-right, back, ear, nose, lips, eyes.",
)
@click.option("--turntable", type=click.IntRange(1, 3600), metavar="N", help="N frames once around the head.")
@click.option("--movie", type=Output(dir_okay=False), help="The turntable as one .mp4 or .gif.")
@click.option("--fps", type=Within(1, 240), default=24.0, show_default=True, help="Frames a second of --movie.")
@click.option("--size", metavar="WxH", help="Size of a picture in pixels; one number is a square.")
@click.option("--compare", is_flag=True, help="Without and with scattering, side by side.")
@click.option(
    "--mode", default="full", show_default=True, help="full, diffuse, specular, none (no scattering), lobe:I."
)
@click.option("--lights", metavar="NAME=GAIN,...", help="Gain of each light: key=1.5,rim=0.5 or key=1/0.9/0.8.")
@click.option("--skin", metavar="NAME|FILE", help="Another skin on the same lobes: a preset, a look or a skin's file.")
@click.option("--exposure", type=Within(-100, 100), metavar="STOPS", help="Brightness of the PNGs.")
@click.option("--supersample", type=click.IntRange(1, 8), default=2, show_default=True, help="N x N points a pixel.")
@click.option(
    "--environment",
    metavar="FILE",
    help="Sky: .exr, .hdr, or studio or sunset; of a bake with relight: in its look.",
)
@click.option("--rotate", type=Within(-3600, 3600), default=0.0, metavar="DEG", help="Turn sky and suns about +y.")
@click.option(
    "--sun", "suns", multiple=True, metavar="X,Y,Z=R/G/B", help="Sunlight that travels along X,Y,Z; may be repeated."
)
@click.option(
    "--turn",
    type=click.Choice(["camera", "light"]),
    default="camera",
    show_default=True,
    help="What goes around.",
)
@quiet_option
def command(
    folder: str,
    out: str | None,
    png: str | None,
    exr: bool,
    views: str | None,
    turntable: int | None,
    movie: str | None,
    fps: float,
    size: str | None,
    compare: bool,
    mode: str,
    lights: str | None,
    skin: str | None,
    exposure: float | None,
    supersample: int,
    environment: str | None,
    rotate: float,
    suns: tuple[str, ...],
    turn: str,
    verbosity: int,
) -> None:
    """Show what a bake left in FOLDER, or in the folder of the look FOLDER.yaml: in a window, or as pictures.

    Of a look, its `preview:` is as it stands now; what else has changed since the bake is told.
    Pictures come with --out, --png, --exr, --views, --turntable or --compare.
    Without a display, writes FOLDER/preview.png. With --environment or --sun, which replace its lights, the look of the
    bake must have `relight:`.
    """
    from skinbake.preview.platform import has_display

    named, look = folder, named_look(folder)
    folder = look.output.dir if look else folder
    gains = parse_lights(lights)
    pixels = parse_size(size) if size else None
    pictures = bool(out or png or exr or views or turntable or compare)
    if png and (out or turntable or len(parse_names(views)) > 1):
        raise InputError("--png: names one picture; give --out DIR for several")
    if png and Path(png).suffix.lower() != ".png":
        raise InputError(f"--png {png}: expected a name that ends in .png")
    later = None
    if environment is not None or suns:
        later = later_light(environment, rotate, suns)
        if lights or skin is not None or compare or mode == "none":
            raise InputError(
                "--environment and --sun: expected neither --lights, --skin, --compare nor --mode none beside them"
            )
    elif rotate or turn == "light":
        option = "--turn light" if turn == "light" else f"--rotate {rotate:g}"
        raise InputError(
            f"{option}: expected --environment or --sun beside it, which it turns: a bake's own lights stand where "
            "they were baked"
        )
    if turn == "light" and not turntable:
        raise InputError("--turn light: expected --turntable N beside it, whose frames it is for")
    if movie:
        _refuse_movie(movie, turntable, png, parse_names(views))
    _refuse_unknown(folder, mode, gains, parse_names(views), later is not None)
    for line in changed_since(look, named) if verbosity else ():
        click.echo(printable(line), err=True)
    if not pictures and has_display():
        from skinbake.baking.window_actions import window_actions
        from skinbake.io.bake_folder import read_bake_folder, read_relit_folder
        from skinbake.io.other_skins import other_skin, other_skins
        from skinbake.preview.platform import renderer_words
        from skinbake.preview.window import PreviewWindow
        from skinbake.progress import Progress

        progress = Progress(verbosity > 0)
        with progress.task("reading the bake"):
            baked = read_relit_folder(folder) if later else read_bake_folder(folder)
        scene, skins = baked.scene, [] if later else other_skins(baked)
        if skin is not None:
            skins.insert(0, other_skin(baked, skin))
            scene = shown_with(baked, skin, verbosity)
        actions = window_actions(Path(folder), Path(named) if look else None)
        relit = relit_controls(later, environment)
        window = PreviewWindow(
            scene, (look or baked.spec).preview, pixels, mode, gains, exposure, relit, skins, actions
        )
        progress.line(f"drawn by {renderer_words(window.device)}; H shows the keys")
        window.run()
        return
    render_still(
        folder,
        out=out,
        png=png,
        exr=exr,
        views=parse_names(views),
        turntable=turntable,
        movie=movie,
        stills=not movie or out is not None,
        frames_per_second=fps,
        size=pixels,
        compare=compare,
        mode=mode,
        gains=gains,
        exposure=exposure,
        supersample=supersample,
        later=later,
        skin=skin,
        turn=turn,
        verbosity=verbosity,
        look=look.preview if look else None,
    )


def _refuse_unknown(folder: str, mode: str, gains: dict[str, list[float]], views: list[str], later: bool) -> None:
    """Stop at names that the bake has not, before its textures are read.

    Parameters
    ----------
    folder : str
    mode : str
    gains : mapping of light name to RGB
    views : list of str
    later : bool
        Whether lights that come later are shown.

    Raises
    ------
    InputError
    """
    from skinbake.io.bake_folder import lights_of, look_of_bake
    from skinbake.preview.camera import refuse_unknown_views
    from skinbake.preview.mode import parse_mode
    from skinbake.preview.shader_light import gains_of_lights

    _, manifest, spec = look_of_bake(folder)
    refuse_unknown_views(views)
    parse_mode(mode, 1 if later or not manifest["lobes"] else len(manifest["lobes"]))
    gains_of_lights(lights_of(manifest, spec), spec.output.separate_lights, gains)


def _refuse_movie(movie: str, turntable: int | None, png: str | None, views: list[str]) -> None:
    """Stop before anything is read for a movie that cannot be.

    Parameters
    ----------
    movie : path
    turntable : int, optional
    png : str, optional
    views : list of str

    Raises
    ------
    InputError
    """
    from skinbake.io.movie import refuse_movie

    refuse_movie(movie)
    if not turntable or png or len(views) > 1:
        raise InputError("--movie: expected --turntable N beside it, no --png, and one view")


def render_still(
    folder: Path | str,
    out: Path | str | None = None,
    gains: dict[str, list[float]] | None = None,
    later: LaterLight | None = None,
    skin: str | None = None,
    verbosity: int = 0,
    look: PreviewSpec | None = None,
    **how: Any,
) -> list[Path]:
    """Render pictures of a bake folder; their paths.

    Parameters
    ----------
    folder : path
    out : path, optional
        Folder for the pictures; FOLDER/preview.png unless given.
    gains : mapping of light name to float or RGB, optional
    later : LaterLight, optional
        In place of the bake's lights.
    skin : str, optional
        Name or file of another skin on the same lobes.
    verbosity : int
    look : PreviewSpec, optional
        What is not said otherwise; that of the bake unless given.
    **how
        As `render_views.render`.
    """
    from skinbake.baking.render_views import render
    from skinbake.io.bake_folder import read_bake_folder, read_relit_folder
    from skinbake.io.fingerprint import every_input
    from skinbake.io.output_names import PICTURE, PICTURE_KEY, is_output
    from skinbake.preview.draw import OffscreenRenderer
    from skinbake.preview.platform import renderer_words
    from skinbake.progress import Progress

    progress = Progress(verbosity > 0)
    with progress.task("reading the bake"):
        baked = read_relit_folder(folder) if later else read_bake_folder(folder, summed=not gains)
    textures = [
        path for path in baked.path.iterdir() if is_output(path.name) and path.name not in (PICTURE, PICTURE_KEY)
    ]
    inputs = [*textures, *every_input(baked.spec)]
    out = Path(out) if out else baked.path
    scene = shown_with(baked, skin, verbosity) if skin is not None else baked.scene
    with progress.task("starting OpenGL"):
        renderer = OffscreenRenderer(scene)
    progress.line(f"drawn by {renderer_words(renderer.device)}")
    with renderer:
        return render(
            renderer, look or baked.spec.preview, out, gains=gains, progress=progress, inputs=inputs, later=later, **how
        )


def shown_with(baked: BakeFolder, name: str, verbosity: int) -> PreviewScene:
    """The scene of a bake with another skin; how far its fit is off is told.

    Parameters
    ----------
    baked : BakeFolder
    name : str
        Of the skin, or its file.
    verbosity : int

    Raises
    ------
    InputError, ConfigError
        There is no such skin, or it does not go with this bake.
    """
    from skinbake.io.other_skins import other_skin
    from skinbake.preview.other_skin import skin_line, with_skin

    skin = other_skin(baked, name)
    try:
        gaussians = skin.fit()
    except ConfigError:  # says file and line
        raise
    except InputError as error:
        raise InputError(f"--skin {name}: {error}") from error
    if verbosity:
        click.echo(printable(skin_line(skin.name, gaussians)), err=True)
    return with_skin(baked.scene, gaussians)
