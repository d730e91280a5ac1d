#include "dielectric.glsl"
// T(n.l) T(n.v), T = 1 - F: what passes the boundary into the body and out again.
vec3 passed(float n_dot_l, float n_dot_v, vec3 index) {
  return (1.0 - dielectric(n_dot_l, index)) * (1.0 - dielectric(n_dot_v, index));
}
