// Vectors of three numbers.

const plus = (a, b) => a.map((x, k) => x + b[k]);
const minus = (a, b) => a.map((x, k) => x - b[k]);
const times = (a, s) => a.map((x) => x * s);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const size = (a) => Math.hypot(...a);
const unit = (a) => (size(a) > 0 ? times(a, 1 / size(a)) : a);
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

// A vector turned about a unit axis (Rodrigues).
function turned(a, axis, angle) {
  const c = Math.cos(angle);
  const across = times(cross(axis, a), Math.sin(angle));
  return plus(plus(times(a, c), across), times(axis, dot(axis, a) * (1 - c)));
}
