"use strict";
// Textures of the model on the card: each is loaded when it is first looked at, and grey until it is there.

class Textures {
  constructor(gl, pictures, changed) {
    Object.assign(this, { gl, pictures, changed, made: new Map(), waiting: 0 });
  }
  bind(unit, number, kind) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.of(number, kind));
  }
  of(number, kind) {
    const name = `${number}-${kind}`;
    if (!this.made.has(name)) {
      this.made.set(name, this.filled(new Uint8Array([128, 128, kind === "relief" ? 255 : 128, 255])));
      this.load(name, this.pictures[number][kind]);
    }
    return this.made.get(name);
  }
  load(name, uri) {
    const image = new Image();
    this.waiting += 1;
    image.onload = () => {
      this.gl.deleteTexture(this.made.get(name));
      this.made.set(name, this.filled(image));
      this.waiting -= 1;
      this.changed();
    };
    image.src = uri;
  }
  filled(from) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    if (from instanceof Image) {
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, from);
      gl.generateMipmap(gl.TEXTURE_2D);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    } else {
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, from);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    }
    for (const edge of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, edge, gl.CLAMP_TO_EDGE);
    return texture;
  }
}
