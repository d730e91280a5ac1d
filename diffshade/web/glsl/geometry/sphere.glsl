#include "../guard.glsl"
// |P| = radius (LIGHT-14), about the origin.
uniform float radius;

// LIGHT-15: z = sqrt(r^2 - dx^2 - dy^2), back along the ray from its closest point to the centre.
vec3 shaded(int face, vec3 o, vec3 d) {
  vec3 near = o - d * dot(o, d);
  vec3 across = near - d * dot(near, d);
  vec3 n = (across - d * root(radius * radius - dot(across, across))) / radius;
  return radiance(n * radius, n);
}
