#include "power.glsl"
#include "../vector.glsl"
// max(0, r.v)^n with r = 2 (n.l) n - l, 0 where n.l <= 0 (Phong 1975; LIGHT-5, 6, 10).
vec3 phong(vec3 n, vec3 l, vec3 v, float n_dot_l, vec3 shininess) {
  if (n_dot_l <= 0.0 || v == vec3(0.0)) return vec3(0.0);
  return power_of_one_minus(versine(mirrored(l, n), v), shininess);
}
