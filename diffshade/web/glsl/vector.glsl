#include "guard.glsl"
// Directions, as diffshade/vector.py has them: all are unit vectors that point away from the surface.

// a / |a|; zero for a vector that has no direction.
vec3 direction(vec3 a) {
  float square = dot(a, a);
  return square <= SHORTEST ? vec3(0.0) : a * inversesqrt(square);
}

// 1 - a.b = |a - b|^2 / 2 of unit vectors, which loses nothing where they meet.
float versine(vec3 a, vec3 b) {
  vec3 between = a - b;
  return 0.5 * dot(between, between);
}

// Halfway between l and v (Blinn 1977); zero where l = -v, to the rounding of both.
vec3 halfway(vec3 l, vec3 v) {
  vec3 h = l + v;
  return dot(h, h) < 1.1920929e-7 ? vec3(0.0) : direction(h);
}

// r = 2 (n.l) n - l (LIGHT-10).
vec3 mirrored(vec3 l, vec3 n) {
  return 2.0 * dot(n, l) * n - l;
}
