// SPDX-License-Identifier: Apache-2.0
// The little of WebGL 2 that layers share.

export interface Program {
  readonly handle: WebGLProgram;
  /** Where a uniform is; null where the program does not use it, which WebGL takes as "leave it". */
  at(name: string): WebGLUniformLocation | null;
}

export function compile(gl: WebGL2RenderingContext, vertex: string, fragment: string): Program {
  const handle = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]] as const) {
    const shader = gl.createShader(kind);
    if (!shader) throw new Error("the graphics card is not available");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(handle, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(`a shader does not compile: ${gl.getShaderInfoLog(shader) ?? ""}`);
    }
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`shaders do not link: ${gl.getProgramInfoLog(handle) ?? ""}`);
  }
  const places = new Map<string, WebGLUniformLocation | null>();
  return {
    handle,
    at(name) {
      let place = places.get(name);
      if (place === undefined) places.set(name, (place = gl.getUniformLocation(handle, name)));
      return place;
    },
  };
}

/** A texture whose texels are read one by one, by their number. */
export function texture(gl: WebGL2RenderingContext, target: number): WebGLTexture {
  const made = gl.createTexture();
  gl.bindTexture(target, made);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(target, filter, gl.NEAREST);
  }
  for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
    gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
  }
  return made;
}

/** A texture of one float a texel. */
export function floats(
  gl: WebGL2RenderingContext, width: number, height: number, values: Float32Array,
): WebGLTexture {
  const made = texture(gl, gl.TEXTURE_2D);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32F, width, height);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RED, gl.FLOAT, values);
  return made;
}
