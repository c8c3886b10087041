// The drawn picture: subjects with their layers, in one or several parts of the canvas.

class Picture {
  constructor(canvas, description, bytes) {
    const gl = canvas.getContext("webgl2", { antialias: true });
    if (!gl) throw new Error("This browser cannot draw in 3D (WebGL 2 is off).");
    this.gl = gl;
    this.canvas = canvas;
    this.surface = compiled(gl, SURFACE_VERTEX, SURFACE_FRAGMENT);
    this.depth = compiled(gl, DEPTH_VERTEX, DEPTH_FRAGMENT);
    this.floor = compiled(gl, FLOOR_VERTEX, FLOOR_FRAGMENT);
    this.nothing = gl.createVertexArray();
    this.through = false;
    this.adopt(description, bytes);
    this.makeShadows();
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
  }

  // Show a scene; what was hidden stays so.
  adopt(description, bytes) {
    const gl = this.gl, before = this.subjects || [];
    const shownBefore = new Map(before.flatMap(({ layers }) => layers.map((layer) => [layer.name, layer.shown])));
    for (const part of before.flatMap(({ layers }) => layers.flatMap((layer) => layer.parts))) part.instances.free();
    this.subjects = description.subjects.map((subject, index) => ({
      ...subject,
      shown: before[index] ? before[index].shown : true,
      human: subject.layers.some((layer) => layer.name === "human"),
      centre: new Track(bytes, subject.centre),
      looks: new Map(Object.entries(subject.looks).map(([name, path]) => [name, new Track(bytes, path)])),
      layers: subject.layers.map((layer) => ({
        ...layer,
        shown: shownBefore.has(layer.name) ? shownBefore.get(layer.name) : layer.shown,
        solid: layer.opacity,
        parts: layer.parts.map((part) => new Part(gl, bytes, part)),
      })),
    }));
    this.reaches = Object.fromEntries(
      ["floor", "each"].map((name) => [name, Math.max(...description.camera[name].reaches.flat())]),
    );
    this.seeThrough(this.through);
  }

  // Return the layers that draw something, by their names.
  layers() {
    const named = new Map();
    for (const layer of this.subjects.flatMap((subject) => subject.layers))
      if (layer.parts.length) named.set(layer.name, [...(named.get(layer.name) || []), layer]);
    return named;
  }

  showLayer(name, on) {
    for (const layer of this.subjects.flatMap((subject) => subject.layers)) if (layer.name === name) layer.shown = on;
  }

  makeShadows() {
    const gl = this.gl;
    this.shadows = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shadows);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_SIZE, SHADOW_SIZE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    this.shadowFrame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadows, 0);
  }

  // Return the parts of the canvas and who stands where in each: all on one floor, each alone, or over each other.
  views(arrangement) {
    const shown = this.subjects.filter((subject) => subject.shown);
    const { width, height } = this.canvas;
    if (arrangement !== "beside" || shown.length < 2) {
      const figures = shown.map((subject) => this.figure(subject, arrangement, shown));
      return [{ x: 0, y: 0, width, height, figures }];
    }
    const nearness = (columns) => Math.min((1.3 * width) / columns, height / Math.ceil(shown.length / columns));
    const counts = shown.map((_, i) => i + 1);
    const columns = counts.reduce((best, count) => (nearness(count) > nearness(best) ? count : best), 1);
    const rows = Math.ceil(shown.length / columns);
    const edge = (share, size) => Math.round(share * size);
    return shown.map((subject, i) => {
      const row = Math.floor(i / columns), column = i % columns;
      const x = edge(column / columns, width), y = edge(row / rows, height);
      return {
        ...{ x, y, width: edge((column + 1) / columns, width) - x, height: edge((row + 1) / rows, height) - y },
        figures: [this.figure(subject, arrangement, shown)],
      };
    });
  }

  figure(subject, arrangement, shown) {
    const still = { subject, shift: [0, 0, 0], scale: 1, opacity: 1 };
    if (arrangement === "floor") return { ...still, shift: subject.shift };
    if (arrangement !== "over") return still;
    const robots = shown.filter((other) => !other.human);
    const opacity = subject === (robots[0] || shown[0]) ? 1 : subject.human ? 0.4 : 0.5;
    return { ...still, opacity, scale: robots.length ? subject.scale : 1 };
  }

  // Return the point that a camera follows in a view.
  centre({ figures }, second) {
    const middle = [0, 0, 0];
    for (const { subject, shift, scale } of figures) {
      const at = subject.centre.at(second * subject.fps);
      for (let i = 0; i < 3; i++) middle[i] += (shift[i] + scale * at[i]) / figures.length;
    }
    return middle;
  }

  // Return where what is looked at from near is in a view, by its name; robots before humans.
  look({ figures }, name, second) {
    const with_it = figures.filter(({ subject }) => subject.looks.has(name));
    const figure = with_it.find(({ subject }) => !subject.human) || with_it[0];
    if (!figure) return null;
    const at = figure.subject.looks.get(name).at(second * figure.subject.fps);
    return figure.shift.map((x, i) => x + figure.scale * at[i]);
  }

  seeThrough(on) {
    this.through = on;
    for (const subject of this.subjects)
      for (const layer of subject.layers) layer.opacity = on && layer.through ? layer.through : layer.solid;
  }

  show(second) {
    for (const subject of this.subjects.filter((item) => item.shown))
      for (const layer of subject.layers)
        if (layer.shown) for (const part of layer.parts) part.show(second * subject.fps);
  }

  // Draw one view; `middle` is what its light falls on.
  draw(view, [eye, target], middle, reach) {
    const gl = this.gl;
    const drawn = view.figures.flatMap((figure) =>
      figure.subject.layers
        // Laid over the robot's, the human's own objects would only hide them.
        .filter((layer) => layer.shown && !(figure.opacity < 1 && layer.name === "human's object"))
        .map((layer) => ({ layer, figure, opacity: figure.opacity * layer.opacity })),
    );
    const opaque = drawn.filter(({ opacity }) => opacity >= 1), ghosts = drawn.filter(({ opacity }) => opacity < 1);
    const half = reach + 1.5;
    const above = middle.map((x, i) => x + 3 * half * SUN[i]);
    const sunView = product(orthographic(half, half, 6 * half), lookAt(above, middle));

    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.viewport(0, 0, SHADOW_SIZE, SHADOW_SIZE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 4);
    this.drawDepth(opaque, sunView);
    gl.disable(gl.POLYGON_OFFSET_FILL);

    const { width, height } = view;
    const away = Math.hypot(...eye.map((x, i) => x - target[i]));
    const seen = product(perspective(width / height, 0.02 * away, 20 * away + 60), lookAt(eye, target));
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const below = this.canvas.height - view.y - height; // Counted from the bottom.
    gl.viewport(view.x, below, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(view.x, below, width, height);
    gl.clearColor(...BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);

    const light = ({ program, uniforms }) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(uniforms.view, false, seen);
      gl.uniformMatrix4fv(uniforms.sun_view, false, sunView);
      gl.uniform1i(uniforms.shadows, 0);
      return uniforms;
    };
    const ground = light(this.floor);
    gl.uniform2f(ground.middle, target[0], target[1]);
    gl.uniform1f(ground.extent, 6 + 2.5 * away);
    gl.uniform3f(ground.background, ...BACKGROUND);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);

    const surfaces = (group) => {
      const uniforms = light(this.surface);
      gl.uniform3f(uniforms.sun, ...SUN);
      gl.uniform3f(uniforms.eye, ...eye);
      for (const item of group) {
        gl.uniform1f(uniforms.opacity, item.opacity);
        this.drawLayer(item, uniforms);
      }
    };
    surfaces(opaque);
    for (const ghost of ghosts) {
      // Only what is nearest of a ghost is seen, not what is inside of it.
      gl.colorMask(false, false, false, false);
      this.drawDepth([ghost], seen);
      gl.colorMask(true, true, true, true);
      gl.enable(gl.BLEND);
      surfaces([ghost]);
      gl.disable(gl.BLEND);
    }
    gl.disable(gl.SCISSOR_TEST);
    return seen;
  }

  drawDepth(items, view) {
    const gl = this.gl, { program, uniforms } = this.depth;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.view, false, view);
    for (const item of items) this.drawLayer(item, uniforms);
  }

  drawLayer({ layer, figure }, uniforms) {
    this.gl.uniform4f(uniforms.pane, ...figure.shift, figure.scale);
    for (const part of layer.parts) part.instances.draw();
  }
}
