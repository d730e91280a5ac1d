// The singularities of the equations, as diffshade/guard.py guards them, in float32.

const float SHORTEST = 2.2737368e-13;  // the cube root of the smallest normal number
const float LEAST_ROOT = 1.0842022e-19;  // its square root

// part / whole; 0 where the whole is no more than SHORTEST: no colour, no share.
float ratio(float part, float whole) {
  return abs(whole) <= SHORTEST ? 0.0 : part / whole;
}

vec3 ratio(vec3 part, vec3 whole) {
  return vec3(ratio(part.r, whole.r), ratio(part.g, whole.g), ratio(part.b, whole.b));
}

// sqrt(x) of what is above 0.
float root(float x) {
  return x <= LEAST_ROOT ? 0.0 : sqrt(x);
}

vec3 root(vec3 x) {
  return vec3(root(x.r), root(x.g), root(x.b));
}
