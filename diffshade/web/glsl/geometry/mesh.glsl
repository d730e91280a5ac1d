// Triangles: three numbers of vertices a face, and where these are.
uniform highp isampler2D faces;
uniform highp sampler2D vertices;

ivec2 place(int number, int width) {
  return ivec2(number % width, number / width);
}

vec3 vertex(int number) {
  return texelFetch(vertices, place(number, textureSize(vertices, 0).x), 0).xyz;
}

ivec3 corners(int face) {
  return texelFetch(faces, place(face, textureSize(faces, 0).x), 0).xyz;
}
