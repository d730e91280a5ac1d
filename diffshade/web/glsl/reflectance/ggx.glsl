#include "../guard.glsl"
// D = alpha^2 / (pi (alpha^2 cos^2 + sin^2)^2) (Trowbridge and Reitz 1975, Walter et al. 2007, 33).
vec3 ggx(Facets seen, vec3 alpha) {
  float q = seen.versine;
  vec3 width = alpha * (1.0 - q);
  vec3 across = ratio(alpha, width * width + q * (2.0 - q));
  return across * across / 3.14159265;
}

// A = (sqrt(c^2 + alpha^2 (1 - c^2)) - c) / 2: c Lambda(c) of Smith's masking (Walter et al. 2007, 34).
vec3 ggx_shadow(float c, vec3 alpha) {
  vec3 width = alpha * alpha * (1.0 - c * c);
  return 0.5 * ratio(width, root(c * c + width) + c);
}
