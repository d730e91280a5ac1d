// f(d) = exp(-a d).
float exponential(float d, float a) {
  return exp(-a * d);
}
