#include "mesh.glsl"
// Every face is shaded at its centroid, with its plane's normal (text B).
vec3 shaded(int face, vec3 o, vec3 d) {
  ivec3 k = corners(face);
  vec3 a = vertex(k.x), b = vertex(k.y), c = vertex(k.z);
  return radiance((a + b + c) / 3.0, normalize(cross(normalize(b - a), normalize(c - a))));
}
