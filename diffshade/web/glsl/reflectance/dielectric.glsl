#include "../guard.glsl"
// F = (g - c)^2 / (g + c)^2 / 2 [1 + (c (g + c) - 1)^2 / (c (g - c) + 1)^2], g^2 = index^2 - 1 + c^2
// (Cook and Torrance 1982); 1 where g^2 <= 0: all is reflected.
vec3 dielectric(float c, vec3 index) {
  vec3 beyond = (index - 1.0) * (index + 1.0);
  vec3 square = beyond + c * c;
  vec3 across = root(square) + c;
  across = mix(across, vec3(0.0), lessThan(across, vec3(4.7683716e-7)));  // the root of SHORTEST
  vec3 thin = ratio(beyond, across);
  vec3 s = ratio(thin, across);
  vec3 p = ratio(c * across - 1.0, c * thin + 1.0);
  vec3 part = 0.5 * s * s * (1.0 + p * p);
  vec3 total = vec3(lessThanEqual(square, vec3(0.0))) * vec3(lessThan(beyond, vec3(0.0)));
  return mix(part, vec3(1.0), total);
}
