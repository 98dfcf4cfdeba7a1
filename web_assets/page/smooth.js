// Pictures of one moment, and smooth motion between them.
//
// The server sends each picture as one batch of messages, with its time as the position of the node CLOCK. A picture is
// shown when the next one has arrived; until then robot and bodies glide from its poses to those of the next, at the
// rate of the display. Plan, grid and all else stay those of the picture that is shown. The camera glides with them.
//
// `motm` is what the other scripts of the page use: `taps` see messages from the server before they are shown, and may
// change them; `show` adds messages of the page's own; `send` speaks to the server.
(() => {
  const CLOCK = "/clock";
  const GLIDES = /^\/(robot\/(link|shadow)|bodies\/(object|body))\//;
  const FIELDS = { SetPositionMessage: "position", SetOrientationMessage: "wxyz" };
  const CAMERA = { SetCameraPositionMessage: "position", SetCameraLookAtMessage: "look_at", SetCameraFovMessage: "fov" };
  const FAR = 0.6; // [m] a body that goes so far between two pictures was put there
  const LEAP = 0.5; // [s] between two pictures that do not follow each other
  const SHORTEST = 15, LONGEST = 150, USUAL = 50; // [ms] from picture to picture
  const PAUSE = 250; // [ms] after which the camera may have been moved by hand
  const SLOW = 45, AGAIN = 3000; // [ms] from frame to frame of a display that gains nothing; until it is tried again

  let worker = null, listener = null;
  let held = null; // the picture that comes next
  let waiting = []; // batches after it
  let moves = []; // {message, field, from, to}
  let began = 0, usual = USUAL, scatter = 0, span = USUAL, arrived = 0; // [ms]
  let time = NaN, run = NaN;
  let asked = false, pace = 16, frame = 0, tried = 0; // [ms]
  const shown = new Map(); // pose by type and node, as it is on the screen
  const camera = { at: -1e9, end: 0, begin: 0, still: true, from: {}, to: {} };

  const motm = (window.motm = {
    taps: [],
    slow: () => pace > SLOW - 1,
    place: (name) => shown.get(`SetPositionMessage ${name}`)?.position,
    turn: (name) => shown.get(`SetOrientationMessage ${name}`)?.wxyz,
    show: (messages) => (held ? waiting.push(messages) : deliver(messages)),
    send: (message) => worker?.postMessage({ type: "send", message }),
  });

  const deliver = (messages) => {
    if (!messages.length || !listener) return;
    for (const message of messages) {
      if (message.type in FIELDS && GLIDES.test(message.name)) shown.set(`${message.type} ${message.name}`, message);
    }
    listener.call(worker, { data: { type: "message_batch", messages } });
  };

  const between = (from, to, share, turns) => {
    const sign = turns && from.reduce((sum, value, i) => sum + value * to[i], 0) < 0 ? -1 : 1;
    const mixed = from.map((value, i) => value + share * (sign * to[i] - value));
    const length = turns ? Math.hypot(...mixed) || 1 : 1;
    return turns ? mixed.map((value) => value / length) : mixed;
  };

  const settle = (but = () => false) => {
    if (!held) return;
    const batches = [held.filter((message) => !but(message)), ...waiting];
    held = null;
    waiting = [];
    moves = [];
    batches.forEach(deliver);
  };

  const planned = (messages) => {
    const found = [];
    for (const message of messages) {
      const field = FIELDS[message.type];
      if (!field || !GLIDES.test(message.name)) continue;
      const from = shown.get(`${message.type} ${message.name}`)?.[field];
      const to = Array.from(message[field]);
      if (from && (field === "wxyz" || Math.hypot(...to.map((value, i) => value - from[i])) < FAR))
        found.push({ message, field, from: Array.from(from), to });
    }
    return found;
  };

  const take = (messages) => {
    const clock = messages.find((message) => message.type === "SetPositionMessage" && message.name === CLOCK);
    if (!clock) return held ? waiting.push(messages) : deliver(messages);
    const now = performance.now(), step = clock.position[0] - time;
    const follows = clock.position[1] === run && step > 0 && step < LEAP && !document.hidden;
    [time, run] = clock.position;
    const slow = pace > SLOW && now - tried < AGAIN;
    if (pace > SLOW && !slow) [pace, tried, frame] = [SLOW, now, 0];
    if (!follows || slow) {
      settle();
      deliver(messages);
    } else {
      const next = planned(messages);
      const gliding = new Set(next.map((move) => `${move.message.type} ${move.message.name}`));
      const on = new Set(moves.map((move) => move.message));
      settle((message) => on.has(message) && gliding.has(`${message.type} ${message.name}`));
      const gap = Math.min(LONGEST, Math.max(SHORTEST, now - arrived));
      scatter = 0.8 * scatter + 0.2 * Math.abs(gap - usual);
      usual = 0.7 * usual + 0.3 * gap;
      span = usual + scatter; // so that the next picture is there before the motion ends
      [held, moves, began] = [messages, next, now];
      ask();
    }
    arrived = now;
  };

  const film = (messages) => {
    const now = performance.now();
    const fresh = now - camera.at > PAUSE;
    const shares = cameraNow(now);
    camera.at = now;
    [camera.from, camera.to] = [fresh ? {} : shares, { ...camera.to }];
    for (const message of messages) camera.to[message.type] = message;
    [camera.begin, camera.end] = [now, fresh ? now : Math.max(now + SHORTEST, held ? began + span : now + span)];
    look(now);
    ask();
  };

  const cameraNow = (now) => {
    const share = camera.end > camera.begin ? Math.min(1, (now - camera.begin) / (camera.end - camera.begin)) : 1;
    const found = {};
    for (const [type, message] of Object.entries(camera.to)) {
      const field = CAMERA[type], from = camera.from[type]?.[field];
      const to = message[field], mixed = from === undefined ? to : between([from].flat(), [to].flat(), share);
      found[type] = { ...message, [field]: field === "fov" ? [mixed].flat()[0] : mixed };
    }
    return found;
  };

  const look = (now) => {
    camera.still = now >= camera.end;
    deliver(Object.values(cameraNow(now)));
  };

  const ask = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(glide);
  };

  const glide = () => {
    asked = false;
    const now = performance.now();
    if (frame) pace = 0.8 * pace + 0.2 * (now - frame);
    frame = held || !camera.still ? now : 0;
    if (held) {
      const share = Math.min(1, (now - began) / span);
      if (share >= 1) settle();
      else deliver(moves.map(({ message, field, from, to }) => ({ ...message, [field]: between(from, to, share, field === "wxyz") })));
    }
    if (!camera.still) look(now);
    if (held || !camera.still) ask();
  };

  const forget = () => {
    [held, waiting, moves, time] = [null, [], [], NaN];
    shown.clear();
    Object.assign(camera, { at: -1e9, still: true, from: {}, to: {} });
  };

  const arrive = (messages) => {
    for (const tap of motm.taps) tap(messages);
    const eye = messages.filter((message) => message.type in CAMERA && !message.initial);
    if (eye.length) film(eye);
    take(eye.length ? messages.filter((message) => !eye.includes(message)) : messages);
  };

  const own = Object.getOwnPropertyDescriptor(Worker.prototype, "onmessage");
  Object.defineProperty(Worker.prototype, "onmessage", {
    ...own,
    set(act) {
      own.set.call(this, (event) => {
        const { type, messages } = event.data ?? {};
        if (type === "connected") {
          [worker, listener] = [this, act];
          forget();
        }
        if (type !== "message_batch") return act.call(this, event);
        arrive(messages);
      });
    },
  });
})();
