"use strict";
// Draws what a bake left with the preview's own shaders: nothing is blurred here, lobes are added up.
(() => {
  const bake = JSON.parse(document.getElementById("bake").textContent);
  const canvas = document.getElementById("picture");
  const note = document.getElementById("note");
  const $ = (id) => document.getElementById(id);
  const HEADER = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"
    + "precision highp sampler2DArray;\n";
  // Means of the points that a pixel was drawn with
  const RESOLVE = HEADER + `uniform sampler2D frame; uniform float side; layout(location = 0) out vec4 mean;
    vec4 at(ivec2 place) { return texelFetch(frame, clamp(place, ivec2(0), textureSize(frame, 0) - 1), 0); }
    void main() {
      if (side < 1.0) {  // a coarse frame, between its points
        vec2 place = gl_FragCoord.xy * side - 0.5, part = fract(place);
        ivec2 low = ivec2(floor(place));
        mean = mix(mix(at(low), at(low + ivec2(1, 0)), part.x), mix(at(low + ivec2(0, 1)), at(low + 1), part.x), part.y);
        return;
      }
      int count = int(side);
      vec4 sum = vec4(0.0);
      for (int y = 0; y < count; ++y) for (int x = 0; x < count; ++x)
        sum += at(ivec2(gl_FragCoord.xy) * count + ivec2(x, y));
      mean = sum / float(count * count);
    }`;
  const SLOW_MS = 60, QUICK_MS = 12, COARSEST = 0.25, PAUSE_MS = 160;

  const state = {
    mode: "full", other: "none", split: false, at: 0.5, exposure: bake.exposure,
    gains: bake.lights.map(() => 1), tints: bake.lights.map(() => "#ffffff"), camera: null,
    turn: 0, skin: "",  // the bake's own, or the name of another on its lobes
  };
  let said = "", gl = null, programs = {}, tiles = [], empty = null, targets = {}, ready = false, later = 0, wanted = 0;
  let drawing = null, changed = false, points = 1;  // frame that the driver is at; what it does not show; points a pixel's side
  let skies = null;  // promise of the textures that skies are made of, which are read once one is asked for

  // --- bytes -----------------------------------------------------------------------------------------------------

  const bytesOf = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));

  async function inflated(base64) {
    const stream = new Blob([bytesOf(base64)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).arrayBuffer();
  }

  const scratch = new DataView(new ArrayBuffer(4));
  function half(value) {  // to binary16, rounded to nearest; what is smaller than its least normal is kept as a subnormal
    scratch.setFloat32(0, value);
    const bits = scratch.getUint32(0), sign = (bits >>> 16) & 0x8000, exponent = ((bits >>> 23) & 255) - 112;
    const fraction = bits & 0x7fffff;
    if (exponent >= 31) return sign | 0x7bff;
    if (exponent <= 0) {
      if (exponent < -10) return sign;
      const shift = 14 - exponent;
      return sign | (((fraction | 0x800000) + (1 << (shift - 1))) >>> shift);
    }
    return sign | (((exponent << 23) | fraction) + 0x1000) >>> 13;
  }

  // Values of the 256 bytes of a channel as halves: squares where light is stored, else a straight line
  function decoder(coding, low, high) {
    return Uint16Array.from({ length: 256 }, (_, i) => {
      const x = i / 255;
      return half(coding === "sqrt" ? high * x * x : low + (high - low) * x);
    });
  }

  async function pixelsOf(image) {
    const bitmap = await createImageBitmap(
      new Blob([bytesOf(image.data)], { type: "image/webp" }), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    const page = document.createElement("canvas");
    page.width = bitmap.width;
    page.height = bitmap.height;
    const context = page.getContext("2d", { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, page.width, page.height).data;
  }

  // --- OpenGL ----------------------------------------------------------------------------------------------------

  function written(text, defines) {  // switches are asked for by #ifdef, other symbols are replaced
    const flags = Object.keys(defines).filter((name) => bake.switches.includes(name));
    let out = text.replace("#version 330 core", "");
    for (const [name, value] of Object.entries(defines)) if (!flags.includes(name)) out = out.replace(new RegExp(`\\b${name}\\b`, "g"), () => value);
    return HEADER + flags.map((name) => `#define ${name} 1\n`).join("") + out;
  }

  function compiled(vertex, fragment) {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
        throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(gl.getProgramInfoLog(program));
    const places = {};
    return { program, place: (name) => (name in places ? places[name] : (places[name] = gl.getUniformLocation(program, name))) };
  }

  function skinProgram(tile, mode) {
    if (skyOf(mode)) mode = "sky";
    const key = `${tile.number}:${mode}`;
    if (!programs[key])
      programs[key] = compiled(written(bake.shaders.skin_vert, {}), written(bake.shaders.skin_frag, tile.defines[mode]));
    return programs[key];
  }

  function sampler(kind, filter) {
    const texture = gl.createTexture();
    gl.bindTexture(kind, texture);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, filter], [gl.TEXTURE_MAG_FILTER, filter],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(kind, name, value);
    return texture;
  }

  async function arrayTexture(layers) {
    const { width, height, channels } = layers[0];
    const planes = [];
    for (const image of layers) {
      if (image.coding === "half") { planes.push(new Uint16Array(bytesOf(image.data).buffer)); continue; }
      const bytes = await pixelsOf(image);
      const tables = [0, 1, 2].map((c) => decoder(image.coding, image.low[c], image.high[c]));
      const plane = new Uint16Array(width * height * channels);
      for (let i = 0, o = 0; o < plane.length; i += 4) for (let c = 0; c < channels; ++c) plane[o++] = tables[c][bytes[i + c]];
      planes.push(plane);
    }
    const texture = sampler(gl.TEXTURE_2D_ARRAY, gl.LINEAR);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const [inner, form] = { 1: [gl.R16F, gl.RED], 3: [gl.RGB16F, gl.RGB], 4: [gl.RGBA16F, gl.RGBA] }[channels];
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, inner, width, height, layers.length);
    planes.forEach((plane, layer) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, width, height, 1,
      form, gl.HALF_FLOAT, plane));
    return texture;
  }

  async function normalTexture(whole) {  // the map and its coarser levels; the last channel is the normals' variance
    const texture = sampler(gl.TEXTURE_2D_ARRAY, gl.LINEAR), levels = [{ normal: whole }, ...whole.levels];
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    const filled = [];
    for (const { normal, variance } of levels) {
      const bytes = await pixelsOf(normal), varied = variance && await pixelsOf(variance);
      const tables = [0, 1, 2].map((c) => decoder(normal.coding, normal.low[c], normal.high[c]));
      const table = variance && decoder(variance.coding, variance.low[0], variance.high[0]);
      filled.push(Uint16Array.from(bytes, (byte, i) => (i % 4 < 3 ? tables[i % 4][byte] : varied ? table[varied[i - 3]] : 0)));
    }
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, levels.length, gl.RGBA16F, whole.width, whole.height, 1);
    filled.forEach((plane, level) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, level, 0, 0, 0, levels[level].normal.width,
      levels[level].normal.height, 1, gl.RGBA, gl.HALF_FLOAT, plane));
    return texture;
  }

  function oilTexture() {
    const { width, height, data } = bake.oil;
    const values = new Float32Array(bytesOf(data).buffer);
    const texture = sampler(gl.TEXTURE_2D_ARRAY, gl.LINEAR);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RG16F, width, height, 1);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, 0, width, height, 1, gl.RG, gl.HALF_FLOAT, Uint16Array.from(values, half));
    return texture;
  }

  async function geometryOf(tile) {
    const view = new DataView(await inflated(tile.geometry)), count = tile.vertices;
    const sizes = { position: 3, normal: 3, tangent: 4, uv: 2 };
    let at = 0;
    const vertices = gl.createVertexArray();
    gl.bindVertexArray(vertices);
    Object.entries(sizes).forEach(([name, size], location) => {
      const values = new Float32Array(count * size), { low, high } = tile.ranges[name];
      for (let c = 0; c < size; ++c) for (let i = 0; i < count; ++i, at += 2)
        values[i * size + c] = low[c] + (high[c] - low[c]) * view.getUint16(at, true) / 65535;
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, size, gl.FLOAT, false, 0, 0);
    });
    const indices = new Uint32Array(tile.indices);
    for (let i = 0, last = 0; i < indices.length; ++i, at += 4) indices[i] = last = (last + view.getInt32(at, true)) >>> 0;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return vertices;
  }

  function target(name, width, height, depth) {
    const old = targets[name];
    if (old && old.width === width && old.height === height) return old;
    if (old) { gl.deleteTexture(old.texture); gl.deleteFramebuffer(old.frame); if (old.depth) gl.deleteRenderbuffer(old.depth); }
    const made = { width, height, texture: sampler(gl.TEXTURE_2D, gl.NEAREST), frame: gl.createFramebuffer(), depth: null };
    gl.texStorage2D(gl.TEXTURE_2D, 1, name === "text" ? gl.RG8 : gl.RGBA16F, width, height);
    if (name !== "text") {
      gl.bindFramebuffer(gl.FRAMEBUFFER, made.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made.texture, 0);
    }
    if (depth) {
      made.depth = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, made.depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, made.depth);
    }
    return (targets[name] = made);
  }

  async function load() {
    gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL 2; try a current Firefox, Chrome, Edge or Safari");
    if (!gl.getExtension("EXT_color_buffer_float") && !gl.getExtension("EXT_color_buffer_half_float"))
      throw new Error("this graphics driver cannot draw to float textures");
    programs = {};
    targets = {};
    const units = gl.getParameter(gl.MAX_TEXTURE_IMAGE_UNITS), read = bake.lobes.length + (bake.table ? 11 : 7);
    if (read > units) throw new Error(`${bake.lobes.length} lobes need ${read} texture units, this driver has ${units}`);
    const total = bake.tiles.reduce((sum, tile) => sum + Object.keys(tile.textures).length, 0);
    let done = 0;
    const made = [];
    for (const tile of bake.tiles) {
      const textures = { oil_albedo: oilTexture() };
      for (const [name, layers] of Object.entries(tile.textures)) {
        note.textContent = `Loading, ${++done} of ${total} textures`;
        const same = layers[0].same_as;
        textures[name] = same ? textures[same] : await (layers[0].levels ? normalTexture(layers[0]) : arrayTexture(layers));
      }
      made.push({ ...tile, textures, array: await geometryOf(tile) });
    }
    tiles = made;
    skies = null;
    empty = gl.createVertexArray();
    ready = true;
    note.textContent = "";
    redraw();
  }

  const skyOf = (mode) => bake.skies.find((sky) => mode === `sky:${sky.name}`);
  const skyWanted = () => Boolean(skyOf(state.mode) || (state.split && skyOf(state.other)));
  const skyThere = () => tiles.every((tile) => tile.textures.sky);

  function readSkies() {
    const mine = tiles;  // others come with another context
    return (skies ??= (async () => {
      for (const tile of mine) {
        note.textContent = "Loading the skies";
        const texture = await arrayTexture(tile.sky);
        if (mine === tiles) tile.textures.sky = texture;
      }
      if (mine === tiles) note.textContent = "";
    })());
  }

  // A sky's share of each texture, turned by some degrees: a Fourier series
  function skyGains(sky) {
    const a = state.turn * Math.PI / 180;
    return sky.turn[0].map((_, k) => sky.turn.reduce((sum, row, i) => {
      const order = (i + 1) >> 1;
      return sum + row[k] * (i % 2 ? Math.cos(order * a) : i ? Math.sin(order * a) : 1);
    }, 0));
  }

  // --- drawing ---------------------------------------------------------------------------------------------------

  const sub = (a, b) => a.map((x, i) => x - b[i]);
  const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a); return a.map((x) => x / n); };

  function axesOf(camera) {
    const a = camera.azimuth * Math.PI / 180, e = camera.elevation * Math.PI / 180;
    const back = [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)];
    const right = unit(cross([0, 1, 0], back));
    return { back, right, up: cross(back, right), eye: camera.target.map((x, i) => x + camera.distance * back[i]) };
  }

  function matrices(camera, aspect) {
    const { back, right, up, eye } = axesOf(camera);
    const away = dot(sub(eye, bake.centre), back), far = Math.max(away + bake.radius, 1e-3) * 1.01;
    const near = Math.max((away - bake.radius) * 0.99, far * 1e-3), t = 1 / Math.tan(bake.yfov * Math.PI / 360);
    const P = [t / aspect, 0, 0, 0, 0, t, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
    const V = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
    return { V, P, eye };
  }

  const linear = (hex) => [1, 3, 5].map((i) => {
    const x = parseInt(hex.slice(i, i + 2), 16) / 255;
    return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
  });

  const baked = { weights: bake.lobes.map((l) => l.weight), total_weight: bake.total_weight, line: "" };
  const skinOf = (name) => bake.skins.find((skin) => skin.name === name) || baked;

  function drawSkin(mode, camera, aspect) {
    const sky = skyOf(mode);
    if (sky && !skyThere()) return;
    const { V, P, eye } = matrices(camera, aspect);
    const gains = state.gains.map((gain, i) => linear(state.tints[i]).map((c) => c * gain));
    const layers = sky ? skyGains(sky) : bake.separate || mode === "none" ? gains.flat() : [1, 1, 1];
    const lamps = bake.shader_lights;
    const lamp = lamps.color.flatMap((rgb, i) => rgb.map((x, c) => x * gains[lamps.light[i]][c]));
    const skin = skinOf(state.skin);
    const weights = sky ? [1, 1, 1] : mode.startsWith("lobe") ? bake.lobes.flatMap(() => [1, 1, 1]) : skin.weights.flat();
    for (const tile of tiles) {
      const { program, place } = skinProgram(tile, mode);
      gl.useProgram(program);
      gl.uniformMatrix4fv(place("V"), false, V);
      gl.uniformMatrix4fv(place("P"), false, P);
      gl.uniform3fv(place("cam_pos"), eye);
      gl.uniform3fv(place("lobe_weight"), weights);
      gl.uniform3fv(place("layer_gain"), layers);
      gl.uniform3fv(place("total_weight"), skin.total_weight);
      gl.uniform1iv(place("light_kind"), lamps.kind);
      gl.uniform1iv(place("light_layer"), lamps.light);
      gl.uniform3fv(place("light_at"), lamps.at.flat());
      gl.uniform3fv(place("light_axis"), lamps.axis.flat());
      gl.uniform2fv(place("light_cosines"), lamps.cosines.flat());
      gl.uniform3fv(place("light_color"), lamp);
      for (const name of ["albedo_exponent_after", "normal_strength", "f0", "strength"]) gl.uniform1f(place(name), bake[name]);
      if (bake.table) ["table_low", "table_range"].forEach((name, i) => gl.uniform2fv(place(name), bake.table[i]));
      let unit = 0;
      for (const [name, texture] of Object.entries(sky ? { ...tile.textures, lobe_0: tile.textures.sky } : tile.textures)) {
        if (!place(name)) continue;  // what this shader does not read needs no unit
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
        gl.uniform1i(place(name), unit++);
      }
      gl.bindVertexArray(tile.array);
      gl.drawElements(gl.TRIANGLES, tile.indices, gl.UNSIGNED_INT, 0);
    }
  }

  function pass(program, to, uniforms) {
    gl.bindFramebuffer(gl.FRAMEBUFFER, to ? to.frame : null);
    gl.viewport(0, 0, to ? to.width : canvas.width, to ? to.height : canvas.height);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.useProgram(program.program);
    uniforms(program.place);
    gl.bindVertexArray(empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  function bind(place, unit, name, texture) {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(place(name), unit);
  }

  function draw(side) {
    if (!ready || gl.isContextLost()) return;
    const width = canvas.width, height = canvas.height, aspect = width / height;
    const large = target(side < 2 ? "coarse" : "large", Math.ceil(width * side), Math.ceil(height * side), true);
    gl.bindFramebuffer(gl.FRAMEBUFFER, large.frame);
    gl.viewport(0, 0, large.width, large.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (state.split) {
      const at = Math.round(Math.round(state.at * width) * side);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, 0, at, large.height);
      drawSkin(state.other, state.camera, aspect);
      gl.scissor(at, 0, large.width - at, large.height);
    }
    drawSkin(state.mode, state.camera, aspect);
    gl.disable(gl.SCISSOR_TEST);
    programs.resolve ??= compiled(written(bake.shaders.screen_vert, {}), RESOLVE);
    programs.display ??= compiled(written(bake.shaders.screen_vert, {}), written(bake.shaders.display_frag, bake.tonemap));
    const small = target("small", width, height, false), text = target("text", width, height, false);
    pass(programs.resolve, small, (place) => { bind(place, 0, "frame", large.texture); gl.uniform1f(place("side"), side); });
    pass(programs.display, null, (place) => {
      bind(place, 0, "frame", small.texture);
      bind(place, 1, "text", text.texture);
      gl.uniform3fv(place("background"), bake.background);
      gl.uniform2f(place("size"), width, height);
      gl.uniform1f(place("gain"), 2 ** state.exposure);
    });
  }

  function redraw() {  // a coarse frame at once, and one with four points a pixel as soon as nothing moves
    clearTimeout(later);
    later = 0;
    changed = true;
    tell();
    if (ready && skyWanted() && !skyThere()) readSkies().then(redraw, failed);
    if (!drawing) wanted ||= requestAnimationFrame(coarse);
  }

  function coarse() {  // one at a time: a driver that is slow would else be behind what is asked for
    wanted = 0;
    changed = false;
    const begun = performance.now();
    draw(points);
    whenDrawn(() => {
      const took = performance.now() - begun;
      if (took > SLOW_MS) points = Math.max(points / 2, COARSEST);
      else if (took < QUICK_MS) points = Math.min(points * 2, 1);
      if (changed) wanted ||= requestAnimationFrame(coarse);
      else later = setTimeout(fine, PAUSE_MS);
    });
  }

  function whenDrawn(then) {
    const frame = (drawing = ready && !gl.isContextLost() ? gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0) : {});
    const look = () => {
      if (frame instanceof WebGLSync && !gl.isContextLost() && gl.clientWaitSync(frame, 0, 0) === gl.TIMEOUT_EXPIRED)
        return setTimeout(look, 2);
      if (frame instanceof WebGLSync) gl.deleteSync(frame);
      drawing = null;
      then();
    };
    if (ready) gl.flush();
    setTimeout(look);
  }

  function fine() {
    later = 0;
    draw(2);
    addressed();
  }

  const framed = window.parent !== window;
  const addressed = () => { if (!framed && state.camera) history.replaceState(null, "", `#${hash()}`); };

  function tell() {  // the page around this one, which tells its other frames
    if (!framed || !ready || hash(false) === said) return;
    said = hash(false);
    window.parent.postMessage({ skinbake: said }, "*");
  }

  function heard(e) {  // what another frame shows
    if (e.source !== window.parent || typeof e.data?.skinbake !== "string" || !ready) return;
    fromHash(e.data.skinbake);
    said = hash(false);
    shown();
    redraw();
  }

  function resized() {
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale));
    redraw();
  }

  // --- controls --------------------------------------------------------------------------------------------------

  const fitted = (view) => {  // a tall window stands further away: the view's frame was this wide
    const aspect = canvas.clientWidth / Math.max(canvas.clientHeight, 1);
    return { ...view, target: [...view.target], distance: view.distance * Math.max(1, bake.aspect / aspect) };
  };
  const turn = (dx, dy) => {
    state.camera.azimuth = (state.camera.azimuth + dx + 360) % 360;
    state.camera.elevation = Math.min(89, Math.max(-89, state.camera.elevation + dy));
    redraw();
  };
  const zoom = (factor) => { state.camera.distance = Math.min(1e6, Math.max(1, state.camera.distance * factor)); redraw(); };
  const pan = (x, y) => {
    const { right, up } = axesOf(state.camera), frame = 2 * state.camera.distance * Math.tan(bake.yfov * Math.PI / 360);
    state.camera.target = state.camera.target.map((t, i) => t + frame * (x * right[i] + y * up[i]));
    redraw();
  };

  function pointers() {
    const down = new Map();
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      down.set(e.pointerId, { x: e.clientX, y: e.clientY });
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => down.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      const last = down.get(e.pointerId);
      if (!last || !ready) return;
      const dx = e.clientX - last.x, dy = e.clientY - last.y, tall = canvas.clientHeight;
      if (down.size === 2) {
        const [other] = [...down].filter(([id]) => id !== e.pointerId).map(([, p]) => p);
        const before = Math.hypot(last.x - other.x, last.y - other.y), now = Math.hypot(e.clientX - other.x, e.clientY - other.y);
        if (now > 0 && before > 0) zoom(before / now);
        pan(-dx / tall / 2, dy / tall / 2);
      } else if (e.buttons & 6 || e.shiftKey) pan(-dx / tall, dy / tall);
      else turn(-dx * 0.4, dy * 0.4);
      down.set(e.pointerId, { x: e.clientX, y: e.clientY });
    });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(e.deltaY * 0.001)); }, { passive: false });
    const divider = $("divider");
    const moveTo = (share) => {
      state.at = Math.min(1, Math.max(0, share));
      divider.style.left = `${100 * state.at}%`;
      divider.setAttribute("aria-valuenow", Math.round(100 * state.at));
      redraw();
    };
    divider.addEventListener("pointerdown", (e) => divider.setPointerCapture(e.pointerId));
    divider.addEventListener("pointermove", (e) => {
      if (e.buttons) moveTo((e.clientX - canvas.getBoundingClientRect().left) / canvas.clientWidth);
    });
    divider.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[e.key];
      if (step) { e.preventDefault(); moveTo(state.at + step); }
    });
  }

  function keys() {
    canvas.addEventListener("keydown", (e) => {
      const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
      if (arrow && e.shiftKey) pan(arrow[0] * 0.03, arrow[1] * 0.03);
      else if (arrow) turn(arrow[0] * 4, arrow[1] * 4);
      else if (e.key === "+" || e.key === "=") zoom(1 / 1.1);
      else if (e.key === "-") zoom(1.1);
      else if (e.key === "s") $("split").click();
      else if (/^[1-9]$/.test(e.key) && bake.modes[e.key - 1]) { $("mode").selectedIndex = e.key - 1; $("mode").onchange(); told(bake.modes[$("mode").selectedIndex].label); }
      else return;
      e.preventDefault();
    });
  }

  let quiet = 0;
  function told(text) {  // for a moment; also by screen readers
    note.textContent = text;
    clearTimeout(quiet);
    quiet = setTimeout(() => { note.textContent = ""; }, 1500);
  }

  const option = (value, label) => Object.assign(document.createElement("option"), { value, textContent: label });

  function panel() {
    for (const id of ["mode", "other"]) {
      $(id).append(...bake.modes.map((m) => option(m.name, m.label)));
      $(id).onchange = () => { state[id] = $(id).value; shown(); redraw(); };
    }
    if (bake.skins.length) {
      $("skin").append(option("", "as baked"),
        ...bake.skins.map((skin) => option(skin.name, skin.again ? `${skin.name} (bake again for this one)` : skin.name)));
      $("skin").onchange = () => { state.skin = $("skin").value; shown(); redraw(); };
    }
    $("skin-row").hidden = !bake.skins.length;
    $("turn-row").hidden = !bake.skies.length;
    $("turn").oninput = () => { state.turn = Number($("turn").value); shown(); redraw(); };
    $("view").append(...Object.keys(bake.views).map((name) => option(name, name)));
    $("view").onchange = () => { state.camera = fitted(bake.views[$("view").value]); redraw(); };
    $("split").onchange = () => { state.split = $("split").checked; shown(); redraw(); };
    $("exposure").oninput = () => { state.exposure = Number($("exposure").value); shown(); redraw(); };
    if (bake.separate) bake.lights.forEach((name, i) => {
      const row = document.createElement("label"), range = document.createElement("input"), tint = document.createElement("input");
      const value = document.createElement("output");
      Object.assign(range, { type: "range", min: 0, max: 3, step: 0.05, id: `gain-${i}` });
      Object.assign(tint, { type: "color", id: `tint-${i}` });
      range.setAttribute("aria-label", `Strength of ${name}`);
      tint.setAttribute("aria-label", `Colour of ${name}`);
      range.oninput = () => { state.gains[i] = Number(range.value); shown(); redraw(); };
      tint.oninput = () => { state.tints[i] = tint.value; redraw(); };
      value.id = `gain-value-${i}`;
      row.append(name, range, value, tint);
      $("lights").append(row);
    }); else $("lights").append("This bake summed its lights: output.lights: separate keeps them apart.");
    $("fold").onclick = () => {
      const hidden = ($("controls").hidden = !$("controls").hidden);
      $("fold").textContent = hidden ? "Show" : "Hide";
      $("fold").setAttribute("aria-expanded", String(!hidden));
      resized();
    };
    $("link").onclick = async () => {
      const address = `${location.href.split("#")[0]}#${hash()}`;
      addressed();
      try { await navigator.clipboard.writeText(address); told("Copied"); }
      catch { told(framed ? "This frame may not copy" : "The link is in the address bar"); }
    };
    $("save").onclick = () => {
      draw(2);
      Object.assign(document.createElement("a"), { href: canvas.toDataURL("image/png"), download: `${bake.title}.png` }).click();
    };
    const about = document.createElement("dl");
    for (const [term, lines] of bake.about) {
      about.append(Object.assign(document.createElement("dt"), { textContent: term }));
      for (const line of lines) about.append(Object.assign(document.createElement("dd"), { textContent: line }));
    }
    $("about").append(about);
  }

  function shown() {  // the controls show the state
    $("mode").value = state.mode;
    $("other").value = state.other;
    $("skin").value = state.skin;
    $("skin-line").textContent = skinOf(state.skin).line;
    $("turn").value = state.turn;
    $("turn-value").textContent = `${state.turn}\u00b0`;
    $("sky-line").textContent = skyWanted() ? "Under a sky: the skin as baked, and what comes from inside it. "
      + "What the oil mirrors of a sky is not in this page." : "";
    $("split").checked = state.split;
    $("divider").hidden = !state.split;
    $("divider").style.left = `${100 * state.at}%`;
    $("divider").setAttribute("aria-valuenow", Math.round(100 * state.at));
    $("exposure").value = state.exposure;
    $("exposure-value").textContent = state.exposure.toFixed(1);
    if (bake.separate) state.gains.forEach((gain, i) => {
      $(`gain-${i}`).value = gain;
      $(`gain-value-${i}`).textContent = gain.toFixed(2);
      $(`tint-${i}`).value = state.tints[i];
    });
  }

  function hash(own = true) {  // what is shown, as a link has it; without what each look has its own of
    const c = state.camera;
    const parts = { view: [c.azimuth, c.elevation, c.distance, ...c.target].join(","), mode: state.mode,
      exposure: state.exposure };
    if (bake.skies.length) parts.turn = state.turn;
    if (own) Object.assign(parts, { gains: state.gains.join(","), tints: state.tints.map((t) => t.slice(1)).join(",") });
    if (own && bake.skins.length) parts.skin = state.skin;
    if (state.split) Object.assign(parts, { other: state.other, at: state.at });
    return new URLSearchParams(parts).toString();
  }

  function fromHash(text = location.hash.slice(1)) {
    const asked = new URLSearchParams(text), view = asked.get("view");
    if (view in bake.views) state.camera = fitted(bake.views[view]);
    else if (view) {
      const numbers = view.split(",").map(Number);
      if (numbers.length === 6 && numbers.every(Number.isFinite))
        state.camera = { azimuth: numbers[0], elevation: numbers[1], distance: Math.max(1, numbers[2]), target: numbers.slice(3) };
    }
    const names = bake.modes.map((m) => m.name), number = (key) => Number(asked.get(key));
    if (names.includes(asked.get("mode"))) state.mode = asked.get("mode");
    state.split = names.includes(asked.get("other"));
    if (state.split) state.other = asked.get("other");
    if (asked.has("exposure") && Number.isFinite(number("exposure"))) state.exposure = number("exposure");
    if (asked.has("turn") && number("turn") >= 0 && number("turn") <= 360) state.turn = number("turn");
    if (asked.has("at") && Number.isFinite(number("at"))) state.at = Math.min(1, Math.max(0, number("at")));
    if (asked.get("skin") === "" || bake.skins.some((skin) => skin.name === asked.get("skin"))) state.skin = asked.get("skin");
    const gains = (asked.get("gains") || "").split(",").map(Number);
    if (gains.length === state.gains.length && gains.every((g) => Number.isFinite(g) && g >= 0)) state.gains = gains;
    const tints = (asked.get("tints") || "").split(",");
    if (tints.length === state.tints.length && tints.every((t) => /^[0-9a-f]{6}$/.test(t))) state.tints = tints.map((t) => `#${t}`);
  }

  // For scripts and tests: a picture of a view, as a data URL
  window.skinbake = {
    ready: () => ready,
    still: () => ready && !wanted && !later && !drawing && !(skyWanted() && !skyThere()),  // nothing is left to be drawn
    async render({ view, mode = "full", width, height, exposure = bake.exposure, skin = "", turn = 0 }) {
      if (skyOf(mode)) await readSkies();
      const kept = { ...state, gains: [...state.gains] }, size = [canvas.width, canvas.height];
      Object.assign(state, { mode, exposure, skin, turn, split: false, camera: { ...bake.views[view] } });
      [canvas.width, canvas.height] = [width, height];
      draw(2);
      const picture = canvas.toDataURL("image/png");
      Object.assign(state, kept);
      [canvas.width, canvas.height] = size;
      redraw();
      return picture;
    },
  };

  async function start() {
    panel();
    state.camera = fitted(bake.start);
    $("view").value = bake.view;
    fromHash();
    shown();
    pointers();
    keys();
    new ResizeObserver(resized).observe(canvas);
    if (new URLSearchParams(location.hash.slice(1)).get("panel") === "0") $("fold").click();
    window.addEventListener("message", heard);
    window.addEventListener("hashchange", () => { fromHash(); shown(); redraw(); });
    canvas.addEventListener("webglcontextlost", (e) => { e.preventDefault(); ready = false; clearTimeout(quiet); note.textContent = "The graphics driver was reset ..."; });
    canvas.addEventListener("webglcontextrestored", () => load().catch(failed));
    await load();
  }

  function failed(error) { note.textContent = `This page cannot show the head: ${error.message}`; }

  start().catch(failed);
})();
