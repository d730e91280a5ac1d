// Powers of cosines close to 1, without what rounding takes of them.

// log(1 - q), by its series where it is small.
float log_one_minus(float q) {
  if (q > 0.0625) return log(1.0 - q);
  return -q * (1.0 + q * (1.0 / 2.0 + q * (1.0 / 3.0 + q * (1.0 / 4.0 + q * (1.0 / 5.0 + q / 6.0)))));
}

// (1 - q)^n; 0 where the cosine 1 - q is not above 0.
vec3 power_of_one_minus(float q, vec3 n) {
  return q >= 1.0 ? vec3(0.0) : exp(n * log_one_minus(q));
}
