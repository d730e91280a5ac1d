// f(d) = min(1 / (c0 + c1 d + c2 d^2), 1) (LIGHT-12).
float quadratic(float d, float c0, float c1, float c2) {
  return 1.0 / max(c0 + d * (c1 + d * c2), 1.0);
}
