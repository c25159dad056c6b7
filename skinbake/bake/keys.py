"""The key of each stage of a look: what it reads, and nothing else, so that only what changed is run again."""

from __future__ import annotations

from typing import Any

from skinbake.io.fingerprint import code_key, key_of
from skinbake.scene.spec import SceneSpec

READERS = (
    "io/mesh",
    "io/image.py",
    "io/exr.py",
    "kernels/half.py",
    "stored_precision.py",
)  # a texel may come out otherwise when these change


def profile_key(spec: SceneSpec, inputs: dict[str, str]) -> str:
    """Of the fitted profile."""
    return key_of(code_key("profile"), spec.skin.model_dump(mode="json", exclude={"path"}), inputs.get("skin"))


def light_key(spec: SceneSpec, inputs: dict[str, str], name: str, energy_conservation: bool) -> str:
    """Of one light's irradiance. Roughness counts only where the oil layer's share is taken off the light."""
    light = next(light for light in spec.lights if light.name == name).model_dump(mode="json")
    light.pop("path", None)
    # An environment is planned by the tolerance
    tolerance = spec.diffusion.tolerance if light["type"] == "environment" else None
    oil = None
    if energy_conservation:
        oil = (spec.specular.model_dump(mode="json"), inputs.get("roughness"), inputs.get("specular"))
    return key_of(
        code_key("atlas", "irradiance", *READERS),
        geometry(spec, inputs),
        occluders(spec, inputs),
        (
            spec.maps.normal.model_dump(mode="json", exclude={"path"}) if spec.maps.normal else None,
            inputs.get("normal"),
        ),
        (light, inputs.get(f"light.{name}"), tolerance, spec.shadows, spec.output.seed, spec.output.precision),
        oil,
    )


def geometry(spec: SceneSpec, inputs: dict[str, str]) -> list[Any]:
    """What decides which point of the skin a texel shows."""
    mesh = spec.mesh.model_dump(mode="json", exclude={"path", "any_size"})
    return [mesh, inputs["mesh"], spec.texture.model_dump(mode="json")]


def occluders(spec: SceneSpec, inputs: dict[str, str]) -> list[Any]:
    """What rays meet that lies in other files than the mesh."""
    placed = _without_paths(spec.model_dump(mode="json", include={"occluders"}))
    return [placed, sorted(item for item in inputs.items() if item[0].startswith("occluder."))]


def diffuse_key(spec: SceneSpec, inputs: dict[str, str], gaussians: Any, irradiance: Any) -> str:
    """Of the lobes: `gaussians` are variances and weights, `irradiance` what identifies the light that is blurred."""
    return key_of(
        code_key("atlas", "profile", "diffuse", *READERS),
        geometry(spec, inputs),
        gaussians,
        irradiance,
        spec.diffusion.model_dump(mode="json"),
        (spec.terms.transmission, occluders(spec, inputs) if spec.terms.transmission != "off" else None),
        _albedo(spec, inputs),
        (spec.output.precision, spec.output.compression, spec.output.lights, spec.output.seed),
    )


def raster_key(spec: SceneSpec, inputs: dict[str, str]) -> str:
    """Of the atlas."""
    return key_of(code_key("atlas", *READERS), geometry(spec, inputs))


def blur_key(spec: SceneSpec, inputs: dict[str, str], light: str, kind: tuple[Any, ...]) -> str:
    """Of one light's lobe, or its values at probes: `light` is the key of its irradiance, `kind` says which and how."""
    return key_of(
        code_key("atlas", "diffuse", *READERS),
        geometry(spec, inputs),
        spec.diffusion.model_dump(mode="json", exclude={"probes"}),
        _albedo(spec, inputs),
        light,
        kind,
    )


def preview_key(spec: SceneSpec, inputs: dict[str, str], lobes: str) -> str:
    """Of preview.png: `lobes` is the key of what it draws."""
    look = _without_paths(spec.model_dump(mode="json"))
    drawing = code_key("preview", "io/bake_folder.py", "io/png.py", "bake/preview_worker.py", *READERS)
    return key_of(drawing, look, inputs, lobes)


def _albedo(spec: SceneSpec, inputs: dict[str, str]) -> Any:
    """What of the albedo is in the light that is blurred."""
    before = spec.texturing.exponent_before
    albedo = (inputs.get("albedo"), spec.maps.albedo_rgb, spec.maps.albedo and spec.maps.albedo.color_space)
    return (before, albedo if before else None)


def _without_paths(value: Any) -> Any:
    """Where files lie makes no difference, what is in them has its own key."""
    if isinstance(value, dict):
        return {key: _without_paths(inner) for key, inner in value.items() if key not in ("path", "dir", "opacity")}
    return [_without_paths(inner) for inner in value] if isinstance(value, list) else value
