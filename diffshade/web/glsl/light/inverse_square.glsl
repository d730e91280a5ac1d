// f(d) = 1 / d^2; 0 at d = 0.
float inverse_square(float d) {
  return d == 0.0 ? 0.0 : (1.0 / d) * (1.0 / d);
}
