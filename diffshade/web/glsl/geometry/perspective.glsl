#include "../vector.glsl"
// Rays from an eye through a plane that lies near the object, where rounding is least.
uniform vec3 middle, across, upwards, eye;

void ray(vec2 at, out vec3 o, out vec3 d) {
  o = middle + at.x * across + at.y * upwards;
  d = direction(o - eye);
}

vec3 towards_viewer(vec3 p) {
  return direction(eye - p);
}
