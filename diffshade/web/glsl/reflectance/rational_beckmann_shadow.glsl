#include "beckmann.glsl"
// A = alpha s (1 - 1.259 t + 0.396 t^2) / (3.535 + 2.181 t), 0 from t = 1.6 on (Walter et al. 2007, 27).
float rational_beckmann_shadow(float c, float alpha) {
  float width = alpha * root(1.0 - c * c);
  float t = steepness(c, width);
  if (t >= 1.6) return 0.0;
  return width * (1.0 + t * (0.396 * t - 1.259)) / (3.535 + 2.181 * t);
}

vec3 rational_beckmann_shadow(float c, vec3 a) {
  return vec3(
    rational_beckmann_shadow(c, a.r), rational_beckmann_shadow(c, a.g), rational_beckmann_shadow(c, a.b)
  );
}
