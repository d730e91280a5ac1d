#include "../vector.glsl"
// Under what angles the facets that mirror l to v are seen: microfacets, s = D F G / (4 n.v)
// (Torrance and Sparrow 1967; Cook and Torrance 1982; Walter et al. 2007, 20).
struct Facets {
  float versine;  // 1 - n.h
  float n_dot_l;  // 0 where there are none
  float n_dot_v;
  float h_dot_l;
};

Facets facets_between(vec3 n, vec3 l, vec3 v, float n_dot_l) {
  vec3 h = halfway(l, v);
  float n_dot_v = dot(n, v);
  bool dark = n_dot_l <= 0.0 || n_dot_v <= 0.0 || h == vec3(0.0);
  return Facets(
    min(versine(n, h), 1.0),
    dark ? 0.0 : n_dot_l,
    dark ? 1.0 : n_dot_v,
    max(dot(h, l), 0.0)
  );
}
