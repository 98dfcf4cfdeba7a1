// Keys work wherever the focus is, except in text fields, and a tap is a click.
//
// Viser listens for keys at the top of the document, but its tabs and handles keep Space and Enter to themselves, its
// checkboxes and closed lists count as fields, and Space also presses the button that was clicked last. The script takes
// plain keys before any widget does and hands them to the document; Enter, Tab and the arrows stay with the widgets, and
// Escape with what lies over the page. A window of ours with a Close button is closed by Escape, and by a click beside
// it; under it only H does what it always does.
//
// Browsers capture a finger to the canvas from its first touch on, which Viser takes for a gesture in progress, so that
// no tap would be a click. The script releases the capture.
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
