"""Raster and three shadowed lights at 2048^2: seconds by stage, rays a second beside the bare embree loop.

`python -m tests.bench.bench_irradiance [mesh] [mm_per_unit] [size]`. Each ratio comes from one run, its two sides taken
in turn, so that whatever else the machine does slows both.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

import numba
import numpy as np

from skinbake.atlas import rasterize
from skinbake.io.mesh import read_mesh
from skinbake.irradiance import light_texels
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.surface import texel_surface
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, PointLight, SpotLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SpecularSpec

HEAD = Path(__file__).parents[2] / "data" / "head.obj"
RAYS = 1 << 20
LIGHTS = (
    DirectionalLight(name="key", type="directional", direction=(-0.62, -0.55, -0.56), irradiance=(3, 3, 3)),
    PointLight(name="rim", type="point", position_mm=(-350, 200, -150), intensity=(2e5, 2e5, 2e5)),
    SpotLight(name="top", type="spot", position_mm=(0, 400, 500), intensity=(4e5, 4e5, 4e5), axis=(0, -0.6, -1)),
)


def best(call, times: int = 3) -> float:
    """Shortest of a few runs, seconds."""
    found = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        found.append(time.perf_counter() - start)
    return min(found)


def measure(path: str, mm_per_unit: str, size: str) -> list[dict]:
    """A row a stage, then rays a second."""
    mesh = read_mesh(path, float(mm_per_unit))
    shape = (int(size), int(size))
    maps = SkinMaps()
    counted = [0]
    original = Occluder.occluded

    def count(self, origin, direction, reach):
        counted[0] += len(origin)
        return original(self, origin, direction, reach)

    atlas = rasterize(mesh, shape)
    light_texels(atlas, mesh, maps, LIGHTS)  # compiles
    rows = [
        ("raster", best(lambda: rasterize(mesh, shape))),
        ("smooth surface and embree", best(lambda: Occluder(mesh))),
    ]
    occluder = Occluder(mesh)
    rows.append(("texel surface", best(lambda: texel_surface(atlas[0], mesh, maps, SpecularSpec(), occluder))))
    Occluder.occluded = count  # type: ignore[method-assign]
    rows.append(("three lights, shadows", best(lambda: light_texels(atlas, mesh, maps, LIGHTS))))
    rays = counted[0] / 3
    Occluder.occluded = original  # type: ignore[method-assign]
    rows.append(("three lights, no shadows", best(lambda: light_texels(atlas, mesh, maps, LIGHTS, shadows=False))))
    sky = (EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1)),)
    rows.append(("a sky, 256 directions", best(lambda: light_texels(atlas, mesh, maps, sky), 1)))

    surface = texel_surface(atlas[0], mesh, maps, SpecularSpec(), occluder)
    origin = np.ascontiguousarray(surface.origin[atlas[0].addressed][:RAYS])
    direction = np.broadcast_to(np.float32([0.62, 0.55, 0.56]), origin.shape).copy()
    reach = np.full(len(origin), np.inf, np.float32)
    bare = best(lambda: occluder._scene.run(origin, direction, reach, query="OCCLUDED"))
    ours = best(lambda: occluder.occluded(origin, direction, reach))
    texels = int(size) ** 2
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    threads = numba.get_num_threads()
    return [{"name": name, "seconds": seconds, "mtexels_per_s": texels / seconds / 1e6} for name, seconds in rows] + [
        {"name": "rays of the three lights", "mrays": rays / 1e6, "rays_a_texel_and_light": rays / 3 / texels},
        {"name": "bare embree, 1 thread", "mrays_per_s": len(origin) / bare / 1e6, "peak_mib": peak},
        {
            "name": f"occluder, {threads} threads",
            "mrays_per_s": len(origin) / ours / 1e6,
            "bare_over_ours": bare / ours,
        },
    ]


def run(quick: bool) -> list[dict]:
    """The sample head, for the runner."""
    return measure(str(HEAD), "1", "512" if quick else "2048")


def main(path: str = str(HEAD), mm_per_unit: str = "1", size: str = "2048") -> int:
    """Print the table."""
    for row in measure(path, mm_per_unit, size):
        numbers = "  ".join(f"{key.replace('_', ' ')} {value:.4g}" for key, value in row.items() if key != "name")
        print(f"{row['name']:<28}{numbers}")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
