"""Frames of a bake's `relight` textures while the light turns and while it stands, beside three baked lights.

`python -m tests.bench.relit_frames FOLDER` draws, in turn, the bake in FOLDER under a studio's sky and the scene of
`bench_preview` with its three lights, 512 x 512, four samples a pixel, and prints the median of a frame's seconds, of
the clock and of all processors. A light that stands lets textures be summed once; a turning one, or one whose gain
changes, cannot.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from skinbake.io.bake_folder import read_relit_folder
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.relit import LaterLight, sky_samples
from skinbake.preview.target import FloatTarget
from skinbake.relight.skies import made_sky
from tests.bench.bench_preview import HEAD, bench_scene

SIZE, FRAMES, FIRST = 512, 25, 3  # the first frames compile and upload


def main(folder: str) -> None:
    """Draw, print."""
    from OpenGL import GL

    relit, baked = read_relit_folder(folder).scene, bench_scene(HEAD)
    camera, seconds = view(baked.mesh, "three-quarter", 1.0), {}
    with OffscreenRenderer(relit) as later, OffscreenRenderer(baked) as live:
        light, samples = LaterLight(made_sky("studio")), sky_samples(live.device)

        def shine(degrees: float) -> None:
            turned = light.turned(degrees)
            later._renderer.show_later(
                turned.coefficients(relit.basis), turned.mirrored_sky(samples), turned.mirrored_suns
            )

        def dim(gain: float) -> None:
            live._renderer.gains_rgb = np.full((len(baked.lights), 3), gain)

        cases: dict[str, tuple[OffscreenRenderer, Callable[[int], None], bool]] = {
            "textures, light turns": (later, lambda frame: shine(7.0 * frame), False),
            "textures, light stands": (later, lambda frame: shine(0.0), True),
            "three lights, gains change": (live, lambda frame: dim(1 + 0.01 * frame), False),
            "three lights, they stand": (live, lambda frame: dim(1.0), True),
        }
        for name, (opened, prepare, fold) in cases.items():
            opened._platform.make_current()
            ours, found = opened._renderer, []
            ours.fold = fold
            if ours.target is None:
                ours.target = FloatTarget(SIZE, SIZE, samples=4, half=True)
            for frame in range(FIRST + FRAMES):
                GL.glFinish()
                begun = np.array([time.perf_counter(), time.process_time()])
                prepare(frame)
                ours.draw(camera)
                ours.target.resolve()
                GL.glFinish()
                found.append(np.array([time.perf_counter(), time.process_time()]) - begun)
            seconds[name] = np.median(found[FIRST:], axis=0)
        print(f"{live.device}, {len(next(iter(relit.lobes[0].rgb.values())))} textures, {SIZE} x {SIZE}")
    for name, (clock, processors) in seconds.items():
        print(f"{name:>27}: {1 / clock:5.1f} frames a second, {processors:.3f} CPU seconds a frame")


if __name__ == "__main__":
    main(sys.argv[1])
