// F_0 + (1 - F_0) (1 - c)^5 (Schlick 1994).
vec3 schlick(float c, vec3 f0) {
  float rest = 1.0 - c;
  float square = rest * rest;
  return f0 + (1.0 - f0) * (square * square * rest);
}
