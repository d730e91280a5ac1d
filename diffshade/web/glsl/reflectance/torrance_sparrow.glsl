#include "../guard.glsl"
// D = exp(-(theta / alpha)^2) / (pi alpha^2), theta the angle between h and n (Torrance, Sparrow 1967).

// theta^2 = 2 sum over k of (2 q)^k / (k^2 (2k over k)), q = 1 - cos theta in [0, 1]: arcsin's series.
float squared_angle(float q) {
  float term = q, sum = 0.0;
  for (float k = 1.0; k < 20.0; k += 1.0) {
    sum += term;
    term *= q * k * k / ((k + 1.0) * (2.0 * k + 1.0));
  }
  return 2.0 * sum;
}

vec3 torrance_sparrow(Facets seen, vec3 alpha) {
  vec3 scale = ratio(vec3(1.0), alpha);
  return exp(-squared_angle(seen.versine) * scale * scale) * scale * scale / 3.14159265;
}
