#version 330 core
// Adds up what the bake left and shades the oil layer; nothing is blurred here. The words in capitals that no #define
// explains are written in by skinbake/preview/renderer.py: constants of the bake, and how many lobes and lights there are.

const float PI = 3.14159265358979;
const float LEAST_PASSED = 0.05;  // share of a sky's light that passes the oil, below which it counts as this
const float LOBE_END = 16.0;  // squared slope over m^2, from which on a lobe counts as black

in vec3 frag_position;
in vec3 frag_normal;
in vec4 frag_tangent;
in vec2 frag_uv;

uniform vec3 cam_pos;

DECLARE_LOBES
uniform vec3 lobe_weight[N_LOBES];
uniform vec3 layer_gain[N_GAINS];    // of each stored light's diffuse part
uniform vec3 total_weight;
#ifdef SKIN_TABLE
uniform sampler2DArray weight_table; // weights one after the other, four a texel; rows and columns are nodes
uniform sampler2DArray table_row;
#ifdef TABLE_COLUMNS
uniform sampler2DArray table_column;
#endif
#ifdef SKIN_SCATTERS
uniform sampler2DArray scatter_map;
#endif
uniform vec2 table_low;              // nodes are even in the roots: these at the first one, and from it to the last
uniform vec2 table_range;
#endif
uniform float albedo_exponent_after; // theory.md 5.1: 1 - x
uniform sampler2DArray irradiance;
uniform sampler2DArray visibility;
uniform sampler2DArray albedo;
uniform sampler2DArray normal_map;
uniform sampler2DArray roughness_map;
uniform sampler2DArray specular_map;
uniform sampler2DArray oil_albedo;        // rows sqrt(N.V), columns sqrt(m); f0 * red + green
uniform float normal_strength;
uniform float f0;
#ifdef HAS_F0_MAP
uniform sampler2DArray f0_map;
#endif
uniform float strength;

uniform int light_kind[N_LIGHTS];
uniform int light_layer[N_LIGHTS];
uniform vec3 light_at[N_LIGHTS];     // position, or unit vector towards a directional light
uniform vec3 light_axis[N_LIGHTS];
uniform vec2 light_cosines[N_LIGHTS]; // of a spot's outer and inner angle
uniform vec3 light_color[N_LIGHTS];  // irradiance facing it, or intensity; with the light's gain

#ifdef LIGHT_COMES_LATER
uniform sampler2DArray open_sky;  // harmonics Y_0 to Y_8 of the directions that are open, three a layer
uniform sampler2DArray sky_directions;  // a row each: unit vector and part of the sphere; radiance, and 1 if bright
#endif

layout(location = 0) out vec4 radiance;
#ifdef GBUFFER
layout(location = 1) out vec4 out_position;
layout(location = 2) out vec4 out_normal;
layout(location = 3) out vec4 out_tangent;
layout(location = 4) out vec4 out_uv;
#endif

#ifdef SKIN_TABLE
// Weights of the skin at this place, and what they give back of light; as skinbake/profile/weight_table.py, theory.md 4.8
void weigh(out vec3 weight[N_LOBES], out vec3 total)
{
    vec2 value = vec2(texture(table_row, vec3(frag_uv, 0.0)).r, 0.0);
#ifdef TABLE_COLUMNS
    value.y = texture(table_column, vec3(frag_uv, 0.0)).r;
#endif
    vec2 nodes = vec2(textureSize(weight_table, 0).yx);
    vec2 at = clamp((sqrt(max(value, 0.0)) - table_low) / table_range, 0.0, 1.0) * (nodes - 1.0) + 0.5;
    float scatter = 1.0;
#ifdef SKIN_SCATTERS
    scatter = texture(scatter_map, vec3(frag_uv, 0.0)).r;
#endif
    total = vec3(0.0);
    for (int i = 0; i < N_LOBES; ++i)
        weight[i] = scatter * lobe_weight[i];  // light through thin parts, which no table weighs
    float number[4 * TABLE_LAYERS];
    for (int i = 0; i < TABLE_LAYERS; ++i) {
        vec4 four = texture(weight_table, vec3(at.y / nodes.y, at.x / nodes.x, i));
        for (int c = 0; c < 4; ++c)
            number[4 * i + c] = four[c];
    }
    for (int i = 0; i < N_GAUSSIANS; ++i) {
        vec3 here = vec3(number[3 * i], number[3 * i + 1], number[3 * i + 2]);
        total += here;
        weight[i] = scatter * here;
    }
    weight[0] += (1.0 - scatter) * total;
}
#endif

#ifdef HAS_NORMAL_MAP
// Which of the normal map's levels has texels as wide as this pixel is where it is widest
float normal_level()
{
    vec2 size = vec2(textureSize(normal_map, 0).xy);
    vec2 across = dFdx(frag_uv) * size, down = dFdy(frag_uv) * size;
    return clamp(0.5 * log2(max(dot(across, across), dot(down, down)) + 1e-12), 0.0, LAST_NORMAL_LEVEL);
}
#endif

// As skinbake/irradiance/normal_map.py bends it for the diffuse part
vec3 shading_normal(vec3 n, vec3 s)
{
#ifdef HAS_NORMAL_MAP
#ifdef OBJECT_SPACE
    return dot(s, s) > 0.0 ? normalize(s) : n;
#endif
    vec3 t = frag_tangent.xyz;
    if (dot(t, t) < 1e-12 || s.z <= 0.0)
        return n;
    // MikkTSpace: frames as they are interpolated
    vec3 b = cross(frag_normal, t) * (frag_tangent.w < 0.0 ? -1.0 : 1.0);
    n = normalize(s.x * normal_strength * t + s.y * normal_strength * b + s.z * frag_normal);
#endif
    return n;
}

// As skinbake/irradiance/bump_terminator.py, theory.md 10.1; cos_mapped is above 0
float bump_terminator(float cos_mapped, float cos_smooth)
{
    return cos_smooth <= 0.0 ? 0.0 : min(1.0, BUMP_GAIN * cos_smooth / cos_mapped);
}

// A(c, m) for rho_s = 1, theory.md 6.4
float specular_albedo(float c, float m, float f0_here)
{
    vec2 size = vec2(textureSize(oil_albedo, 0).xy);
    vec2 at = sqrt(clamp(vec2(m, c), 0.0, 1.0)) * (size - 1.0) + 0.5;
    vec2 split = texture(oil_albedo, vec3(at / size, 0.0)).rg;
    return f0_here * split.r + split.g;
}

#ifdef HAS_ENVIRONMENT
// 2 int A(c, m) c dc over 0 ... 1, theory.md 6.4, by x = sqrt(c) as the table has it: Gauss-Legendre, 4 x^3 in the weights
float mean_specular_albedo(float m, float f0_here)
{
    const vec2 NODES[5] = vec2[5](vec2(0.0469101, 0.0000489), vec2(0.2307653, 0.0117636), vec2(0.5, 0.1422222),
                                  vec2(0.7692347, 0.4357177), vec2(0.9530899, 0.4102475));
    float sum = 0.0;
    for (int i = 0; i < 5; ++i)
        sum += NODES[i].y * specular_albedo(NODES[i].x * NODES[i].x, m, f0_here);
    return sum;
}
#endif

// A lobe by the variance of the normals that it is seen through
float widened(float m, float variance)
{
    return min(sqrt(m * m + variance), 1.0);
}

// Beckmann's slopes in log form, theory.md 6.7
float beckmann(float sine, float n_dot_h, float m)
{
    float tangent = sine / (n_dot_h * m);
    return exp(-tangent * tangent - 2.0 * log(m) - 4.0 * log(n_dot_h));
}

// Kelemen/Szirmay-Kalos, theory.md 6.7, for rho_s = 1; `second` is the width of another lobe, where there is one
float oil_brdf(vec3 n, vec3 l, vec3 v, float m, float second, float f0_here)
{
    vec3 h = l + v;
    float h_squared = dot(h, h);
    vec3 half_vector = h * inversesqrt(max(h_squared, 1e-12));
    float n_dot_h = dot(n, half_vector);
    if (n_dot_h <= 0.0)
        return 0.0;
    vec3 sine = cross(n, half_vector);  // 1 - (N.H)^2 would be granular for small m
    float grazing = clamp(1.0 - dot(v, half_vector), 0.0, 1.0);
    float squared = grazing * grazing;
    float fresnel = f0_here + (1.0 - f0_here) * squared * squared * grazing;
    float slopes = beckmann(length(sine), n_dot_h, m);
#ifdef SECOND_LOBE
    slopes = mix(slopes, beckmann(length(sine), n_dot_h, second), SECOND_MIX);
#endif
    return fresnel / max(h_squared, HALF_SQUARED_MIN) * slopes;
}

// Unit vector to light i, and in `arriving` what falls on a plane that faces it
vec3 to_light(int i, out vec3 arriving)
{
    arriving = light_color[i];
    if (light_kind[i] == DIRECTIONAL)
        return light_at[i];
    vec3 way = light_at[i] - frag_position;
    float distance_squared = max(dot(way, way), NEAREST_MM * NEAREST_MM);
    vec3 l = way * inversesqrt(distance_squared);
    arriving /= distance_squared;
    float c = -dot(l, light_axis[i]);
    if (light_kind[i] == SPOT)
        arriving *= smoothstep(light_cosines[i].x, light_cosines[i].y, c);
    else if (light_kind[i] == FACET)
        arriving *= max(c, 0.0);
    return l;
}

#ifdef LIGHT_COMES_LATER
// Whether direction l is open, from harmonics up to order 2; pole +y, azimuth from +z towards +x
float is_open(mat3 seen, vec3 l)
{
    vec3 low = vec3(0.282095, 0.488603 * l.x, 0.488603 * l.y);
    vec3 middle = vec3(0.488603 * l.z, 1.092548 * l.x * l.z, 1.092548 * l.x * l.y);
    vec3 high = vec3(0.315392 * (3.0 * l.y * l.y - 1.0), 1.092548 * l.y * l.z, 0.546274 * (l.z * l.z - l.x * l.x));
    return clamp(dot(seen[0], low) + dot(seen[1], middle) + dot(seen[2], high), 0.0, 1.0);
}
#endif

void main()
{
    vec3 smooth_normal = normalize(frag_normal);
    vec4 mapped = vec4(0.0);  // mean of the normals under this pixel, and what they vary about it, theory.md 6.8
    float level = 0.0;
#ifdef HAS_NORMAL_MAP
    level = normal_level();
    mapped = textureLod(normal_map, vec3(frag_uv, 0.0), level);
#endif
    vec3 n = shading_normal(smooth_normal, mapped.xyz);
    vec3 v = normalize(cam_pos - frag_position);
    float flat_m = clamp(texture(roughness_map, vec3(frag_uv, 0.0)).r, ROUGHNESS_MIN, 1.0);
    float m = widened(flat_m, mapped.w);
    float f0_here = f0;
#ifdef HAS_F0_MAP
    f0_here = texture(f0_map, vec3(frag_uv, 0.0)).r;
#endif
    float rho_s = strength * texture(specular_map, vec3(frag_uv, 0.0)).r;
#ifdef NEEDS_OIL_ALBEDO
    float reflected = clamp(rho_s * specular_albedo(dot(n, v), m, f0_here), 0.0, 1.0);
#endif
    vec3 color = vec3(0.0);

#ifdef SHOW_DIFFUSE
    vec3 sum = vec3(0.0);
#ifdef SKIN_TABLE
    vec3 weight[N_LOBES];
    vec3 total;
    weigh(weight, total);
#endif
    for (int layer = 0; layer < N_LAYERS; ++layer) {
#ifdef UNSCATTERED
        sum += layer_gain[layer] * texture(irradiance, vec3(frag_uv, layer)).rgb;
#else
        sum += layer_gain[layer] * (SUM_OF_LOBES);
#endif
    }
ADD_GREY_LAYERS
    vec3 exitance = sum;
#ifdef UNSCATTERED
#ifdef SKIN_TABLE
    exitance *= total * texture(albedo, vec3(frag_uv, 0.0)).rgb;
#else
    exitance *= total_weight * texture(albedo, vec3(frag_uv, 0.0)).rgb;
#endif
#else
#ifdef ALBEDO_AFTER
    exitance *= pow(max(texture(albedo, vec3(frag_uv, 0.0)).rgb, 0.0), vec3(albedo_exponent_after));
#endif
#endif
#ifdef LIGHT_COMES_LATER
    exitance = max(exitance, 0.0);  // the series of a hard light rings below 0
#endif
#ifdef ENERGY_CONSERVATION
    exitance *= 1.0 - reflected;  // theory.md 7.1
#endif
    color += exitance / PI;
#endif

#ifdef SHOW_SPECULAR
    float sharp = widened(SECOND_ROUGHNESS, mapped.w);
#ifdef LIGHT_COMES_LATER
    mat3 seen_sky = mat3(texture(open_sky, vec3(frag_uv, 0.0)).rgb, texture(open_sky, vec3(frag_uv, 1.0)).rgb,
                         texture(open_sky, vec3(frag_uv, 2.0)).rgb);
#endif
#ifdef HAS_ENVIRONMENT
    float mirrored = reflected;
#ifdef ENERGY_CONSERVATION
    mirrored /= max(1.0 - rho_s * mean_specular_albedo(flat_m, f0_here), LEAST_PASSED);  // the bake took that off
#endif
#endif
    for (int i = 0; i < N_LIGHTS; ++i) {
#ifdef HAS_ENVIRONMENT
        if (light_kind[i] == ENVIRONMENT) {
            // As if what arrives came evenly from everywhere
            vec3 arriving = texture(irradiance, vec3(frag_uv, light_layer[i])).rgb;
            color += light_color[i] * arriving / PI * mirrored;
            continue;
        }
#endif
        vec3 arriving;
        vec3 l = to_light(i, arriving);
        float n_dot_l = dot(n, l);
        if (n_dot_l > 0.0) {
#ifdef LIGHT_COMES_LATER
            float seen = is_open(seen_sky, l);
#else
            float seen = texture(visibility, vec3(frag_uv, light_layer[i])).r;
#endif
#ifdef HAS_NORMAL_MAP
            seen *= bump_terminator(n_dot_l, dot(smooth_normal, l));
#endif
            color += arriving * (rho_s * seen * n_dot_l * oil_brdf(n, l, v, m, sharp, f0_here));
        }
    }
#ifdef LIGHT_COMES_LATER
    // As skinbake/preview/mirrored_sky.py says. What a direction stands for widens the lobe, lest few show as dots
    vec3 dim = vec3(0.0), bright = vec3(0.0);
    float dim_weight = 0.0, bright_weight = 0.0;
    for (int i = 0; i < textureSize(sky_directions, 0).y; ++i) {
        vec4 direction = texelFetch(sky_directions, ivec3(0, i, 0), 0);
        vec3 l = direction.xyz;
        float variance = direction.w / (8.0 * PI);
        float width = sqrt(m * m + variance), second = sqrt(sharp * sharp + variance);
#ifdef SECOND_LOBE
        float widest = max(width, second);
#else
        float widest = width;
#endif
        vec3 h = l + v;
        float n_dot_h = dot(n, h), n_dot_l = dot(n, l);
        if (n_dot_l <= 0.0 || n_dot_h * n_dot_h * (1.0 + LOBE_END * widest * widest) < dot(h, h))
            continue;  // beyond e^-LOBE_END of the lobe's top: most directions of a sky are
        float weight = direction.w * n_dot_l * oil_brdf(n, l, v, width, second, f0_here);
        float seen = is_open(seen_sky, l);
#ifdef HAS_NORMAL_MAP
        seen *= bump_terminator(n_dot_l, dot(smooth_normal, l));
#endif
        vec4 sent = texelFetch(sky_directions, ivec3(1, i, 0), 0);
        if (sent.a > 0.5) {
            bright_weight += weight;
            bright += weight * seen * sent.rgb;
        } else {
            dim_weight += weight;
            dim += weight * seen * sent.rgb;
        }
    }
    color += reflected * (dim / max(dim_weight, 1e-20) + bright / max(bright_weight, specular_albedo(dot(n, v), m, f0_here)));
#endif
#endif

    radiance = vec4(color, 1.0);
#ifdef GBUFFER
    out_position = vec4(frag_position, TILE_NUMBER);
    out_normal = vec4(frag_normal, 1.0);
    out_tangent = frag_tangent;
    out_uv = vec4(frag_uv.x, 1.0 - frag_uv.y, level, 1.0);
#endif
}
