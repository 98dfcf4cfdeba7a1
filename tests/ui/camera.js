// Tell with which camera the scene was drawn last: `sceneCamera` is its view and its projection, column by column.
(() => {
  const PARTS = ["viewMatrix", "projectionMatrix"]; // as three.js calls them in its shaders
  const gl = WebGL2RenderingContext.prototype;
  const { getUniformLocation: find, uniformMatrix4fv: set } = gl;
  const parts = new WeakMap();
  window.sceneCamera = [null, null];
  gl.getUniformLocation = function (program, name) {
    const place = find.call(this, program, name);
    if (place && PARTS.includes(name)) parts.set(place, PARTS.indexOf(name));
    return place;
  };
  gl.uniformMatrix4fv = function (place, transpose, values, ...rest) {
    if (parts.has(place)) window.sceneCamera[parts.get(place)] = Array.from(values);
    set.call(this, place, transpose, values, ...rest);
  };
})();
