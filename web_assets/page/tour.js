// A welcome on the first visit, and a tour of a minute: a place and its costs, a Temi in the way, and why it plans ahead.
(() => {
  const SEEN = "motm-seen", touch = matchMedia("(pointer: coarse)").matches;
  const card = document.createElement("div");
  card.id = "motm-tour";
  let step = -1;
  const tab = (name) => { // Viser's tabs listen for a press without motion
    const found = [...document.querySelectorAll("[role=tab]")].find((tab) => tab.textContent.trim() === name);
    const { left, top } = found?.getBoundingClientRect() ?? {};
    const how = { bubbles: true, button: 0, isPrimary: true, pointerId: 1, clientX: left + 9, clientY: top + 9 };
    for (const kind of ["pointerdown", "pointerup"]) found?.dispatchEvent(new PointerEvent(kind, how));
  };
  const running = (wanted) => motm.data.now?.playing !== wanted && motm.say("toggle");
  const STEPS = [
    {
      text: "<b>1 of 4.</b> The robot waits. The dots on the floor are places where its base could stand for the current target: yellow costs little time, violet a lot, and grey is impossible. <b>Click a coloured one.</b>",
      begin: () => (running(false), motm.blink("places")),
      done: () => motm.data.now.picked !== null,
    },
    {
      text: "<b>2 of 4.</b> <i>Why</i>, on the right, has its costs: the time to get there, and the time from there on to the next target. Its two paths are dashed. The robot takes the place with the least sum, in a pink frame.",
      begin: () => tab("Why"),
    },
    {
      text: "<b>3 of 4.</b> Now put somebody in its way, and watch the blue plan lead round it. You can drag the Temi, too.",
      act: ["Drop a Temi", () => (motm.say("temi"), running(true))],
    },
    {
      text: "<b>4 of 4.</b> The place is chosen with the next target in mind. What if it were not? The same run is computed twice, with and without it. <i>Tune</i>, on the right, has both times, and <b>Watch both runs</b>.",
      begin: () => running(true),
      act: ["Why plan for the next target?", () => (motm.say("ahead"), tab("Tune"))],
    },
  ];
  const button = (name, act, main) => {
    const made = document.createElement("button");
    [made.type, made.textContent, made.className] = ["button", name, main ? "main" : ""];
    made.addEventListener("click", act);
    return made;
  };
  const close = () => {
    localStorage.setItem(SEEN, "1");
    step = -1;
    card.remove();
  };
  const put = (html, ...buttons) => {
    const text = document.createElement("div"), row = document.createElement("div");
    text.innerHTML = html;
    row.className = "row";
    row.append(...buttons);
    card.replaceChildren(text, row);
    document.body.append(card);
  };
  const go = (number) => {
    step = number;
    if (step >= STEPS.length) return close();
    const { text, begin, act, done } = STEPS[step];
    begin?.();
    const last = step === STEPS.length - 1;
    const next = button(last ? "Done" : done ? "Skip" : "Next", () => go(step + 1), !act && !done);
    const buttons = act ? [button(act[0], () => (act[1](), next.classList.add("main")), true)] : [];
    put(text, ...buttons, next, ...(last ? [] : [button("End the tour", close)]));
  };
  motm.offer = () => {
    if (localStorage.getItem(SEEN) || motm.answer) return;
    put(
      `<b>Look</b> ${touch ? "one finger turns, two move and zoom" : "drag to turn, right-drag to move, wheel to zoom"}<br><b>Disturb</b> grab a Temi, a cube or a table and drag it<br><b>Ask</b> click a coloured dot, then open <i>Why</i>`,
      ...(motm.data.now?.mine ? [button("Tour of one minute", () => go(0), true)] : []), button("Got it", close));
  };
  motm.changed = () => step >= 0 && STEPS[step].done?.() && go(step + 1);
})();
