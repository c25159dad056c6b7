"""What is written into the shader's text: constants of the bake, its numbers of lobes and lights, and what is shown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from skinbake.irradiance.bump_terminator import BUMP_GAIN
from skinbake.irradiance.oil_layer import HALF_SQUARED_MIN, ROUGHNESS_MIN
from skinbake.irradiance.punctual_light import NEAREST_MM
from skinbake.preview import shader_light
from skinbake.preview.mode import Mode
from skinbake.preview.normal_levels import LEVELS
from skinbake.preview.scene import PreviewScene
from skinbake.preview.shader_light import ENVIRONMENT, ShaderLight
from skinbake.preview.skin_table import table_layers

SHADERS = Path(__file__).parent / "shaders"
# What the shader has in common with the bake, as GLSL literals
CONSTANTS = {
    name: repr(value)
    for name, value in (
        ("BUMP_GAIN", BUMP_GAIN),
        ("NEAREST_MM", NEAREST_MM),
        ("ROUGHNESS_MIN", ROUGHNESS_MIN),
        ("HALF_SQUARED_MIN", HALF_SQUARED_MIN),
        ("LAST_NORMAL_LEVEL", float(LEVELS - 1)),
        ("DIRECTIONAL", shader_light.DIRECTIONAL),
        ("POINT", shader_light.POINT),
        ("SPOT", shader_light.SPOT),
        ("FACET", shader_light.FACET),
        ("ENVIRONMENT", shader_light.ENVIRONMENT),
    )
}
# Symbols that the text asks for with #ifdef; all others are replaced
SWITCHES = (
    "GBUFFER",
    "HAS_NORMAL_MAP",
    "OBJECT_SPACE",
    "SHOW_DIFFUSE",
    "SHOW_SPECULAR",
    "UNSCATTERED",
    "ALBEDO_AFTER",
    "ENERGY_CONSERVATION",
    "HAS_ENVIRONMENT",
    "NEEDS_OIL_ALBEDO",
    "SKIN_TABLE",
    "TABLE_COLUMNS",
    "SKIN_SCATTERS",
    "SECOND_LOBE",
    "HAS_F0_MAP",
    "LIGHT_COMES_LATER",
)


def grey_layers(first: int, layers: int, read: str) -> str:
    """Text that adds to `sum` what layers hold of three grey lights each; as `skinbake.relight.grey_lights.summed`.

    Parameters
    ----------
    first : int
        How many layers in colour come before; `layer_gain` has a gain for each, then one for each grey light.
    layers : int
        How many of them; with none there is no text.
    read : str
        How a layer is read, `layer` being its number.
    """
    if not layers:
        return ""
    lines = (
        "vec3 grey = vec3(0.0), tint;",
        f"for (int layer = {first}; layer < {first + layers}; ++layer) {{ vec3 held = {read}.rgb;",
        f"int light = {first} + 3 * (layer - {first});",
        "grey += layer_gain[light] * held.r + layer_gain[light + 1] * held.g + layer_gain[light + 2] * held.b; }",
        f"{{ const int layer = 0; tint = {read}.rgb; }}",
        "sum += grey * tint * (3.0 / max(tint.r + tint.g + tint.b, 1e-20));",
    )
    return " ".join(lines)  # it becomes a macro, which is one line


def shader_defines(
    scene: PreviewScene,
    tile: int,
    mode: Mode,
    lights: Sequence[ShaderLight],
    layers: int,
    geometry_buffer: bool = False,
) -> dict[str, str]:
    """Symbols of `skin.frag` for one tile: those of SWITCHES that are set, and what replaces the others.

    Parameters
    ----------
    scene : PreviewScene
    tile : int
    mode : Mode
    lights : sequence of ShaderLight
    layers : int
        Of the lobes' textures, or gains of the lights that these hold.
    geometry_buffer : bool
        Write position, normal, tangent and UV beside the picture.
    """
    lobes = range(len(scene.lobes))
    shown = [mode.lobe] if mode.name == "lobe" else lobes
    table = scene.table
    varies = table is not None and mode.diffuse and mode.name != "lobe"
    second = scene.specular.second
    weight = "weight" if varies else "lobe_weight"
    terms = [f"{weight}[{i}] * texture(lobe_{i}, vec3(frag_uv, layer)).rgb" for i in shown]
    conserving = scene.energy_conservation and mode.name != "lobe"
    later = tile in scene.open_sky
    grey = 0
    if later and scene.basis is not None and layers > 1:
        grey = scene.basis.textures - scene.basis.in_colour
        layers = scene.basis.in_colour
    mirrored = any(light.kind == ENVIRONMENT for light in lights) and mode.specular
    on = {
        "GBUFFER": geometry_buffer,
        "HAS_NORMAL_MAP": tile in scene.maps.normal,
        "OBJECT_SPACE": scene.maps.normal_space == "object",
        "SHOW_DIFFUSE": mode.diffuse,
        "SHOW_SPECULAR": mode.specular,
        "UNSCATTERED": mode.name == "none",
        "ALBEDO_AFTER": scene.texturing.exponent_before < 1 and mode.name in ("full", "diffuse"),
        "ENERGY_CONSERVATION": conserving,
        "HAS_ENVIRONMENT": mirrored,
        "NEEDS_OIL_ALBEDO": conserving or mirrored or (later and mode.specular),
        "SKIN_TABLE": varies,
        "TABLE_COLUMNS": varies and table is not None and len(table.names) > 1,
        "SKIN_SCATTERS": varies and table is not None and table.scatters,
        "SECOND_LOBE": second is not None,
        "HAS_F0_MAP": tile in scene.maps.f0,
        "LIGHT_COMES_LATER": later,
    }
    return (
        {
            "DECLARE_LOBES": "".join(f"uniform sampler2DArray lobe_{i};\n" for i in lobes),
            "SUM_OF_LOBES": " + ".join(terms),
            "N_LOBES": str(len(scene.lobes)),
            "N_GAUSSIANS": str(scene.gaussians),
            "TABLE_LAYERS": str(table_layers(scene.gaussians)),
            "N_LAYERS": str(layers),
            "N_GAINS": str(layers + 3 * grey),
            "ADD_GREY_LAYERS": grey_layers(layers, grey, "texture(lobe_0, vec3(frag_uv, layer))"),
            "N_LIGHTS": str(len(lights)),
            "TILE_NUMBER": f"{tile}.0",
            "SECOND_ROUGHNESS": repr(float(second.roughness if second else 1.0)),
            "SECOND_MIX": repr(float(second.mix if second else 0.0)),
        }
        | CONSTANTS
        | {name: "1" for name in SWITCHES if on[name]}
    )
