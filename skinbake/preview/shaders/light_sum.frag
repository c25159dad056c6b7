#version 330 core
// Sum over the lights of one lobe, texel by texel. Bilinear reading is linear, so folding first changes nothing.

uniform sampler2DArray lobe;
uniform vec3 layer_gain[N_GAINS];

layout(location = 0) out vec4 folded;

void main()
{
    vec3 sum = vec3(0.0);
    for (int layer = 0; layer < N_LAYERS; ++layer)
        sum += layer_gain[layer] * texelFetch(lobe, ivec3(gl_FragCoord.xy, layer), 0).rgb;
ADD_GREY_LAYERS
    folded = vec4(sum, 1.0);
}
