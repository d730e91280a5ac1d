// The picture: one triangle over the canvas, whose fragment shader is the illumination equation.

const TRIANGLE = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

const canvas = document.getElementById("picture");

class Picture {
  constructor(arrays) {
    this.arrays = arrays;
    const options = { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true };
    this.gl = canvas.getContext("webgl2", options);
    if (!this.gl) throw new Error("This browser has no WebGL 2, or has it switched off, so there is no picture.");
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.build());
    this.build();
  }

  static async from(textures) {
    return new Picture(await Promise.all(textures.map(unpacked)));
  }

  build() {
    const gl = this.gl;
    const largest = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    for (const { width, height } of data.surface.textures) {
      if (Math.max(width, height) > largest) {
        throw new Error(`The picture needs ${width} × ${height} texels, and this browser has ${largest} a side.`);
      }
    }
    const program = gl.createProgram();
    gl.attachShader(program, this.compiled(gl.VERTEX_SHADER, TRIANGLE));
    gl.attachShader(program, this.compiled(gl.FRAGMENT_SHADER, data.shader));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.disable(gl.DITHER);
    this.place = (name) => gl.getUniformLocation(program, name);
    data.surface.textures.forEach((texture, unit) => this.upload(texture, unit));
    for (const [name, value] of Object.entries(data.surface.camera)) this.put(name, [value].flat());
    this.put("radius", [data.surface.radius]);
    this.draw();
  }

  compiled(type, source) {
    const gl = this.gl;
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    return shader;
  }

  upload({ name, width, height, format }, unit) {
    const gl = this.gl;
    const [layout, type] = {
      R32I: [gl.RED_INTEGER, gl.INT],
      RGB32I: [gl.RGB_INTEGER, gl.INT],
      RGB32F: [gl.RGB, gl.FLOAT],
    }[format];
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl[format], width, height, 0, layout, type, this.arrays[unit]);
    gl.uniform1i(this.place(name), unit);
  }

  put(uniform, numbers) {
    this.gl[`uniform${numbers.length}fv`](this.place(uniform), numbers);
  }

  draw() {
    for (const one of parameters.values()) this.put(one.uniform, inShader(one, values.get(one.name)));
    this.gl.drawArrays(this.gl.TRIANGLES, 0, 3);
  }
}

// A value as the shader has it: one a channel, positions from the middle of the surface, directions of length 1.
function inShader(one, numbers) {
  if (one.kind === "position") return minus(numbers, data.surface.origin);
  if (one.kind === "direction") return unit(numbers);
  if (one.kind === "channels" && numbers.length === 1) return [numbers[0], numbers[0], numbers[0]];
  return numbers;
}

async function unpacked(texture) {
  const bytes = Uint8Array.from(atob(texture.data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  return texture.format.endsWith("F") ? new Float32Array(buffer) : new Int32Array(buffer);
}
