#include "../guard.glsl"
// G / (4 n.v), G = G_1(n.l) G_1(n.v), G_1(c) = c / (c + A(c)) (Walter et al. 2007, 23).
vec3 separable(Facets seen, vec3 of_l, vec3 of_v) {
  float n_dot_l = seen.n_dot_l, n_dot_v = seen.n_dot_v;
  return 0.25 * ratio(vec3(n_dot_l), n_dot_l + of_l) * ratio(vec3(1.0), n_dot_v + of_v);
}
