#include "../guard.glsl"
// G / (4 n.v), G = min(1, 2 (n.h)(n.v) / v.h, 2 (n.h)(n.l) / v.h) (Torrance and Sparrow 1967).
vec3 v_groove(Facets seen) {
  float slope = ratio(2.0 * (1.0 - seen.versine), seen.h_dot_l);
  float lit = min(slope * seen.n_dot_l, 1.0);
  return vec3(0.25 * (slope * seen.n_dot_v < lit ? slope : ratio(lit, seen.n_dot_v)));
}
