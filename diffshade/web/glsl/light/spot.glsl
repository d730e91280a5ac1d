// max(0, cos)^e, the angle between the ray and the direction in which the light shines (Warn 1983).
float shining(float cosine, float exponent) {
  return cosine <= 2.9802322e-8 ? 0.0 : exp(exponent * log(cosine));
}
