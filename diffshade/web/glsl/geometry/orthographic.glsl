// Parallel rays: a point that a pixel's ray goes through, its direction, and v (LIGHT-7).
uniform vec3 middle, across, upwards, back;

void ray(vec2 at, out vec3 o, out vec3 d) {
  o = middle + at.x * across + at.y * upwards;
  d = -back;
}

vec3 towards_viewer(vec3 p) {
  return back;
}
