// Draw the scene as on a slow machine: with rough edges and at most about twice a second. The last picture that
// is asked for is drawn too, only later. What else waits for a frame, such as lists that open, does not wait longer.
(() => {
  const GAP = 450; // [ms] at least between two pictures
  const make = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, how) {
    return make.call(this, kind, { ...how, antialias: false });
  };
  const ask = requestAnimationFrame.bind(window);
  const forget = cancelAnimationFrame.bind(window);
  const waiting = new Map(); // timers of delayed callbacks, by the number that was given for them
  let number = 1e9; // never one of the browser's own, nor the -1 that libraries forget when they wait for none
  const painters = new WeakSet(); // callbacks that have drawn
  const gl = WebGL2RenderingContext.prototype;
  const clear = gl.clear;
  let painting = false;
  let last = -GAP;
  gl.clear = function (mask) {
    painting = true;
    clear.call(this, mask);
  };
  window.requestAnimationFrame = (act) => {
    const run = (now) => {
      painting = false;
      act(now);
      if (!painting) return;
      painters.add(act);
      last = performance.now();
    };
    const rest = painters.has(act) ? last + GAP - performance.now() : 0;
    if (rest <= 0) return ask(run);
    const own = number++;
    const begin = () => {
      waiting.delete(own);
      ask(run);
    };
    waiting.set(own, setTimeout(begin, rest));
    return own;
  };
  window.cancelAnimationFrame = (which) => {
    if (!waiting.has(which)) return forget(which);
    clearTimeout(waiting.get(which));
    waiting.delete(which);
  };
})();
