#include "mesh.glsl"
uniform highp sampler2D normals;

vec3 vertex_normal(int number) {
  return texelFetch(normals, place(number, textureSize(normals, 0).x), 0).xyz;
}
