#include "beckmann.glsl"
// erfc(x) for x >= 0, to 1.2e-7 of it (Numerical Recipes, erfcc: a Chebyshev fit).
float erfc(float x) {
  float t = 1.0 / (1.0 + 0.5 * x);
  float fit = -0.82215223 + t * 0.17087277;
  fit = -1.13520398 + t * (1.48851587 + t * fit);
  fit = 0.09678418 + t * (-0.18628806 + t * (0.27886807 + t * fit));
  fit = -1.26551223 + t * (1.00002368 + t * (0.37409196 + t * fit));
  return t * exp(-x * x + fit);
}

// A = c (erf(t) - 1) / 2 + alpha s exp(-t^2) / (2 sqrt(pi)), s^2 = 1 - c^2 (Walter et al. 2007, 26).
float beckmann_shadow(float c, float alpha) {
  float width = alpha * root(1.0 - c * c);
  float t = steepness(c, width);
  return 0.5 * (width * exp(-t * t) / 1.77245385 - c * erfc(t));
}

vec3 beckmann_shadow(float c, vec3 alpha) {
  return vec3(beckmann_shadow(c, alpha.r), beckmann_shadow(c, alpha.g), beckmann_shadow(c, alpha.b));
}
