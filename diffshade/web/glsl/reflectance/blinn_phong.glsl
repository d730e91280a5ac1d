#include "power.glsl"
#include "../vector.glsl"
// max(0, n.h)^n with h = (l + v) / |l + v|, 0 where n.l <= 0 (Blinn 1977).
vec3 blinn_phong(vec3 n, vec3 l, vec3 v, float n_dot_l, vec3 shininess) {
  vec3 h = halfway(l, v);
  if (n_dot_l <= 0.0 || h == vec3(0.0)) return vec3(0.0);
  return power_of_one_minus(versine(n, h), shininess);
}
