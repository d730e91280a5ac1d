// 1 inside the cone, 0 beyond its angle.
float inside(float cosine, float cutoff) {
  return cosine < cos(min(cutoff, 1.57079633)) ? 0.0 : 1.0;
}
