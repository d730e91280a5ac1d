#include "../guard.glsl"
// G / (4 n.v), G = 1 / (1 + Lambda(n.l) + Lambda(n.v)) (Heitz 2014, 99); of_l and of_v are A there.
vec3 height_correlated(Facets seen, vec3 of_l, vec3 of_v) {
  float n_dot_l = seen.n_dot_l, n_dot_v = seen.n_dot_v;
  return 0.25 * ratio(vec3(n_dot_l), n_dot_l * (n_dot_v + of_v) + n_dot_v * of_l);
}
