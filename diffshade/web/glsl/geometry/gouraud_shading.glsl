#include "barycentric.glsl"
#include "vertex_normals.glsl"
// The vertices are shaded, and intensities interpolated over the face (text B).
vec3 shaded(int face, vec3 o, vec3 d) {
  ivec3 k = corners(face);
  vec3 a = vertex(k.x), b = vertex(k.y), c = vertex(k.z);
  vec3 w = barycentric(a, b, c, o, d);
  return w.x * radiance(a, vertex_normal(k.x)) + w.y * radiance(b, vertex_normal(k.y))
       + w.z * radiance(c, vertex_normal(k.z));
}
