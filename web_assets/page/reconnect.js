// A lost connection comes back, and a line over the scene says that it is lost.
//
// Viser's page tries to connect anew once a second, and gives up the attempt before. After some that have failed, a
// browser waits up to 5 s before it makes another (Chromium's throttle of websockets), so that all are given up before
// they are made: the page of a server that was away for half a minute never came back. The script lets an attempt end
// (Viser ends it after 5 s) before the next begins.
(() => {
  const words = "Connection to the server lost. This page reconnects by itself while it is in front.";
  const line = document.createElement("div");
  line.setAttribute("role", "status");
  line.textContent = words;
  line.style.cssText = "position:fixed;top:12px;left:12px;z-index:10000;padding:6px 12px;border-radius:6px;" +
    "background:#b91c1c;color:#fff;font:14px system-ui,sans-serif;max-width:calc(100vw - 48px)";
  const known = new WeakSet(), trying = new WeakSet();
  let connected = false;
  const heard = (worker, type) => {
    if (type !== "connected" && type !== "closed") return;
    trying.delete(worker);
    if (type === "connected") line.remove();
    else if (connected) document.body.append(line);
    connected ||= type === "connected";
  };
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (data, ...rest) {
    const type = data?.type;
    if (type === "set_server" || type === "retry") {
      if (!known.has(this)) {
        known.add(this);
        this.addEventListener("message", (event) => heard(this, event.data?.type));
      }
      if (type === "retry" && trying.has(this)) return;
      trying.add(this);
    }
    return post.call(this, data, ...rest);
  };
})();
