// The transfer curve of sRGB (IEC 61966-2-1) and the nearest of 8 bits, as `render` writes a .png.

vec3 to_srgb(vec3 linear) {
  vec3 l = clamp(linear, 0.0, 1.0);
  vec3 power = 1.055 * pow(max(l, 0.0031308), vec3(1.0 / 2.4)) - 0.055;
  return mix(power, 12.92 * l, lessThanEqual(l, vec3(0.0031308)));
}

vec3 display(vec3 linear) {
  return floor(255.0 * to_srgb(linear) + 0.5) / 255.0;
}
