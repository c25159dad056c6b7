"""The same shading in NumPy, in float64, from the geometry buffer of the shader's own raster pass."""

import numpy as np

from skinbake.irradiance.bump_terminator import bump_terminator
from skinbake.irradiance.oil_albedo import mean_specular_albedo, specular_albedo
from skinbake.numerics import normalized, safe_div
from skinbake.preview.normal_levels import normal_levels
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, RectangleLight, SpotLight
from tests.oil_brdf import kelemen_brdf


def bilinear(image, uv):
    """image (h, w, k) at uv (n, 2), v up, clamped at the edge."""
    image = np.asarray(image, np.float64)
    h, w = image.shape[:2]
    x = np.clip(uv[:, 0] * w - 0.5, 0, w - 1)
    y = np.clip((1 - uv[:, 1]) * h - 0.5, 0, h - 1)
    x0, y0 = np.minimum(x.astype(int), max(w - 2, 0)), np.minimum(y.astype(int), max(h - 2, 0))
    x1, y1 = np.minimum(x0 + 1, w - 1), np.minimum(y0 + 1, h - 1)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    return top * (1 - fy) + (image[y1, x0] * (1 - fx) + image[y1, x1] * fx) * fy


def softened(cos_mapped, cos_smooth):
    """Factor of the bake's own kernel, point by point; 1 where the mapped normal turns away and nothing is left."""
    factor = np.ones(cos_mapped.shape)
    for i in np.flatnonzero(cos_mapped > 0):
        factor[i] = bump_terminator(cos_mapped[i], cos_smooth[i])
    return factor


def shade(scene, geometry, camera, mode, gains):
    """Radiance (H, W, 3), zero where nothing is shown."""
    out = np.zeros((*geometry.tile.shape, 3))
    for tile in scene.tiles:
        at = geometry.tile == tile
        planes = [
            np.asarray(p[at], np.float64)
            for p in (geometry.position_mm, geometry.normal, geometry.tangent, geometry.uv, geometry.normal_level)
        ]
        out[at] = _shade(scene, tile, *planes, camera.position_mm, mode, gains)
    return out


def _shade(scene, tile, position, normal, tangent, uv, level, eye, mode, gains):
    smooth = normalized(normal)
    n, variance = _mapped(scene.maps, tile, normal, tangent, uv, level)
    v = normalized(eye - position)
    maps, spec = scene.maps, scene.specular
    m = (
        bilinear(maps.roughness[tile][..., None], uv)[:, 0]
        if tile in maps.roughness
        else np.full(len(uv), spec.roughness)
    )
    flat_m = np.clip(m, 1e-4, 1)
    m = np.minimum(np.sqrt(flat_m**2 + variance), 1)
    factor = bilinear(maps.specular[tile][..., None], uv)[:, 0] if tile in maps.specular else 1.0
    rho_s = spec.strength * factor
    albedo = bilinear(maps.albedo[tile], uv) if tile in maps.albedo else np.broadcast_to(maps.albedo_rgb, (len(uv), 3))
    f0 = bilinear(maps.f0[tile][..., None], uv)[:, 0] if tile in maps.f0 else spec.f0
    cosine = (n * v).sum(1)
    albedo_of_oil = _oil_albedo(cosine, m, f0)
    if spec.second is not None:
        of_second = _oil_albedo(cosine, np.full(len(uv), spec.second.roughness), f0)
        albedo_of_oil = (1 - spec.second.mix) * albedo_of_oil + spec.second.mix * of_second
    reflected = np.clip(rho_s * albedo_of_oil, 0, 1)[:, None]
    color = np.zeros((len(uv), 3))

    if mode.diffuse:
        if mode.name == "none":
            exitance = sum(g * bilinear(scene.irradiance[tile][i], uv) for i, g in enumerate(gains))
            total = scene.total_weight_rgb
            if scene.table is not None:
                total = scene.table.total(_quantities(scene, tile, uv))
            exitance = exitance * total * albedo
        else:
            lobes = (
                [(scene.lobes[mode.lobe], 1.0)]
                if mode.name == "lobe"
                else list(zip(scene.lobes, _weights(scene, tile, uv), strict=True))
            )
            used = gains if scene.separate else np.ones((1, 3))
            exitance = sum(w * g * bilinear(x.rgb[tile][i], uv) for x, w in lobes for i, g in enumerate(used))
            if mode.name != "lobe":
                exitance = exitance * albedo ** (1 - scene.texturing.exponent_before)
        if scene.energy_conservation and mode.name != "lobe":
            exitance = exitance * (1 - reflected)
        color += exitance / np.pi

    if mode.specular:
        mirrored = reflected
        if scene.energy_conservation:  # what arrives is what the bake's oil let pass
            kept = _mean_oil_albedo(flat_m, f0)
            if spec.second is not None:
                of_second = _mean_oil_albedo(np.full(len(uv), spec.second.roughness), f0)
                kept = (1 - spec.second.mix) * kept + spec.second.mix * of_second
            mirrored = reflected / np.maximum(1 - rho_s * kept, 0.05)[:, None]
        for i, light in enumerate(scene.lights):
            if isinstance(light, EnvironmentLight):
                color += gains[i] * bilinear(scene.irradiance[tile][i], uv) / np.pi * mirrored
                continue
            seen = bilinear(scene.visibility[tile][i][..., None], uv)[:, 0]
            for to_light, arriving in _arriving(light, position):
                cos = (n * to_light).sum(1)
                soft = 1.0
                if tile in maps.normal:
                    soft = softened(cos, (smooth * to_light).sum(1))
                f = kelemen_brdf(n, to_light, v, m, f0, rho_s)
                if spec.second is not None:
                    sharp = np.minimum(np.sqrt(spec.second.roughness**2 + variance), 1)
                    other = kelemen_brdf(n, to_light, v, sharp, f0, rho_s)
                    f = (1 - spec.second.mix) * f + spec.second.mix * other
                color += gains[i] * arriving * (f * np.maximum(cos, 0) * seen * soft)[:, None]
    return color


def _oil_albedo(cosine, m, f0):
    """A(c, m), which is linear in f0: between those of f0 = 0 and f0 = 1."""
    none, all_of_it = specular_albedo(cosine, m, 0.0), specular_albedo(cosine, m, 1.0)
    return none + f0 * (all_of_it - none)


def _mean_oil_albedo(m, f0):
    """The same of a constant sky, at as many roughnesses as there are, linear between 256 of them."""
    nodes = np.linspace(m.min(), m.max() + 1e-9, 256)
    none, all_of_it = (np.interp(m, nodes, mean_specular_albedo(nodes, each)) for each in (0.0, 1.0))
    return none + f0 * (all_of_it - none)


def _quantities(scene, tile, uv):
    """What the table's maps hold, those that the tile has."""
    maps = {name: getattr(scene.maps, name).get(tile) for name in scene.table.quantities}
    return {name: bilinear(image[..., None], uv)[:, 0] for name, image in maps.items() if image is not None}


def _weights(scene, tile, uv):
    """Weights of every lobe, (3,) or (n, 3)."""
    alone = np.array([x.weight_rgb for x in scene.lobes])
    if scene.table is None:
        return alone
    values = _quantities(scene, tile, uv)
    through = [scene.table.scatter_at(values)[:, None] * w for w in alone[scene.gaussians :]]
    return [*scene.table.at(values), *through]


def _mapped(maps, tile, n, tangent, uv, level):
    """Unit normals, and the variance of the slopes under a pixel: between the two nearest levels of the map."""
    if tile not in maps.normal:
        return normalized(n), 0.0
    levels = normal_levels(maps.normal[tile], maps.normal_strength, maps.normal_space)
    read = np.stack([bilinear(image, uv) for image in levels])
    level = np.minimum(level, len(levels) - 1)
    low = np.minimum(level.astype(int), max(len(levels) - 2, 0))
    some, part = np.arange(len(uv)), (level - low)[:, None]
    mapped = (1 - part) * read[low, some] + part * read[np.minimum(low + 1, len(levels) - 1), some]
    s, variance = mapped[:, :3], mapped[:, 3]
    if maps.normal_space == "object":
        return normalized(s), variance
    t = tangent[:, :3]
    b = np.cross(n, t) * np.sign(tangent[:, 3:])
    k = maps.normal_strength
    return normalized(k * s[:, :1] * t + k * s[:, 1:2] * b + s[:, 2:] * n), variance


def _arriving(light, position):
    """(unit vector to the light, irradiance facing it) of each point it is made of."""
    if isinstance(light, DirectionalLight):
        yield np.broadcast_to(-normalized(light.direction), position.shape), np.array(light.irradiance)
        return
    if isinstance(light, RectangleLight):
        u, v = np.array(light.edge_u_mm), np.array(light.edge_v_mm)
        facing = normalized(np.cross(u, v))
        quarter = np.array(light.radiance) * np.linalg.norm(np.cross(u, v)) / 4
        for a in (-0.25, 0.25):
            for b in (-0.25, 0.25):
                way = np.array(light.position_mm) + a * u + b * v - position
                to_light = normalized(way)
                shine = np.maximum(-(to_light @ facing), 0) / (way**2).sum(1)
                yield to_light, quarter * shine[:, None]
        return
    way = np.array(light.position_mm) - position
    to_light = normalized(way)
    reach = 1 / (way**2).sum(1)
    if isinstance(light, SpotLight):
        inner, outer = np.cos(np.radians([light.inner_deg, light.outer_deg]))
        t = np.clip(safe_div(-(to_light @ normalized(light.axis)) - outer, inner - outer), 0, 1)
        reach = reach * t * t * (3 - 2 * t)
    yield to_light, np.array(light.intensity) * reach[:, None]
