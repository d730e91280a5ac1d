// max(0, n.l): the cosine of the angle of incidence (LIGHT-4).
float lambert(float n_dot_l) {
  return max(n_dot_l, 0.0);
}
