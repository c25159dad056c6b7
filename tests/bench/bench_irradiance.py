"""Raster and three shadowed lights at 2048^2: seconds by stage, rays a second beside the bare embree loop.

`python -m tests.bench.bench_irradiance [size] [mesh mm_per_unit]`: the sample head and, where it lies in
../shared/assets or SKINBAKE_LPS, the Lee Perry-Smith scan; or the mesh that is given. Each ratio comes from one run,
its two sides taken in turn, so that whatever else the machine does slows both.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from skinbake.atlas import rasterize
from skinbake.io.mesh import read_mesh
from skinbake.irradiance import light_texels
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.surface import texel_surface
from skinbake.kernels.threads import thread_count
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, PointLight, SpotLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SpecularSpec

ROOT = Path(__file__).parents[2]
SCAN = Path(os.environ.get("SKINBAKE_LPS", ROOT.parent / "shared" / "assets" / "lee_perry_smith")) / "head.obj"
RAYS = 1 << 20
LIGHTS = (
    DirectionalLight(name="key", type="directional", direction=(-0.62, -0.55, -0.56), irradiance=(3, 3, 3)),
    PointLight(name="rim", type="point", position_mm=(-350, 200, -150), intensity=(2e5, 2e5, 2e5)),
    SpotLight(name="top", type="spot", position_mm=(0, 400, 500), intensity=(4e5, 4e5, 4e5), axis=(0, -0.6, -1)),
)
SKY = EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1))


def timed(call) -> float:
    """Seconds."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def best(call, times: int = 3) -> float:
    """Shortest of a few runs, seconds."""
    return min(timed(call) for _ in range(times))


def measure(name: str, mesh: SkinMesh, size: int) -> list[dict]:
    """A row a stage, then rays a second."""
    shape, maps, texels = (size, size), SkinMaps(), size**2
    counted = [0]
    original = Occluder.occluded

    def count(self, origin, direction, reach):
        counted[0] += len(origin)
        return original(self, origin, direction, reach)

    atlas = rasterize(mesh, shape)
    light_texels(atlas, mesh, maps, (*LIGHTS, SKY))  # compiles
    occluder = Occluder(mesh)
    surface = texel_surface(atlas[0], mesh, maps, SpecularSpec(), occluder)
    rows = [
        ("raster", best(lambda: rasterize(mesh, shape))),
        ("smooth surface and embree", best(lambda: Occluder(mesh))),
        ("texel surface", best(lambda: texel_surface(atlas[0], mesh, maps, SpecularSpec(), occluder))),
        ("three lights, shadows", best(lambda: light_texels(atlas, mesh, maps, LIGHTS))),
        ("three lights, no shadows", best(lambda: light_texels(atlas, mesh, maps, LIGHTS, shadows=False))),
        ("a sky", best(lambda: light_texels(atlas, mesh, maps, [SKY]))),
    ]
    Occluder.occluded = count  # type: ignore[method-assign]
    try:
        light_texels(atlas, mesh, maps, LIGHTS)
    finally:
        Occluder.occluded = original  # type: ignore[method-assign]

    origin = surface.origins(np.flatnonzero(atlas[0].addressed)[:RAYS])
    direction = np.broadcast_to(np.float32([0.62, 0.55, 0.56]), origin.shape).copy()
    reach = np.full(len(origin), np.inf, np.float32)
    result = [
        {"name": f"{name}: {stage}", "seconds": seconds, "mtexels_per_s": texels / seconds / 1e6}
        for stage, seconds in rows
    ]
    result.append(
        {"name": f"{name}: rays", "mrays": counted[0] / 1e6, "rays_a_texel_and_light": counted[0] / 3 / texels}
    )
    everyone = os.environ.get("NUMBA_NUM_THREADS", "")
    for threads in sorted({1, thread_count()}):
        os.environ["NUMBA_NUM_THREADS"] = str(threads)
        bounds = np.linspace(0, len(origin), threads + 1).astype(int)

        def bare(threads: int = threads, bounds=bounds) -> None:
            def run(i: int) -> None:
                part = slice(bounds[i], bounds[i + 1])
                occluder._scene.run(origin[part], direction[part], reach[part], query="OCCLUDED")

            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(run, range(threads)))

        pairs = [(timed(bare), timed(lambda: occluder.occluded(origin, direction, reach))) for _ in range(5)]
        theirs, ours = (min(side) for side in zip(*pairs, strict=True))
        rate = len(origin) / 1e6
        result.append(
            {
                "name": f"{name}: rays, both on {threads} thread{'s' * (threads > 1)}",
                "bare_mrays_per_s": rate / theirs,
                "ours_mrays_per_s": rate / ours,
                "ours_over_bare": theirs / ours,
            }
        )
    os.environ["NUMBA_NUM_THREADS"] = everyone
    return result


def heads() -> dict[str, SkinMesh]:
    """The sample head, and the scan where it is."""
    found = {"head": read_mesh(ROOT / "data" / "head.obj", 1.0)}
    return found | ({"scan": read_mesh(SCAN, 50.35)} if SCAN.exists() else {})


def run(quick: bool) -> list[dict]:
    """Both heads, for the runner."""
    return [row for name, mesh in heads().items() for row in measure(name, mesh, 512 if quick else 2048)]


def main(size: str = "2048", path: str = "", mm_per_unit: str = "1") -> int:
    """Print the table."""
    meshes = {Path(path).stem: read_mesh(path, float(mm_per_unit))} if path else heads()
    for name, mesh in meshes.items():
        for row in measure(name, mesh, int(size)):
            numbers = "  ".join(f"{key.replace('_', ' ')} {value:.4g}" for key, value in row.items() if key != "name")
            print(f"{row['name']:<34}{numbers}")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
