#include "../guard.glsl"
// The reflectance of a metal of index of refraction `index` + i `extinction` (Born and Wolf, 14.2), as
// diffshade/reflectance/fresnel.py writes it out.
float conductor(float c, float index, float extinction) {
  float s2 = 1.0 - c * c;
  float x = index * index - extinction * extinction - s2;
  float y = 2.0 * index * extinction;
  float size = root(x * x + y * y);
  float twice = x > 0.0 ? size + x : y * ratio(y, size - x);
  float crossed = 2.0 * root(0.5 * twice) * c;
  float s = ratio(size + c * c - crossed, size + c * c + crossed);
  float parallel = c * c * size + s2 * s2;
  float p = ratio(parallel - crossed * s2, parallel + crossed * s2);
  return 0.5 * s * (1.0 + p);
}

vec3 conductor(float c, vec3 index, vec3 k) {
  return vec3(
    conductor(c, index.r, k.r), conductor(c, index.g, k.g), conductor(c, index.b, k.b)
  );
}
