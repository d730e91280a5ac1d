#include "../guard.glsl"
// D = exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4) (Beckmann 1963, Cook and Torrance 1982).
vec3 beckmann(Facets seen, vec3 alpha) {
  float q = seen.versine;
  float cosine2 = (1.0 - q) * (1.0 - q);
  vec3 scale = ratio(vec3(1.0), alpha * cosine2);
  return exp(-q * (2.0 - q) * cosine2 * scale * scale) * scale * scale / 3.14159265;
}

// t = 1 / (alpha tan theta), beyond 12 of which no facet hides another.
float steepness(float c, float width) {
  return c / max(width, c / 12.0);
}
