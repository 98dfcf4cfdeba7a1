// Tell with which cameras the scene was drawn: `sceneCameras` has the view and the projection, column by column, that each
// program was given last, the latest last. There are several: shadows and reflections are drawn with cameras of their own.
(() => {
  const PARTS = ["viewMatrix", "projectionMatrix"]; // as three.js calls them in its shaders
  const gl = WebGL2RenderingContext.prototype;
  const { getUniformLocation: find, uniformMatrix4fv: set } = gl;
  const places = new WeakMap();
  const cameras = new Map(); // by program, in the order in which they were given
  gl.getUniformLocation = function (program, name) {
    const place = find.call(this, program, name);
    if (place && PARTS.includes(name)) places.set(place, [program, PARTS.indexOf(name)]);
    return place;
  };
  gl.uniformMatrix4fv = function (place, transpose, values, ...rest) {
    if (places.has(place)) {
      const [program, part] = places.get(place);
      const camera = cameras.get(program) || [null, null];
      camera[part] = Array.from(values);
      cameras.delete(program);
      cameras.set(program, camera);
    }
    set.call(this, place, transpose, values, ...rest);
  };
  window.sceneCameras = () => [...cameras.values()].filter((camera) => camera.every(Boolean));
})();
