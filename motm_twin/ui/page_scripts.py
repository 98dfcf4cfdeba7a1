"""Scripts in the page: keys that work everywhere, and a connection that comes back; and the page with them in it."""

import functools
import gzip

from websockets.datastructures import Headers
from websockets.http11 import Response

# Keys work wherever the focus is, except where somebody types, and a tap is a click.
#
# Viser listens for keys at the top of the document, but its tabs and handles keep Space and Enter to themselves, its
# checkboxes and closed lists count as fields, and Space also presses the button that was clicked last. The script takes
# plain keys before any widget does and hands them to the document; Enter, Tab and the arrows stay with the widgets, and
# Escape with what lies over the page. A window of ours with a Close button is closed by Escape, and by a click beside
# it; under it only H does what it always does.
#
# A finger belongs to the canvas from its first touch on (browsers capture it), which Viser takes for a gesture that is
# under way: no tap would be a click. So the script lets go of it.
KEYS = """<script>
(() => {
  const noText = /^(checkbox|radio|range|button|submit|reset|file|color)$/;
  const closedList = (e) => e.getAttribute("aria-haspopup") === "listbox" && e.getAttribute("aria-expanded") !== "true";
  const typing = (e) => e.isContentEditable || e.tagName === "TEXTAREA" || e.tagName === "SELECT" ||
    (e.tagName === "INPUT" && !noText.test(e.type) && !closedList(e));
  const covers = "[role=dialog], [role=listbox]";
  const covered = () => [...document.querySelectorAll(covers)].some((e) => e.checkVisibility());
  const closing = () => [...document.querySelectorAll("[role=dialog] button")].find(
    (e) => e.textContent.trim() === "Close" && e.checkVisibility());
  const take = (event) => {
    const at = event.target;
    const close = closing();
    if (event.isTrusted && close && event.key !== "Tab" && event.key.toLowerCase() !== "h") {
      if (event.type === "keyup") return;
      event.stopImmediatePropagation();
      if (event.key === "Escape") close.click();
      return;
    }
    if (!event.isTrusted || !(at instanceof Element) || typing(at) || event.ctrlKey || event.altKey || event.metaKey)
      return;
    if (event.type === "keydown" && event.key === "Enter" && at.type === "checkbox") at.click();
    if (event.key.length !== 1 && event.key !== "Delete" && (event.key !== "Escape" || covered())) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.repeat && event.key === " ") return;
    const { key, code, shiftKey, repeat } = event;
    const again = { key, code, shiftKey, repeat, bubbles: true, cancelable: true };
    document.body.dispatchEvent(new KeyboardEvent(event.type, again));
  };
  addEventListener("keydown", take, true);
  addEventListener("keyup", take, true);
  addEventListener("pointerdown", (event) => {
    const at = event.target, close = closing();
    if (close && !at.closest("[role=dialog]")) close.click();
    if (event.pointerType === "mouse" || !(at instanceof HTMLCanvasElement)) return;
    if (at.hasPointerCapture(event.pointerId)) at.releasePointerCapture(event.pointerId);
  }, true);
})();
</script>"""


# Viser's page tries to connect anew once a second, and gives up the attempt before. After some that have failed, a
# browser waits up to 5 s before it makes another (Chromium's throttle of websockets), so that all are given up before
# they are made: the page of a server that was away for half a minute never came back. The script lets an attempt end
# (Viser ends it after 5 s) before the next begins. While there is no connection a line over the scene says so; Viser
# only fades its panel.
RECONNECT = """<script>
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
</script>"""


SCRIPTS = (KEYS, RECONNECT)


def with_scripts(response: Response | None) -> Response | None:
    """The answer to a request for the page with the scripts in it; any other answer as it is."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    body = _inserted(bytes(response.body or b""), zipped)
    headers = Headers((name, value) for name, value in response.headers.raw_items() if name != "Content-Length")
    headers["Content-Length"] = str(len(body))
    return Response(response.status_code, response.reason_phrase, headers, body)


@functools.lru_cache(maxsize=2)
def _inserted(body: bytes, zipped: bool) -> bytes:
    """The page with the scripts at the start of its head. Raises ValueError for a page without one."""
    page = gzip.decompress(body) if zipped else body
    before, head, after = page.partition(b"<head>")
    if not head:
        raise ValueError("Viser's page has no <head> for our scripts: this Viser is not the pinned one")
    page = before + head + "".join(SCRIPTS).encode() + after
    return gzip.compress(page, mtime=0) if zipped else page
