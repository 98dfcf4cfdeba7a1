// Plays a recording in a page without a server: it takes the place of the worker that would talk to one.
//
// The element "motm-recording" holds, gzipped and in base64, the length of a text (4 bytes), JSON with `messages` ([s,
// message] in order of time) and what the overlay shows, and the arrays that messages refer to, all padded to 8 bytes
// (motm_twin/ui/export.py).
(() => {
  const ARRAYS = { "<f4": Float32Array, "<f8": Float64Array, "|u1": Uint8Array, "<u2": Uint16Array, "<u4": Uint32Array,
    "|i1": Int8Array, "<i2": Int16Array, "<i4": Int32Array, "<f2": Uint16Array };
  const TICK = 25; // [ms]
  const SPEEDS = { "1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1x": 1, "2x": 2, "4x": 4, "8x": 8 };
  let worker = null, recording = null;
  let at = 0, playing = true, speed = "1x", shown = -1, last = 0;

  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (data, ...rest) {
    if (data?.type === "set_server") {
      worker = this;
      begin();
    } else if (this !== worker) return post.call(this, data, ...rest);
  };
  const emit = (data) => worker.dispatchEvent(new MessageEvent("message", { data }));

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const load = async () => {
    const packed = bytes(document.getElementById("motm-recording").textContent);
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const all = await new Response(stream).arrayBuffer(), length = new DataView(all).getUint32(0, true);
    const read = JSON.parse(new TextDecoder().decode(new Uint8Array(all, 4, length)));
    const padded = (size) => Math.ceil(size / 8) * 8;
    let start = padded(4 + length);
    const buffers = read.lengths.map((size) => {
      const part = all.slice(start, start + size);
      start += padded(size);
      return part;
    });
    const whole = (value) => {
      if (value === null || typeof value !== "object") return value;
      if ("__binary_index" in value) return new ARRAYS[value.dtype](buffers[value.__binary_index]);
      for (const key of Object.keys(value)) value[key] = whole(value[key]);
      return value;
    };
    for (const entry of read.messages) whole(entry[1]);
    whole(read.ground);
    return read;
  };
  const key = (message) => {
    const fields = message.type === "SceneNodeUpdateMessage" ? Object.keys(message.updates).join() : "";
    return message.props && message.name ? `made ${message.name}` : `${message.type} ${message.name ?? ""} ${fields}`;
  };
  // Pictures of the ground: each is kept as the cells that differ from the one before, and given to Viser as a PNG.
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
  let cells = null, reached = -1;
  const turn = ([gaps, bits]) => {
    let at = 0;
    for (let i = 0; i < gaps.length; i++) cells[(at += gaps[i])] ^= bits[i];
  };
  const ground = (number) => {
    const { width, height, palette, steps } = recording.ground;
    cells ??= new Uint8Array(width * height);
    while (reached < number) turn(steps[++reached]);
    while (reached > number) turn(steps[reached--]);
    const image = pen.createImageData(width, height), dots = new Uint32Array(image.data.buffer), shades = new Uint32Array(palette.buffer);
    cells.forEach((cell, i) => (dots[i] = shades[cell]));
    [canvas.width, canvas.height] = [width, height];
    pen.putImageData(image, 0, 0);
    return bytes(canvas.toDataURL().split(",")[1]);
  };
  const drawn = (message) => {
    const number = message.updates?._data?.ground;
    return number === undefined ? message : { ...message, updates: { _data: ground(number) } };
  };
  const copy = (message) => ({ ...message, ...(message.props && { props: { ...message.props } }) });

  // Messages after one index up to another, of each kind and node the last; nodes that are made anew lose their past.
  const until = (from, to) => {
    const kept = new Map();
    for (const [, message] of recording.messages.slice(from + 1, to + 1)) {
      const name = key(message);
      if (name.startsWith("made ") || message.type === "RemoveSceneNodeMessage")
        for (const [other, { name: node }] of kept) if (node === message.name) kept.delete(other);
      kept.delete(name);
      kept.set(name, message);
    }
    return [...kept.values()].map(copy).map(drawn);
  };
  const show = (time) => {
    at = Math.min(recording.last, Math.max(recording.first, time));
    let to = shown;
    const messages = recording.messages, done = (index) => messages[index][0] <= at + 1e-6;
    while (to + 1 < messages.length && done(to + 1)) to++;
    while (to > 0 && !done(to)) to--;
    if (to > shown) emit({ type: "message_batch", messages: until(shown, to) });
    if (to < shown) {
      const made = (list) => new Set(list.filter(([, { props, name }]) => props && name).map(([, { name }]) => name));
      const kept = made(messages.slice(0, to + 1));
      const gone = [...made(messages.slice(to + 1, shown + 1))].filter((name) => !kept.has(name));
      const away = gone.map((name) => ({ type: "RemoveSceneNodeMessage", name, owner: "server" }));
      emit({ type: "message_batch", messages: [...until(-1, to), ...away] });
    }
    shown = to;
    motm.learn("now", { state: "done", text: "", t: at, span: [recording.first, recording.last], live: false, playing,
      speed, mine: true, aside: null, says: recording.says.findLast(([time]) => time <= at + 1e-6)?.[1] ?? "" });
  };
  const widen = () => { // a narrow page looks from farther away
    const first = (type) => recording.messages.find(([, message]) => message.type === type && message.initial)?.[1];
    const eye = first("SetCameraPositionMessage"), aim = first("SetCameraLookAtMessage")?.look_at;
    const far = Math.max(1, (recording.aspect * innerHeight) / innerWidth);
    if (eye && aim) eye.position = eye.position.map((value, i) => aim[i] + far * (value - aim[i]));
  };
  const steps = {
    toggle: () => {
      playing = !playing;
      if (playing && at >= recording.last) at = recording.first;
    },
    step: (count) => ((playing = false), show(at + recording.step * count)),
    speed: (name) => (speed = name),
    look: (seconds) => ((playing = false), show(recording.last - seconds)),
  };
  motm.answer = (name, ...more) => {
    steps[name]?.(...more);
    if (recording) show(at);
  };
  const begin = async () => {
    recording = await load();
    widen();
    emit({ type: "connected" });
    for (const mark of ["legend", "events", "names"]) motm.learn(mark, recording[mark]);
    show(recording.first);
    last = performance.now();
    setInterval(() => {
      const now = performance.now(), passed = (now - last) / 1000;
      last = now;
      if (!playing || document.querySelector(".cover")) return;
      if (at >= recording.last) playing = false;
      show(at + passed * SPEEDS[speed]);
    }, TICK);
  };
})();
