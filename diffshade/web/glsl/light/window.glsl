// w(d) = max(0, 1 - (d / R)^4)^2 (Karis 2013).
float window(float d, float reach) {
  if (d >= reach) return 0.0;
  float square = (d / reach) * (d / reach);
  return (1.0 - square * square) * (1.0 - square * square);
}
