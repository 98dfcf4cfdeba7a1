// Draw the scene as on a slow machine: with rough edges and at most about three times a second. The last picture that
// is asked for is drawn too, only later. What else waits for a frame, such as lists that open, does not wait longer.
(() => {
  const GAP = 300; // [ms] at least between two pictures
  const make = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, how) {
    return make.call(this, kind, { ...how, antialias: false });
  };
  const ask = requestAnimationFrame.bind(window);
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
    return rest > 0 ? setTimeout(() => ask(run), rest) : ask(run);
  };
})();
