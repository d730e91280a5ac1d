// f(d) = 1 / (c0 + c1 d).
float linear(float d, float c0, float c1) {
  float whole = c0 + c1 * d;
  return whole < 4e-29 ? 0.0 : 1.0 / whole;
}
