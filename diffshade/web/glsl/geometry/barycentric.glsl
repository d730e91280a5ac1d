#include "mesh.glsl"
// Where the ray o + t d crosses the plane of a triangle (Moeller and Trumbore 1997): the weights of b
// and c are s.(d x e2) / det and d.(s x e1) / det, s = o - a, det = e1.(d x e2). The pixel sees this
// triangle: what rounding takes past an edge is put on it.
vec3 barycentric(vec3 a, vec3 b, vec3 c, vec3 o, vec3 d) {
  vec3 s = o - a, e1 = b - a, e2 = c - a;
  vec3 w = vec3(0.0, dot(s, cross(d, e2)), dot(d, cross(s, e1))) / dot(e1, cross(d, e2));
  w = max(vec3(1.0 - w.y - w.z, w.yz), 0.0);
  return w / (w.x + w.y + w.z);
}
