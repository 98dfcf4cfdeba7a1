// What lies over the scene: a timeline, the legend, names of things under the mouse, and a cover until there is a picture.
//
// The server keeps what is shown in widgets that nobody sees, as JSON behind a mark (motm_twin/ui/panel/panel.py). They
// are read as they pass by; wishes of the visitor go back through a text widget.
(() => {
  const MARK = /^<!--motm:(\w+)-->/, ASK = "motm-ask";
  const LENGTH = 120; // [s] of the timeline
  const NEAR = 7, REACH = 22; // [px] from a mark, and from the middle of a thing
  const REST = 700; // [ms]
  const COVER = 20000, STILL = 800, LATE = 300; // [ms] a page is then shown as it is; without a new part or a delay the scene is whole
  const KINDS = {
    picked: ["up", "green"], placed: ["dot", "green"], arrived: ["dot", "green"], done: ["flag", "green"],
    missed: ["cross", "amber"], lost: ["cross", "amber"], postponed: ["cross", "amber"], failed: ["cross", "red"],
    contact: ["cross", "red"], error: ["cross", "red"], cut_in: ["square", "amber"], stop: ["square", "amber"],
    fault: ["square", "red"], edit: ["diamond", "past"], branch: ["fork", "past"],
  };
  const data = (motm.data = {}); // by mark
  let ask = null, asked = 0;
  const say = (...words) => {
    if (motm.answer) motm.answer(...words);
    else if (ask) motm.send({ type: "GuiUpdateMessage", uuid: ask, updates: { value: JSON.stringify([++asked, ...words]) } });
  };

  motm.say = say;

  // layers

  const known = new Map(); // nodes: {owner, visible} as the server has them
  const hidden = new Set();
  let blinking = null;
  const layerOf = (name) => data.legend?.find(({ nodes }) => nodes.some((node) => name === node || name.startsWith(`${node}/`)));
  const members = (layer) => [...known].filter(([name]) => layerOf(name) === layer);
  const visibility = (name, owner, visible) => ({ type: "SetSceneNodeVisibilityMessage", name, owner, visible });
  const apply = (layer, on) => motm.show(members(layer).map(([name, node]) => visibility(name, node.owner, on && node.visible)));
  const toggle = (layer) => {
    hidden.has(layer.key) ? hidden.delete(layer.key) : hidden.add(layer.key);
    blink(null);
    apply(layer, !hidden.has(layer.key));
    say("hide", [...hidden]);
    legend();
  };
  const blink = (layer) => {
    if (blinking) {
      clearInterval(blinking.timer);
      apply(blinking.layer, !hidden.has(blinking.layer.key));
    }
    if (!layer || hidden.has(layer.key)) return void (blinking = null);
    let on = true, left = 6;
    const timer = setInterval(() => {
      apply(layer, (on = !on));
      if (--left === 0) blink(null);
    }, 280);
    blinking = { layer, timer };
  };
  // A display that is slow would never finish a picture of the ground before the next one comes.
  let ground = 0, later = null;
  const rest = (messages) => {
    const at = messages.findIndex(({ type, name, updates }) => type === "SceneNodeUpdateMessage" && name === "/map" && updates._data);
    if (at < 0 || !motm.slow()) return;
    const now = performance.now();
    if (later === null && now - ground > REST) return void (ground = now);
    const [message] = messages.splice(at, 1);
    if (later === null) setTimeout(() => {
      motm.show([later]);
      [later, ground] = [null, performance.now()];
    }, REST);
    later = message;
  };
  motm.blink = (key) => blink(data.legend.find((layer) => layer.key === key));
  const switched = (messages) => {
    const more = [];
    for (const message of messages) {
      if (typeof message.name !== "string") continue;
      if (message.type === "SetSceneNodeVisibilityMessage") {
        const node = known.get(message.name);
        if (node) node.visible = message.visible;
        if (hidden.has(layerOf(message.name)?.key)) message.visible = false;
      } else if (message.props) {
        known.set(message.name, { owner: message.owner, visible: true });
        if (hidden.has(layerOf(message.name)?.key)) more.push(visibility(message.name, message.owner, false));
      } else if (message.type === "RemoveSceneNodeMessage") known.delete(message.name);
    }
    messages.push(...more);
  };

  // elements

  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes))
      name.startsWith("on") ? element.addEventListener(name.slice(2), value) : element.setAttribute(name, value);
    element.append(...children);
    return element;
  };
  const SIGNS = {
    play: "M5 3l9 6-9 6z", pause: "M4 3h3.5v12H4zM10.5 3H14v12h-3.500z", back: "M13 3l-7 6 7 6zM4 3h1.800v12H4z",
    on: "M5 3l7 6-7 6zM12.2 3H14v12h-1.800z", live: "M3 3l5.5 6L3 15zM9 3l5.5 6L9 15z",
    branch: "M5 2v14M5 11c6 0 7-3 7-7", undo: "M6 4L3 7l3 3M3 7h7a4 4 0 010 8H7", save: "M9 2v9M5 8l4 4 4-4M3 15h12",
    page: "M4 2h7l3 3v11H4zM7 8h5M7 11h5", picture: "M2 5h3l1.5-2h5L13 5h3v10H2zM9 12.500a2.7 2.7 0 100-5.4 2.7 2.7 0 000 5.4",
    film: "M2 5h9v8H2zM11 8l5-3v8l-5-3", wrist: "M2 4h14v10H2zM9 8h5v4H9z", moon: "M14.500 11A6.500 6.500 0 017 3.500a6 6 0 107.500 7.500z", restart: "M14 9a5 5 0 11-1.5-3.500M14 2v4h-4",
  };
  const sign = (name) => {
    const filled = ["play", "pause", "back", "on", "live"].includes(name);
    const made = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    made.setAttribute("viewBox", "0 0 18 18");
    made.innerHTML = `<path d="${SIGNS[name]}" ${filled ? 'fill="currentColor"' : 'fill="none" stroke="currentColor" stroke-width="1.6"'}/>`;
    return made;
  };
  const button = (name, title, act, label = title) => {
    const made = make("button", { type: "button", title, "aria-label": label, onclick: () => act() }, sign(name));
    made.press = (name, label, title) => {
      if (made.dataset.sign !== name) made.replaceChildren(sign(name));
      made.dataset.sign = name;
      made.setAttribute("aria-label", label);
      made.title = title;
    };
    return made;
  };

  const chips = make("div", { class: "chips", role: "group", "aria-label": "Legend" });
  const track = make("canvas", { class: "track", role: "slider", tabindex: "0", "aria-label": "Time", title: "" });
  const clock = make("span", { class: "clock" });
  const tip = make("div", { class: "tip", role: "tooltip" });
  const controls = {
    back: button("back", "One period back (J)", () => say("step", -1), "Back by one period"),
    play: button("play", "Play (space)", () => say("toggle"), "Play"),
    on: button("on", "One period on (K)", () => say("step", 1), "On by one period"),
    reset: button("restart", "Back to the start of the run (R)", () => say("reset"), "Reset"),
    live: button("live", "Back to live (L)", () => say("live"), "Live"),
    branch: button("branch", "Branch from here: the twin goes on from the shown moment", () => say("branch"), "Branch"),
    undo: button("undo", "Undo the branch", () => say("undo"), "Undo the branch"),
    save: button("save", "Save the session: reruns bit for bit (V)", () => say("save"), "Save the session as a file"),
    page: button("page", "Save the last 30 s as a page that plays without a server", () => say("page", 30), "Export a page"),
    picture: button("picture", "Picture of the scene (PNG)", () => say("picture"), "Save a picture"),
    wrist: button("wrist", "View of the wrist camera (I)", () => motm.look(controls.wrist), "Wrist camera"),
    theme: button("moon", "Light or dark", () => (localStorage.setItem("motm-theme", theme.dark ? "light" : "dark"), paint())),
    film: button("film", "Film what the scene shows (WebM): press again to end", () => film(), "Film"),
  };
  const speed = make("select", { title: "Wanted speed (Z, X)", "aria-label": "Speed of the twin", onchange: () => say("speed", speed.value) },
    ...["1/8", "1/4", "1/2", "1x", "2x", "4x", "8x"].map((name) => make("option", { value: name }, name)));
  const bar = make("div", { class: "bar" }, track, make("div", { class: "row" }, controls.reset, controls.back, controls.play, controls.on, speed,
    clock, controls.live, controls.branch, controls.undo, make("span", { class: "gap" }), controls.save, controls.page,
    controls.picture, controls.wrist, controls.film, controls.theme));
  const cover = make("div", { class: "cover", role: "status" }, make("b", {}, "motm-twin"), make("span", {}, "connecting"));
  // a drive that was proposed by a click, and one that can be undone

  const choice = (words, ...acts) => make("div", { class: "ask", role: "status" }, make("span", {}, words),
    ...acts.map(([name, does]) => make("button", { type: "button", onclick: does }, name)));
  const going = choice("Drive here?", ["Drive", () => say("go")], ["Cancel", () => say("stay")]);
  const sent = choice("", ["Undo", () => say("stay")]);
  const propose = () => {
    const [x, y] = data.now?.going ?? [];
    const spot = x === undefined || !data.now.mine ? null : motm.pixel?.([x, y, 0.75]);
    const asked = data.now?.free === false ? "This place is not free. Drive anyway?" : "Drive here?";
    if (going.firstChild.textContent !== asked) going.firstChild.textContent = asked;
    going.hidden = !spot;
    if (spot) [going.style.left, going.style.top] = [`${spot[0]}px`, `${spot[1]}px`];
    sent.hidden = !data.now?.sent_to || !data.now.mine;
    const words = data.now?.sent_to ?? "";
    if (sent.firstChild.textContent !== words) sent.firstChild.textContent = words;
  };
  motm.frames.push(propose);
  const root = make("div", { id: "motm" }, motm.wrist, sent, chips, bar, tip);

  const legend = () => {
    chips.replaceChildren(...(data.legend ?? []).map((layer) => {
      const swatch = make("i", { class: layer.shape });
      swatch.style.setProperty("--look", layer.swatch);
      const point = ({ currentTarget }) => {
        const { left, top } = currentTarget.getBoundingClientRect();
        tell(layer.hint, left, top - 4);
        blink(layer);
      };
      return make("button", { type: "button", "aria-description": layer.hint, "aria-label": layer.title, "aria-pressed": String(!hidden.has(layer.key)),
        onclick: () => toggle(layer), onmouseenter: point, onmouseleave: () => (tell(""), blink(null)) }, swatch,
        make("span", {}, layer.title));
    }));
  };

  // timeline

  const bounds = () => {
    const span = data.now?.span;
    if (motm.answer && span) return span;
    const start = Math.max(0, (span?.[1] ?? 0) - LENGTH);
    return [start, start + LENGTH];
  };
  const length = () => Math.max(0.05, bounds()[1] - bounds()[0]);
  const at = (time) => ((time - bounds()[0]) / length()) * track.clientWidth;
  const ink = (name) => getComputedStyle(root).getPropertyValue(`--motm-${name}`);
  const timeAt = (x) => bounds()[0] + (x / Math.max(1, track.clientWidth)) * length();
  let drawn = ""; // what the track shows: a picture that stays the same costs nothing
  const draw = () => {
    const place = data.now?.span ? [data.now.t, ...data.now.span].map((time) => Math.round(at(time ?? 0))) : [];
    const shows = [track.clientWidth, data.events?.length, data.events?.at(-1)?.[0], data.now?.live, theme.dark, ...place].join();
    if (shows === drawn) return;
    drawn = shows;
    const ratio = devicePixelRatio, width = track.clientWidth, height = track.clientHeight, now = data.now;
    if (!width || !now) return;
    if (track.width !== width * ratio) [track.width, track.height] = [width * ratio, height * ratio];
    const pen = track.getContext("2d", { willReadFrequently: true }), middle = height / 2;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const bar = (from, to, colour) => {
      pen.fillStyle = colour;
      pen.fillRect(from, middle - 3, Math.max(0, to - from), 6);
    };
    bar(0, width, ink("rest"));
    if (now.span) {
      bar(at(now.span[0]), at(now.span[1]), ink("kept"));
      bar(at(now.span[0]), at(now.t ?? now.span[1]), ink("brand"));
    }
    pen.fillStyle = ink("mute");
    pen.font = "10px system-ui, sans-serif";
    const step = length() > 60 ? 20 : length() > 15 ? 5 : 1;
    for (let mark = Math.ceil(bounds()[0] / step) * step; mark < bounds()[1]; mark += step) {
      pen.fillRect(at(mark), middle + 4, 1, 4);
      pen.fillText(`${mark}`, at(mark) + 3, height - 1);
    }
    for (const [time, kind] of data.events ?? []) if (time >= bounds()[0]) {
      const [shape, colour] = KINDS[kind] ?? [];
      if (shape) spot(pen, at(time), middle, shape, ink(colour));
    }
    if (now.t === null) return;
    pen.beginPath();
    pen.arc(Math.min(width - 5, Math.max(5, at(now.t))), middle, 5.5, 0, 7);
    pen.fillStyle = ink(now.live ? "green" : "past");
    pen.fill();
    pen.lineWidth = 2;
    pen.strokeStyle = ink("paper");
    pen.stroke();
  };
  const spot = (pen, x, y, shape, colour) => {
    const lines = { up: [[-4, 4], [4, 4], [0, -4]], square: [[-3, -3], [3, -3], [3, 3], [-3, 3]], flag: [[-3, 5], [-3, -5], [5, -2], [-3, 1]],
      diamond: [[0, -4], [4, 0], [0, 4], [-4, 0]], fork: [[-4, -4], [0, 0], [4, -4], [1, 5], [-1, 5]] }[shape];
    pen.beginPath();
    if (shape === "dot") pen.arc(x, y - 8, 3.5, 0, 7);
    else if (shape === "cross") {
      for (const [a, b] of [[-4, -4], [-4, 4]]) pen.moveTo(x + a, y - 8 + b), pen.lineTo(x - a, y - 8 - b);
      pen.strokeStyle = colour;
      pen.lineWidth = 2.2;
      return pen.stroke();
    } else lines.forEach(([a, b], i) => (i ? pen.lineTo(x + a, y - 8 + b) : pen.moveTo(x + a, y - 8 + b)));
    pen.closePath();
    pen.fillStyle = colour;
    pen.fill();
  };
  const bring = () => {
    const now = data.now;
    if (!now) return;
    const past = !now.live;
    controls.play.press(
      now.playing ? "pause" : "play",
      now.playing ? "Pause" : !past && now.state === "done" ? "Restart" : "Play",
      !now.playing && !past && now.state === "done" ? "Start again (not by space)" : "Play or pause (space)");
    for (const name of ["reset", "back", "play", "on", "live", "branch", "undo"]) controls[name].disabled = !now.mine;
    track.toggleAttribute("aria-disabled", !now.mine);
    speed.disabled = !now.mine;
    if (document.activeElement !== speed) speed.value = now.speed;
    controls.live.disabled ||= !past;
    controls.branch.disabled ||= !past;
    controls.undo.hidden = now.aside === null;
    if (now.aside !== null) controls.undo.title = `Undo the branch: on from ${now.aside.toFixed(2)} s`;
    const words = now.t === null ? "" : `${now.t.toFixed(2)} s`;
    if (clock.textContent !== words) clock.textContent = words;
    clock.classList.toggle("past", past);
    for (const [name, value] of [["valuemin", now.span?.[0]], ["valuemax", now.span?.[1]], ["valuenow", now.t]])
      track.setAttribute(`aria-${name}`, value ?? 0);
    draw();
  };
  let looked = 0, last = null;
  const look = (event, end) => {
    const span = data.now?.span;
    if (!span) return;
    const seconds = Math.max(0, span[1] - timeAt(event.clientX - track.getBoundingClientRect().left));
    if (end || performance.now() - looked > 50) {
      looked = performance.now();
      say("look", seconds < 0.15 ? 0 : Math.round(seconds * 100) / 100);
    }
  };
  track.addEventListener("pointerdown", (event) => {
    track.setPointerCapture(event.pointerId);
    last = event.pointerId;
    look(event, true);
  });
  track.addEventListener("pointermove", (event) => (last === event.pointerId ? look(event, false) : hint(event)));
  for (const name of ["pointerup", "pointercancel"]) track.addEventListener(name, (event) => {
    if (last === event.pointerId) look(event, true);
    last = null;
  });
  track.addEventListener("pointerleave", () => tell(""));
  track.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) say("step", step);
    else if (event.key === "End") say("live");
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  const hint = (event) => {
    const x = event.clientX - track.getBoundingClientRect().left;
    const near = (data.events ?? []).filter(([time]) => Math.abs(at(time) - x) < NEAR).slice(-4);
    tell(near.map(([time, , text]) => `${time.toFixed(2)} s  ${text}`).join("\n"), event.clientX, event.clientY - 18);
  };
  const tell = (words, x = 0, y = 0) => {
    tip.textContent = words;
    tip.style.display = words ? "block" : "none";
    const box = root.getBoundingClientRect();
    tip.style.left = `${Math.min(x - box.left, box.width - tip.offsetWidth - 8)}px`;
    tip.style.top = `${y - box.top - tip.offsetHeight}px`;
  };

  let recorder = null;
  const film = () => {
    if (recorder) return recorder.stop();
    const parts = [], canvas = document.querySelector("canvas[data-engine]") ?? document.querySelector("canvas:not(.track)");
    recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: "video/webm", videoBitsPerSecond: 6e6 });
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => {
      controls.film.classList.remove("running");
      recorder = null;
      const link = make("a", { href: URL.createObjectURL(new Blob(parts, { type: "video/webm" })), download: `motm-${clock.textContent.replace(" ", "")}.webm` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    };
    recorder.start();
    controls.film.classList.add("running");
  };

  // light or dark, as the browser prefers it, or as it was chosen here

  const prefers = matchMedia("(prefers-color-scheme: dark)"), theme = { message: null, dark: false };
  const paint = () => {
    theme.dark = (localStorage.getItem("motm-theme") ?? (prefers.matches ? "dark" : "light")) === "dark";
    document.documentElement.classList.toggle("motm-dark", theme.dark);
    if (theme.message) motm.show([{ ...theme.message, dark_mode: theme.dark }]);
    draw();
  };
  prefers.addEventListener("change", paint);

  // names of things under the mouse

  const things = () => [
    ...(data.names?.bins ?? []).map(([name, ...place]) => [name, place]),
    ...[...known.keys()].filter((name) => /^\/bodies\/(object|body)\/[^/]+$/.test(name)).map((name) => {
      const place = motm.place(name);
      return place && [decodeURIComponent(name.split("/").pop()), name.includes("/object/") ? place : [place[0], place[1], 0.5]];
    }).filter(Boolean),
  ];
  document.addEventListener("pointermove", (event) => {
    if (!(event.target instanceof HTMLCanvasElement) || event.target === track) return;
    if (event.buttons) return tell("");
    let best = REACH, found = "";
    for (const [name, place] of things()) {
      const spot = motm.pixel(place);
      if (!spot) continue;
      const off = Math.hypot(spot[0] - event.clientX, spot[1] - event.clientY);
      if (off < best) [best, found] = [off, name];
    }
    tell(found, event.clientX + 12, event.clientY - 8);
  });

  document.addEventListener("keydown", (event) => event.key === "i" && !event.isTrusted && motm.look(controls.wrist));

  // mouse, finger or key may turn the view

  const TURNS = /^(Key[WASDQE]|Arrow\w+)$/, OFTEN = 200; // [ms]
  let pressed = false, turned = -1e9;
  const scene = ({ target }) => target instanceof HTMLCanvasElement && target !== track && target !== motm.wrist;
  const turns = () => {
    if (performance.now() - turned < OFTEN) return;
    turned = performance.now();
    say("turned");
  };
  addEventListener("pointerdown", (event) => (pressed = scene(event)), true);
  for (const name of ["pointerup", "pointercancel"]) addEventListener(name, () => (pressed = false), true);
  addEventListener("pointermove", () => pressed && turns(), true);
  addEventListener("wheel", (event) => scene(event) && turns(), { capture: true, passive: true });
  document.addEventListener("keydown", (event) => TURNS.test(event.code) && turns());

  // a link to a moment: #t=47.5&cam=Follow

  const link = new URLSearchParams(location.hash.slice(1));
  if (location.hash) history.replaceState(null, "", location.pathname + location.search); // Viser would try to connect to it
  const follow = () => {
    if (!link.size || cover.isConnected || !data.now || !(ask || motm.answer)) return;
    const time = Number(link.get("t")), last = data.now?.span?.[1];
    if (link.has("cam")) say("camera", link.get("cam"));
    link.delete("cam");
    if (!link.has("t") || !(last >= time)) return; // not yet
    say("look", Math.round((last - time) * 100) / 100);
    link.delete("t");
  };

  // the page

  const covered = setInterval(() => {
    const now = performance.now(), count = motm.renderer?.info.memory.geometries ?? 0;
    if (count !== parts || now - checked > LATE) [parts, changed] = [count, now];
    checked = now;
    const whole = data.now && data.now.t !== null && parts > 0 && now - changed > STILL && (ask || motm.answer);
    cover.lastChild.textContent = !data.now ? "connecting" : data.now.t === null ? data.now.text || data.now.state : `drawing the scene: ${parts} parts`;
    if (!whole && now - begun < COVER) return;
    clearInterval(covered);
    cover.remove();
    say("drawn");
    follow(); // nothing may come of a twin that stands still
    motm.offer?.();
  }, 100);
  const begun = performance.now();
  let parts = 0, changed = begun, checked = begun;
  const says = make("div", { class: "says" });
  motm.learn = (mark, value) => {
    const first = mark === "legend" && !data.legend;
    if (mark === "legend" && !first) return; // chips know their layers
    data[mark] = value;
    if (first) {
      for (const layer of data.legend) if (!layer.on) hidden.add(layer.key);
      for (const layer of data.legend) if (hidden.has(layer.key)) apply(layer, false);
      legend();
    }
    if (mark === "now" || mark === "events") bring();
    if (mark === "now") propose(), motm.changed?.(), follow();
    if (typeof value.says === "string" && says.textContent !== value.says) says.textContent = value.says;
  };
  const again = () => {
    say("hide", [...hidden]);
    say("drawn");
  };
  motm.taps.push((messages) => {
    for (const message of messages) {
      const content = message.type === "GuiHtmlMessage" ? message.props.content : message.type === "GuiUpdateMessage" ? message.updates.content : "";
      const mark = typeof content === "string" && MARK.exec(content);
      if (message.type === "GuiTextMessage" && message.props.label === ASK) {
        ask = message.uuid;
        told = 0;
        shape();
        if (data.legend && !cover.isConnected) again(); // a new connection
        follow();
      }
      if (mark) motm.learn(mark[1], JSON.parse(content.slice(mark[0].length)));
    }
    const styled = messages.find(({ type }) => type === "ThemeConfigurationMessage");
    if (styled) theme.message = Object.assign(styled, { dark_mode: theme.dark });
    rest(messages);
    switched(messages);
  });
  const PANEL = 334, NARROW = 700; // [px], as in cameras.py
  let told = 0;
  const shape = () => { // width / height of the picture beside the panel, which is docked when the scene is drawn
    const canvas = document.querySelector("canvas:not(.track)");
    if (!ask || !canvas?.clientHeight) return;
    const docks = cover.isConnected && innerWidth > NARROW && canvas.clientWidth > innerWidth - PANEL;
    const aspect = (docks ? innerWidth - PANEL : canvas.clientWidth) / canvas.clientHeight;
    if (Math.abs(aspect - told) > 1e-3) say("aspect", (told = aspect));
  };
  const place = () => {
    const canvas = document.querySelector("canvas:not(.track)");
    if (!canvas) return;
    shape();
    const { left, width } = canvas.getBoundingClientRect();
    root.style.left = `${left}px`;
    root.style.width = `${width}px`;
    root.classList.toggle("narrow", width < 620);
    if (!folded && innerWidth <= NARROW) {
      const sheet = document.querySelector('.mantine-Paper-root[style*="max-height: 60%"] [style*="3.5em"]');
      folded = Boolean(sheet);
      sheet?.click(); // a phone begins with the scene
    }
    draw();
  };
  let folded = false;
  addEventListener("DOMContentLoaded", () => {
    document.body.append(root, cover, says, going);
    for (const part of [root, says]) part.classList.toggle("recorded", Boolean(motm.answer));
    new ResizeObserver(place).observe(document.body);
    paint();
    setInterval(place, 500); // panels come, go and are dragged
    place();
  });
})();
