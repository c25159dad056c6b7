#version 330 core

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec2 uv;

uniform mat4 V;
uniform mat4 P;

out vec3 frag_position;
out vec3 frag_normal;
out vec4 frag_tangent;
out vec2 frag_uv;

void main()
{
    frag_position = position;
    frag_normal = normal;
    frag_tangent = tangent;
    frag_uv = vec2(uv.x, 1.0 - uv.y);  // row 0 of every texture is v = 1
    gl_Position = P * V * vec4(position, 1.0);
}
