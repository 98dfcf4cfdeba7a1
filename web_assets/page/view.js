// The camera of the page: where points of the world are on the screen, furniture cut away, and a view from the wrist.
//
// three.js tells developers' tools about its renderer and scenes, and this script listens. What stands between the camera
// and the robot it rides with (or between it and the hand) is drawn with holes like a sieve, and so is all furniture in the
// plan view. Viser draws on; only the shaders of furniture, which is known by its materials, get a few lines more.
(() => {
  const FURNITURE = /^(wood|dark_wood|steel|white|dark|inside|card|tape|wall|plain)(_\d+)?$/; // motm_twin/ui/scene/furniture.py
  const ROBOT = "/robot/link/base_link", HAND = "/robot/link/panda_hand";
  const CUT = { Follow: [ROBOT, 0.6, 0.9], Gripper: [HAND, 0, 0.25] }; // by camera: node, height and radius [m]
  const LOWEST = 0.15, AIM = 0.4; // [m] height of the eye at least; of what is looked at from lower down
  const SEARCH = 1000, GAP = 200; // [ms] between two looks for new furniture; between two pictures of the wrist
  const WIDTH = 256, HEIGHT = 192, PALM = 0.07; // [px] of them; [m] what is nearer is the hand itself

  let camera = null, searched = 0, drawn = 0, inside = false, eye = null;
  const cut = { value: null }, sieve = { value: 0 }, radius = { value: 1 };
  const seen = new WeakSet();
  motm.frames = []; // called with the scene before a picture of it is drawn
  motm.wrist = document.createElement("canvas");
  Object.assign(motm.wrist, { className: "wrist", width: WIDTH, height: HEIGHT, hidden: true, title: "View of the wrist camera" });

  const vector = ([x, y, z]) => new camera.position.constructor(-y, z, -x); // three.js has y upwards
  motm.pixel = (place) => { // of a point of the world on the page; null behind the camera
    if (!camera) return null;
    const spot = vector(place).project(camera), box = motm.renderer.domElement.getBoundingClientRect();
    return spot.z > 1 ? null : [box.left + (box.width * (1 + spot.x)) / 2, box.top + (box.height * (1 - spot.y)) / 2];
  };
  motm.look = (button) => button.classList.toggle("on", !(motm.wrist.hidden = !motm.wrist.hidden));

  const raise = () => { // an eye below the floor comes up, as far from what it looks at, and on the same side of it
    if (camera.position.y >= LOWEST) return;
    const e = camera.matrixWorld.elements, aim = camera.position.clone();
    const far = e[9] < -0.05 ? (aim.y - AIM) / e[9] : 3, off = Math.sqrt(Math.max(far ** 2 - (AIM - LOWEST) ** 2, 0.5));
    aim.set(aim.x - far * e[8], AIM, aim.z - far * e[10]);
    camera.position.set(aim.x - off * e[2], LOWEST, aim.z + off * e[0]);
    camera.lookAt(aim);
    camera.updateMatrixWorld();
  };

  const pierced = (material) => {
    material.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, { motmCut: cut, motmSieve: sieve, motmRadius: radius });
      shader.fragmentShader = "uniform vec3 motmCut;\nuniform float motmSieve, motmRadius;\n" + shader.fragmentShader.replace(
        "#include <clipping_planes_fragment>",
        `#include <clipping_planes_fragment>
        float motmAlong = dot(-vViewPosition, motmCut) / max(dot(motmCut, motmCut), 1e-6);
        float motmOff = length(-vViewPosition - motmAlong * motmCut) / (motmRadius * max(motmAlong, 0.3));
        float motmGone = step(0.0, motmAlong) * (1.0 - smoothstep(0.8, 0.95, motmAlong)) * (1.0 - smoothstep(0.6, 1.0, motmOff));
        if (max(0.85 * motmGone * step(1e-6, dot(motmCut, motmCut)), motmSieve) >
          fract(52.9829189 * fract(dot(floor(gl_FragCoord.xy), vec2(0.06711056, 0.00583715))))) discard;`);
    };
    material.customProgramCacheKey = () => "motm";
    material.needsUpdate = true;
  };
  const prepare = (scene) => {
    const now = performance.now();
    if (now - searched > SEARCH) {
      searched = now;
      scene.traverse(({ name, material }) => {
        if (!material?.isMeshStandardMaterial || seen.has(material) || !FURNITURE.test(name)) return;
        seen.add(material);
        pierced(material);
      });
    }
    const [node, height, wide] = CUT[motm.data?.now?.camera] ?? [], place = motm.place(node);
    cut.value = place ? vector([place[0], place[1], place[2] + height]).applyMatrix4(camera.matrixWorldInverse) : vector([0, 0, 0]);
    radius.value = wide ?? 1;
    sieve.value = motm.data?.now?.camera === "Top" ? 0.6 : 0;
  };
  const fromWrist = (renderer, scene) => { // into a corner that the picture of the page then overwrites
    const place = motm.place(HAND), turn = motm.turn(HAND), now = performance.now();
    if (motm.wrist.hidden || now - drawn < GAP || !place || !turn || !motm.data?.names?.wrist) return;
    drawn = now;
    eye ??= new camera.constructor(1, WIDTH / HEIGHT, PALM, 50);
    const [w, x, y, z] = turn, far = motm.data.names.wrist;
    eye.fov = (360 / Math.PI) * Math.atan((Math.tan((far * Math.PI) / 360) * HEIGHT) / WIDTH);
    const ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], up = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)];
    eye.position.copy(vector(place));
    eye.up.copy(vector(up));
    eye.lookAt(vector(ahead).add(eye.position));
    eye.updateProjectionMatrix();
    const whole = { copy(other) { return Object.assign(this, { x: other.x, y: other.y, z: other.z, w: other.w }); } };
    const before = [cut.value, sieve.value];
    [cut.value, sieve.value, inside] = [vector([0, 0, 0]), 0, true];
    renderer.getViewport(whole);
    const ratio = renderer.getPixelRatio();
    renderer.setViewport(0, 0, WIDTH / ratio, HEIGHT / ratio);
    renderer.render(scene, eye);
    renderer.setViewport(whole.x, whole.y, whole.z, whole.w);
    [cut.value, sieve.value, inside] = [...before, false];
    const canvas = renderer.domElement;
    motm.wrist.getContext("2d").drawImage(canvas, 0, canvas.height - HEIGHT, WIDTH, HEIGHT, 0, 0, WIDTH, HEIGHT);
  };

  const tools = (window.__THREE_DEVTOOLS__ ??= new EventTarget());
  tools.addEventListener("observe", ({ detail }) => {
    if (detail?.info?.memory) motm.renderer = detail;
    if (!detail?.isScene) return;
    const before = detail.onBeforeRender;
    detail.onBeforeRender = (...given) => {
      const [renderer, scene, seenBy, target] = given;
      if (!inside && !target && seenBy?.isPerspectiveCamera && scene.children.length > 2) {
        camera = seenBy;
        raise();
        prepare(scene);
        fromWrist(renderer, scene);
        for (const act of motm.frames) act(scene);
      }
      before.apply(detail, given);
    };
  });
})();
