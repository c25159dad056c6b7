"""Time of the diffusion, and its error on a scan: `python -m tests.bench.bench_diffuse [--size 2048] [--json FILE]`.

Ratios first, since the machine may be busy: each ratio is of two things timed one after the other, best of several.
What is timed is first checked to be the same thing: the blurs of OpenCV, scikit-image and SciPy equal ours on a fully
covered texture.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from skinbake.atlas import face_mm_per_texel, interpolate, rasterize
from skinbake.diffuse import diffuse
from skinbake.diffuse.methods import METHODS
from skinbake.diffuse.methods.hybrid import LOOSE
from skinbake.diffuse.planning.fixed import plan_lobe
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.diffuse.texture_space.blur import texture_blur, texture_pyramid, widest_level
from skinbake.machine import reuse_freed
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec

# The six Gaussians of GPU Gems 3, chapter 14, mm^2 and RGB; theory.md 4.7
VARIANCE_MM2 = np.array([0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41])
WEIGHT_RGB = np.array(
    [
        [0.233, 0.455, 0.649],
        [0.1, 0.336, 0.344],
        [0.118, 0.198, 0],
        [0.113, 0.007, 0.007],
        [0.358, 0.004, 0],
        [0.078, 0, 0],
    ]
)
_ROOT = Path(__file__).parents[2]
SCAN = [
    folder
    for folder in (_ROOT.parent / "shared" / "assets" / "lee_perry_smith", _ROOT / "data" / "lee_perry_smith")
    if (folder / "head.obj").is_file()
]
SKIN = GaussianSum(VARIANCE_MM2, WEIGHT_RGB, np.zeros(3), np.ones(3))


def best(run, repeats=3):
    """Shortest of several runs, and the last result."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - start)
    return min(times), result


def flat_blurs(size: int) -> dict:
    """Six texture blurs against copying and against three libraries."""
    import cv2
    import scipy.ndimage
    import skimage.filters

    rng = np.random.default_rng(0)
    light = rng.random((1, size, size, 3)).astype(np.float32)
    covered = np.ones((size, size), np.float32)
    texels2 = VARIANCE_MM2 / 0.05 * (size / 2048) ** 2  # a texel of 0.22 mm at 2048

    def ours():
        pyramid = texture_pyramid(light, covered)
        return [texture_blur(pyramid, (t, t), widest_level((t, t))) for t in texels2]

    ours()
    seconds, lobes = best(ours)

    def copy_full():
        return [light.copy() for _ in texels2]  # into new memory, as the blurs write theirs

    def copy_bytes():
        return [light.copy(), *(lobe.copy() for lobe in lobes)]

    copy_full()
    copy_six, _ = best(copy_full, 5)
    copy_least, _ = best(copy_bytes, 5)
    # The same blur by others; each is seen to be the same before it is timed, where all are wide enough to agree
    sigmas = np.sqrt(texels2)
    others = {
        "opencv": lambda sigma: cv2.GaussianBlur(light[0], (0, 0), sigma),
        "scikit_image": lambda sigma: skimage.filters.gaussian(light[0], sigma, channel_axis=-1),
        "scipy": lambda sigma: scipy.ndimage.gaussian_filter(light[0], (sigma, sigma, 0), mode="nearest"),
    }
    wide = 4
    step = size // lobes[wide].shape[1]
    inner = slice(64 // step, -64 // step)
    found = {
        "texture_over_copy_of_six_full_maps": seconds / copy_six,
        "texture_over_copy_of_bytes_once": seconds / copy_least,
        "seconds_texture": seconds,
        "seconds_copy_of_six": copy_six,
    }
    for name, blur in others.items():
        small = blur(sigmas[wide]).reshape(size // step, step, size // step, step, 3).mean(axis=(1, 3))
        difference = float(np.abs(small[inner, inner] - lobes[wide][0][inner, inner]).max())
        if difference > 2e-3:
            raise AssertionError(f"{name}: expected the same blur to 2e-3 of the light's range, got {difference:.2g}")
        their_seconds, _ = best(lambda blur=blur: [blur(sigma) for sigma in sigmas], 2)
        found |= {
            f"{name}_over_texture": their_seconds / seconds,
            f"seconds_{name}": their_seconds,
            f"largest_difference_{name}": difference,
        }
    return found | {"stored_sizes": [lobe.shape[1] for lobe in lobes]}


def scan() -> tuple[SkinMesh, str] | None:
    """The Lee Perry-Smith head when it is there."""
    from skinbake.io.mesh import read_mesh

    return (read_mesh(str(SCAN[0] / "head.obj"), 50.35), "Lee Perry-Smith") if SCAN else None


def hard_key(mesh, atlas) -> dict:
    """Hard directional light with traced shadows, and the seconds its rays took."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, mesh.corner_position_mm.astype(np.float32))
    towards = np.array([-0.6, 0.5, 0.62]) / np.linalg.norm([-0.6, 0.5, 0.62])
    source, seconds = {}, 0.0
    for raster in atlas:
        normal, position = interpolate(raster, mesh.corner_normal), interpolate(raster, mesh.corner_position_mm)
        face = mesh.face_normal[raster.face_index]
        cosine = np.maximum(normal @ towards.astype(np.float32), 0) * (face @ towards > 0) * raster.addressed
        lit = np.flatnonzero(cosine)
        start_at = (position.reshape(-1, 3)[lit] + 0.02 * face.reshape(-1, 3)[lit]).astype(np.float32)
        start = time.perf_counter()
        hit = scene.run(start_at, np.tile(towards.astype(np.float32), (len(lit), 1)))
        seconds += time.perf_counter() - start
        cosine.reshape(-1)[lit[hit >= 0]] = 0
        tint = np.array([3, 2.8, 2.5])
        source[raster.tile] = np.ascontiguousarray((cosine[None, ..., None] * tint).astype(np.float32))
    return {"source": source, "seconds": seconds}


def seconds_of_one_light(size: int) -> dict[str, float]:
    """Lighting the scan by one sun as a bake does it, and what of it are shadows; what rays meet is there already."""
    from skinbake.atlas.look_atlas import look_atlas
    from skinbake.io.config import load_look
    from skinbake.io.scene_files import read_scene
    from skinbake.irradiance.decide import decide
    from skinbake.irradiance.light_skin import light_skin

    look = f"""
mesh: {{path: "{SCAN[0] / "head.obj"}", mm_per_unit: 50.35}}
texture: {{size: {size}}}
skin: {{preset: gpugems3-six-gaussians}}
lights: [{{name: key, type: directional, direction: [0.6, -0.5, -0.62], irradiance: [3, 2.8, 2.5]}}]
output: {{dir: out}}
"""
    with TemporaryDirectory() as folder:
        (Path(folder) / "look.yaml").write_text(look)
        spec = load_look(Path(folder) / "look.yaml")
        scene = read_scene(spec)
    atlas = look_atlas(spec.texture, scene.mesh)
    assert scene.occluder
    bright = spec.model_copy(update={"shadows": False})
    with_shadows, without = (best(lambda s=s: light_skin(s, decide(s), scene, atlas), 5)[0] for s in (spec, bright))
    return {"seconds_of_one_light": with_shadows, "seconds_of_its_shadows": with_shadows - without}


def on_the_scan(size: int, probes: int) -> dict:
    """Each method's error and seconds, lobe by lobe and summed."""
    found = scan()
    if found is None:
        return {}
    mesh, _ = found
    atlas = rasterize(mesh, (size, size))
    key = hard_key(mesh, atlas)
    report: dict = {
        "seconds_shadow_rays": key["seconds"],
        **seconds_of_one_light(size),
        "methods": {},
    }
    for method, tolerance in (
        ("texture", 0.003),
        ("stretch", 0.003),
        ("hybrid", 0.003),
        ("surface", 0.003),
        ("surface", 0.01),
        ("auto", 0.003),
        ("auto", 0.01),
    ):
        spec = DiffusionSpec(method=method, tolerance=tolerance, probes=probes)
        seconds = []
        for _ in range(3):
            marks: list[tuple[str, float]] = []
            start = time.perf_counter()
            baked = diffuse(
                key["source"],
                ("key",),
                atlas,
                mesh,
                SKIN,
                spec,
                0,
                progress=lambda s, m=marks: m.append((s, time.perf_counter())),
            )
            end = time.perf_counter()
            ends = [t for _, t in marks[1:]] + [end]
            measuring = sum(t - began for (s, began), t in zip(marks, ends, strict=True) if s.startswith("measuring"))
            seconds.append((end - start - measuring, measuring))
        lobes, measuring = min(seconds)  # the first runs touch fresh memory
        report["methods"][f"{method} {tolerance}"] = {
            "seconds_lobes": lobes,
            "seconds_error": measuring,
            "met": baked.tolerance_met,
            "rms": baked.error.rms,
            "p95": baked.error.p95,
            "max": baked.error.max,
            "method": baked.error.method,
            "storage": baked.error.storage,
            "lobes": [
                {
                    "method": b.method,
                    "size": b.rgb[1001].shape[1],
                    "rms": b.error.rms,
                    "p95": b.error.p95,
                    "max": b.error.max,
                }
                for b in baked.lobes
            ],
        }
    report["seams"] = seams(mesh, atlas, key["source"])
    return report


def seams(mesh, atlas, source, count: int = 10_000) -> dict:
    """Difference of the two sides of UV seam samples over the mean, before and after (lobe of 1.99 mm^2).

    First only samples that a texture can show: four texels of their own chart on both sides (charts that touch in UV
    cannot be read there), and texels of at most ten times the mean length (faces squeezed to nothing in UV).
    """
    from skinbake.bilinear import bilinear_texels, read_bilinear
    from skinbake.diffuse.texture_space.stretch import chart_of_face, uv_vertices
    from tests.diffuse.test_surface import seam_samples

    pairs, faces = seam_samples(mesh, count, with_faces=True)
    places = [np.stack([1 - uv[:, 1], uv[:, 0]], axis=1) for uv in pairs]
    charts = chart_of_face(uv_vertices(mesh))
    shown = np.where(atlas[0].addressed, charts[atlas[0].face_index], -1).reshape(-1)
    length = face_mm_per_texel(mesh, (atlas[0].shape[1], atlas[0].shape[0])).max(axis=1)
    mean = np.sqrt(atlas[0].area_mm2.sum() / np.count_nonzero(atlas[0].area_mm2))
    clean = (length[faces[0]] < 10 * mean) & (length[faces[1]] < 10 * mean)
    for place, face in zip(places, faces, strict=True):
        clean &= (shown[bilinear_texels(place, *atlas[0].shape)[0]] == charts[face][:, None]).all(axis=1)
    resources = LobeResources(source, SkinGeometry(atlas, mesh), DiffusionSpec(tolerance=0.003))
    images = {"before": source[1001]}
    for name in ("texture", "hybrid", "surface"):
        lobe = plan_lobe(resources, METHODS[name], 1.99).parameters._replace(level=0)
        images[name] = METHODS[name].map(resources, lobe)[1001]
    # As loose as `auto` allows a hybrid lobe to be
    loose = lobe._replace(threshold=LOOSE[-1] * resources.spec.tolerance)
    images["hybrid, loose"] = METHODS["hybrid"].map(resources, loose)[1001]
    out = {}
    for name, image in images.items():
        sides = [read_bilinear(image, place) for place in places]
        apart = np.abs(sides[0] - sides[1]) / image[image > 0].mean()
        for label, which in (("", clean), (" (all)", np.ones(count, bool))):
            found = apart[which]
            out[name + label] = {
                "samples": int(which.sum()),
                "rms": float(np.sqrt((found**2).mean())),
                "p95": float(np.percentile(found, 95)),
            }
    return out


def run(quick: bool) -> list[dict]:
    """The blurs beside other libraries', and the methods on the scan where it lies, for the runner."""
    size = 512 if quick else 2048
    flat = flat_blurs(size)
    rows = [{"name": f"six blurs of {size}^2"} | {k: v for k, v in flat.items() if not isinstance(v, list)}]
    for name, row in on_the_scan(size, 500 if quick else 2000).get("methods", {}).items():
        rows.append({"name": f"scan: {name}"} | {k: v for k, v in row.items() if isinstance(v, float)})
    return rows


def main() -> None:
    """Print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=2048)
    parser.add_argument("--probes", type=int, default=2000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    reuse_freed()  # as the command line does
    report = {"flat": flat_blurs(options.size), "scan": on_the_scan(options.size, options.probes)}
    report["peak_gib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    for name, value in report["flat"].items():
        print(f"{name:40s} {value if isinstance(value, list) else f'{value:.4g}'}")
    for name, row in report["scan"].get("methods", {}).items():
        print(
            f"{name:14s} rms {row['rms']:.3%} p95 {row['p95']:.3%} max {row['max']:.2%} method {row['method']:.3%} "
            f"storage {row['storage']:.3%} lobes {row['seconds_lobes']:.2f} s error {row['seconds_error']:.2f} s "
            f"{'met' if row['met'] else 'MISSED'}"
        )
        for i, lobe in enumerate(row["lobes"]):
            numbers = f"rms {lobe['rms']:.3%} p95 {lobe['p95']:.3%} max {lobe['max']:.2%}"
            print(f"    lobe {i} {lobe['method']:9s} {lobe['size']:5d} {numbers}")
    for name, row in report["scan"].get("seams", {}).items():
        print(f"seam sides apart, {name:14s} of {row['samples']}: rms {row['rms']:.3%} p95 {row['p95']:.3%}")
    rays = report["scan"].get("seconds_shadow_rays", float("nan"))
    light, shadows = (
        report["scan"].get(name, float("nan")) for name in ("seconds_of_one_light", "seconds_of_its_shadows")
    )
    print(f"one light's bare shadow rays {rays:.2f} s; in a bake its shadows {shadows:.2f} s, all of it {light:.2f} s")
    print(f"peak {report['peak_gib']:.2f} GiB")
    if options.json:
        options.json.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
