#include "barycentric.glsl"
#include "vertex_normals.glsl"
#include "../vector.glsl"
// Every pixel is shaded, with the interpolated and renormalised normal (text B).
vec3 shaded(int face, vec3 o, vec3 d) {
  ivec3 k = corners(face);
  vec3 a = vertex(k.x), b = vertex(k.y), c = vertex(k.z);
  vec3 w = barycentric(a, b, c, o, d);
  vec3 n = w.x * vertex_normal(k.x) + w.y * vertex_normal(k.y) + w.z * vertex_normal(k.z);
  return radiance(w.x * a + w.y * b + w.z * c, direction(n));
}
