#version 330 core
// What tonemap.py does, for the screen: background, exposure, highlights rolled off with their hue, sRGB

const float KNEE = TONEMAP_KNEE;
const float DESATURATION = TONEMAP_DESATURATION;

uniform sampler2D frame;
uniform sampler2D text;
uniform vec3 background;
uniform vec2 size;  // of the screen, pixels
uniform float gain;  // 2^exposure, on the skin only

layout(location = 0) out vec4 shown;

void main()
{
    vec4 skin = texture(frame, gl_FragCoord.xy / size);  // a coarse frame is smaller than the screen
    vec3 rgb = clamp(skin.rgb * gain, 0.0, 60000.0) + (1.0 - skin.a) * background;
    float peak = max(rgb.r, max(rgb.g, rgb.b));
    float bent = peak > KNEE ? 1.0 - (1.0 - KNEE) * (1.0 - KNEE) / (peak - KNEE + 1.0 - KNEE) : peak;
    rgb *= peak > 0.0 ? bent / peak : 1.0;
    rgb = mix(rgb, vec3(bent), 1.0 - 1.0 / (DESATURATION * (peak - bent) + 1.0));
    vec3 curve = 1.055 * pow(max(rgb, 1e-4), vec3(1.0 / 2.4)) - 0.055;
    vec3 encoded = mix(curve, 12.92 * rgb, lessThanEqual(rgb, vec3(0.0031308)));
    ivec2 place = ivec2(gl_FragCoord.x, size.y - gl_FragCoord.y);  // from the top left corner
    vec2 caption = vec2(0.0);
    if (all(lessThan(place, textureSize(text, 0)))) caption = texelFetch(text, place, 0).rg;
    shown = vec4(mix(encoded * (1.0 - caption.g), vec3(0.9), caption.r), 1.0);
}
